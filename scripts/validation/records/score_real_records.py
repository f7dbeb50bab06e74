"""The 207 real hand-held scalpel cuts, scored as a study: means, spread between cuts, reliability of every metric.

    python -m scripts.validation.records.score_real_records                reads ../shared/data beside the repository
    python -m scripts.validation.records.score_real_records --out FOLDER   also writes the page, and every card as CSV

A record holds force only, normalised to the largest of the data set (unit "1"), at 30 Hz; the first 120 of its 180
samples are the cut, and are scored. Metrics that need newtons, position, angle or depth are unavailable. The file does
not state who made a trial, so the study is one of trials: its reliability is the similarity of the cuts within a trial
compared to those of other trials, and not evidence that a metric measures skill. No ratings of the cuts are used.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

from cutenv.display.report.study_page import table_lines
from cutenv.records.scoring import METRICS, score
from cutenv.records.scoring.study import StudiedCut, Study
from cutenv.sim.trace import Trace
from scripts.validation.records.real_records import CUT_SAMPLES, DATA, LICENCE, SOURCE, read_cuts


def study_of(traces: list[Trace]) -> Study:
    """Return the cuts as a study of trials, over every metric that all have and that the record does not fix."""
    cuts = [
        StudiedCut(
            card=score(trace.select(slice(0, CUT_SAMPLES)), name=f"{trace.metadata['trial']} {trace.metadata['cut']}"),
            operator=trace.metadata["trial"],
        )
        for trace in traces
    ]
    values = {metric: [cut.card.metrics[metric].value for cut in cuts] for metric in METRICS}
    # The duration is that of the 120 samples for every cut.
    known = [metric for metric, column in values.items() if None not in column and metric != "duration"]
    return Study(name="207 hand-held scalpel cuts", cuts=cuts, metrics=known, who="trial")


def trial_lines(study: Study) -> list[str]:
    """Return by trial the mean of every metric, and below each the standard deviation between its cuts."""
    names = [found.metric for found in study.findings]
    lines = [f"{'trial':6s} {'cuts':>4s} " + " ".join(f"{name:>19s}" for name in names)]
    for trial in study.operators:
        columns = [found.series[trial] for found in study.findings]
        cells = [f"{values.mean():9.3g} ±{np.std(values, ddof=1):8.2g}" for values in columns]
        lines.append(f"{trial:6s} {len(columns[0]):4d} " + " ".join(f"{cell:>19s}" for cell in cells))
    return lines


def main() -> int:
    """Read, score and print; return 2 if the file is missing or another."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, default=DATA, metavar="FILE", help="scalpel_excision_forces.csv")
    parser.add_argument("--out", type=Path, metavar="FOLDER", help="write real_study.html and real_study.csv there")
    arguments = parser.parse_args()
    try:
        study = study_of(read_cuts(arguments.data))
    except (FileNotFoundError, ValueError) as error:
        print(error, file=sys.stderr)
        return 2
    print(f"The first {CUT_SAMPLES} samples of each cut; force is normalised, its unit left out.")
    print("Mean over a trial's cuts, ± the standard deviation between them.\n")
    print("\n".join(trial_lines(study)))
    print()
    print("\n".join(table_lines(study)))
    if arguments.out is not None:
        from cutenv.display.report.study_page import write_study

        arguments.out.mkdir(parents=True, exist_ok=True)
        page = arguments.out / "real_study.html"
        cards = write_study(page, study)
        print(f"page: {page}\ncards: {cards}")
    print(f"\nSource: {SOURCE}. Licence: {LICENCE}.")
    return 0


if __name__ == "__main__":
    sys.exit(main())
