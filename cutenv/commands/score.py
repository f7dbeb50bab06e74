"""Score cuts of people or policies: card, page of advice, table."""

from __future__ import annotations

import argparse
import dataclasses
import re
import sys
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from cutenv.commands import options

if TYPE_CHECKING:  # what scores is slow to import, and --help does not need it
    from cutenv.records.scoring import ReferenceSet


PAGES_NEED = ("jinja2", "matplotlib")  # libraries without which a record is scored on the terminal alone


@options.reports_errors("score")
def main(argv: Sequence[str]) -> int:
    """Score; return 0, or 2 on bad input."""
    arguments = _parser().parse_args(argv)
    from cutenv.agents.difficulty import scripts_on_specimen_of
    from cutenv.commands.inputs import read_records, targets
    from cutenv.display.report.score_page import ScoredRecord, write_score_page, write_summary
    from cutenv.records.scoring import score
    from cutenv.records.scoring.reference import fitting_reference

    if (pages := all(map(find_spec, PAGES_NEED))) or arguments.example:
        options.made_folder("--out", arguments.out)
    target, wanted, layer = (
        options.target_length(arguments),
        options.wanted_depth_given(arguments),
        options.layer_depth_given(arguments),
    )
    line = options.line_given(arguments)
    reference = reference_set(arguments.reference)
    if arguments.example:
        if arguments.records:
            raise ValueError("--example scores a simulated cut; leave the records out.")
        arguments.records = [_example(arguments.out / "example.csv")]
    elif not arguments.records:
        raise ValueError("give records of cuts, a folder of them, or --example to score a simulated cut.")
    records = read_records(arguments)
    if line is not None:
        without = [str(trace.metadata["name"]) for trace in records.traces if trace.blade_x is None]
        if without:
            raise ValueError(
                f"--line: no places of the blade in {', '.join(without)}. Record blade_x and blade_y, from the middle "
                "of the clamp, or leave the option out."
            )
    aims, without_effect = targets(records.traces, target)
    for note in [*records.notes, *without_effect]:
        print(f"note: {note}", file=sys.stderr)
    for each in records.refused:
        print(f"left out: {each.name}: {each.reason}", file=sys.stderr)
    written = []
    for trace, aimed in zip(records.traces, aims, strict=True):
        card = score(
            trace,
            target_length=aimed,
            reference=fitting_reference(reference, trace),
            wanted=wanted,
            layer_depth=layer,
            line=line,
        )
        card = dataclasses.replace(card, scripts=scripts_on_specimen_of(trace))
        name = re.sub(r"[^\w.-]+", "_", card.name) + "_score.html"
        scored = ScoredRecord(trace=trace, card=card, target_length=aimed)
        written.append((scored, name))
        print(card if len(records.traces) == 1 else f"{card.name}: {card.headline()}")
        if pages:
            write_score_page(arguments.out / name, scored, language=arguments.language)
    if not written:
        raise ValueError("no record is left to score.")
    if not pages:
        print(f"no page: {' and '.join(PAGES_NEED)} are an extra: pip install 'cutenv[view]'", file=sys.stderr)
    elif len(written) > 1:
        table, page = write_summary(arguments.out, written, language=arguments.language)
        print(f"summary: {page} and {table}")
    else:
        print(f"page: {arguments.out / written[0][1]}")
    return 0


def _example(path: Path) -> Path:
    """Write a simulated cut past the target and back."""
    from cutenv.records import save
    from cutenv.sim.plant import Leg, SimulatedPlant, run, to_trace
    from cutenv.sim.tissue import Specimen

    plant = SimulatedPlant(Specimen.drawn(3))
    cut = run(plant, [Leg(position=0.085, speed=0.0127, dwell=0.2), Leg(position=0.075, speed=0.005)])
    save([to_trace(plant, cut, name="example", target_length_m=0.08)], path)
    print(f"record of a simulated cut: {path}")
    return path


def reference_set(given: str) -> ReferenceSet | None:
    """Return a reference set by name, file or folder.

    None for ``none``. Raise ValueError if it is none of these, or the folder holds too few cuts.
    """
    from cutenv.commands.inputs import SUFFIXES
    from cutenv.records import read_record
    from cutenv.records.scoring import ReferenceSet, score
    from cutenv.records.scoring.reference import FEWEST_REFERENCE_CUTS, SHIPPED_REFERENCES

    if given == "none":
        return None
    if given in SHIPPED_REFERENCES:
        return ReferenceSet.shipped(given)
    path = Path(given)
    if path.is_file():
        return ReferenceSet.load(path)
    if not path.is_dir():
        names = ", ".join(SHIPPED_REFERENCES)
        raise ValueError(f"--reference {given!r} is neither {names} nor none, nor a file, nor a folder of records.")
    rows, units = [], set()
    for file in sorted(each for each in path.iterdir() if each.suffix.lower() in SUFFIXES):
        for trace in read_record(file).sound:
            metrics = score(trace).metrics
            rows.append((file.stem, {name: scored.value for name, scored in metrics.items()}))
            units.add(trace.force_unit)
    if len(rows) < FEWEST_REFERENCE_CUTS or len(units) > 1:
        of_units = f" of force in {' and '.join(sorted(units))}" if len(units) > 1 else ""
        raise ValueError(
            f"--reference {given} holds {len(rows)} sound cuts{of_units}; a percentile takes "
            f"{FEWEST_REFERENCE_CUTS} or more, of one unit."
        )
    return ReferenceSet.of(rows, name=path.name, about=f"records in {path.name}", force_unit=units.pop())


def _parser() -> argparse.ArgumentParser:
    parser = options.command_parser(
        "score",
        __doc__,
        examples=(
            "cut.csv",
            "--example",
            "cuts --out scored",
            "foreign.csv --target-length 80mm",
            "cut.csv --target-length 80mm --wanted-depth 0mm:6mm,80mm:14mm --layer-depth 16mm",
            "cut.csv --target-length 80mm --line excision:80mm:15mm",
            'forces.txt --map "time=Zeit" "force=Kraft" --unit mN',
        ),
        note="Training feedback for research; not validated for assessment or credentialing of people.",
    )
    add = parser.option
    options.add_record_options(parser, files="*")
    add("--example", "write the record of a simulated cut and score it")
    options.add_target_length(parser, "the record's own, which always holds")
    options.add_depth_options(parser)
    options.add_line(parser, "of records with the places of the blade", "the record's own")
    add(
        "--reference SET",
        "cuts that percentiles compare with: baselines (default), force-alone, none, a file of ReferenceSet.save, "
        "or a folder of your people's records",
        "baselines",
    )
    add("--out FOLDER", "folder of pages and tables; default here", Path())
    options.add_language(parser)
    return parser
