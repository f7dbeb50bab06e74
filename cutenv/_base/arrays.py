"""Array types that modules share."""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

Array: TypeAlias = NDArray[np.float64]
"""Array of float64."""
Array32: TypeAlias = NDArray[np.float32]
"""Array of float32, as observations and actions are."""
Indices: TypeAlias = NDArray[np.int64]
"""Array of indices."""
Struct: TypeAlias = Any
"""One element of a structured array, its fields read as attributes (``state.tip``)."""
StructArray: TypeAlias = NDArray[Any]
"""Structured array."""
