"""Tables in which every row is one value of one channel, as databases and tidy data are: a column for each channel."""

from __future__ import annotations

import functools
import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cutenv._base.arrays import Array
from cutenv.recording.cell_values import CellValues
from cutenv.recording.named_columns import NamedColumns
from cutenv.recording.stated_units import known_spelling, split_header

_CHANNEL = re.compile(
    r"force|load|kraft|fuerza|forza|charge|\bf[xyz]?\b|position|displacement|travel|weg", re.IGNORECASE
)
_MOST_CHANNELS = 32


def one_column_a_channel(table: NamedColumns) -> NamedColumns:
    """Return a table of times, channels and values with a column for each channel; any other as it is.

    A column of text is one of channels if it says which of them is a force or a way; of trials it is not.
    """
    if table.n_columns < 3 or len(table.headers) < table.n_columns:
        return table
    texts = [k for k in range(table.n_columns) if table.typed(k).kind == "text"]
    numbers = [k for k in range(table.n_columns) if k not in texts]
    key = next((k for k in texts if _names_channels(table.text(k))), None)
    if key is None:
        return table
    if len(numbers) > 2:
        numbers = [k for k in numbers if _varies_within(table.values(k), np.array(table.text(key)))]
    if len(numbers) != 2:
        return table
    time, value = numbers
    if table.typed(time).kind == "number" and not (np.diff(table.values(time)) >= 0.0).mean() > 0.9:
        time, value = value, time
    channels = np.array(table.text(key))
    names = list(dict.fromkeys(channels.tolist()))
    units = [""] * len(names)
    for other in texts:
        said = np.array(table.text(other))
        each = [set(said[channels == name].tolist()) for name in names]
        state = len(set(said.tolist())) == 1 and known_spelling(str(said[0])) is None  # such as "good"
        if other == key or state:
            continue
        if any(len(of_one) > 1 for of_one in each):
            return table
        units = [of_one.pop() for of_one in each]
    moments, rows = np.unique(table.values(time), return_inverse=True)
    columns = np.full((len(names), len(moments)), np.nan)
    for k, name in enumerate(names):
        here = channels == name
        columns[k, rows[here]] = table.values(value)[here]
    first = np.full(len(moments), len(rows))
    np.minimum.at(first, rows, np.arange(len(rows)))

    def typed(column: int) -> CellValues:
        return replace(table.typed(time), values=moments) if column == 0 else CellValues(values=columns[column - 1])

    def text(column: int) -> Sequence[str]:
        return [f"{each:.9g}" for each in typed(column).values.tolist()]

    return replace(
        table,
        headers=(table.headers[time], *names),
        units=("", *units),
        n_columns=1 + len(names),
        lines=table.lines[first],
        typed=functools.cache(typed),
        text=text,
        parts=None,
        part_names=(),
        notes=(*table.notes, f"{len(names)} channels below one another, by {table.header(key)!r}: a column each."),
    )


def _varies_within(values: Array, channels: NDArray[np.str_]) -> bool:
    """Return whether numbers vary within a channel, as those of a series do, and its number does not."""
    known = np.isfinite(values)
    each = [values[known & (channels == name)] for name in np.unique(channels)]
    return any(len(of_one) > 0 and np.ptp(of_one) > 0.0 for of_one in each)


def _names_channels(cells: Sequence[str]) -> bool:
    """Return whether some cells name channels, among them a force or a way."""
    names = set(cells)
    if not 1 < len(names) <= _MOST_CHANNELS:
        return False
    units = [known_spelling(split_header(name)[1]) for name in names]
    told = sum(unit is not None and unit.quantity in ("force", "length") for unit in units)
    return told > 0 or sum(bool(_CHANNEL.search(re.sub(r"[_\d]", " ", name))) for name in names) > 1
