"""Teacher's upload of other programs' records: staged, previewed, and read by columns."""

from __future__ import annotations

import re
import secrets
import shutil
import tempfile
import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from cutenv._base.validation import in_range
from cutenv.display.report import RecordPicture
from cutenv.records import ColumnMap, Imported, RecordError, read_record
from cutenv.records.csv_file import is_own
from cutenv.records.foreign.column_map import parse_expression
from cutenv.records.foreign.named_columns import NamedColumns
from cutenv.records.foreign.proposal import proposal
from cutenv.records.foreign.text_tables import sniff_table
from cutenv.records.schema import FIELD_UNITS
from cutenv.sim.trace import Trace

LARGEST_UPLOAD = 16 * 2**20
"""Largest upload that is read [bytes]."""
PICKED = ("time", "force", "position", "depth", "speed", "angle")
"""Fields of a record for which a column can be picked."""
_MOST_FILES, _MOST_COLUMNS, _LONGEST_LINE, _SHOWN_ROWS = 20, 64, 20_000, 8
_MOST_STAGED = 8
_SI = {field: units[0].sign for field, units in FIELD_UNITS.items()}
_BY_HAND = {"depth": "mm", "angle": "deg"}  # fields that may be one number, and its unit in the form


class DroppedFile(NamedTuple):
    """Uploaded file: client's name, shown but never opened, and local path."""

    name: str
    path: Path
    own: bool
    """True if its headers name quantities and units, so that nothing has to be picked."""


class PreviewColumn(NamedTuple):
    """Header of a column, "" without one, and its first cells."""

    name: str
    cells: tuple[str, ...]


class ReadCut(NamedTuple):
    """Cut as read: file name, record, and faults in words or ""."""

    name: str
    trace: Trace
    flaw: str

    @property
    def span(self) -> tuple[float, float] | None:
        """Least and greatest position [mm]; None without positions."""
        position = self.trace.position
        return None if position is None else (1e3 * float(position.min()), 1e3 * float(position.max()))


@dataclass(frozen=True, kw_only=True)
class Upload:
    """Some files that one person's cuts are in."""

    id: str
    files: tuple[DroppedFile, ...]
    columns: tuple[PreviewColumn, ...]
    """Columns of the first file whose columns have to be picked; () if there is none."""
    guess: Mapping[str, str]
    """The form as it is guessed: columns by number from 1, and units where the header is silent."""
    questions: tuple[str, ...] = ()
    """Questions that the first such file leaves open, with the answer that the guess takes."""

    def read(self, form: Mapping[str, str]) -> tuple[list[ReadCut], list[str], list[RecordPicture]]:
        """Read the files by a form of columns; return cuts, notes, pictures.

        Raises ValueError if the form names no columns of the files, or a file cannot be read; it names file, place,
        reason and cure.
        """
        mapping = picked_map(form) if self.columns else None
        cuts: list[ReadCut] = []
        notes: list[str] = []
        pictures: list[RecordPicture] = []
        for file in self.files:
            try:
                found: Imported = read_record(file.path, None if file.own else mapping)
            except RecordError as error:
                raise ValueError(f"{file.name}: {error.reason}") from None
            pictures += [RecordPicture(**found.picture(k)) for k in range(len(found.records))]
            notes += [note.replace(file.path.name, file.name) for note in found.notes]
            for trace, flaws in zip(found.traces, found.flaws, strict=True):
                cuts.append(ReadCut(file.name, trace, " ".join(each.message for each in flaws if each.refuse)))
        return cuts, notes, pictures


def picked_map(form: Mapping[str, str]) -> ColumnMap:
    """Return the mapping of fields such as ``force`` and ``force_unit``, or ValueError."""
    given: dict[str, str] = {}
    for field in PICKED:
        columns = [f"#{column}" for name in (field, f"{field}_y", f"{field}_z") if (column := form.get(name, ""))]
        value = form.get(f"{field}_value", "").strip().replace(",", ".") if field in _BY_HAND else ""
        if columns and value:
            raise ValueError(f"{field} is given as a column and as a number. Leave one of them out.")
        if value:
            given[field] = f"{_number(field, value):g}{_BY_HAND[field]}"
        elif columns:
            sign = "-" if form.get(f"{field}_sign") == "-" else ""
            unit = form.get(f"{field}_unit", "")
            body = columns[0] if len(columns) == 1 else f"norm({','.join(columns)})"
            given[field] = f"{sign}{body}" + (f"[{unit}]" if unit else "")
    if "force" not in given:
        raise ValueError("no column is picked for the force. Pick one.")
    rate = form.get("rate", "").strip().replace(",", ".")
    if ("time" in given) == bool(rate):
        raise ValueError("pick a column for the time, or give the readings a second: one of both.")
    return ColumnMap.parse([f"{field}={text}" for field, text in given.items()] + [f"rate={rate}Hz"] * bool(rate))


def picked_length(form: Mapping[str, str]) -> float | None:
    """Return a form's target length [m], or None; ValueError if out of range."""
    text = form.get("target", "").strip().replace(",", ".")
    if not text:
        return None
    return in_range("target", _number("target", text), 5.0, 150.0, "mm", "Give it from the clamp.") / 1e3


def _number(name: str, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise ValueError(f"{name} = {text[:40]!r} is no number. Give one, or leave it empty.") from None


class Uploads:
    """Uploads that wait for columns to be named; the oldest of too many goes."""

    def __init__(self) -> None:
        self._staged: dict[str, tuple[Upload, Path]] = {}
        self._guard = threading.Lock()

    def add(self, files: Sequence[tuple[str, bytes]]) -> Upload:
        """Stage files, each a name to show and its content.

        Raises ValueError if there are none or too many, or one is no text with a table of numbers; nothing is kept
        then.
        """
        if not 1 <= len(files) <= _MOST_FILES:
            raise ValueError(f"{len(files)} files cannot be taken at once. Give 1 to {_MOST_FILES}.")
        folder = Path(tempfile.mkdtemp(prefix="cutenv-upload-"))
        try:
            staged = [self._stage(folder / f"record{k}.csv", *file) for k, file in enumerate(files, 1)]
            foreign = next((file for file in staged if not file.own), None)
            columns, guess, questions = ((), {}, ()) if foreign is None else _previewed(_table_of(foreign))
        except BaseException:
            shutil.rmtree(folder, ignore_errors=True)
            raise
        upload = Upload(
            id=secrets.token_urlsafe(9), files=tuple(staged), columns=columns, guess=guess, questions=questions
        )
        with self._guard:
            oldest = list(self._staged)[: max(0, len(self._staged) + 1 - _MOST_STAGED)]
            self._staged[upload.id] = (upload, folder)
        for number in oldest:
            self.drop(number)
        return upload

    def find(self, number: str) -> Upload:
        """Return an upload by its id; LookupError if there is none."""
        try:
            return self._staged[number][0]
        except KeyError:
            raise LookupError("This upload is gone. Give the files again.") from None

    def drop(self, number: str) -> None:
        """Delete an upload; does nothing if there is none."""
        with self._guard:
            staged = self._staged.pop(number, None)
        if staged is not None:
            shutil.rmtree(staged[1], ignore_errors=True)

    def close(self) -> None:
        """Delete all uploads."""
        for number in list(self._staged):
            self.drop(number)

    def _stage(self, path: Path, name: str, content: bytes) -> DroppedFile:
        shown = re.sub(r"[^\w .()+-]", "_", re.split(r"[\\/]", name)[-1])[-80:] or "record"
        if content and max(map(len, re.split(rb"[\r\n]", content))) > _LONGEST_LINE:
            raise ValueError(f"{shown}: a line is longer than {_LONGEST_LINE} bytes. Export the record as text.")
        path.write_bytes(content)
        return DroppedFile(shown, path, bool(content) and is_own(path))


def _table_of(file: DroppedFile) -> NamedColumns:
    try:
        table = sniff_table(file.path)
    except RecordError as error:
        raise ValueError(f"{file.name}: {error.reason}") from None
    if table.n_columns > _MOST_COLUMNS:
        raise ValueError(f"{file.name}: it has {table.n_columns} columns; export at most {_MOST_COLUMNS} of them.")
    return table


def _previewed(table: NamedColumns) -> tuple[tuple[PreviewColumn, ...], dict[str, str], tuple[str, ...]]:
    """Return first cells of each column, proposed form, and open questions."""
    cells = [tuple(table.text(k)[:_SHOWN_ROWS]) for k in range(table.n_columns)]
    names = [*table.headers, *[""] * table.n_columns]
    columns = tuple(PreviewColumn(names[k], cells[k]) for k in range(table.n_columns))
    form: dict[str, str] = {}
    try:
        found = proposal(table)
    except RecordError as error:  # no column can be a force: the teacher may know better
        return columns, form, (error.reason,)
    items = found.items
    for field in ("time", "force", "position"):
        if field not in items:
            continue
        expression = parse_expression(field, items[field])
        place = table.index(expression.columns[0])
        form[field] = str(place + 1)
        if expression.sign < 0.0:
            form[f"{field}_sign"] = "-"
        if not table.stated(place):
            form[f"{field}_unit"] = expression.unit or items.get("unit" if field == "force" else "", _SI[field])
    if "rate" in items:
        form["rate"] = items["rate"].removesuffix("Hz")
    return columns, form, tuple(map(str, found.questions))
