"""Depth of cut by place: what the blade met along the line, and its integral."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cutenv.trace import Trace

Array = NDArray[np.float64]

SHALLOWEST = 0.5e-3
"""Shallower than this a force per depth says nothing [m]: half the least depth measured."""


@dataclass(frozen=True, kw_only=True, eq=False)
class DepthProfile:
    """Depth of cut B [m] at increasing positions [m], both of shape (n,); linear between, constant beyond."""

    position: Array
    depth: Array

    @classmethod
    def constant(cls, depth: float) -> DepthProfile:
        """Return the profile of the same depth [m] everywhere."""
        return cls(position=np.array([0.0, 1.0]), depth=np.array([depth, depth]))

    @classmethod
    def recorded(cls, trace: Trace, *, by: str) -> DepthProfile:
        """Return the depth that the blade met where it first passed.

        Raises
        ------
        ValueError
            If the trace lacks depth or position; ``by`` names the function that needs them.
        """
        position, depth = trace.require("position", "depth", by=by)
        new_ground = np.concatenate(([True], np.diff(np.maximum.accumulate(position)) > 0.0))
        return cls(position=position[new_ground], depth=depth[new_ground])

    def at(self, position: float | Array) -> Array:
        """Return B [m] at ``position`` [m], of its shape."""
        return np.asarray(np.interp(position, self.position, self.depth))

    def area(self, start: float, end: float) -> float:
        """Return the integral of B from ``start`` to ``end`` [m2]."""
        inside = self.position[(self.position > start) & (self.position < end)]
        x = np.concatenate(([start], inside, [end]))
        B = self.at(x)
        return float(0.5 * (B[1:] + B[:-1]) @ np.diff(x))
