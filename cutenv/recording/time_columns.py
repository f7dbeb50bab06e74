"""Times in two columns: seconds and nanoseconds of ROS, or a clock of whole seconds beside its milliseconds."""

from __future__ import annotations

import functools
import re
from dataclasses import replace

import numpy as np

from cutenv.recording.cell_values import CellValues
from cutenv.recording.named_columns import NamedColumns

_SECONDS = re.compile(r"(?:.*[^a-z])?(?:secs?|seconds?|tv_sec)", re.IGNORECASE)
_PARTS = (  # of a second, by the end of the name
    (re.compile(r"(?:.*[^a-z])?(?:n(?:ano)?secs?|nanoseconds?|ns)", re.IGNORECASE), 10**9),
    (re.compile(r"(?:.*[^a-z])?(?:u(?:sec)?s?|micros(?:ec(?:ond)?s?)?)", re.IGNORECASE), 10**6),
    (re.compile(r"(?:.*[^a-z])?(?:m(?:sec)?s?|millis(?:ec(?:ond)?s?)?)", re.IGNORECASE), 10**3),
)


def whole_times(table: NamedColumns) -> NamedColumns:
    """Return a table whose column of seconds includes the parts of a second that a second column holds."""
    headers = [re.sub(r"(?<=[a-z])(?=[A-Z])", "_", header.strip()) for header in table.headers[: table.n_columns]]
    for k, header in enumerate(headers):
        for j, other in enumerate(headers):
            parts = next((size for pattern, size in _PARTS if pattern.fullmatch(other)), 0)
            if j == k or not parts:
                continue
            seconds, fraction = table.typed(k), table.typed(j).values
            by_clock = seconds.kind in ("clock", "date")
            if not by_clock and not _SECONDS.fullmatch(header):
                continue
            known = fraction[np.isfinite(fraction)]
            whole = seconds.values[np.isfinite(seconds.values)]
            falls = len(known) > 1 and bool((np.diff(known) < 0.0).any())
            if not falls or known.min() < 0.0 or known.max() >= parts or (np.diff(whole) % 1.0).any():
                continue
            return _with_parts(table, k, j, parts)
    return table


def _with_parts(table: NamedColumns, k: int, j: int, parts: int) -> NamedColumns:
    before = table.typed

    def typed(column: int) -> CellValues:
        cells = before(column)
        if column != k:
            return cells
        return replace(cells, values=cells.values - cells.values[0] + before(j).values / parts, unit="s", kind="date")

    note = f"time: {table.header(k)!r} and {table.header(j)!r} together."
    return replace(table, typed=functools.cache(typed), notes=(*table.notes, note))
