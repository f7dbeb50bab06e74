"""Records as CSV. Comments with schema and metadata, a row of headers with units, a row for each reading."""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from cutenv._base.arrays import Array
from cutenv.records.schema import (
    SCHEMA,
    Column,
    as_names,
    check_schema,
    from_json,
    mapping_from_json,
    shortened,
    to_json,
)
from cutenv.records.table import CUT_COLUMN, CutTable, parsed_headers, table_of
from cutenv.sim.trace import Trace

_ENCODING = "utf-8-sig"  # spreadsheets write a byte order mark in front
_SCHEMA_LINE = re.compile(r"#\s*(cutenv-record\b.*)")
_FACT_LINE = re.compile(r"#\s*(?P<what>(?P<kind>metadata|columns|rows)(?: of cut (?P<cut>[0-9]{1,9}))?):(?P<json>.*)")

_ROWS = ("rows", None)

TRUNCATED = "truncated"
"""Key in the metadata: true if the record was not finished, and holds only what was written by then."""


@dataclass
class _Head:
    """Lines above the first row of numbers."""

    names: list[str] = field(default_factory=list)
    columns: list[Column | None] = field(default_factory=list)
    lines: int = 0
    native: bool = False
    facts: dict[tuple[str, int | None], Any] = field(default_factory=dict)

    def of_cuts(self, kind: str) -> dict[int, Any]:
        """Return facts of a kind by number of cut."""
        return {cut: fact for (which, cut), fact in self.facts.items() if which == kind and cut is not None}


def write(traces: Sequence[Trace], path: Path) -> None:
    """Write a new file; the digits restore every number exactly."""
    table = table_of(traces)
    columns: list[Iterable[str]] = [map(repr, values.tolist()) for values in table.values]
    names = list(table.headers)
    if table.cut is not None:
        names.insert(0, CUT_COLUMN)
        columns.insert(0, (f"{number:.0f}" for number in table.cut.tolist()))
    facts: dict[str, object] = {"metadata": table.shared} if table.shared else {}
    facts |= {f"metadata of cut {number}": metadata for number, metadata in table.own.items()}
    facts |= {f"columns of cut {number}": held for number, held in table.held.items()}
    with path.open("w", encoding="ascii", newline="\n") as file:
        file.write(head_text(names, len(table.values[0]), facts))
        file.writelines(",".join(row) + "\n" for row in zip(*columns, strict=True))


def head_text(names: Sequence[str], rows: int | None, facts: Mapping[str, object]) -> str:
    """Return a file's head: schema, number of rows, metadata, column names.

    Without a number (None) the record is still growing, or was never finished: its complete lines are read.
    """
    said = {"rows": rows, **facts}
    comments = "".join(f"# {kind}: {to_json(fact)}\n" for kind, fact in said.items())
    return f"# {SCHEMA}\n{comments}{','.join(names)}\n"


def read(path: Path) -> list[CutTable]:
    """Read a file as one table; a ValueError names the line at fault."""
    try:
        text = path.read_bytes().decode(_ENCODING).replace("\r\n", "\n").replace("\r", "\n")
    except UnicodeDecodeError as error:
        line, byte = error.object.count(b"\n", 0, error.start) + 1, error.object[error.start]
        raise ValueError(
            f"line {line}: the byte 0x{byte:02x} is no text in UTF-8. Save the file as CSV in UTF-8."
        ) from None
    lines = text.split("\n")
    head = _head(lines)
    growing = head.native and head.facts.get(_ROWS, 0) is None
    if growing:  # only complete lines; zero bytes replace lines that a disk lost in a power cut
        lost = (number for number in range(head.lines, len(lines)) if "\0" in lines[number])
        del lines[next(lost, -1) :]
    filled = [number for number in range(head.lines, len(lines)) if lines[number]]
    rows = [lines[number] for number in filled]
    numbers = _numbers(rows)
    if numbers is None or (numbers.size and numbers.shape[1] != len(head.names)):
        raise ValueError(_fault_of_numbers(filled, rows, head))
    if not numbers.size:
        raise ValueError("it holds no readings, only names of columns.")
    if _ROWS in head.facts and not growing:
        _check_whole(head.facts[_ROWS], len(numbers), ended=not lines[-1])
    metadata = {**head.facts.get(("metadata", None), {}), **({TRUNCATED: True} if growing else {})}
    return [
        CutTable.of(
            head.names,
            list(numbers.T),
            columns=head.columns,
            place=lambda row: f"line {filled[row] + 1}",
            native=head.native,
            shared=metadata,
            own=head.of_cuts("metadata"),
            held=head.of_cuts("columns"),
        )
    ]


def read_metadata(path: Path) -> dict[str, Any]:
    """Return the metadata shared by a file's cuts, {} without.

    Damaged lines above the rows are a ValueError, which names file and line.
    """
    try:
        with path.open(encoding=_ENCODING) as file:
            metadata: dict[str, Any] = _head(file).facts.get(("metadata", None), {})
            return metadata
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def is_own(path: Path) -> bool:
    """Return whether a file begins as a record of this package.

    The schema shows it, or headers that have units.
    """
    with path.open(encoding="latin-1") as file:  # any bytes will do: only the beginning counts
        for line in file:
            text = line.removeprefix("\xef\xbb\xbf").strip()
            if text.startswith("#"):
                if _SCHEMA_LINE.fullmatch(text):
                    return True
            elif text:
                try:
                    parsed_headers([name.strip() for name in text.split(",")])
                except ValueError:
                    return False
                return True
    return False


def _head(lines: Iterable[str]) -> _Head:
    """Read up to the headers, and check them."""
    head = _Head()
    for line in lines:
        head.lines += 1
        text = line.strip()
        if text.startswith("#"):
            _take_comment(head, text)
        elif text:
            head.names = [name.strip() for name in text.split(",")]
            break
    if not head.names:
        raise ValueError("it has no row of headers, such as time_s,force_N,position_m.")
    place = f"line {head.lines}: "
    if all(map(_is_number, head.names)):
        raise ValueError(f"{place}the first row holds numbers. Put names with units above, such as time_s,force_N.")
    for mark, called in ((";", "semicolons"), ("\t", "tabs")):
        if mark in text:
            raise ValueError(f"{place}{called} part the columns. Part them by commas, and write decimals with a point.")
    try:
        head.columns = parsed_headers(head.names)
    except ValueError as error:
        raise ValueError(f"{place}{error}") from None
    return head


def _take_comment(head: _Head, text: str) -> None:
    """Store a comment's statement about the record; ignore others."""
    if found := _SCHEMA_LINE.fullmatch(text):
        check_schema(found[1])
        head.native = True
        return
    found = _FACT_LINE.fullmatch(text)
    if not found:
        return
    what = f"line {head.lines}: {found['what']}"
    key = (found["kind"], int(found["cut"]) if found["cut"] else None)
    if key in head.facts:
        raise ValueError(f"{what} stands there twice. Keep one of the lines.")
    if found["kind"] == "metadata":
        head.facts[key] = mapping_from_json(what, found["json"])
    elif found["kind"] == "columns":
        head.facts[key] = as_names(what, from_json(what, found["json"]))
    else:
        head.facts[key] = from_json(what, found["json"])


def _numbers(rows: list[str]) -> Array | None:
    """Return the rows below the headers, shape (n, columns), or None."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # an empty file is reported in other words
        try:
            return np.loadtxt(rows, delimiter=",", comments=None, ndmin=2)
        except ValueError:
            return None


def _check_whole(announced: object, found: int, *, ended: bool) -> None:
    """Raise an error for a file that lost its end."""
    if announced != found or not ended:
        lost = "and its last line is not whole" if not ended else "rows were lost or added"
        raise ValueError(
            f"it announces {shortened(announced)} rows and holds {found}, {lost}. Take the whole file again, or delete "
            "its line '# rows: ...' if it is as it should be."
        )


def _fault_of_numbers(places: list[int], rows: list[str], head: _Head) -> str:
    """Describe the first invalid row: line, column, text and cure."""
    n = len(head.names)
    for place, row in zip(places, rows, strict=True):
        cells = row.split(",")
        if len(cells) != n:
            what = f"{len(cells)} value{'s' * (len(cells) != 1)} for {n} columns ({', '.join(head.names)})"
            return f"line {place + 1}: {what}: {shortened(row)}. {_cure_of_row(row, n)}"
        for name, cell in zip(head.names, cells, strict=True):
            if not _is_number(cell):
                what = f"{shortened(cell)} is not a number" if cell.strip() else "the value is missing"
                return f"line {place + 1}, column {name}: {what}. {_cure_of_cell(cell)}"
    return f"below line {head.lines} there is something that is no row of {n} numbers. Take the file again."


def _cure_of_row(text: str, n: int) -> str:
    if text.startswith("#"):
        return "Put comments above the headers."
    if ";" in text or "\t" in text:
        return "Part the values by commas, and write decimals with a point."
    if len(text.split(",")) > n:
        return "Write decimals with a point: 0,5 is 0.5."
    return "Complete the row or leave it out; the last row of a file that was cut off is such a one."


def _cure_of_cell(cell: str) -> str:
    if '"' in cell or "'" in cell:
        return "Leave out the quotation marks."
    return "Leave out the whole row; a gap in time is allowed." if not cell.strip() else "Write it as 0.125 or 1.25e-1."


def _is_number(cell: str) -> bool:
    """Return whether NumPy can read a cell, more strictly than Python."""
    try:
        float(cell)
    except ValueError:
        return False
    return cell.isascii() and "_" not in cell
