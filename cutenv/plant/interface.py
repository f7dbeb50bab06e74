"""The interface between a task and a plant: the simulator, a replay or a rig."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from cutenv._base.arrays import StructArray


class Plant(Protocol):
    """A blade in tissue, driven by commands and measured by a force sensor at 1 kHz."""

    @property
    def depth(self) -> NDArray[np.float64]:
        """Depth of cut as measured beforehand, one value every 0.5 mm from the clamp, shape (301,) [m]."""
        ...

    def advance(self, speed: float, angle: float, ticks: int) -> StructArray:
        """Command ``speed`` [m/s] and ``angle`` [rad] for ``ticks`` milliseconds and return the readings.

        Returns
        -------
        Records
            Readings (:data:`cutenv.cutting.dtypes.READING`), shape (ticks,), valid until the next call.  Of the fields
            ``true_force``, ``elastic_force``, ``tip`` and ``jump``, those that a plant cannot know are NaN.
        """
        ...
