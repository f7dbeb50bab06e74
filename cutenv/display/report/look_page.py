"""Records as they were understood, before anybody scores them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cutenv._base.arrays import Array
from cutenv._base.unit_table import shown_unit
from cutenv.display.report.page import number, significant, write_page
from cutenv.display.report.record_figure import RecordPicture, record_figure

_DOTS = np.array([[0x01, 0x08], [0x02, 0x10], [0x04, 0x20], [0x40, 0x80]])  # of a Braille cell, from above
_LABEL = 9  # characters in front of each line
_FORCE_ROWS, _WAY_ROWS = 9, 4


def record_lines(picture: RecordPicture, width: int, *, braille: bool = True) -> list[str]:
    """Return the lines of a picture of a whole record.

    The width is that of the terminal [characters], 40 or more; without ``braille`` it shows ASCII alone.
    """
    record = picture.record
    columns = max(20, width - _LABEL - 1)
    unit = "N" if record.force_unit == "N" else "1"
    lines = [f"force [{unit}]", *_curve(record.time, record.force, columns, _FORCE_ROWS, braille)]
    if record.position is not None:
        shown = shown_unit("m")
        lines += [f"position [{shown.sign}]"]
        lines += _curve(record.time, shown.from_si(record.position), columns, _WAY_ROWS, braille)
    start, end = float(record.time[0]), float(record.time[-1])
    if picture.cuts:
        lines.append(" " * _LABEL + _marks(record.time, picture.cuts, columns))
    length = f"{end - start:.2f} s"
    lines.append(" " * _LABEL + "0" + length.rjust(columns - 1))
    return lines


def _curve(time: Array, values: Array, columns: int, rows: int, braille: bool) -> list[str]:
    """Return the lines of a curve, with its range in front."""
    across, down = (2, 4) if braille else (1, 1)
    low, high = float(values.min()), float(values.max())
    span = high - low or 1.0
    x = np.minimum(((time - time[0]) / (time[-1] - time[0]) * columns * across).astype(int), columns * across - 1)
    y = np.minimum(((high - values) / span * rows * down).astype(int), rows * down - 1)
    dots = np.zeros((rows * down, columns * across), dtype=bool)
    dots[y, x] = True
    for k in range(columns * across):  # between the extremes of neighbouring readings the curve is one line
        here = y[x == k] if len(time) < 20_000 else y[np.searchsorted(x, k) : np.searchsorted(x, k, side="right")]
        if len(here):
            dots[here.min() : here.max() + 1, k] = True
    labels = {0: f"{high:.4g}", rows - 1: f"{low:.4g}"}
    lines = []
    for row in range(rows):
        cells = dots[row * down : (row + 1) * down].reshape(down, columns, across).transpose(1, 0, 2)
        if braille:
            drawn = "".join(chr(0x2800 + int((cell * _DOTS).sum())) for cell in cells)
        else:
            drawn = "".join("*" if cell.any() else " " for cell in cells)
        lines.append(f"{labels.get(row, ''):>{_LABEL - 1}} {drawn}".rstrip())
    return lines


def _marks(time: Array, cuts: Sequence[slice], columns: int) -> str:
    """Return a line that marks where each cut is."""
    line = [" "] * columns
    for order, cut in enumerate(cuts, 1):
        first, last = (
            int((float(moment) - time[0]) / (time[-1] - time[0]) * (columns - 1)) for moment in time[cut][[0, -1]]
        )
        word = f"cut {order}"
        for k in range(first, last + 1):
            line[k] = "-"
        line[first] = line[last] = "|"
        if last - first > len(word) + 2:
            begin = (first + last - len(word)) // 2
            line[begin : begin + len(word)] = word
    return "".join(line).rstrip()


@dataclass(frozen=True, kw_only=True)
class UnderstoodFile:
    """File as it was understood."""

    name: str
    pictures: Sequence[RecordPicture] = ()
    mapping: str = ""  # options of the command line; "" for a record of this package
    questions: Sequence[str] = ()
    left_out: Sequence[str] = ()
    notes: Sequence[str] = ()
    reason: str = ""  # for which it is not read, "" if it is

    @property
    def unit(self) -> str:
        """Unit of force of its records."""
        return self.pictures[0].record.force_unit if self.pictures else "N"

    @property
    def rows(self) -> list[tuple[str, list[str]]]:
        """Rows of the table of its records."""
        rows = []
        for k, picture in enumerate(self.pictures, 1):
            record = picture.record
            position = record.position
            travel = "–" if position is None else number(1e3 * float(position.max() - position.min()), 1)
            peak = significant(float(record.force.max()), 3)
            rows.append((str(k), [str(len(record)), number(record.duration, 2), peak, travel, str(len(picture.cuts))]))
        return rows


def write_look_page(path: Path, files: Sequence[UnderstoodFile]) -> None:
    """Write the page of some files; raise as :func:`cutenv.display.report.page.write_page`."""
    write_page(path, "look.html", files=files, record_figure=record_figure)
