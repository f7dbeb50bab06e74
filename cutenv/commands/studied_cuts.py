"""Cuts of several people, scored, with operators by table or record."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from cutenv._base.output import watched
from cutenv.commands.inputs import LoadedTraces, Source, read_records, targets
from cutenv.commands.options import made_place, target_length
from cutenv.commands.score import reference_set
from cutenv.records import OperatorRow, recorded_operators
from cutenv.records.measurement.calibration import RefusedRecord
from cutenv.records.scoring import ScoreCard, score
from cutenv.records.scoring.doubts import DOUBT
from cutenv.records.scoring.reference import fitting_reference
from cutenv.records.scoring.study import StudiedCut, condition_of
from cutenv.sim.trace import Trace

_MOST_DOUBTS = 10  # that are printed


class StudiedRecords(NamedTuple):
    """Cuts by person in order, refused records, abandoned cuts."""

    cuts: list[StudiedCut]
    refused: list[RefusedRecord]
    left: Mapping[str, tuple[int, ...]]  # by operator, how many finished cuts stand before each one that was left


def studied_cuts(arguments: argparse.Namespace, rows: Sequence[OperatorRow] | None) -> StudiedRecords:
    """Read and score the records; print notes and progress.

    ``rows`` of the table of operators come from the records without a table. Raise ValueError, OSError if the options
    are invalid, a record is bad or not to be found, records and operators do not fit, or all cuts were made for
    practice.
    """
    reference, length = reference_set(arguments.reference), target_length(arguments)
    records = read_records(arguments)
    aimed, without_effect = targets(records.traces, length)
    for note in [*records.notes, *without_effect]:
        print(f"note: {note}", file=sys.stderr)
    if rows is None:
        recorded = recorded_operators([trace.metadata for trace in records.traces])
        pairs = sorted(zip(recorded, range(len(recorded)), strict=True), key=lambda pair: pair[0].order)
    else:
        pairs = assigned([row for row in rows if row.record], records, arguments.operators)
    pairs = _that_count(pairs, records.traces)
    cuts = [
        StudiedCut(
            card=score(
                _by_hand(records.traces[i], row.operator),
                target_length=aimed[i],
                reference=fitting_reference(reference, records.traces[i]),
            ),
            operator=row.operator,
            group=row.group,
            session=row.session,
            date=str(records.traces[i].metadata.get("date") or ""),
            marks=row.marks,
            condition=condition_of(records.traces[i].metadata),
        )
        for row, i in watched(pairs, "scoring", "cut")
    ]
    _print_doubts([cut.card for cut in cuts])
    return StudiedRecords(cuts, records.refused, _left(rows or (), [row for row, _ in pairs]))


def _that_count(pairs: Sequence[tuple[OperatorRow, int]], traces: Sequence[Trace]) -> list[tuple[OperatorRow, int]]:
    """Return cuts not made for practice; raise ValueError without any.

    The number left out is printed.
    """
    counted = [pair for pair in pairs if traces[pair[1]].metadata.get("practice") is not True]
    count = len(pairs) - len(counted)
    if pairs and not counted:
        raise ValueError(
            f"all {count} cuts were made for practice (practice: true in their records): warm-up cuts of a course, or "
            "cuts with the tip shown. Give cuts that count, too."
        )
    if count:
        print(
            f"note: left out: {count} of {len(pairs)} cuts, made for practice (practice: true in their records): "
            "warm-up cuts of a course, or cuts with the tip shown",
            file=sys.stderr,
        )
    return counted


def _by_hand(trace: Trace, operator: str) -> Trace:
    """Return a record with its operator, checked as hand motion."""
    named = bool(trace.metadata.get("operator"))
    return trace if named else trace.with_metadata({**trace.metadata, "operator": operator})


def _print_doubts(cards: Sequence[ScoreCard]) -> None:
    """Print which cuts are doubtful as recorded."""
    doubted = [(card.name, note) for card in cards for note in card.notes if note.startswith(DOUBT)]
    for name, note in doubted[:_MOST_DOUBTS]:
        print(f"note: {name}: {note}", file=sys.stderr)
    if len(doubted) > _MOST_DOUBTS:
        print(f"note: {len(doubted) - _MOST_DOUBTS} doubts more; each cut's card has its own", file=sys.stderr)


def _left(rows: Sequence[OperatorRow], finished: Sequence[OperatorRow]) -> dict[str, tuple[int, ...]]:
    """Count an operator's finished cuts before each abandoned one."""
    found: dict[str, tuple[int, ...]] = {}
    for row in sorted((row for row in rows if not row.record), key=lambda row: (row.order, row.line)):
        before = sum(
            each.operator == row.operator and (each.order, each.line) < (row.order, row.line) for each in finished
        )
        found[row.operator] = (*found.get(row.operator, ()), before)
    return found


def study_name(arguments: argparse.Namespace) -> str:
    """Return a study's title, from ``--name`` or the first source."""
    source: Path = arguments.operators or arguments.records[0].absolute()
    if "*" in source.name:  # a pattern is named after its folder
        source = source.parent
    return str(arguments.name or source.stem)


def assigned(rows: Sequence[OperatorRow], records: LoadedTraces, table: Path) -> list[tuple[OperatorRow, int]]:
    """Return rows of cuts with indices in ``records.traces``, by operator in order.

    Raise ValueError if a cut has no row or two, or a row no cut; names them all.
    """
    found: list[tuple[OperatorRow, int]] = []
    used: dict[str, set[Path]] = {}
    unknown = []
    by_name = {row.record: row for row in rows}
    for i, source in enumerate(records.sources):
        names = [name for name in _names(source) if name in by_name]
        if len(names) > 1:
            raise ValueError(f"{table}: records {' and '.join(map(repr, names))} are one cut; keep one row.")
        if not names:
            unknown.append(_names(source)[0])
            continue
        used.setdefault(names[0], set()).add(source.path)
        found.append((by_name[names[0]], i))
    twice = [name for name, paths in used.items() if len(paths) > 1]
    # A record that was left out as bad keeps its row.
    bad = {Path(each.name).stem for each in records.refused} | {each.name for each in records.refused}
    missing = [row.record for row in rows if row.record not in used and not {row.record, Path(row.record).stem} & bad]
    wrong = [f"no row for {', '.join(unknown)}"] * bool(unknown)
    wrong += [f"no record for {', '.join(missing)}"] * bool(missing)
    wrong += [f"several files are called {', '.join(twice)}; give their suffixes"] * bool(twice)
    if wrong:
        raise ValueError(f"{table} and the records do not fit: {'; '.join(wrong)}.")
    return sorted(found, key=lambda pair: (pair[0].order, pair[0].line, pair[1]))


def _names(source: Source) -> list[str]:
    """Return names by which rows call a cut."""
    names = [source.path.name, source.path.stem]
    if source.number is not None:
        names += [f"{name} {source.number}" for name in names]
    return names


def check_page(out: Path | None) -> None:
    """Refuse an output path that cannot be written."""
    if out is None:
        return
    if out.suffix != ".html":
        raise ValueError(f"--out {out} must end in .html; the numbers go beside it as .csv.")
    made_place("--out", out)
