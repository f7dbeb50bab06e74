"""Maps of a cut: depth, or distance to a line.

They have a value at each point that the tip has passed.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from cutenv._base.arrays import Array
from cutenv.records.scoring.validity import Unavailable
from cutenv.sim.quantities import (
    DEPTH_COSTS,
    DEPTH_TOLERANCE,
    FARTHEST_TOLERANCE,
    LAYER_TOLERANCE,
    LINE_TOLERANCE,
    PATH_COSTS,
    into_layer,
    left_uncut,
    map_cost,
    too_deep,
)
from cutenv.sim.tissue.grid import SPACING
from cutenv.sim.tissue.lines import CutLine

LINE_KEY = "line_m"  # key, in a record's metadata, of the line to cut along: places along and across the slab [m]


class CutMap(ABC):
    """Map of a cut, with charges and shortcomings.

    It has a value every 0.5 mm from the clamp to the tip.
    """

    part: str  # name of the part of the score that it decides

    @abstractmethod
    def cost(self, target_length: float) -> float:
        """Return the task's charge for the map, by target length [m]."""

    @abstractmethod
    def words(self, target_length: float) -> str:
        """Return the errors of the map in words."""

    @abstractmethod
    def _shortcomings(self, target_length: float) -> Iterator[str]: ...

    def shortcoming(self, target_length: float) -> str:
        """Return the first thing lacking for success in words, or ""."""
        return next(self._shortcomings(target_length), "")


@dataclass(frozen=True, kw_only=True, eq=False)
class DepthMap(CutMap):
    """Depth of a cut along its line.

    Attributes
    ----------
    depth : array, shape (n,)
        Depth of the floor of the cut below the surface [m].
    wanted : array of shape (n,), or None
        Wanted depth [m].
    layer : float or None
        Depth below the surface at which another layer begins [m].
    """

    part = "depth"

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
        """Opened depth of the layer below [m], shape (n,)."""
        if self.layer is None:
            raise Unavailable("no depth of a layer below was given")
        return into_layer(self.depth, self.layer)

    @property
    def deepest_opened(self) -> float:
        """Largest depth into the layer [m], 0 without one."""
        return 0.0 if self.layer is None else float(self.opened.max())

    def mean_error(self, target_length: float) -> float:
        """Return the error's integral along the cut over target length [m]."""
        return (self.deep + self.uncut) / target_length

    def cost(self, target_length: float) -> float:
        """Return the task's charge for depth, by target length [m]. A missing layer adds nothing."""
        return map_cost(
            DEPTH_COSTS,
            {
                "deep": self.deep,
                "uncut": self.uncut,
                "layer": 0.0 if self.layer is None else SPACING * float(self.opened.sum()),
                "deepest": self.deepest_opened,
                "target": target_length,
            },
        )

    def words(self, target_length: float) -> str:
        """Return mean depth error and depth into the layer in words."""
        off = f"{1e3 * self.mean_error(target_length):.1f} mm off the wanted depth in the mean"
        opened = self.deepest_opened
        return off if math.isclose(opened, 0.0, abs_tol=1e-9) else f"{off}, {1e3 * opened:.1f} mm into the layer below"

    def _shortcomings(self, target_length: float) -> Iterator[str]:
        mean, opened = self.mean_error(target_length), self.deepest_opened
        if mean > DEPTH_TOLERANCE:
            yield (
                f"the depth is {1e3 * mean:.1f} mm off the wanted one in the mean, "
                f"more than {1e3 * DEPTH_TOLERANCE:g} mm"
            )
        if opened > LAYER_TOLERANCE:
            yield f"the layer below is opened by {1e3 * opened:.1f} mm, more than {1e3 * LAYER_TOLERANCE:g} mm"

    @property
    def _wanted(self) -> Array:
        if self.wanted is None:
            raise Unavailable("no wanted depth was given")
        return self.wanted


@dataclass(frozen=True, kw_only=True, eq=False)
class PathMap(CutMap):
    """Distance of a cut to its line.

    Attributes
    ----------
    aside : array, shape (n,)
        Distance of the cut to the left of the line [m].
    """

    part = "path"

    line: CutLine
    aside: Array

    @property
    def place(self) -> Array:
        """Cut's places along and across the slab [m], shape (n, 2)."""
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
        """Return the distance's integral along the line over target length [m]."""
        return SPACING * float(np.abs(self.aside).sum()) / target_length

    def cost(self, target_length: float) -> float:
        """Return the task's charge for the path, by target length [m]."""
        return map_cost(PATH_COSTS, {"area": self.area, "farthest": self.farthest, "target": target_length})

    def words(self, target_length: float) -> str:
        """Return mean and largest distance in words."""
        mean, largest = 1e3 * self.mean_distance(target_length), 1e3 * self.farthest
        return f"{mean:.1f} mm off the line in the mean, {largest:.1f} mm at most"

    def _shortcomings(self, target_length: float) -> Iterator[str]:
        mean, farthest = self.mean_distance(target_length), self.farthest
        if mean > LINE_TOLERANCE:
            yield f"the cut is {1e3 * mean:.1f} mm off the line in the mean, more than {1e3 * LINE_TOLERANCE:g} mm"
        if farthest > FARTHEST_TOLERANCE:
            yield f"the cut is up to {1e3 * farthest:.1f} mm off the line, more than {1e3 * FARTHEST_TOLERANCE:g} mm"
