"""Named columns of a foreign file, whatever its format.

A mapping, or the proposal of one, is made from them.
"""

from __future__ import annotations

import difflib
import functools
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from cutenv._base.arrays import Array
from cutenv.records.foreign.cell_values import CellValues, of_array
from cutenv.records.foreign.stated_units import known_spelling, split_header, unit_of_field, without_brackets
from cutenv.records.schema import UNITS, RecordError

RowNumbers = NDArray[np.intp]


@dataclass(frozen=True, kw_only=True)
class LeftOut:
    """Rows of a file that are in no record."""

    count: int
    reason: str  # in words

    def __str__(self) -> str:
        return f"{self.count} row{'' if self.count == 1 else 's'} left out: {self.reason}"


@dataclass(frozen=True, kw_only=True, eq=False)
class NamedColumns:
    """Named columns of equal length, with the file's statements."""

    path: Path
    headers: tuple[str, ...]  # headers of the columns, as in the file, "" for one without; empty if the file has none
    n_columns: int
    lines: RowNumbers  # place of each row in the file, from 1, shape (n,)
    about: str  # format as it was detected, for the reader
    typed: Callable[[int], CellValues]  # maps the index of a column to its cells as numbers
    text: Callable[[int], Sequence[str]]  # maps the index of a column to its cells as text
    # units that the file states outside of the headers, "" where it is silent; empty if it states none
    units: tuple[str, ...] = ()
    # number of the specimen or block of each row, from 0; None if the file has only one, shape (n,)
    parts: RowNumbers | None = None
    part_names: tuple[str, ...] = ()  # names of the parts, for the reader
    part_starts: tuple[float, ...] = ()  # beginning of each part on a common clock [s]; empty if the file states none
    rate: float | None = None  # readings a second that the file states [Hz]
    force_unit: str = ""  # unit of force that a line above the table states for all of it; "" if none does
    left_out: tuple[LeftOut, ...] = ()  # rows that are no readings at all
    notes: tuple[str, ...] = ()  # peculiarities of the file, for the reader
    above: str = "nothing stands above them"  # text above the numbers in place of a header, for messages
    row_name: str = "line"  # word for a row in messages
    # topic, stream or group whose readings are the rows, while others are interpolated; "" if all columns share them
    source: str = ""

    @classmethod
    def of(
        cls,
        path: Path,
        columns: Mapping[str, Any] | Sequence[tuple[str, Any]],
        *,
        units: Mapping[str, str] | Sequence[str] = (),
        about: str,
        row_name: str = "row",
        lines: RowNumbers | None = None,
        **facts: Any,
    ) -> Self:
        """Make named columns of arrays from a binary format or stream.

        A name may hold a unit, ``force [N]``; `units` are by name, or of each column. Further `facts` are attributes.
        """
        pairs = list(columns.items() if isinstance(columns, Mapping) else columns)
        names = [name for name, _ in pairs]
        arrays = [np.asarray(content).reshape(-1) for _, content in pairs]
        lengths = {len(array) for array in arrays}
        if len(lengths) != 1 or lengths == {0}:
            raise RecordError(path, f"{about}: it holds no columns of equal length with numbers in them.")
        if isinstance(units, Mapping):
            units = [units.get(name, "") for name in names]
        typed = functools.cache(lambda k: of_array(arrays[k]))
        return cls(
            path=path,
            headers=tuple(names),
            units=tuple(units),
            n_columns=len(names),
            lines=np.arange(1, lengths.pop() + 1) if lines is None else lines,
            about=about,
            typed=typed,
            text=lambda k: _texts(arrays[k]),
            row_name=row_name,
            **facts,
        )

    def __len__(self) -> int:
        return len(self.lines)

    def __str__(self) -> str:
        return f"{self.n_columns} columns, {self.about}, {len(self)} rows"

    def index(self, name: str) -> int:
        """Return a column's index by name or place (``#2``)."""
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

    def header(self, index: int) -> str:
        """Return a column's header, or its place without one."""
        return self.headers[index] if index < len(self.headers) and self.headers[index] else f"#{index + 1}"

    def stated(self, index: int) -> str:
        """Return a column's unit as stated in the file, or ""."""
        said = self.units[index] if index < len(self.units) else ""
        header = self.headers[index] if index < len(self.headers) else ""
        in_header = split_header(header)[1]
        if not said or known_spelling(in_header):
            said = in_header or said
        if said.isdecimal() and said == in_header and self._is_indexed(header):
            said = ""
        if not said:
            said = self.typed(index).unit
        return said.strip("[](){}<> \t")

    def _is_indexed(self, header: str) -> bool:
        """Return whether a name is one of an indexed series, ``wrench[0]``."""
        name = bare_name(header)
        return sum(bare_name(each) == name and without_brackets(each)[1].isdecimal() for each in self.headers) > 1

    def unit(self, index: int, field: str) -> str | None:
        """Return a column's stated unit for a field, or None."""
        said = self.stated(index)
        if not said:
            return "1" if field == "force" and self.header(index).strip() == "force_1" else None
        unit = unit_of_field(field, said)
        if unit is not None:
            return unit
        if field == "time" and self.typed(index).kind in ("clock", "date"):
            return None  # "Time (-)" above dates, which need no unit
        listed = ", ".join(repr(each) for each in UNITS[field] if "_" not in each)
        name = bare_name(self.header(index))
        raise RecordError(
            self.path,
            f"column {self.header(index)!r}: unit of {field} must be one of {listed}, got {said!r}. Or give it in the "
            f"mapping: {field}={name}[unit].",
        )

    def values(self, index: int) -> Array:
        """Return a column's numbers, shape (n,), with NaN for none."""
        return self.typed(index).values

    def texts(self, indices: Sequence[int]) -> list[tuple[str, ...]]:
        """Return columns as text, a tuple per row."""
        return list(zip(*(self.text(k) for k in indices), strict=True))


def bare_name(header: str) -> str:
    """Return a header without the unit in brackets."""
    return without_brackets(header)[0]


def column_stem(header: str) -> str:
    """Return a header without its unit, in small letters."""
    return split_header(header)[0].lower()


def _texts(array: NDArray[Any]) -> list[str]:
    return [f"{each:.9g}" if isinstance(each, float) else str(each) for each in array.tolist()]
