"""Map of a cut along a drawn line: its distance to the line at each point that the tip has passed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cutenv._base.arrays import Array
from cutenv.task_quantities import FARTHEST_TOLERANCE, LINE_TOLERANCE, path_cost
from cutenv.tissue.grid import SPACING
from cutenv.tissue.lines import CutLine

LINE_KEY = "line_m"
"""Key, in a record's metadata, of the line to cut along: places along and across the slab [m]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class PathMap:
    """Distance of a cut to its line, every 0.5 mm of the line from the clamp to the tip.

    Attributes
    ----------
    line : CutLine
        Line to cut along.
    aside : array, shape (n,)
        Distance of the cut to the left of the line [m].
    """

    line: CutLine
    aside: Array

    @property
    def place(self) -> Array:
        """Places of the cut along and across the slab [m], shape (n, 2)."""
        n = len(self.aside)
        x, y, angle = self.line.x[:n], self.line.y[:n], self.line.angle[:n]
        return np.column_stack((x - self.aside * np.sin(angle), y + self.aside * np.cos(angle)))

    @property
    def area(self) -> float:
        """Area between cut and line [m2]."""
        bend = self.line.curvature[: len(self.aside)]
        return SPACING * float((np.abs(self.aside) * (1.0 - 0.5 * bend * self.aside)).sum())

    @property
    def farthest(self) -> float:
        """Largest distance between cut and line [m]."""
        return float(np.abs(self.aside).max())

    def mean_distance(self, target_length: float) -> float:
        """Return the integral of the distance along the line over the target length [m]."""
        return SPACING * float(np.abs(self.aside).sum()) / target_length

    def cost(self, target_length: float) -> float:
        """Return what the task's reward charges for the path of a cut of this target length [m]."""
        return path_cost({"area": self.area, "farthest": self.farthest, "target": target_length})

    def shortcoming(self, target_length: float) -> str:
        """Return what a success of the task lacks, in words; "" if the cut is near enough to the line."""
        mean = self.mean_distance(target_length)
        if mean > LINE_TOLERANCE:
            return f"the cut is {1e3 * mean:.1f} mm off the line in the mean, more than {1e3 * LINE_TOLERANCE:g}"
        if self.farthest > FARTHEST_TOLERANCE:
            return f"the cut is up to {1e3 * self.farthest:.1f} mm off the line, more than {1e3 * FARTHEST_TOLERANCE:g}"
        return ""
