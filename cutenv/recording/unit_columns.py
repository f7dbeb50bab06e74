"""Units that a table gives in a column of their own."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np

from cutenv.recording.named_columns import NamedColumns
from cutenv.recording.specimens import TIME_NAME
from cutenv.recording.stated_units import known_spelling

_UNITS = re.compile(r"(?:.*[^a-z])?(?:units?|einheit(?:en)?)", re.IGNORECASE)


def with_unit_columns(table: NamedColumns) -> NamedColumns:
    """Return a table with the units of a column "Units" given to the columns in front of it that state none."""
    headers = table.headers[: table.n_columns]
    units = [*table.units, *[""] * table.n_columns][: table.n_columns]
    behind, found = 0, False
    for k, header in enumerate(headers):
        if not _UNITS.fullmatch(header.strip()) or table.typed(k).kind != "text":
            continue
        said = set(table.text(k))
        if len(said) == 1 and known_spelling(*said) is not None:
            for j in range(behind, k):
                if not table.stated(j) and _is_value(table, j):
                    units[j], found = next(iter(said)), True
        behind = k + 1
    return replace(table, units=tuple(units)) if found else table


def _is_value(table: NamedColumns, k: int) -> bool:
    """Return whether a column holds measured values: neither times nor the numbers of the readings."""
    if table.typed(k).kind != "number" or TIME_NAME.search(table.headers[k].strip()):
        return False
    values = table.values(k)
    return not bool((np.diff(values[np.isfinite(values)]) == 1.0).all())
