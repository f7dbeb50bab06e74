"""Force statistics of 207 real hand-held scalpel cuts: the record type meets real data.

    python scripts/real_records.py                reads ../shared/data beside the repository
    python scripts/real_records.py --data FILE    reads another copy of the file

The cuts are elliptical excisions in a skin phantom with a No. 10 blade: 18 trials, 180 samples a cut at 30
Hz, of which the first 120 are the cut.  The force is a pure number, normalised to the largest of the data
set; there is no position, so neither a modulus nor a fracture resistance can be had from them.
"""

from __future__ import annotations

import argparse
import csv
import itertools
import sys
from pathlib import Path

import numpy as np

from cutenv.trace import Trace

DATA = Path(__file__).resolve().parents[2] / "shared" / "data" / "scalpel_excision_forces.csv"
CUT_SAMPLES = 120
COLUMNS = ["trial", "cut", "time_s", "force_normalised"]
LICENCE = "MIT, (c) Arturas Straizys"
SOURCE = "straizys/elliptical-excision-force-model; Communications Engineering 2023, s44172-023-00086-z"


def read_cuts(path: Path) -> list[Trace]:
    """Read every cut of the file, force only, unit "1"; metadata: trial, cut, cut_samples, source, licence.

    Raises
    ------
    FileNotFoundError
        If the file is missing; the message names the cure.
    ValueError
        If its columns are others.
    """
    if not path.is_file():
        raise FileNotFoundError(
            f"No file {path}. The recorded cuts are not part of this repository: put "
            f"scalpel_excision_forces.csv there, or name it with --data."
        )
    with path.open(newline="", encoding="utf-8") as file:
        rows = csv.reader(line for line in file if not line.startswith("#"))
        header = next(rows, [])
        if header != COLUMNS:
            raise ValueError(f"{path} has columns {', '.join(header)}; expected {', '.join(COLUMNS)}.")
        traces = []
        for (trial, cut), group in itertools.groupby(rows, key=lambda row: (row[0], int(row[1]))):
            time, force = np.array([row[2:] for row in group], dtype=np.float64).T
            metadata = {
                "trial": trial,
                "cut": cut,
                "cut_samples": CUT_SAMPLES,
                "source": SOURCE,
                "licence": LICENCE,
            }
            traces.append(Trace(time=time, force=force, force_unit="1", metadata=metadata))
    return traces


def force_statistics(cuts: list[Trace]) -> dict[str, float]:
    """Statistics of the cutting phase of one trial's cuts; force is a pure number, its rate per second.

    ``mean`` and ``peak`` are means over the cuts, ``sd`` the mean standard deviation within a cut,
    ``cv_of_means`` and ``cv_of_peaks`` standard deviations between cuts (population) over their means,
    ``rms_rate`` the root mean square of dF/dt over all cuts.
    """
    phases = [cut.select(slice(0, CUT_SAMPLES)) for cut in cuts]
    means, peaks, deviations = (
        np.array([statistic(phase.force) for phase in phases]) for statistic in (np.mean, np.max, np.std)
    )
    rates = np.concatenate([np.diff(phase.force) / np.diff(phase.time) for phase in phases])
    return {
        "cuts": len(cuts),
        "mean": float(means.mean()),
        "peak": float(peaks.mean()),
        "sd": float(deviations.mean()),
        "cv_of_means": float(means.std() / means.mean()),
        "cv_of_peaks": float(peaks.std() / peaks.mean()),
        "rms_rate": float(np.sqrt(np.mean(rates**2))),
    }


def table(traces: list[Trace]) -> str:
    """Aligned text: a row for each trial, and one for all cuts together."""
    trials: dict[str, list[Trace]] = {}
    for trace in traces:
        trials.setdefault(trace.metadata["trial"], []).append(trace)
    heads = ["trial", "cuts", "mean", "peak", "SD", "CV of means", "CV of peaks", "RMS dF/dt [1/s]"]
    lines = ["  ".join(f"{head:>{max(len(head), 6)}}" for head in heads)]
    for trial, cuts in [*trials.items(), ("all", traces)]:
        n, *numbers = force_statistics(cuts).values()
        cells = [trial, f"{n:.0f}", *(f"{number:.3f}" for number in numbers)]
        lines.append("  ".join(f"{c:>{max(len(h), 6)}}" for c, h in zip(cells, heads, strict=True)))
    return "\n".join(lines)


def main() -> int:
    """Read, print; 2 if the file is missing or another."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, default=DATA, metavar="FILE", help="scalpel_excision_forces.csv")
    try:
        traces = read_cuts(parser.parse_args().data)
    except (FileNotFoundError, ValueError) as error:
        print(error, file=sys.stderr)
        return 2
    rate = np.mean([trace.sample_rate for trace in traces])
    print(f"{len(traces)} hand-held scalpel cuts at {rate:.1f} Hz, the first {CUT_SAMPLES} samples of each.")
    print('Force is normalised to the largest of the data set (unit "1"); no position was recorded.\n')
    print(table(traces))
    print(f"\nSource: {SOURCE}. Licence: {LICENCE}.")
    return 0


if __name__ == "__main__":
    sys.exit(main())
