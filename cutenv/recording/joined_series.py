"""Series of readings, each on its own clock, brought to the times of one of them: topics, streams and channels."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cutenv._base.arrays import Array
from cutenv.recording.mapped_columns import STAMP
from cutenv.recording.named_columns import LeftOut, NamedColumns, bare_name
from cutenv.recording.schema import RecordError


@dataclass(frozen=True, kw_only=True, eq=False)
class Series:
    """Readings of one source.

    Attributes
    ----------
    source : str
        Topic, stream or group.
    headers : tuple of str
        Names of the columns, with their units in brackets where they are known.
    times : ndarray of shape (n,)
        Times [s], in any order.
    values : ndarray of shape (n, n_columns)
        Numbers in the units of the headers.
    """

    source: str
    headers: tuple[str, ...]
    times: Array
    values: Array

    def in_order(self) -> Series:
        """Return the readings in the order of their times, the first of those with the same time."""
        times, first = np.unique(self.times, return_index=True)
        return Series(source=self.source, headers=self.headers, times=times, values=self.values[first])


def joined(path: Path, every: Sequence[Series], names: Collection[str], notes: Sequence[str] = ()) -> NamedColumns:
    """Return series as one table; its rows are the readings of the series that is needed first.

    Parameters
    ----------
    path : path
        File, for messages.
    every : sequence of Series
        At least one.
    names : collection of str
        Columns that are needed, that of the force first; the rows reach from where to where all of them have
        readings, and one step of theirs more. Without any, the rows are those of the series with a force that has the
        most readings.
    notes : sequence of str
        Peculiarities of the file, for the reader.

    Raises
    ------
    RecordError
        If the needed series have no two readings in common.
    """
    series = [each.in_order() for each in every]
    headers = [header for each in series for header in each.headers]
    series_of = [k for k, each in enumerate(series) for _ in each.headers]
    place = {f"#{k}": owner for k, owner in enumerate(series_of, 2)}  # the stamp is the first column
    place |= {bare_name(header): owner for header, owner in zip(headers, series_of, strict=True)}
    needed = list(dict.fromkeys(place[name] for name in map(bare_name, names) if name in place))
    forces = [k for k, each in enumerate(series) if any(header.endswith("[N]") for header in each.headers)]
    base = needed[0] if needed else max(forces or range(len(series)), key=lambda k: len(series[k].times))
    rows, used = series[base].times, [series[k] for k in needed or [base]]
    # A slower series holds for one of its steps more.
    steps = [float(np.median(np.diff(each.times))) if len(each.times) > 1 else 0.0 for each in used]
    first = max(each.times[0] - step for each, step in zip(used, steps, strict=True))
    last = min(each.times[-1] + step for each, step in zip(used, steps, strict=True))
    kept: NDArray[np.intp] = np.flatnonzero((rows >= first) & (rows <= last))
    if len(kept) < 2:
        listed = ", ".join(
            f"{each.source} from {each.times[0] - rows[0]:.3f} s to {each.times[-1] - rows[0]:.3f} s" for each in used
        )
        raise RecordError(path, f"its topics have no two readings at the same time: {listed}. Map topics that do.")
    columns = [rows[kept] - rows[0]]
    for k, each in enumerate(series):
        columns += [
            each.values[kept, column] if k == base else np.interp(rows[kept], each.times, each.values[:, column])
            for column in range(len(each.headers))
        ]
    apart = [each.source for each in series if each.times[0] > rows[-1] or each.times[-1] < rows[0]]
    if apart:
        told = f"no reading of {' or '.join(apart)} lies in the time of {series[base].source}: another clock?"
        notes = (*notes, told)
    repeated = len(every[base].times) - len(rows)
    return NamedColumns.of(
        path,
        list(zip((f"{STAMP} [s]", *headers), columns, strict=True)),
        about=f"readings of {series[base].source}",
        row_name="reading",
        lines=kept + 1,
        source=series[base].source if len(series) > 1 else "",
        left_out=(LeftOut(count=repeated, reason="they repeat a time; the first of each is kept"),) if repeated else (),
        notes=tuple(notes),
    )
