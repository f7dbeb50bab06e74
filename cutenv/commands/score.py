"""Score cuts, whoever made them: a card, a page that says what to try next, and a table of many."""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Sequence
from pathlib import Path

from cutenv.commands.records import add_record_options, read_records
from cutenv.recording import read_record
from cutenv.scoring import ReferenceSet, score
from cutenv.scoring.reference import FEWEST, SHIPPED
from cutenv.trace import Trace
from cutenv.validation import in_range

_LENGTH = re.compile(r"([\d.]+)\s*(mm|cm|m)")
_TO_METRES = {"mm": 1e-3, "cm": 1e-2, "m": 1.0}
_SUFFIXES = (".csv", ".parquet", ".h5", ".hdf5")


def main(argv: Sequence[str]) -> int:
    """Run the command; return 0, or 2 if the records or the options are bad."""
    arguments = _parser().parse_args(argv)
    try:
        _score(arguments)
    except (OSError, ValueError) as error:
        print(f"cutenv score: {error}", file=sys.stderr)
        return 2
    return 0


def _score(arguments: argparse.Namespace) -> None:
    from cutenv.report.score_page import ScoredRecord, write_score_page, write_summary

    if not arguments.out.is_dir():
        raise FileNotFoundError(f"--out {arguments.out}: no such folder; make it first.")
    target = None if arguments.target is None else parse_length(arguments.target)
    reference = reference_set(arguments.reference)
    records = read_records(arguments)
    for note in records.notes:
        print(f"note: {note}", file=sys.stderr)
    for each in records.refused:
        print(f"left out: {each.name}: {each.reason}", file=sys.stderr)
    written = []
    for trace in records.traces:
        aimed = target if target is not None else trace.metadata.get("target_length_m")
        card = score(trace, target_length=aimed, reference=_fitting(reference, trace))
        name = re.sub(r"[^\w.-]+", "_", card.name) + "_score.html"
        scored = ScoredRecord(trace=trace, card=card, target_length=aimed)
        write_score_page(arguments.out / name, scored)
        written.append((scored, name))
        print(card if len(records.traces) == 1 else f"{card.name}: {card.headline()}")
    if not written:
        raise ValueError("no record is left to score.")
    if len(written) > 1:
        table, page = write_summary(arguments.out, written)
        print(f"summary: {page} and {table}")
    else:
        print(f"page: {arguments.out / written[0][1]}")


def parse_length(text: str) -> float:
    """Return a length with its unit, such as ``80mm`` or ``8cm``, in metres.

    Raises
    ------
    ValueError
        If it has no unit, or is not a length.
    """
    match = _LENGTH.fullmatch(text.strip())
    if match is None:
        raise ValueError(f"--target {text!r} is no length with a unit; write 80mm or 8cm.")
    return in_range("--target", float(match[1]) * _TO_METRES[match[2]], 0.005, 0.15, "m", "Write 80mm or 8cm.")


def reference_set(given: str) -> ReferenceSet | None:
    """Return the reference set of a name, a file, or a folder of a lab's own records; None for ``none``.

    Raises
    ------
    ValueError
        If it is none of these, or the folder holds too few cuts.
    """
    if given == "none":
        return None
    if given in SHIPPED:
        return ReferenceSet.shipped(given)
    path = Path(given)
    if path.is_file():
        return ReferenceSet.load(path)
    if not path.is_dir():
        names = ", ".join(SHIPPED)
        raise ValueError(f"--reference {given!r} is neither {names} nor none, nor a file, nor a folder of records.")
    rows, units = [], set()
    for file in sorted(each for each in path.iterdir() if each.suffix.lower() in _SUFFIXES):
        for trace in read_record(file).sound:
            metrics = score(trace).metrics
            rows.append((file.stem, {name: scored.value for name, scored in metrics.items()}))
            units.add(trace.force_unit)
    if len(rows) < FEWEST or len(units) > 1:
        raise ValueError(
            f"--reference {given} holds {len(rows)} sound cuts in {len(units)} units of force; a percentile takes "
            f"{FEWEST} or more, of one unit."
        )
    return ReferenceSet.of(rows, name=path.name, about=f"records in {path.name}", force_unit=units.pop())


def _fitting(reference: ReferenceSet | None, trace: Trace) -> ReferenceSet | None:
    """Return the reference set for a record; None if its force is in another unit and cannot be compared.

    A record of force alone is compared with the set for such records.
    """
    if reference is not None and reference.name == "baselines" and trace.position is None:
        reference = ReferenceSet.shipped("force-alone")
    return reference if reference is not None and reference.force_unit == trace.force_unit else None


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="cutenv score",
        description=__doc__,
        epilog="Training feedback for research; not validated for assessment or credentialing of people.",
    )
    add_record_options(parser)
    parser.add_argument("--target", metavar="LENGTH", help="aimed at, from the clamp: 80mm; default the record's own")
    parser.add_argument(
        "--reference",
        default="baselines",
        help=f"{', '.join(SHIPPED)} (default), none, a file of ReferenceSet.save, or a folder of your people's records",
    )
    parser.add_argument("--out", type=Path, default=Path(), metavar="FOLDER", help="for pages and tables; default here")
    return parser
