"""Further SIMD lanes of a row of cuts: the scalars that begin any record of each cut, as a structure of arrays.

Such a record begins with scalars, 8 bytes wide each, and ends with profiles along the cut.  A row gathers the scalars;
the profiles stay in the records.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from cutenv._base.arrays import StructArray
from cutenv._engine.intrinsics import as_float64_view
from cutenv._engine.jit import njit_inline
from cutenv._engine.randomness import Integer


def lane_dtype(record: np.dtype[Any], scratch: Sequence[tuple[str, str]], lanes: int) -> np.dtype[Any]:
    """Return the structured dtype of the lanes: the scalars that begin a ``record``, and scratch, for each of them."""
    names = (record.names or ())[: count_scalars(record)]
    own = [(name, record[name].base, (lanes,)) for name in names]
    return np.dtype((np.record, [*own, *((name, kind, (lanes,)) for name, kind in scratch)]))


def count_scalars(record: np.dtype[Any]) -> int:
    """Return how many scalars a record begins with."""
    names = record.names or ()
    return next((k for k, name in enumerate(names) if record[name].shape != ()), len(names))


class LaneViews(NamedTuple):
    """Lanes and the cuts' records as flat arrays of float64, as :class:`~cutenv.cutting.row.Plain`."""

    lanes: StructArray
    records: StructArray
    width: Integer
    """Number of lanes."""
    scalars: Integer
    size: Integer
    """64-bit numbers in a record."""


@njit_inline
def lane_views(lanes: StructArray, records: StructArray, count: Integer, scalars: Integer) -> LaneViews:
    """Return flat views of ``count`` lanes, shape (1,), and of the cuts' records, shape (n,)."""
    numbers = as_float64_view(records)
    return LaneViews(as_float64_view(lanes), numbers, count, scalars, len(numbers) // len(records))


@njit_inline
def gather(views: LaneViews, n: Integer, cut: Integer) -> None:
    """Load the scalars of cut number ``cut`` into lane ``n``."""
    for k in range(views.scalars):
        views.lanes[k * views.width + n] = views.records[cut * views.size + k]


@njit_inline
def pad(views: LaneViews, taken: Integer) -> None:
    """Fill the lanes after the first ``taken`` ones with the scalars of the first."""
    for n in range(taken, views.width):
        for k in range(views.scalars):
            views.lanes[k * views.width + n] = views.lanes[k * views.width]


@njit_inline
def scatter(views: LaneViews, n: Integer, cut: Integer) -> None:
    """Store the scalars in lane ``n`` back to their cut."""
    for k in range(views.scalars):
        views.records[cut * views.size + k] = views.lanes[k * views.width + n]
