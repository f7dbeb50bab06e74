"""Tables of numbers from any program: encoding, separator, decimal sign, header and units are detected."""

from __future__ import annotations

import csv
import difflib
import re
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cutenv._base.arrays import Array
from cutenv.recording.column_map import known_unit
from cutenv.recording.schema import UNITS, UTF_16, RecordError, check_beginning


class Dialect(NamedTuple):
    """Separator of cells (a space: any number of blanks), and decimal sign."""

    separator: str
    decimal: str


# In order of preference if two explain the lines equally well; quotation marks distinguish commas of both kinds.
_DIALECTS = [Dialect(*pair) for pair in ("\t.", "\t,", ";.", ";,", ",.", " .", " ,", ",,")]
_NAMES = {"\t": "tab", ";": "semicolon", ",": "comma", " ": "blanks"}
_SAMPLE = 400  # lines from which the separator is chosen
_NO_ROW = frozenset(("", "#", "%", "/"))  # beginnings of lines that are blank or comments
_NUMBERS = {
    ".": re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"),
    ",": re.compile(r"[+-]?(?:\d+(?:,\d+)?|,\d+)(?:[eE][+-]?\d+)?"),
}
_POINT, _COMMA = re.compile(r"\d\.\d"), re.compile(r"\d,\d")
_MISSING = re.compile(r"|--?|[+-]?(nan|inf(inity)?)|#?n/?a|#value!|#div/0!|null|none", re.IGNORECASE)
_BRACKETS = re.compile(r"(.*\S)\s*[\[(]([^\[\]()]*)[\])]")


@dataclass(frozen=True, kw_only=True, eq=False)
class SniffedTable:
    """Rows of a text file, with the content of its header.

    Attributes
    ----------
    path : Path
        Path of the file.
    headers : tuple of str
        Headers of the columns, as in the file; empty if it has none.
    units_row : tuple of str
        Units below the headers, empty if there is no such row.
    separator, decimal : str
        Separator of cells (a space: any number of blanks), and decimal sign.
    rows : list of str
        Lines that hold numbers.
    lines : ndarray of int, shape (n,)
        Their numbers in the file, from 1.
    n_columns : int
        Number of cells in a row.
    above : str
        Text above the numbers in place of a header, for messages.
    """

    path: Path
    headers: tuple[str, ...]
    units_row: tuple[str, ...]
    separator: str
    decimal: str
    rows: list[str]
    lines: NDArray[np.intp]
    n_columns: int
    above: str
    row_name: ClassVar[str] = "line"
    """Word for a row in messages."""

    def __str__(self) -> str:
        decimal = "comma" if self.decimal == "," else "point"
        return f"{self.n_columns} columns, separator {_NAMES[self.separator]}, decimal {decimal}, {len(self.rows)} rows"

    def index(self, name: str) -> int:
        """Return the index of the column with this name, with or without its unit, or at this place (``#2``).

        Raises
        ------
        RecordError
            If none or several match; the message names the nearest.
        """
        if (place := re.fullmatch(r"#(\d{1,9})", name)) is not None:
            if not 1 <= int(place[1]) <= self.n_columns:
                raise RecordError(self.path, f"there is no column {name}: the rows have {self.n_columns}.")
            return int(place[1]) - 1
        if not self.headers:
            raise RecordError(
                self.path,
                f"there is no column {name!r}, for no line above the numbers names them ({self.above}). Write a line "
                "of names there, or name columns by their place: time=#1 force=#2.",
            )
        spellings: list[Callable[[str], str]] = [str.strip, lambda text: bare_name(text).lower(), column_stem]
        for spelling in spellings:
            found = [i for i, header in enumerate(self.headers) if spelling(header) == spelling(name)]
            if len(found) > 1:
                places = " and ".join(f"#{i + 1}" for i in found)
                raise RecordError(self.path, f"columns {places} are both called {name!r}. Name the one by its place.")
            if found and found[0] < self.n_columns:
                return found[0]
        names = {bare_name(header).lower(): header for header in self.headers[: self.n_columns] if header}
        nearest = difflib.get_close_matches(bare_name(name).lower(), names, n=1, cutoff=0.5)
        hint = f" Did you mean {bare_name(names[nearest[0]])!r}?" if nearest else ""
        raise RecordError(self.path, f"there is no column {name!r}; there are {', '.join(names.values())}.{hint}")

    def unit(self, index: int, field: str) -> str | None:
        """Return the unit that the header gives a column as a field of a trace; None if it gives none.

        Raises
        ------
        RecordError
            If it gives an unknown one.
        """
        if index >= len(self.headers):
            return None
        header = self.headers[index]
        said = self.units_row[index] if index < len(self.units_row) else ""
        if (bracketed := _BRACKETS.fullmatch(header)) is not None:
            said = bracketed[2]
        elif not said and (ending := _without_ending(header)[1]) and _is_unit(field, ending):
            said = ending
        elif not said and header.strip() == "force_1" and field == "force":
            said = "1"
        said = said.strip("[]() \t")
        if not said:
            return None
        try:
            return known_unit(field, said)
        except ValueError as error:
            raise RecordError(
                self.path, f"column {header!r}: {error} Or give it in the mapping: {field}={bare_name(header)}[unit]."
            ) from None

    def numbers(self, indices: list[int]) -> Array:
        """Return some columns as numbers, shape (n, len(indices)), all of them finite.

        Raises
        ------
        RecordError
            If a cell is not a number; the message names its line.
        """
        rows, separator = self.rows, self.separator
        if self.decimal == separator == ",":
            rows, separator = ["\t".join(split_row(row, ",")) for row in rows], "\t"
        if self.decimal == ",":
            rows = [row.replace(",", ".") for row in rows]
        try:
            if self._is_ragged():
                raise ValueError("rows of unequal length")
            values = np.loadtxt(
                rows,
                delimiter=None if separator == " " else separator,
                usecols=indices,
                comments=None,
                quotechar='"',
                ndmin=2,
            )
            if len(values) != len(rows) or not np.isfinite(values).all():
                raise ValueError("cells without a number")
        except (ValueError, OverflowError) as error:
            raise self._bad_cell(indices, str(error)) from None
        return values

    def texts(self, indices: list[int]) -> list[tuple[str, ...]]:
        """Return some columns as text, a tuple for each row.

        Raises
        ------
        RecordError
            If a row is too short; the message names its line.
        """
        found = []
        for row, line in zip(self.rows, self.lines, strict=True):
            cells = split_row(row, self.separator)
            if len(cells) <= max(indices):
                raise self._ragged(int(line), len(cells))
            found.append(tuple(cells[i] for i in indices))
        return found

    def _is_ragged(self) -> bool:
        if any('"' in row for row in self.rows):
            found = {len(split_row(row, self.separator)) for row in self.rows}
        elif self.separator == " ":
            found = {len(row.split()) for row in self.rows}
        else:
            found = {row.count(self.separator) + 1 for row in self.rows}
        return found != {self.n_columns}

    def _ragged(self, line: int, cells: int) -> RecordError:
        return RecordError(
            self.path,
            f"line {line} has {cells} cells, the others have {self.n_columns}. Complete the line or delete it.",
        )

    def _bad_cell(self, indices: list[int], reason: str) -> RecordError:
        """Return an error that names the bad cell; only an unreadable file is searched cell by cell."""
        number = _NUMBERS[self.decimal]
        for row, line in zip(self.rows, self.lines, strict=True):
            cells = split_row(row, self.separator)
            if len(cells) != self.n_columns:
                return self._ragged(int(line), len(cells))
            for i in indices:
                cell = cells[i]
                name = self.headers[i] if i < len(self.headers) and self.headers[i] else f"#{i + 1}"
                where = f"line {line}, column {name!r}"
                if number.fullmatch(cell) and np.isfinite(float(cell.replace(",", "."))):
                    continue
                if _MISSING.fullmatch(cell) or number.fullmatch(cell):
                    return RecordError(
                        self.path, f"{where} has no finite number but {cell!r}. Delete the line, or repair the record."
                    )
                clock = " A time of day: give rate=1000Hz (what it was) instead." if cell.count(":") else ""
                return RecordError(self.path, f"{where} has {cell[:40]!r}, which is no number.{clock}")
        return RecordError(self.path, f"its numbers are not read: {reason}.")


def sniff_table(path: Path) -> SniffedTable:
    """Read a text file, and detect its format.

    Raises
    ------
    RecordError
        If it holds no table of numbers.
    """
    lines = _decoded(path).replace("\r\n", "\n").replace("\r", "\n").split("\n")
    written = [i for i, line in enumerate(lines) if line.lstrip()[:1] not in _NO_ROW]
    if not written:
        raise RecordError(path, "it holds no numbers: every line is blank or a comment.")
    around = max(0, len(written) // 2 - _SAMPLE // 2)
    sample = [lines[i] for i in written[around : around + _SAMPLE]]
    explained = {dialect: _explained(sample, dialect) for dialect in _DIALECTS}
    best = [dialect for dialect, share in explained.items() if share == max(explained.values())]
    tables = [_table(path, lines, written, sample, dialect) for dialect in best]
    # A sample of whole numbers does not show the decimal sign; the other rows do. "0,15" is one number or two; if both
    # explain the lines, the header decides.
    return max(
        tables,
        key=lambda table: (
            table.decimal == _decimal_sign(table.rows, table.separator),
            len(table.headers) == table.n_columns,
            table.n_columns > 1,
        ),
    )


def bare_name(header: str) -> str:
    """Return a header without the unit in brackets."""
    found = _BRACKETS.fullmatch(header.strip())
    return (found[1] if found else header).strip()


def column_stem(header: str) -> str:
    """Return a header without its unit, in small letters."""
    return _without_ending(bare_name(header))[0].lower()


def _without_ending(header: str) -> tuple[str, str]:
    """Split a header such as ``force_N``, ``force / N`` or ``force in N`` into name and unit.

    Only a known unit makes an ending a unit: ``F_1`` is a channel, ``a / b`` a ratio.
    """
    parts = re.split(r"\s*/\s*|\s+in\s+", header.strip(), maxsplit=1)
    if len(parts) == 2 and any(_is_unit(field, parts[1]) for field in UNITS):
        return parts[0], parts[1]
    units = sorted({unit for units in UNITS.values() for unit in units if unit != "1"}, key=len, reverse=True)
    for unit in units:
        if header.strip().endswith(f"_{unit}") and not header.startswith("_"):
            return header.strip().removesuffix(f"_{unit}"), unit
    return header.strip(), ""


def split_row(row: str, separator: str) -> list[str]:
    """Return the cells of a line; cells in quotation marks may contain the separator."""
    if '"' in row:
        try:
            (cells,) = csv.reader([row.strip(" ")], delimiter=separator, skipinitialspace=True)
        except (csv.Error, ValueError):  # a quotation that does not end, or is as long as the file
            cells = row.split(separator)
        return [cell.strip() for cell in cells]
    return row.split() if separator == " " else [cell.strip() for cell in row.split(separator)]


def _decoded(path: Path) -> str:
    content = path.read_bytes()
    check_beginning(path, content, "text", UTF_16)
    encodings = ("utf-16",) if content[:2] in UTF_16 else ("utf-8-sig", "cp1252")
    for encoding in encodings:
        try:
            text = content.decode(encoding)
        except UnicodeDecodeError:
            continue
        if "\0" in text:
            raise RecordError(path, "it is no text: it holds zero bytes. Export the record as text, in UTF-8.")
        return text
    raise RecordError(path, "it is no text in UTF-8, UTF-16 or Windows' encoding. Save it as UTF-8.")


def _decimal_sign(rows: list[str], separator: str) -> str:
    points, commas = (any(sign.search(row) for row in rows) for sign in (_POINT, _COMMA))
    return "," if commas and not points and separator != "," else "."


def _explained(sample: list[str], dialect: Dialect) -> float:
    """Return the share of the lines that is numbers and their separators, in rows of the most frequent length [1]."""
    rows = [split_row(line, dialect.separator) for line in sample]
    length, _ = Counter(len(row) for row in rows).most_common(1)[0]
    number = _NUMBERS[dialect.decimal]
    cells = [cell for row in rows if len(row) == length for cell in row]
    numbers = sum(len(cell) + 1 for cell in cells if number.fullmatch(cell))
    return numbers / sum(len(cell) + 1 for row in rows for cell in row)


def _table(path: Path, lines: list[str], written: list[int], sample: list[str], dialect: Dialect) -> SniffedTable:
    separator, decimal = dialect
    number = _NUMBERS[decimal]
    rows = [split_row(line, separator) for line in sample]
    length, _ = Counter(len(row) for row in rows).most_common(1)[0]
    rows = [row for row in rows if len(row) == length]
    numeric = [i for i in range(length) if 2 * sum(bool(number.fullmatch(row[i])) for row in rows) >= len(rows)]

    def holds_numbers(line: str) -> bool:
        cells = split_row(line, separator)
        if len(cells) != length:
            return False
        found = [bool(number.fullmatch(cells[i])) for i in numeric]
        return any(found) and all(
            is_number or _MISSING.fullmatch(cells[i]) for is_number, i in zip(found, numeric, strict=True)
        )

    first = next((k for k, i in enumerate(written) if holds_numbers(lines[i])), None)
    if first is None:
        raise RecordError(path, "it holds no rows of numbers, parted by commas, semicolons, tabs or blanks.")
    here = written[first:]
    headers, units_row, above = _header(lines[: here[0]], separator, length)
    return SniffedTable(
        path=path,
        headers=headers,
        units_row=units_row,
        separator=separator,
        decimal=decimal,
        rows=[lines[i] for i in here],
        lines=np.array(here) + 1,
        n_columns=length,
        above=above,
    )


def _header(above: list[str], separator: str, length: int) -> tuple[tuple[str, ...], tuple[str, ...], str]:
    """Return names and units from the last lines above the numbers, and a description if there are none."""
    filled = [line.strip().lstrip("#%/").strip(" ") for line in above]
    filled = [line for line in filled if line.strip()]
    if not filled:
        return (), (), "nothing stands above them"
    last = _header_cells(filled[-1], separator)
    if len(filled) > 1 and _are_units(last):
        names = _header_cells(filled[-2], separator)
        if len(names) >= length:
            return tuple(names), tuple(last), ""
    if len(last) < length:
        return (), (), f"above them stands {filled[-1][:60]!r}: {len(last)} names for {length} columns"
    return tuple(last), (), ""


def _header_cells(line: str, separator: str) -> list[str]:
    if separator == " ":
        line = re.sub(r"\s+(?=[\[(])", "", line)  # "time [s] force [N]" are two names
    return split_row(line, separator)


def _are_units(cells: list[str]) -> bool:
    said = [cell.strip("[]() ") for cell in cells if cell.strip("[]() ")]
    return bool(said) and all(any(_is_unit(field, unit) for field in UNITS) for unit in said)


def _is_unit(field: str, text: str) -> bool:
    try:
        known_unit(field, text)
    except ValueError:
        return False
    return True
