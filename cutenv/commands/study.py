"""Study records of several people: reliability of metrics, separation of groups, learning by CUSUM."""

from __future__ import annotations

import argparse
import sys
import textwrap
from collections.abc import Sequence
from pathlib import Path

from cutenv.commands.inputs import LoadedTraces, Source, read_records, without_target
from cutenv.commands.options import (
    add_record_options,
    add_target_length,
    command_parser,
    made_folder,
    reports_errors,
    target_length,
    watched,
)
from cutenv.recording import OperatorRow, load_operators
from cutenv.scoring import METRICS, score
from cutenv.scoring.score_card import DISCLAIMER
from cutenv.scoring.study import StudiedCut, Study, condition_of

SUFFIXES = (".csv", ".parquet", ".h5", ".hdf5")


@reports_errors("study", ImportError)
def main(argv: Sequence[str]) -> int:
    """Run the command; return 0, or 2 if the records, the table or the options are bad."""
    arguments = _parser().parse_args(argv)
    from cutenv.report.crossover_table import crossover_lines
    from cutenv.report.study_page import write_study
    from cutenv.report.study_table import table_lines

    check_page(arguments.out)
    rows = load_operators(arguments.operators)
    arguments.records = record_files(arguments)
    records = read_records(arguments)
    length = target_length(arguments)
    for note in [*records.notes, *without_target(records.traces, length)]:
        print(f"note: {note}", file=sys.stderr)
    cuts = [
        StudiedCut(
            card=score(records.traces[i], target_length=length),
            operator=row.operator,
            group=row.group,
            session=row.session,
            condition=condition_of(records.traces[i].metadata),
        )
        for row, i in watched(assigned(rows, records, arguments.operators), "scoring", "cut")
    ]
    print("working out reliability, groups and learning ...", file=sys.stderr, flush=True)
    study = Study(
        name=arguments.name or arguments.operators.stem,
        cuts=cuts,
        metrics=tuple(arguments.metric or ()),
        groups=None if arguments.groups is None else tuple(arguments.groups),
        target_group=arguments.criterion_group,
        target=arguments.criterion,
    )
    print("\n".join([*table_lines(study), *crossover_lines(study)]))
    for each in records.refused:
        print(f"note: left out: {each.name}: {each.reason}")
    if arguments.out is not None:
        print("drawing the page ...", file=sys.stderr, flush=True)
        cards = write_study(arguments.out, study)
        print(f"\npage: {arguments.out}\ncards: {cards}")
    return 0


def assigned(rows: Sequence[OperatorRow], records: LoadedTraces, table: Path) -> list[tuple[OperatorRow, int]]:
    """Return every cut's row and its place in ``records.traces``, in the order in which each operator made them.

    Raises
    ------
    ValueError
        If a cut has no row or two, or a row no cut; names them all.
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
    """Return the names by which a row may refer to a cut."""
    names = [source.path.name, source.path.stem]
    if source.number is not None:
        names += [f"{name} {source.number}" for name in names]
    return names


def record_files(arguments: argparse.Namespace) -> list[Path]:
    """Return the records: folders stand for the record files in them, except the table and our own output."""
    ours = {arguments.operators.resolve()}
    if arguments.out is not None:
        ours.add(arguments.out.with_suffix(".csv").resolve())
    files: list[Path] = []
    for path in arguments.records:
        if not path.is_dir():
            files.append(path)
            continue
        inside = [each for each in sorted(path.iterdir()) if each.suffix.lower() in SUFFIXES and each.is_file()]
        inside = [each for each in inside if each.resolve() not in ours]
        if not inside:
            raise FileNotFoundError(f"no records in {path}; they end in {', '.join(SUFFIXES)}.")
        files += inside
    return files


def check_page(out: Path | None) -> None:
    """Raise an error for a path that cannot be written, before any work."""
    if out is None:
        return
    if out.suffix != ".html":
        raise ValueError(f"--out {out} must end in .html; the numbers go beside it as .csv.")
    made_folder("--out", out.parent)


def _parser() -> argparse.ArgumentParser:
    parser = command_parser(
        "study",
        __doc__,
        examples=(
            "records/ --operators operators.csv --out study.html",
            "records/ --operators operators.csv --metric tip_error --criterion 0.003",
            "records/ --operators operators.csv --criterion-group expert --target-length 80mm",
        ),
        note=textwrap.fill(f"Metrics: {', '.join(METRICS)}. {DISCLAIMER}", 100),
    )
    add_record_options(
        parser, metavar="FOLDER", about="folder of records (CSV, Parquet or HDF5), or the records themselves"
    )
    parser.add_argument(
        "--operators",
        type=Path,
        required=True,
        metavar="TABLE.csv",
        help="table with columns record, operator (an anonymous code, P07), and where known group, session, order",
    )
    parser.add_argument("--out", type=Path, metavar="FILE.html", help="page to write; every card beside it as .csv")
    parser.add_argument(
        "--metric",
        action="append",
        choices=list(METRICS),
        metavar="NAME",
        help="metric to study; give it again for more; default the leading ones",
    )
    parser.add_argument("--groups", nargs=2, metavar="NAME", help="two groups to compare, if there are more than two")
    parser.add_argument(
        "--criterion-group", metavar="NAME", help="group whose mean is the target value of the learning curves"
    )
    parser.add_argument(
        "--criterion",
        type=float,
        metavar="VALUE",
        help="target value of the learning curves itself, in the SI unit of the one --metric",
    )
    add_target_length(parser, "the records' own")
    parser.add_argument("--name", metavar="NAME", help="title of the study; default the table's name")
    return parser
