"""Record files as a sub-command is given them: native or foreign, checked, with names and specimens."""

from __future__ import annotations

import argparse
import dataclasses
import re
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from cutenv.measurement import flaws
from cutenv.measurement.calibration import Refused
from cutenv.measurement.cut import SPECIMEN
from cutenv.recording import RecordError, load
from cutenv.recording.foreign import load_foreign
from cutenv.recording.mapping import MAP_FILE, ColumnMap
from cutenv.trace import Trace


class Records(NamedTuple):
    """What was read: cuts, those left out with the reason, and what the reader should know."""

    traces: list[Trace]
    refused: list[Refused]
    notes: list[str]


def add_record_options(parser: argparse.ArgumentParser) -> None:
    """Options of every sub-command that reads records."""
    parser.add_argument(
        "records", nargs="+", type=Path, metavar="FILE", help="CSV, Parquet or HDF5, one cut or several"
    )
    foreign = parser.add_argument_group("files of other programs")
    foreign.add_argument(
        "--map",
        nargs="+",
        metavar="FIELD=COLUMN",
        help="time=t force=Fx, force=norm(Fx,Fy,Fz), position=x[mm], angle=90deg, depth=20mm, rate=1000Hz, "
        f"split_by=trial,cut; kept beside the files as {MAP_FILE} for the next time",
    )
    foreign.add_argument("--unit", help="of the force: N, mN, kN, gf, kgf, lbf, or 1 if it is normalised")
    parser.add_argument(
        "--specimen",
        metavar="PATTERN",
        help="regular expression for the file's path; what it matches (its first group) names the specimen, where "
        "the record does not",
    )
    parser.add_argument("--skip-bad", action="store_true", help="leave bad records out instead of stopping, and say so")


def read_records(arguments: argparse.Namespace) -> Records:
    """Read all files; their cuts named after the file.

    Raises
    ------
    ValueError
        If the options make no sense, or a record is bad and is not to be skipped: all of them, with reasons.
    OSError
        If a file cannot be opened.
    """
    mapping = _mapping(arguments)
    pattern = _pattern(arguments.specimen)
    missing = [str(path) for path in arguments.records if not path.is_file()]
    if missing:
        raise FileNotFoundError(f"no such file: {', '.join(missing)}.")
    traces: list[Trace] = []
    refused: list[Refused] = []
    notes: list[str] = []
    for path in _watched(arguments.records):
        try:
            found, told = _read(path, mapping)
        except RecordError as error:
            refused.append(Refused(path.name, error.reason))
            continue
        notes += told
        for number, trace in enumerate(found, 1):
            named = _named(trace, path, number if len(found) > 1 else None, pattern)
            wrong = flaws(named)
            reasons = " ".join(flaw.message for flaw in wrong if flaw.refuse)
            if reasons:
                refused.append(Refused(str(named.metadata["name"]), reasons))
                continue
            notes += [f"{named.metadata['name']}: {flaw.message}" for flaw in wrong]
            traces.append(named)
    if refused and not arguments.skip_bad:
        listed = "\n".join(f"  {each.name}: {each.reason}" for each in refused)
        raise ValueError(f"{len(refused)} bad records; --skip-bad goes on without them:\n{listed}")
    if mapping is not None and traces:
        for folder in {path.parent for path in arguments.records}:
            mapping.save(folder)
    return Records(traces, refused, notes)


def _mapping(arguments: argparse.Namespace) -> ColumnMap | None:
    if arguments.map is None:
        if arguments.unit is not None:
            raise ValueError("--unit goes with --map: a file of our own says its units in the header.")
        return None
    return ColumnMap.parse(arguments.map, unit=arguments.unit)


def _pattern(text: str | None) -> re.Pattern[str] | None:
    try:
        return None if text is None else re.compile(text)
    except re.error as error:
        raise ValueError(f"--specimen {text!r} is no regular expression: {error}.") from None


def _read(path: Path, mapping: ColumnMap | None) -> tuple[list[Trace], list[str]]:
    if mapping is None and not (path.parent / MAP_FILE).is_file():
        return load(path), []
    if path.suffix.lower() in (".parquet", ".h5", ".hdf5"):
        return load(path), []
    imported = load_foreign(path, mapping)
    return list(imported.traces), list(imported.notes)


def _named(trace: Trace, path: Path, number: int | None, pattern: re.Pattern[str] | None) -> Trace:
    metadata = dict(trace.metadata)
    metadata.setdefault("name", path.stem if number is None else f"{path.stem} {number}")
    if pattern is not None and SPECIMEN not in metadata:
        match = pattern.search(str(path))
        if match is None:
            raise ValueError(f"--specimen {pattern.pattern!r} does not match {path}; it must match every file.")
        metadata[SPECIMEN] = match[1] if match.groups() else match[0]
    return dataclasses.replace(trace, metadata=metadata)


def _watched(paths: Sequence[Path]) -> Sequence[Path]:
    from tqdm import tqdm  # an extra

    watched: Sequence[Path] = tqdm(paths, desc="reading", unit="file", file=sys.stderr, leave=False)
    return watched
