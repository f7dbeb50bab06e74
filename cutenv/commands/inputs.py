"""Record files as arguments: read, checked, with names and specimens."""

from __future__ import annotations

import argparse
import glob
import re
import sys
from pathlib import Path
from typing import NamedTuple

from cutenv._base.output import watched
from cutenv.commands.options import made_folder
from cutenv.records import ColumnMap, Imported, RecordError, read_record
from cutenv.records.files import FORMATS
from cutenv.records.foreign.column_map import MAP_FILE
from cutenv.records.foreign.files_by_suffix import FOREIGN_SUFFIXES, PACKED, is_record_folder
from cutenv.records.measurement.calibration import RefusedRecord
from cutenv.records.measurement.measured_cut import SPECIMEN_KEY
from cutenv.sim.trace import Trace

SUFFIXES = tuple(FORMATS)  # endings of this package's record files, which are looked for in a folder
MAPPED_SUFFIXES = (
    ".txt", ".tsv", ".dat", ".asc", ".lvm", ".tra", ".log", ".prn", ".out", ".json", ".jsonl", ".sto", ".mot",
    *FOREIGN_SUFFIXES,
)  # fmt: skip
"""Endings of other programs' files, which are looked for, too, where a mapping is given or kept."""

_MOST_NOTES = 3  # notes on an option without effect, a line for each record; of more records a single line


class Source(NamedTuple):
    """Source of a cut: file, and number from 1; None for the only one."""

    path: Path
    number: int | None


class LoadedTraces(NamedTuple):
    """Cuts with their sources, refused records, and notes."""

    traces: list[Trace]
    refused: list[RefusedRecord]
    notes: list[str]
    sources: list[Source]


def read_records(arguments: argparse.Namespace) -> LoadedTraces:
    """Read all files; cuts are named after their file.

    Raise ValueError if the options are invalid, or a record is bad and not to be skipped: names all of them, with
    reasons; OSError if a file cannot be opened.
    """
    mapping = given_mapping(arguments)
    pattern = _pattern(arguments.specimen)
    if arguments.confirm is not None:
        made_folder("--confirm", arguments.confirm)
    arguments.records = record_files(arguments)
    traces: list[Trace] = []
    refused: list[RefusedRecord] = []
    notes: list[str] = []
    remembered: set[str] = set()
    sources: list[Source] = []
    for path in watched(arguments.records, "reading", "file"):
        try:
            imported = read_record(path, mapping)
        except RecordError as error:
            refused.append(RefusedRecord(path.name, error.reason))
            if mapping is None and (path.parent / MAP_FILE).is_file():
                remembered.add(str(path.parent / MAP_FILE))
            continue
        notes += imported.notes if arguments.verbose else _unmissable(imported)
        if mapping is None and imported.mapping is not None:
            remembered.add(str(path.parent / MAP_FILE))
        if arguments.confirm is not None:
            _draw(arguments.confirm, imported)
        if imported.unused and any(trace.position is None for trace in imported.traces):
            notes.append(f"{path.name}: read without position; columns left unused: {', '.join(imported.unused)}")
        for number, (trace, wrong) in enumerate(zip(imported.traces, imported.flaws, strict=True), 1):
            source = Source(path, number if len(imported.traces) > 1 else None)
            named = _named(trace, source.path, source.number, pattern)
            reasons = " ".join(flaw.message for flaw in wrong if flaw.refuse)
            if reasons:
                refused.append(RefusedRecord(str(named.metadata["name"]), reasons))
                continue
            notes += [f"{named.metadata['name']}: {flaw.message}" for flaw in wrong]
            traces.append(named)
            sources.append(source)
    notes += [f"columns as kept in {path}; --map replaces them" for path in sorted(remembered)]
    if refused and not arguments.skip_bad:
        listed = "\n".join(f"  {each.name}: {each.reason}" for each in refused)
        many = f"{len(refused)} bad records; --skip-bad goes on without them"
        if len(refused) == 1:
            many = "one bad record; --skip-bad goes on without it"
        hint = "".join(f"\n  (columns as kept in {path})" for path in sorted(remembered))
        raise ValueError(f"{many}:\n{listed}{hint}")
    if mapping is not None and traces:
        for folder in {path.parent for path in arguments.records}:
            try:
                notes.append(f"columns kept in {mapping.save(folder)} for the next time")
            except OSError as error:  # a share that is read-only: the job itself can do without
                notes.append(f"columns not kept in {folder} ({error.strerror or error}); give --map again next time")
    return LoadedTraces(traces, refused, notes, sources)


def chosen_cut(records: LoadedTraces, number: int | None) -> Trace:
    """Return a cut by number from 1, by default the first.

    A note is printed if there are others. Raise ValueError if there is no such cut.
    """
    by_number = {source.number or 1: trace for source, trace in zip(records.sources, records.traces, strict=True)}
    if not by_number:
        raise ValueError("no cut is left.")
    if len({source.path for source in records.sources}) > 1:
        raise ValueError(f"{len(records.sources)} cuts of several files were found; give one file.")
    first = min(by_number)
    if number is None and len(by_number) > 1:
        print(f"note: cut {first} of {len(by_number)} is taken; --cut chooses another.", file=sys.stderr)
    chosen = first if number is None else number
    if chosen not in by_number:
        raise ValueError(f"--cut {chosen}: the file holds cuts {', '.join(map(str, by_number))}; give one of these.")
    return by_number[chosen]


def record_files(arguments: argparse.Namespace) -> list[Path]:
    """Return the files of ``arguments.records``, with patterns and folders expanded.

    Files of other programs are looked for where there is a mapping, given or kept. The folder of a bag, or of a data
    set of LeRobot, is one record. A table of operators and the command's own output are no records. Raise
    FileNotFoundError if a file is missing, or a folder holds no records.
    """
    ours = {path.resolve() for name in ("operators", "out") if (path := getattr(arguments, name, None)) is not None}
    ours |= {path.with_suffix(".csv") if path.suffix == ".html" else path / "scores.csv" for path in ours}
    given: list[Path] = []
    for path in arguments.records:
        matched = [] if path.exists() else sorted(map(Path, glob.glob(str(path))))  # cmd of Windows expands none
        given += [each for each in matched if each.resolve() not in ours] or [path]
    missing = [str(path) for path in given if not path.exists()]
    if missing:
        raise FileNotFoundError(
            f"no such file: {', '.join(missing)}. 'cutenv play --out cuts' records cuts by hand, "
            "'cutenv score --example' scores a simulated one."
        )
    files: list[Path] = []
    mapped = arguments.map is not None or getattr(arguments, "every_text", False)
    for path in given:
        if not path.is_dir() or is_record_folder(path):
            files.append(path)
            continue
        every = mapped or (path / MAP_FILE).is_file()
        inside = [each for each in sorted(path.iterdir()) if _is_record(each, mapped=every)]
        inside = [each for each in inside if each.resolve() not in ours and each.name != MAP_FILE]
        if not inside:
            endings = (*SUFFIXES, *MAPPED_SUFFIXES) if every else SUFFIXES
            others = "" if every else "; those of other programs need --map"
            raise FileNotFoundError(f"no records in {path}; they end in {', '.join(endings)}{others}.")
        files += inside
    return files


def _is_record(path: Path, *, mapped: bool) -> bool:
    """Return whether a path is a record; other programs' files only if ``mapped``."""
    suffix = Path(path.stem).suffix if mapped and path.suffix.lower() == PACKED else path.suffix
    known = (*SUFFIXES, *MAPPED_SUFFIXES) if mapped else SUFFIXES
    return suffix.lower() in known if path.is_file() else is_record_folder(path)


def targets(traces: list[Trace], given: float | None) -> tuple[list[float | None], list[str]]:
    """Return target lengths [m], and notes on a useless ``--target-length``.

    A record's own target is what the cut was aimed at, so the option holds only for records without one.
    """
    own = [trace.metadata.get("target_length_m") for trace in traces]
    notes: dict[str, list[str]] = {"have no position": [], "hold their own targets": []}
    for trace, length in zip(traces, own, strict=True):
        if given is None:
            break
        effect = f"{trace.metadata['name']}: --target-length has no effect, because the record"
        if trace.position is None:
            notes["have no position"].append(f"{effect} has no position")
        elif isinstance(length, int | float) and abs(length - given) > 0.5e-4:
            notes["hold their own targets"].append(f"{effect} holds its own target, {1e3 * length:.1f} mm")
    lines = []
    for why, each in notes.items():
        many = f"--target-length has no effect on {len(each)} of {len(traces)} records, which {why}"
        lines += each if len(each) <= _MOST_NOTES else [many]
    return [given if length is None else length for length in own], lines


def given_mapping(arguments: argparse.Namespace) -> ColumnMap | None:
    """Return the mapping of ``--map`` and ``--unit``, or None. ValueError for ``--unit`` alone."""
    if arguments.map is None:
        if arguments.unit is not None:
            raise ValueError("--unit goes with --map: cutenv's own files have their units in the header.")
        return None
    return ColumnMap.parse(arguments.map, unit=arguments.unit)


def _unmissable(imported: Imported) -> list[str]:
    """Return warnings on a foreign file: lost rows, assumptions."""
    return [f"{imported.path.name}: {said}" for said in (*map(str, imported.left_out), *imported.assumed)]


def _pattern(text: str | None) -> re.Pattern[str] | None:
    try:
        return None if text is None else re.compile(text)
    except re.error as error:
        raise ValueError(f"--specimen {text!r} is no regular expression: {error}.") from None


def _draw(folder: Path, imported: Imported) -> None:
    """Draw a picture of each record of a file."""
    from cutenv.display.report import RecordPicture, draw_record  # an extra, and slow to import

    for k in range(len(imported.records)):
        place = "" if len(imported.records) == 1 else f"_{k + 1}"
        title = f"{imported.path.name}{place.replace('_', ', record ')}"
        draw_record(folder / f"{imported.path.stem}{place}.png", RecordPicture(**imported.picture(k)), title)


def _named(trace: Trace, path: Path, number: int | None, pattern: re.Pattern[str] | None) -> Trace:
    metadata = dict(trace.metadata)
    metadata.setdefault("name", path.stem if number is None else f"{path.stem} {number}")
    if pattern is not None and SPECIMEN_KEY not in metadata:
        match = pattern.search(str(path))
        if match is None:
            raise ValueError(f"--specimen {pattern.pattern!r} does not match {path}; it must match every file.")
        metadata[SPECIMEN_KEY] = match[1] if match.groups() else match[0]
    return trace.with_metadata(metadata)
