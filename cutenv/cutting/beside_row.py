"""Lanes beside a row of cuts: the scalars that begin a record of each cut, as a structure of arrays.

A record beside those of the law begins with scalars, 8 bytes wide each, and ends with profiles along the cut.  A row
gathers the scalars; the profiles stay in the records.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from cutenv._base.arrays import StructArray
from cutenv._engine.intrinsics import as_float64_view
from cutenv._engine.jit import njit_inline
from cutenv._engine.randomness import Integer


def beside_dtype(record: np.dtype[Any], passing: Sequence[tuple[str, str]], lanes: int) -> np.dtype[Any]:
    """Return the structured dtype of such a row: the scalars that begin a record, and scratch, for each lane."""
    names = (record.names or ())[: scalars_of(record)]
    own = [(name, record[name].base, (lanes,)) for name in names]
    return np.dtype((np.record, [*own, *((name, kind, (lanes,)) for name, kind in passing)]))


def scalars_of(record: np.dtype[Any]) -> int:
    """Return how many scalars a record begins with."""
    return next(k for k, name in enumerate(record.names or ()) if record[name].shape != ())


class Beside(NamedTuple):
    """A row and the cuts' records as flat arrays of float64, as :class:`~cutenv.cutting.row.Plain`."""

    row: StructArray
    records: StructArray
    lanes: Integer
    scalars: Integer
    size: Integer
    """64-bit numbers in a record."""


@njit_inline
def beside_views(rows: StructArray, records: StructArray, lanes: Integer, scalars: Integer) -> Beside:
    """Return flat views of a row, shape (1,), and of the cuts' records, shape (n,)."""
    numbers = as_float64_view(records)
    return Beside(as_float64_view(rows), numbers, lanes, scalars, len(numbers) // len(records))


@njit_inline
def take_beside(beside: Beside, n: Integer, cut: Integer) -> None:
    """Load the scalars of cut number ``cut`` into lane ``n`` (gather)."""
    for k in range(beside.scalars):
        beside.row[k * beside.lanes + n] = beside.records[cut * beside.size + k]


@njit_inline
def pad_beside(beside: Beside, taken: Integer) -> None:
    """Fill the lanes after the first ``taken`` ones."""
    for n in range(taken, beside.lanes):
        for k in range(beside.scalars):
            beside.row[k * beside.lanes + n] = beside.row[k * beside.lanes]


@njit_inline
def put_beside(beside: Beside, n: Integer, cut: Integer) -> None:
    """Store the scalars in lane ``n`` back to their cut (scatter)."""
    for k in range(beside.scalars):
        beside.records[cut * beside.size + k] = beside.row[k * beside.lanes + n]
