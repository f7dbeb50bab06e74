"""Map of a cut: the depth of its floor at each point that the tip has passed, beside the wanted depth and the layer."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cutenv._base.arrays import Array
from cutenv.scoring.unavailable import Unavailable
from cutenv.task_quantities import DEPTH_TOLERANCE, LAYER_TOLERANCE, depth_cost, into_layer, left_uncut, too_deep
from cutenv.tissue.grid import SPACING


@dataclass(frozen=True, kw_only=True, eq=False)
class DepthMap:
    """Depth of a cut along its line, every 0.5 mm from the clamp to the tip.

    Attributes
    ----------
    depth : array, shape (n,)
        Depth of the floor of the cut below the surface [m].
    wanted : array of shape (n,), or None
        Wanted depth [m].
    layer : float or None
        Depth below the surface at which another layer begins [m].
    """

    depth: Array
    wanted: Array | None = None
    layer: float | None = None

    @property
    def position(self) -> Array:
        """Positions from the clamp [m], shape (n,)."""
        return np.arange(len(self.depth), dtype=np.float64) * SPACING

    @property
    def error(self) -> Array:
        """Depth less the wanted one [m], shape (n,)."""
        return self.depth - self._wanted

    @property
    def deep(self) -> float:
        """Area cut too deep [m2]."""
        return SPACING * float(too_deep(self.depth, self._wanted).sum())

    @property
    def uncut(self) -> float:
        """Area left uncut above the wanted depth [m2]."""
        return SPACING * float(left_uncut(self.depth, self._wanted).sum())

    @property
    def opened(self) -> Array:
        """Depth to which the layer below is opened [m], shape (n,)."""
        if self.layer is None:
            raise Unavailable("no depth of a layer below was given")
        return into_layer(self.depth, self.layer)

    def cost(self, target_length: float) -> float:
        """Return what the task's reward charges for the depth of a cut of this target length [m]; no layer: nothing."""
        opened = np.zeros(1) if self.layer is None else self.opened
        return depth_cost(
            {
                "deep": self.deep,
                "uncut": self.uncut,
                "layer": SPACING * float(opened.sum()),
                "deepest": float(opened.max()),
                "target": target_length,
            }
        )

    def shortcoming(self, target_length: float) -> str:
        """Return what a success of the task lacks, in words; "" if the cut is as deep as wanted."""
        mean = (self.deep + self.uncut) / target_length
        if mean > DEPTH_TOLERANCE:
            return (
                f"the depth is {1e3 * mean:.1f} mm off the wanted one in the mean, more than {1e3 * DEPTH_TOLERANCE:g}"
            )
        if self.layer is not None and float(self.opened.max()) > LAYER_TOLERANCE:
            opened = 1e3 * float(self.opened.max())
            return f"the layer below is opened by {opened:.1f} mm, more than {1e3 * LAYER_TOLERANCE:g}"
        return ""

    @property
    def _wanted(self) -> Array:
        if self.wanted is None:
            raise Unavailable("no wanted depth was given")
        return self.wanted
