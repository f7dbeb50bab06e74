"""Tables of numbers that come from elsewhere than a text file: a bag's topics, the channels of a stream."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from cutenv._base.arrays import Array
from cutenv.recording.csv_sniffer import SniffedTable
from cutenv.recording.record_errors import RecordError

STAMP = "stamp"
"""Name of the column with the time of a reading."""


@dataclass(frozen=True, kw_only=True, eq=False)
class NumberTable(SniffedTable):
    """Numbers that need no parsing, with the headers, units and messages of a text file's table.

    Attributes
    ----------
    values : ndarray of shape (n, n_columns)
        Numbers in the units of the headers.
    source : str
        Topic or stream whose readings are the rows.
    """

    values: Array
    source: str
    row_name: ClassVar[str] = "reading"

    @classmethod
    def of(cls, path: Path, source: str, headers: Sequence[str], values: Array, numbers: NDArray[np.intp]) -> Self:
        """Make a table of columns with units in their headers (``x [mm]``), and each row's number, for messages."""
        return cls(
            path=path,
            headers=tuple(headers),
            units_row=(),
            separator=",",
            decimal=".",
            rows=[""] * len(values),
            lines=numbers,
            n_columns=len(headers),
            above="",
            values=values,
            source=source,
        )

    def __str__(self) -> str:
        return f"{self.n_columns - 1} numbers beside the time, {len(self.values)} readings of {self.source}"

    def numbers(self, indices: list[int]) -> Array:
        """Return some columns, shape (n, len(indices)); raise RecordError if a number is not finite."""
        chosen: Array = self.values[:, indices]
        for row, k in np.argwhere(~np.isfinite(chosen))[:1]:
            raise RecordError(
                self.path,
                f"reading {self.lines[row]} of {self.source}: {self.headers[indices[k]]!r} is {chosen[row, k]}, no "
                "finite number. Leave that column out of the mapping, or repair its source.",
            )
        return chosen

    def texts(self, indices: list[int]) -> list[tuple[str, ...]]:
        """Return some columns as text, a tuple for each row."""
        return [tuple(f"{value:.9g}" for value in row) for row in self.numbers(indices).tolist()]
