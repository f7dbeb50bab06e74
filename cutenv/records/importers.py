"""Reading of any record, of another program by a mapping of its columns."""

from __future__ import annotations

import dataclasses
import itertools
import mmap
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cutenv._base.arrays import Array
from cutenv.records import mcap_file
from cutenv.records.csv_file import is_own
from cutenv.records.files import FORMATS, load, tables_in
from cutenv.records.foreign.column_map import MAP_FILE, ColumnMap
from cutenv.records.foreign.cut_detection import STANDARD, CutSearch, FoundCut, contact_level, find_cuts, find_tare
from cutenv.records.foreign.files_by_suffix import foreign_columns, is_text
from cutenv.records.foreign.mapped_columns import MappedReadings, RecordRows
from cutenv.records.foreign.named_columns import LeftOut, NamedColumns
from cutenv.records.foreign.proposal import Proposal, Question, proposal
from cutenv.records.measurement import QualityIssue, quality_issues
from cutenv.records.measurement.signal_faults import Readings
from cutenv.records.schema import SCHEMA, RecordError
from cutenv.records.table import CutTable
from cutenv.sim.trace import Trace


@dataclass(frozen=True, kw_only=True, eq=False)
class Imported:
    """Content of a file, with findings.

    Attributes
    ----------
    mapping : ColumnMap or None
        Mapping through which it was read; ``imported.mapping.save(folder)`` keeps it for the next file. None: not
        needed.
    records : tuple of Trace
        Every record, complete and unchanged, without tare.
    tared : tuple of Trace
        The same without the sensor's offset, if a quiet start shows it.
    cuts : tuple of tuple of FoundCut
        Position of the cuts in each record.
    traces : tuple of Trace
        Cuts of all records, tared; a record without a cut is one trace. ``metadata`` has the file, its lines, the tare
        and the mapping.
    flaws : tuple of tuple of QualityIssue
        Flaws of each of `traces`; rows are instants of that trace, the message names the lines.
    notes : tuple of str
        Assumptions and corrections, in words, to be shown to the reader.
    unused : tuple of str
        Headers of the columns that `mapping` does not name.
    left_out : tuple of LeftOut
        Rows of the file that are in no record, with their number.
    questions : tuple of Question
        What the file leaves open, where a proposed answer was taken.
    assumed : tuple of str
        Those of the notes that no reader may miss: what was assumed, interpolated, sorted, or parted.
    """

    path: Path
    mapping: ColumnMap | None
    records: tuple[Trace, ...]
    tared: tuple[Trace, ...]
    cuts: tuple[tuple[FoundCut, ...], ...]
    traces: tuple[Trace, ...]
    flaws: tuple[tuple[QualityIssue, ...], ...]
    notes: tuple[str, ...]
    unused: tuple[str, ...] = ()
    left_out: tuple[LeftOut, ...] = ()
    questions: tuple[Question, ...] = ()
    assumed: tuple[str, ...] = ()

    @property
    def sound(self) -> tuple[Trace, ...]:
        """Cuts without a flaw that excludes them."""
        return tuple(
            trace
            for trace, found in zip(self.traces, self.flaws, strict=True)
            if not any(flaw.refuse for flaw in found)
        )

    def picture(self, record: int) -> dict[str, Any]:
        """Return a record's :class:`cutenv.display.report.RecordPicture` fields by name."""
        first = sum(max(1, len(found)) for found in self.cuts[:record])
        cuts = self.cuts[record]
        quiet = self.tared[record].metadata.get("tare_instants")
        return {
            "record": self.records[record],
            "tared": self.tared[record],
            "quiet": None if quiet is None else slice(quiet[0], quiet[1] + 1),
            "cuts": [cut.samples for cut in cuts],
            "flaws": self.flaws[first : first + max(1, len(cuts))],
        }


def read_record(
    path: str | os.PathLike[str], mapping: ColumnMap | None = None, *, search: CutSearch | None = STANDARD
) -> Imported:
    """Read and check cuts from this package's or another program's file.

    A file whose headers name quantity and unit (:func:`cutenv.records.load`) needs no mapping; its cuts are used as
    they are. Any other text file, and a bag of ROS, is read by :func:`load_foreign`, through `mapping` or the one saved
    beside it.

    Returns
    -------
    Imported
        Its `sound` holds the cuts to calculate with.

    Raises
    ------
    RecordError
        If the file cannot be read: names place, reason and cure.
    OSError
        If the file cannot be opened.
    ModuleNotFoundError
        If the format's library is not installed; the message gives the pip command.
    """
    path = Path(path)
    if mapping is not None:
        if is_text(path) or not _is_ours(path):
            return load_foreign(path, mapping, search=search)
        raise RecordError(
            path, "a mapping is for other programs' files; here the names of the columns define them. Leave it out."
        )
    try:
        traces = tuple(load(path))
    except RecordError as error:
        if _is_ours(path):
            raise
        if (path.parent / MAP_FILE).is_file():
            return load_foreign(path, search=search)
        try:
            table = _foreign_table(path)
        except RecordError as foreign:  # no table of numbers either
            raise (error if path.suffix.lower() in FORMATS else foreign) from None
        cure = "if another program wrote it, leave it as it is and name its columns, as at the end of this message."
        own = f" (Cutenv's own format it is not: {error.reason})" if path.suffix.lower() in FORMATS else ""
        raise RecordError(path, f"{cure}{own} {_how_to_map(table)}") from None
    return Imported(
        path=path,
        mapping=None,
        records=traces,
        tared=traces,
        cuts=tuple((FoundCut(start=0, stop=len(trace)),) for trace in traces),
        traces=traces,
        flaws=tuple(map(quality_issues, traces)),
        notes=(f"{path.name}: {len(traces)} cut{'' if len(traces) == 1 else 's'}, as recorded.",),
    )


def _is_ours(path: Path) -> bool:
    """Return whether a file is this package's record, even damaged."""
    if path.suffix.lower() == ".mcap":
        return mcap_file.holds_cuts(path)
    if is_text(path):
        return path.is_file() and is_own(path)
    if path.suffix.lower() not in FORMATS or not path.stat().st_size:
        return False
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
        return content.find(SCHEMA.partition("/")[0].encode()) >= 0


def _loads(path: Path) -> bool:
    """Return whether a file's own column names define them."""
    try:
        return bool(load(path))
    except RecordError:
        return False


def load_foreign(
    path: str | os.PathLike[str], mapping: ColumnMap | None = None, *, search: CutSearch | None = STANDARD
) -> Imported:
    """Read the cuts of another program's table or ROS bag.

    Encoding, separator, decimal comma, lines above the header and units in it or below it are detected. In a bag each
    number of a topic is a column, such as ``/ft/wrench.wrench.force.x``, and ``stamp`` is the time. The sensor's
    offset is subtracted if the record has a quiet start, for a norm from each component; then the cuts in it are found.
    A record that `mapping.split_by` separates from the others is one cut.

    Parameters
    ----------
    path : path
        Path of a text file (.csv, .txt, .dat, .lvm, ...), or of a bag (.mcap, .db3 or .bag; needs the extra ``ros``).
    mapping : ColumnMap, optional
        Mapping of its columns; by default the one saved beside the file.
    search : CutSearch or None
        Criteria for cuts. None: neither tare nor split, each record is one trace.

    Raises
    ------
    RecordError
        If the file or a record in it cannot be read: names line, reason and cure.
    OSError
        If the file cannot be opened.
    """
    path = Path(path)
    table = _foreign_table(path, mapping)
    if mapping is None:
        mapping = _saved_mapping(path, table)
        table = _foreign_table(path, mapping) if table.source else table
    return imported(table, mapping, search)


def look_at(
    path: str | os.PathLike[str], mapping: ColumnMap | None = None, answers: Mapping[str, str] | None = None
) -> Imported:
    """Read any record as understood, before scoring.

    A record of this package is read as it is. Any other file is read by `mapping`, by the one that was saved beside it,
    or by the proposal that is made of its own statements and a person's `answers` (``{"unit": "mN"}``); questions whose
    proposed answers were taken are among the result, one without a likeliest answer raises OpenQuestions.
    """
    path = Path(path)
    if mapping is not None:
        return read_record(path, mapping)
    if _is_ours(path) or (path.suffix.lower() in FORMATS and not is_text(path) and _loads(path)):
        return read_record(path)
    kept = path.parent / MAP_FILE
    if answers is None and kept.is_file():
        try:
            return read_record(path)
        except RecordError:
            note = f"the columns kept in {kept} do not fit this file."
    else:
        note = ""
    table = _foreign_table(path)
    found = proposal(table)
    if answers:
        found = found.answered(answers)
    if found.mapping is None:
        raise OpenQuestions(path, found)
    table = _foreign_table(path, found.mapping) if table.source else table
    understood = imported(table, found.mapping)
    return dataclasses.replace(understood, questions=found.questions, notes=(*understood.notes, *[note] * bool(note)))


class OpenQuestions(RecordError):
    """Error for a file whose questions, `asked`, need an answer."""

    def __init__(self, path: Path, asked: Proposal) -> None:
        questions = " ".join(map(str, asked.questions))
        super().__init__(path, f"{questions} Answer in the mapping: {asked}")
        self.asked = asked


def imported(table: NamedColumns, mapping: ColumnMap, search: CutSearch | None = STANDARD) -> Imported:
    """Read records and cuts through a mapping; raises as :func:`load_foreign`."""
    readings = MappedReadings.of(table, mapping)
    records: list[_Searched] = []
    parts: list[tuple[Trace, tuple[QualityIssue, ...]]] = []
    told: list[str] = []
    for record in readings.records():
        whole = readings.trace(record, None)
        tare = None if search is None else _tare(readings, whole, record, search)
        name = f"record {' '.join(record.group.values())}: " if record.group else ""
        plain = whole if tare is None else readings.trace(record, tare)
        found = [] if search is None else find_cuts(plain, search)
        if record.group and mapping.split_by and found:  # the file defines one cut, the search its start and end
            found = [FoundCut(start=found[0].start, stop=found[-1].stop)]
        records.append(_Searched(whole, plain, tare, tuple(found)))
        if search is not None:
            told += [name + note for note in _remarks(readings, records[-1], search)]
        for cut in found or [FoundCut(start=0, stop=len(plain))]:
            parts.append(_cut(plain, cut, readings.lines[record.rows], table.row_name))
    return Imported(
        path=table.path,
        mapping=mapping,
        records=tuple(record.whole for record in records),
        tared=tuple(record.tared for record in records),
        cuts=tuple(record.cuts for record in records),
        traces=tuple(trace for trace, _ in parts),
        flaws=tuple(found_flaws for _, found_flaws in parts),
        notes=(f"{table.path.name}: {table}.", *map(str, readings.left_out), *readings.notes, *told),
        assumed=tuple(readings.notes),
        unused=_unused(table, mapping),
        left_out=tuple(readings.left_out),
    )


def _foreign_table(path: Path, mapping: ColumnMap | None = None) -> NamedColumns:
    """Return a file's columns, on the mapped force's clock."""
    if mapping is None:
        return foreign_columns(path)
    fields = ("force", *(field for field in mapping.fields if field not in ("force", "time")))
    return foreign_columns(path, [name for field in fields for name in mapping.expression(field).columns])


def _how_to_map(table: NamedColumns) -> str:
    """Return a table's columns, open questions and proposed ``--map``."""
    found = proposal(table)
    names = f"Its columns: {', '.join(filter(None, table.headers))}. " if any(table.headers) else ""
    asked = "".join(f"{question} " for question in found.questions)
    if found.mapping is None:
        return f"{names}{asked}Answer that in the mapping: {found}"
    return f"{names}{asked}Correct this where it is wrong; it is kept beside the files for the next time: {found}"


def _saved_mapping(path: Path, table: NamedColumns) -> ColumnMap:
    try:
        return ColumnMap.load(path.parent)
    except FileNotFoundError:
        raise RecordError(path, f"which of its columns is what? Name them: {_how_to_map(table)}") from None


def _unused(table: NamedColumns, mapping: ColumnMap) -> tuple[str, ...]:
    names = [name for field in mapping.fields for name in mapping.expression(field).columns]
    used = {table.index(name) for name in (*names, *mapping.split_by)}
    return tuple(header for k, header in enumerate(table.headers[: table.n_columns]) if header and k not in used)


def _tare(readings: MappedReadings, whole: Trace, record: RecordRows, search: CutSearch) -> tuple[Array, int] | None:
    """Return offsets [force unit] from a common quiet start, or None."""
    if not readings.expression.is_norm:
        tare = find_tare(whole, search)
        return None if tare is None else (np.array([tare.offset]), tare.stop)
    tares = [find_tare(readings.component(record, k), search) for k in range(readings.force.shape[1])]
    stops = [tare.stop for tare in tares if tare is not None]
    if len(stops) < len(tares):
        return None
    return np.asarray(readings.force[record.rows[: min(stops)]].mean(axis=0)), min(stops)


class _Searched(NamedTuple):
    """Record as it is and tared, with its cuts."""

    whole: Trace
    tared: Trace
    tare: tuple[Array, int] | None  # offsets, and length of its quiet start
    cuts: tuple[FoundCut, ...]


def _remarks(readings: MappedReadings, record: _Searched, search: CutSearch) -> list[str]:
    """Return notes for the reader on tare and cuts."""
    whole, plain, tare, found = record
    unit = readings.force_unit if readings.force_unit == "N" else "(normalised)"
    told = []
    if tare is None:
        told.append("no quiet start, so nothing was taken off the force.")
    else:
        listed = ", ".join(f"{offset:.3g} {unit}" for offset in tare[0])
        seconds = float(whole.time[tare[1] - 1] - whole.time[0])
        told.append(f"{listed} taken off the force, which the sensor showed for {seconds:.2f} s before contact.")
    if not found:
        told.append("no cut found: the force never rises above noise while the blade advances. It is kept whole.")
    for number, cut in enumerate(found, 1):
        start, end = (float(whole.time[i]) for i in (cut.start, cut.stop - 1))
        told.append(f"cut {number} from {start:.3f} s to {end:.3f} s.")
    if whole.position is None and len(found) > 1:
        told.append("without position, turning with little force looks like a pause: confirm, or search longer pauses.")
    if tare is not None and found:
        after = plain.force[found[-1].stop :]
        if len(after) * whole.duration / len(whole) >= search.quiet and len(after):
            moved = float(after.mean())
            if abs(moved) > 0.5 * contact_level(plain, search):
                told.append(
                    f"after the last cut the force is {moved:.3g} {unit}: the zero moved, or something presses."
                )
    if readings.expression.is_norm and whole.position is not None:
        told.append("a norm has no sign: on the way back friction counts as resistance. Map the component instead.")
    return told


def _cut(trace: Trace, cut: FoundCut, lines: NDArray[np.intp], row_name: str) -> tuple[Trace, tuple[QualityIssue, ...]]:
    """Return a record's cut with place in metadata, and its flaws."""
    part = trace.select(cut.samples)
    lines = lines[cut.samples]
    where = {"lines": [int(lines[0]), int(lines[-1])], "instants": [cut.start, cut.stop - 1]}
    part = part.with_metadata({**part.metadata, **where})
    located = tuple(
        dataclasses.replace(flaw, message=f"{row_name}s {lines[flaw.rows[0]]} to {lines[flaw.rows[1]]}: {flaw.message}")
        for flaw in quality_issues(part)
    )
    return part, located


def readings_in(path: Path, mapping: ColumnMap | None = None) -> list[Readings]:
    """Return untared columns of every record of a file.

    Of a file whose headers name quantity and unit they need not be a record: its clock may go back, and its force be of
    any size.
    """
    if mapping is None:
        try:
            tables = tables_in(path)
        except RecordError:
            tables = []
        columns = [readings for table in tables for readings in _of_table(table)]
        if columns:
            return columns
    return [_of_trace(trace) for trace in read_record(path, mapping, search=None).records]


def _of_table(table: CutTable) -> list[Readings]:
    """Return each cut's columns; none without direct force and numbers."""
    n = len(table.values[0])
    borders = [0, n] if table.cut is None else [0, *(np.flatnonzero(np.diff(table.cut)) + 1).tolist(), n]
    named = {column.of_trace: (column, values) for column, values in zip(table.columns, table.values, strict=True)}
    if "force" not in named or n < 2:
        return []
    found = []
    for number, (first, stop) in enumerate(itertools.pairwise(borders)):
        held = {
            name: column.to_si(values[first:stop])
            for name, (column, values) in named.items()
            if name in ("time", "force", "position", "speed") and not np.isnan(values[first:stop]).all()
        }
        if not {"time", "force"} <= held.keys() or not all(np.isfinite(values).all() for values in held.values()):
            return []
        facts = {**table.shared, **table.own.get(number, {})}
        found.append(Readings(**held, force_unit=named["force"][0].force_unit or "N", metadata=facts))
    return found


def _of_trace(trace: Trace) -> Readings:
    return Readings(
        time=trace.time, force=trace.force, position=trace.position, speed=trace.speed, force_unit=trace.force_unit,
        metadata=trace.metadata,
    )  # fmt: skip
