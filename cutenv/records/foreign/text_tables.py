"""Tables of numbers from any program.

Encoding, separator, decimal sign, header, units and specimens are detected.
"""

from __future__ import annotations

import csv
import functools
import re
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from cutenv._base.arrays import Array
from cutenv.records.foreign.cell_values import (
    MISSING,
    MOMENT_PATTERN,
    NUMBER_PATTERNS,
    CellValues,
    cell_values,
    may_be_thousands,
    plain_float,
)
from cutenv.records.foreign.maker_headers import MakerHeader, maker_header, stated_force_unit, stated_rate
from cutenv.records.foreign.named_columns import LeftOut, NamedColumns, RowNumbers
from cutenv.records.foreign.stated_units import known_spelling, split_header
from cutenv.records.foreign.table_layouts import one_column_a_channel, side_by_side, whole_times, with_unit_columns
from cutenv.records.foreign.text_lines import plain_rows, tabled, text_lines
from cutenv.records.schema import RecordError


class Dialect(NamedTuple):
    """Cell separator (a space means any blanks) and decimal sign."""

    separator: str
    decimal: str


# In order of preference if two explain the lines equally well; quotation marks distinguish commas of both kinds.
_DIALECTS = [Dialect(*pair) for pair in ("\t.", "\t,", ";.", ";,", ",.", "|.", "|,", " .", " ,", ",,")]
_NAMES = {"\t": "tab", ";": "semicolon", ",": "comma", "|": "bar", " ": "blanks"}
_SAMPLE = 400  # lines from which the separator is chosen
_NO_ROW = re.compile(r"\s*(?:$|[#%!]|/[/*])")  # lines that are blank or comments; "/ft" is a topic
_KEY_LINE = re.compile(r"\w[\w ]{0,30}:\s+\S.*")  # "rows: 1361", which names no columns
_POINT, _COMMA = re.compile(r"\d\.\d"), re.compile(r"\d,\d")
_DIGIT = re.compile(r"\d")
_NUMBER = {sign: re.compile(pattern) for sign, pattern in NUMBER_PATTERNS.items()}
_GROUPED = {
    ".": re.compile(r"[+-]?[1-9]\d{0,2}(?:[, '\u2019\u00a0\u202f\u2009]\d{3})+(?:\.\d*)?"),
    ",": re.compile(r"[+-]?[1-9]\d{0,2}(?:[. '\u2019\u00a0\u202f\u2009]\d{3})+(?:,\d*)?"),
}
_RUN = 5  # rows below one another that begin a table
_FEWEST_NUMBERS = 0.25  # share of the filled cells that are numbers, in a table
_COMMON = 0.05  # share of the rows above which a length or a gap is the file's habit, not damage


def sniff_table(path: Path, lines: list[str] | None = None) -> NamedColumns:
    """Read a text file, or lines, and detect its format."""
    lines = text_lines(path) if lines is None else lines
    parted = tabled(lines)
    if parted is not None:
        cells = [[cell.strip() for cell in column] for column in zip(*parted.rows, strict=True)]
        lost = (LeftOut(count=parted.odd, reason="lines of another form"),) if parted.odd else ()
        columns = NamedColumns(
            path=path,
            headers=tuple(parted.names),
            n_columns=len(cells),
            lines=np.array(parted.lines),
            about=parted.kind,
            typed=functools.cache(lambda k: cell_values(cells[k], ".")),
            text=lambda k: cells[k],
            rate=stated_rate(parted.facts),
            left_out=lost,
        )
        return with_unit_columns(whole_times(columns))
    lines = plain_rows(lines)
    table = whole_times(_Reading(path, lines, maker_header(lines)).table())
    return with_unit_columns(one_column_a_channel(side_by_side(table)))


def split_row(row: str, separator: str) -> list[str]:
    """Return a line's cells; quoted ones may contain the separator."""
    if '"' in row:
        try:
            (cells,) = csv.reader([row.strip(" ")], delimiter=separator, skipinitialspace=True)
        except (csv.Error, ValueError):  # a quotation that does not end, or is as long as the file
            cells = row.split(separator)
        return [cell.strip() for cell in cells]
    if separator == "|":
        row = row.strip().strip("|")
    return row.split() if separator == " " else [cell.strip() for cell in row.split(separator)]


@dataclass
class _Rows:
    """Rows of cells in one dialect, unread."""

    dialect: Dialect
    length: int  # of cells
    numeric: list[int]  # columns of numbers
    first: int  # place among the written lines
    share: float


class _Reading:
    """One pass over the lines of a text file."""

    def __init__(self, path: Path, lines: list[str], stated: MakerHeader) -> None:
        self.path, self.stated = path, stated
        self.raw = lines
        self.lines = stated.lines
        self.written = [i for i, line in enumerate(self.lines) if not _NO_ROW.match(line)]
        self.written = [i for i in self.written if self.lines[i].strip("\t ,;|-+=")] or self.written
        if not self.written:
            raise RecordError(path, "it holds no numbers: every line is blank or a comment.")
        around = max(0, len(self.written) // 2 - _SAMPLE // 2)
        self.sample = [self.lines[i] for i in self.written[around : around + _SAMPLE]]

    def table(self) -> NamedColumns:
        """Return the table in the best dialect."""
        marks = set().union(*self.sample)
        # Separators that stand nowhere part the lines alike: the first of them speaks for the others.
        nowhere = next((each for each in _NAMES if each not in marks and each != " "), None)
        explained = {
            dialect: _explained(self.sample, dialect)
            for dialect in _DIALECTS
            if dialect.separator in marks or dialect.separator in (" ", nowhere)
        }
        best = [dialect for dialect, share in explained.items() if share >= max(explained.values()) - 1e-9]
        found = [rows for dialect in best if (rows := self._rows(dialect)) is not None]
        if not found:
            raise RecordError(self.path, "it holds no rows of numbers, parted by commas, semicolons, tabs or blanks.")
        # A sample of whole numbers does not show the decimal sign; the other rows do. "0,15" is one number or two; if
        # both explain the lines, the header decides.
        chosen = max(
            found,
            key=lambda rows: (
                rows.dialect.decimal == self._decimal_sign(rows),
                len(self._header(rows).names) == rows.length,
                rows.length > 1,
            ),
        )
        return self._read(chosen)

    def _rows(self, dialect: Dialect) -> _Rows | None:
        rows = [split_row(line, dialect.separator) for line in self.sample]
        is_number = functools.partial(_is_number, decimal=dialect.decimal)
        rows = [row for row in rows if any(map(is_number, row))]
        if not rows:
            return None
        counts = Counter(map(len, rows))
        usual = counts.most_common(1)[0][0]
        length = max(
            n for n, count in counts.items() if n == usual or (n > usual and count > max(2, _COMMON * len(rows)))
        )
        rows = [[*row, *[""] * (length - len(row))] for row in rows if usual <= len(row) <= length]
        filled = [[row[k] for row in rows if row[k]] for k in range(length)]
        numeric = [k for k, cells in enumerate(filled) if cells and 2 * sum(map(is_number, cells)) >= len(cells)]
        n_filled, n_numbers = sum(map(len, filled)), sum(len(filled[k]) for k in numeric)
        if not numeric or n_numbers < _FEWEST_NUMBERS * n_filled:
            return None
        texts = [k for k in range(length) if k not in numeric and filled[k]]
        if dialect.separator == " " and len(texts) > 1:  # words between numbers are prose
            return None

        def holds_numbers(line: str) -> bool:
            cells = split_row(line, dialect.separator)
            if not usual <= len(cells) <= length:
                return False
            found = [is_number(cells[i]) if i < len(cells) else False for i in numeric]
            return any(found) and all(
                good or i >= len(cells) or MISSING.fullmatch(cells[i]) for good, i in zip(found, numeric, strict=True)
            )

        first = self._first(holds_numbers)
        return None if first is None else _Rows(dialect, length, numeric, first, n_numbers / n_filled)

    def _first(self, holds_numbers: Callable[[str], bool]) -> int | None:
        """Return the first row's place, the first of a run."""
        anywhere = None
        for k, i in enumerate(self.written):
            if not holds_numbers(self.lines[i]):
                continue
            anywhere = k if anywhere is None else anywhere
            run = [self.lines[j] for j in self.written[k + 1 : k + _RUN]]
            if all(map(holds_numbers, run)):
                return k
        return anywhere

    def _decimal_sign(self, rows: _Rows) -> str:
        here = [self.lines[i] for i in self.written[rows.first :]]
        points, commas = (any(sign.search(row) for row in here) for sign in (_POINT, _COMMA))
        if commas and points:  # one of them parts thousands
            return rows.dialect.decimal
        return "," if commas and not points and rows.dialect.separator != "," else "."

    def _header(self, rows: _Rows) -> _Header:
        above = (
            self.raw[: self.written[rows.first]] if not self.stated.maker else self.lines[: self.written[rows.first]]
        )
        found = _header_of(above, rows.dialect, rows.length, rows.numeric)
        if self.stated.names and not found.names:
            names, units = self.stated.names, self.stated.units
            if names[0] == "Time" and rows.length == len(names) - 1:  # exported without the time
                names, units = names[1:], units[1:]
            return _Header(names[: rows.length], units[: rows.length], "")
        if self.stated.units:
            return found._replace(units=self.stated.units)
        return found

    def _read(self, rows: _Rows) -> NamedColumns:
        here = self.written[rows.first :]
        header = self._header(rows)
        above = [line for line in self.lines[: here[0]] if line.strip()]
        separator, decimal = rows.dialect
        lines = [self.lines[i] for i in here]
        numbers = self._all_numbers(lines, rows)
        left_out: list[LeftOut] = []
        parts: RowNumbers | None = None
        part_names: tuple[str, ...] = ()
        if numbers is not None:
            kept = np.array(here)
            parts, part_names = _blocks(self._gaps_of_header(kept), len(kept))
            columns = dict(zip(rows.numeric, numbers.T, strict=True))
            text = _columns_of(lines, {}, rows)
            typed: Callable[[int], CellValues] = functools.cache(lambda k: _typed(columns, text, k, decimal))
        else:
            sound = self._sound(lines, np.array(here), rows, header)
            kept, left_out, parts, part_names = sound.places, sound.left_out, sound.parts, sound.part_names
            text, columns = sound.cells, sound.numbers
            typed = functools.cache(lambda k: _typed(columns, sound.cells, k, decimal))
        typed = self.stated.scaled(header.names, typed)
        if 2 * len(kept) < len(here):
            raise RecordError(self.path, "it holds no table of numbers: most of its lines are of another form.")
        sign = "comma" if decimal == "," else "point"
        maker = f"{self.stated.maker}, " if self.stated.maker else ""
        rate = self.stated.rate if self.stated.maker else stated_rate(above)
        return NamedColumns(
            path=self.path,
            headers=header.names,
            units=header.units,
            n_columns=rows.length,
            lines=kept + 1,
            about=f"{maker}separator {_NAMES[separator]}, decimal {sign}",
            typed=typed,
            text=text,
            parts=parts,
            part_names=part_names,
            part_starts=self.stated.starts if parts is not None and len(self.stated.starts) == len(part_names) else (),
            rate=rate,
            force_unit=stated_force_unit(above),
            left_out=tuple(left_out),
            above=header.above,
        )

    def _all_numbers(self, lines: list[str], rows: _Rows) -> Array | None:
        """Return whole rows' numbers, shape (n, numeric columns), or None."""
        separator, decimal = rows.dialect
        if '"' in lines[0] or any('"' in line for line in lines) or (decimal == separator) or separator == "|":
            return None
        if len(lines) > 1 and self.raw[-1] != "" and len(lines[-1]) < len(lines[-2]):
            return None  # perhaps cut off
        lengths = (
            {len(line.split()) for line in lines} if separator == " " else {line.count(separator) + 1 for line in lines}
        )
        if lengths != {rows.length}:
            return None
        if decimal == ",":
            lines = [line.replace(",", ".") for line in lines]
        try:
            values = np.loadtxt(
                lines, delimiter=None if separator == " " else separator, usecols=rows.numeric, comments=None, ndmin=2
            )
        except (ValueError, OverflowError):
            return None
        whole = len(values) == len(lines) and bool(np.isfinite(values).all())
        if not whole or any(may_be_thousands(column) for column in values.T):
            return None
        return values

    def _sound(self, lines: list[str], places: RowNumbers, rows: _Rows, header: _Header) -> _Sound:
        """Separate sound rows from other lines below the first."""
        separator, decimal = rows.dialect
        whole = _whole_line(rows, lines)
        split = {i: split_row(line, separator) for i, line in enumerate(lines) if not (whole and whole(line))}
        counts = Counter(map(len, split.values())) + Counter({rows.length: len(lines) - len(split)})
        shortest = min(k for k, count in counts.items() if count >= _COMMON * len(lines) or len(counts) == 1)
        wordy = set() if whole else _common_words(list(split.values()), rows.numeric, decimal)
        judge = _LineJudge(rows, header, shortest, wordy)
        kinds = [judge.kind(split[i]) if i in split else "row" for i in range(len(lines))]
        if bool(self.raw[-1]) and places[-1] == len(self.raw) - 1:
            last = [split_row(line, separator) for line in lines[-10:]]
            kinds[-1] = "incomplete" if _is_cut_off(last[-1], last[:-1]) else kinds[-1]
        good: list[int] = []
        borders: list[int] = []  # numbers of sound rows in front of text
        other_columns = False
        for i, kind in enumerate(kinds):
            if kind in ("header", "other header"):
                other_columns = kind == "other header"
            if kind == "row" and other_columns:
                kinds[i] = "other columns"
            elif kind == "row":
                good.append(i)
            elif kind != "incomplete" and kind != "odd":
                borders.append(len(good))
        gaps = self._gaps_of_header(places[good])
        kept, own = [lines[i] for i in good], {k: split[i] for k, i in enumerate(good) if i in split}
        left_out = []
        for kind, reason in _REASONS.items():
            where = [i for i, each in enumerate(kinds) if each == kind]
            if where:
                example = f"line {places[where[0]] + 1}: {lines[where[0]].strip()[:40]!r}"
                left_out.append(LeftOut(count=len(where), reason=f"{reason} ({example})"))
        parts, names = _blocks([*borders, *gaps], len(good))
        numbers = _few_gaps(kept, own, rows) if whole else {}
        return _Sound(_columns_of(kept, own, rows), numbers, places[good], left_out, parts, names)

    def _gaps_of_header(self, places: RowNumbers) -> list[int]:
        """Return the rows before which a segment's header was repeated."""
        if not self.stated.starts:
            return []
        jumps = np.flatnonzero(np.diff(places) > 3) + 1
        return [
            int(k) for k in jumps if any(self.raw[i].startswith("Channels") for i in range(places[k - 1], places[k]))
        ]


def _typed(columns: dict[int, Array], text: Callable[[int], Sequence[str]], k: int, decimal: str) -> CellValues:
    """Return a column of numbers, reread as text for large ones."""
    found = columns.get(k)
    if found is not None and np.abs(found[np.isfinite(found)]).max(initial=0.0) < 2.0**53:
        return CellValues(values=found)
    return cell_values(text(k), decimal)


def _columns_of(lines: list[str], split: dict[int, list[str]], rows: _Rows) -> Callable[[int], Sequence[str]]:
    """Return a function from column to cells, padded in short lines."""

    @functools.cache
    def cells() -> list[list[str]]:
        every = [split.get(i) or split_row(line, rows.dialect.separator) for i, line in enumerate(lines)]
        return [[each[k] if k < len(each) else "" for each in every] for k in range(rows.length)]

    return lambda k: cells()[k]


def _whole_line(rows: _Rows, lines: list[str]) -> Callable[[str], object] | None:
    """Return a quick test for lines of plain numbers, or None."""
    separator, decimal = rows.dialect
    if separator in (" ", "|") or separator == decimal or len(rows.numeric) < rows.length:
        return None
    number = rf"\s*(?:{NUMBER_PATTERNS[decimal]})\s*"
    whole = re.compile(rf"{number}(?:{re.escape(separator)}{number}){{{rows.length - 1}}}").fullmatch
    sample = lines[:: max(1, len(lines) // 200)]
    return whole if 2 * sum(whole(line) is not None for line in sample) > len(sample) else None


def _few_gaps(lines: list[str], split: dict[int, list[str]], rows: _Rows) -> dict[int, Array]:
    """Return columns of plain numbers with NaN gaps, or {}."""
    separator, decimal = rows.dialect
    plain = list(lines)
    for i, cells in split.items():
        filled = [*cells[: rows.length], *[""] * (rows.length - len(cells))]
        if not all(_NUMBER[decimal].fullmatch(cell) or MISSING.fullmatch(cell) for cell in filled):
            return {}
        plain[i] = separator.join(cell if _NUMBER[decimal].fullmatch(cell) else "nan" for cell in filled)
    plain = [line.replace(",", ".") for line in plain] if decimal == "," else plain
    try:
        values = np.loadtxt(plain, delimiter=separator, comments=None, ndmin=2)
    except (ValueError, OverflowError):
        return {}
    return {} if any(may_be_thousands(column) for column in values.T) else dict(enumerate(values.T))


def _blocks(borders: Sequence[int], n: int) -> tuple[RowNumbers | None, tuple[str, ...]]:
    """Return each row's block by the borders, and block names."""
    inner = sorted({k for k in borders if 0 < k < n})
    if not inner:
        return None, ()
    parts = np.searchsorted(np.array(inner), np.arange(n), side="right")
    return parts, tuple(f"block {k + 1}" for k in range(len(inner) + 1))


class _Sound(NamedTuple):
    """Sound rows' cells by column, with places, omitted lines and blocks."""

    cells: Callable[[int], Sequence[str]]
    numbers: dict[int, Array]
    places: RowNumbers
    left_out: list[LeftOut]
    parts: RowNumbers | None
    part_names: tuple[str, ...]


_REASONS = {
    "incomplete": "incomplete lines, or of more cells than the others",
    "odd": "lines with words in place of numbers",
    "text": "lines that are no readings",
    "other header": "lines that are no readings",
    "other columns": "rows below another header",
    "header": "the header, repeated between the rows",
}


class _LineJudge:
    """Judge of the lines below the first row."""

    def __init__(self, rows: _Rows, header: _Header, shortest: int, wordy: set[int]) -> None:
        self.rows, self.shortest, self.wordy = rows, shortest, wordy
        self.number = functools.partial(_is_number, decimal=rows.dialect.decimal)
        self.heads = [[_bare(cell) for cell in cells[: rows.length]] for cells in (header.names, header.units)]

    def kind(self, cells: list[str]) -> str:
        """Return "row", "incomplete", or why a line is no row."""
        found = odd = 0
        for k in self.rows.numeric:
            if k >= len(cells) or not (cell := cells[k]):
                continue
            try:
                plain_float(cell, self.rows.dialect.decimal)
                found += 1
                continue
            except ValueError:
                pass
            if self.number(cell):
                found += 1
            elif k not in self.wordy and not MISSING.fullmatch(cell):
                odd += 1
        if not found:
            return self._text(cells)
        if odd:
            return "odd"
        more = cells[self.rows.length :]
        return "incomplete" if len(cells) < self.shortest or any(map(self.number, more)) else "row"

    def _text(self, cells: list[str]) -> str:
        """Return what a line without numbers is."""
        filled = [cell for cell in cells if cell]
        if all(MISSING.fullmatch(cell) for cell in filled):
            return "row" if len(cells) >= self.shortest else "incomplete"
        bare = [_bare(cell) for cell in cells[: self.rows.length]]
        if any(head[: len(bare)] == bare for head in self.heads):
            return "header"
        wide = len(filled) >= max(2, self.shortest - 1) and not any(map(self.number, filled))
        return "other header" if wide and not all(map(_is_unit, filled)) else "text"


def _bare(cell: str) -> str:
    """Return a name or unit without brackets, lower-case."""
    return split_header(cell)[0].strip("()[] ").lower()


def _is_cut_off(cells: list[str], before: list[list[str]]) -> bool:
    """Return whether the last line breaks off, shorter or less precise."""
    usual = [row for row in before if len(row) >= len(cells)]
    if not usual:
        return False
    if len(cells) < len(usual[-1]):
        return True
    decimals = {len(row[len(cells) - 1].partition(".")[2] or row[len(cells) - 1].partition(",")[2]) for row in usual}
    last = cells[-1].replace(",", ".").partition(".")[2]
    return len(decimals) == 1 and len(last) < next(iter(decimals))


def _common_words(split: list[list[str]], numeric: list[int], decimal: str) -> set[int]:
    """Return columns with common words, such as remarks."""
    sample = split[:: max(1, len(split) // 1000)]
    found = set()
    for k in numeric:
        cells = [row[k] for row in sample if k < len(row) and row[k]]
        words = sum(not _is_number(cell, decimal=decimal) and not MISSING.fullmatch(cell) for cell in cells)
        if words > max(2, _COMMON * len(cells)):
            found.add(k)
    return found


@functools.lru_cache(maxsize=1 << 14)
def _is_number(cell: str, *, decimal: str) -> bool:
    """Return whether a cell holds a number or a time.

    A number may have thousands or a unit.
    """
    if _NUMBER[decimal].fullmatch(cell):
        return True
    if not _DIGIT.search(cell):
        return False
    if _GROUPED[decimal].fullmatch(cell) or MOMENT_PATTERN.fullmatch(cell):
        return True
    number = _NUMBER[decimal].match(cell)
    return number is not None and _is_unit(cell[number.end() :])


def _is_unit(text: str) -> bool:
    return known_spelling(text) is not None


def _explained(sample: list[str], dialect: Dialect) -> float:
    """Return the share of lines in regular rows of numbers [1]."""
    rows = [split_row(line, dialect.separator) for line in sample]
    length, _ = Counter(len(row) for row in rows).most_common(1)[0]
    cells = [cell for row in rows if len(row) == length for cell in row]
    numbers = sum(len(cell) + 1 for cell in cells if not cell or _is_number(cell, decimal=dialect.decimal))
    if all(not cell for cell in cells):
        return 0.0
    return numbers / sum(len(cell) + 1 for row in rows for cell in row)


class _Header(NamedTuple):
    """Names and units of columns, or a description instead."""

    names: tuple[str, ...]
    units: tuple[str, ...]
    above: str


def _header_of(above: Sequence[str], dialect: Dialect, length: int, numeric: Sequence[int]) -> _Header:
    """Return names and units from lines above the numbers."""
    filled = [line.lstrip(" #%/!").rstrip("\n ") if line.lstrip()[:1] in "#%/!" else line for line in above]
    written = filled = [line for line in filled if line.strip("\t ,;|-+=:")]
    if dialect.separator == " ":
        filled = [line for line in filled if not _KEY_LINE.fullmatch(line.strip())]
    if not written:
        return _Header((), (), "nothing stands above them")
    rows = [_header_cells(line, dialect, length) for line in filled[-16:] if line.lstrip()[:1] != "{"]
    labelled_names, labelled_units = _labelled(rows, length)
    units, names = _names_and_units([row for row in rows[-8:] if not _label_of(row)], length)
    if labelled_units or (labelled_names and not units):
        names, units = labelled_names or names, labelled_units or units
    if units and any(_IN_VOLTS.search(line) for line in written):  # the units are those after a calibration
        units = tuple("V" if unit else "" for unit in units)
    if len(rows[-1:] and rows[-1]) == length > 1 and rows[-1][0] and not any(rows[-1][1:]) and len(names) >= length:
        names = [rows[-1][0], *names[1:]]  # pandas writes the name of an index below those of the columns
    if len(names) == length - 1 and length - 1 not in numeric:  # a separator at the end of every row
        names = [*names, ""]
    if len(names) == length - 1 and not units and all(names):  # R leaves the corner above its row names out
        return _Header(("row", *names), (), "")
    if len(names) < length and (listed := _listed(written, length)):
        names = listed
    if len(names) < length:
        last = written[-1].strip()
        n_names = len(rows[-1]) if rows else 0
        return _Header((), units, f"above them stands {last[:60]!r}: {n_names} names for {length} columns")
    if not units:
        units = _units_of_groups(rows, list(names))
    return _Header(tuple(names), tuple(units), "")


_IN_VOLTS = re.compile(r"\bdata in volts?\b", re.IGNORECASE)
_LISTED = re.compile(
    r"(?:(?:channel|column|col|ch|kanal|spalte|field)\s*#?)?(\d+)\s*[:=.)-]\s*([^\W\d].*)", re.IGNORECASE
)
_OF_AXIS = re.compile(r"(?:.*[^a-z])?[fmt]?[xyz]|[fmt][xyz]\W.*", re.IGNORECASE)


def _listed(lines: Sequence[str], length: int) -> list[str]:
    """Return column names from lines such as ``Channel 1: Force [N]``."""
    found = [found for line in lines if (found := _LISTED.fullmatch(line.strip())) is not None]
    numbers, names = [int(each[1]) for each in found], [each[2].strip() for each in found]
    if not numbers or numbers != list(range(numbers[0], numbers[0] + len(numbers))):
        return []
    before = length - len(names)  # one of time or of numbers stands in front of the channels
    return [*[""] * before, *names] if before in (0, 1) else []


def _units_of_groups(rows: list[list[str]], names: list[str]) -> tuple[str, ...]:
    """Return units from a line above the names: ``Force (lbf),,,Torque (Nmm),,``."""
    for above in reversed(rows[: rows.index(names)] if names in rows else []):
        said = [split_header(cell)[1] for cell in above]
        first = next((k for k, cell in enumerate(above) if cell), len(above))
        spans = first + 1 < len(above) and not above[first + 1]
        if not spans or not any(map(_is_unit, filter(None, said))):
            continue
        units, current = [], ""
        for k, name in enumerate(names):
            if k < len(above) and above[k]:
                current = said[k] if _is_unit(said[k]) else ""
            units.append(current if _OF_AXIS.fullmatch(split_header(name)[0]) else "")
        return tuple(units)
    return ()


_LABELS = {
    "units": re.compile(r"(?:(?:v|y|vert|vertical|channel)[ _]?)?units?|einheit(?:en)?", re.IGNORECASE),
    "names": re.compile(r"(?:trace|channel|signal|column|long|label)?[ _]?names?|signals?|labels?", re.IGNORECASE),
}


def _labelled(rows: list[list[str]], length: int) -> tuple[list[str], tuple[str, ...]]:
    """Return names and units of lines with a leading label."""
    found: dict[str, list[str]] = {}
    for cells in rows:
        what = _label_of(cells)
        if not what or len(cells) < min(3, length) or length == 1 or not any(cells[1:]):
            continue
        before = max(0, length + 1 - len(cells))  # a label above counter and time, or above the first column
        found[what] = [*[""] * before, *cells[1:]][:length]
    units, names = found.get("units", []), found.get("names", [])
    return names, tuple(units) if _are_units(units) else ()


def _label_of(cells: list[str]) -> str:
    """Return a line's label from its first cell: "units", "names", ""."""
    if len(cells) < 2:
        return ""
    return next((what for what, label in _LABELS.items() if label.fullmatch(cells[0].rstrip(" :="))), "")


def _names_and_units(rows: list[list[str]], length: int) -> tuple[tuple[str, ...], list[str]]:
    """Return units and names from the last lines above a table."""
    for k in range(len(rows) - 1, max(-1, len(rows) - 5), -1):
        if not _are_units(rows[k]):
            continue
        n_units = sum(bool(cell) for cell in rows[k])
        above = [row for row in rows[:k] if len(row) >= length and sum(map(bool, row)) >= max(1, n_units - 1)]
        if above:
            return tuple(rows[k]), above[-1]
        below = [row for row in rows[k + 1 :] if len(row) >= length and all(row[:length])]
        if below:
            return tuple(rows[k]), below[0]
        if all(not cell or _is_unit(cell) for cell in rows[k]):
            return tuple(rows[k]), list(rows[k])
    for cells in reversed(rows):
        n_filled = sum(bool(cell) for cell in cells)
        if any(_NUMBER["."].fullmatch(cell) for cell in cells):
            continue
        if n_filled > 1 and len(rows) > 1 and len({*cells} - {""}) == 1:  # the same of every column names none
            continue
        if n_filled > 1 or (n_filled == 1 and length <= 2 and (length == 1 or (len(cells) == 2 and not cells[0]))):
            if 2 * n_filled < min(length, 8) and len(cells) <= length and _is_label(rows, cells, length):
                continue
            return (), cells
    return (), []


def _is_label(rows: list[list[str]], cells: list[str], length: int) -> bool:
    """Return whether a line names specimens, below fuller lines."""
    here = sum(bool(cell) for cell in cells)
    return any(len(row) >= length and sum(bool(cell) for cell in row) > here and row is not cells for row in rows)


def _header_cells(line: str, dialect: Dialect, length: int) -> list[str]:
    if dialect.separator != " ":
        cells = split_row(line.strip(" "), dialect.separator)
        if len(cells) > length and "(" in line and '"' not in line:  # "Load(8800 (0,3):Load) (N)" is one name
            whole = re.split(rf"{re.escape(dialect.separator)}(?![^()]*\))", line.strip())
            cells = [cell.strip() for cell in whole] if len(whole) == length else cells
        return cells
    wide = [cell for cell in re.split(r"\s{2,}|\t", line.strip()) if cell]
    if len(wide) == length:
        return wide
    cells = split_row(re.sub(r"\s+(?=[\[(])", "", line), " ")  # "time [s] force [N]" are two names
    if len(cells) == length:
        return cells
    for separator in (",", ";", "\t"):
        other = split_row(line, separator)
        if len(other) == length:
            return other
    return cells


def _are_units(cells: Sequence[str]) -> bool:
    said = [cell.strip() for cell in cells if cell.strip()]
    if not said:
        return False
    known = [_is_unit(cell) for cell in said]
    if all(re.fullmatch(r"[\[(<{].{0,12}[\])>}]", cell) for cell in said):
        return any(known) or len(said) > 1
    return any(known) and 2 * sum(known) >= len(said) and all(len(cell) <= 12 for cell in said)
