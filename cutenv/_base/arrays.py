"""Array types that modules share."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

Array: TypeAlias = NDArray[np.float64]
Array32: TypeAlias = NDArray[np.float32]  # array of float32, as observations and actions are
Indices: TypeAlias = NDArray[np.int64]  # array of indices
Struct: TypeAlias = Any  # one element of a structured array, its fields read as attributes (``state.tip``)
StructArray: TypeAlias = NDArray[Any]


def joined_records(parts: Sequence[StructArray]) -> StructArray:
    """Join contiguous records of one type, without comparing fields."""
    kind = parts[0].dtype
    whole: StructArray = np.concatenate([part.view((np.void, kind.itemsize)) for part in parts]).view(kind)
    return whole
