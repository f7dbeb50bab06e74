"""Tables of results: declared once, rendered as text, and as HTML by pages' templates."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

ColumnHead = str | tuple[str, str]  # heading of a column or row: a text, or a text and a unit


class Reason(str):
    """Reason for no value, in its cell and over the empty ones after."""

    __slots__ = ()


class ResultRow(NamedTuple):
    """Row of a table; a marked one stands out on a page."""

    heading: ColumnHead
    cells: Sequence[str]
    marked: bool = False


class ResultTable(NamedTuple):
    """Table of a result; the first heading is that of the rows' headings."""

    caption: str
    heads: Sequence[ColumnHead]
    rows: Sequence[ResultRow]

    def lines(self, *, right: bool = False) -> list[str]:
        """Return aligned lines of text, without the caption; cells at the left or the right of their columns."""
        return aligned([self.heads, *([row.heading, *row.cells] for row in self.rows)], right=right)


def aligned(rows: Sequence[Sequence[ColumnHead]], *, right: bool = False) -> list[str]:
    """Return rows as lines, columns two spaces apart, the first at the left."""
    texts = [[cell if isinstance(cell, str) else f"{cell[0]} [{cell[1]}]" for cell in row] for row in rows]
    widths = [max(map(_width, column)) for column in zip(*texts, strict=True)]
    sides = "<" + (">" if right else "<") * len(widths)
    lines = (zip(row, sides, widths, strict=False) for row in texts)
    return ["  ".join(f"{cell:{side}{width}}" for cell, side, width in line).rstrip() for line in lines]


def _width(cell: str) -> int:
    return 0 if isinstance(cell, Reason) else len(cell)
