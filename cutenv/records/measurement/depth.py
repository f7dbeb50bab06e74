"""Depth of cut by position, its integral, and tip stiffness."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.integrate import trapezoid
from scipy.optimize import least_squares

from cutenv._base.arrays import Array
from cutenv._base.validation import array_in_range, in_range
from cutenv.sim.tissue.cut_model import CutModel
from cutenv.sim.tissue.grid import bulge
from cutenv.sim.tissue.slab import effective_depth
from cutenv.sim.tissue.specimen import LENGTH
from cutenv.sim.trace import Trace

DEPTH_SD_KEY = "depth_sd_m"
"""Key in a record's metadata for the standard deviation of its depth [m]; ``cutenv depth`` writes it."""
WANTED_DEPTH_KEY = "wanted_depth_m"
"""Key in a record's metadata for the wanted depth: pairs [position, depth] along the cut [m], linear between."""
LAYER_DEPTH_KEY = "layer_depth_m"
"""Key in a record's metadata for the depth below the surface at which another layer begins [m]."""
_LARGEST_SD = 0.02  # [m]
_MAX_DEPTH = 0.1  # [m]
_STRAIGHT = 1e-9  # change of the slope that is rounding


def depth_sd(trace: Trace) -> float | None:
    """Return the depth's standard deviation in a record [m], or None."""
    sd = trace.metadata.get(DEPTH_SD_KEY)
    return None if sd is None else in_range(f"metadata {DEPTH_SD_KEY}", sd, 0.0, _LARGEST_SD, "m", "0.3 mm is 0.0003.")


@dataclass(frozen=True, kw_only=True, eq=False)
class DepthProfile:
    """Depth of cut B [m] over position [m], piecewise linear.

    Both have shape (n,); the depth is constant beyond the ends.
    """

    position: Array
    depth: Array

    @classmethod
    def constant(cls, depth: float) -> DepthProfile:
        """Return the profile of the same depth [m] everywhere."""
        return cls(position=np.array([0.0, 1.0]), depth=np.array([depth, depth]))

    @classmethod
    def recorded(cls, trace: Trace, *, by: str) -> DepthProfile:
        """Return the depth where the blade first passed.

        Without depth or position it is a ValueError that names the function `by` which needs them.
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
        return float(trapezoid(self.at(x), x))


def wanted_depth(points: object, *, name: str = WANTED_DEPTH_KEY) -> DepthProfile:
    """Return a wanted depth profile from pairs [position, depth] [m].

    Positions from the clamp increase, -0.05 to 0.5, depths below the surface are 0 to 0.1 [m]. A single pair is one
    depth everywhere. Messages name the argument `name`.
    """
    try:
        pairs = np.array(points, dtype=np.float64)
    except (TypeError, ValueError):
        pairs = np.zeros(0)
    if pairs.ndim != 2 or pairs.shape[1:] != (2,) or not len(pairs):
        raise ValueError(f"{name} = {points!r} is no list of pairs [position, depth] in metres, as [[0, 0.008]].")
    position = array_in_range(f"{name}: position", pairs[:, 0], -0.05, 0.5, "m", "8 cm is 0.08.")
    depth = array_in_range(f"{name}: depth", pairs[:, 1], 0.0, 0.1, "m", "8 mm is 0.008.")
    if (np.diff(position) <= 0.0).any():
        raise ValueError(f"{name}: its positions must increase, and are {position.tolist()} m. Sort the pairs.")
    return DepthProfile(position=position, depth=depth)


def corners(position: Array, depth: Array) -> list[list[float]]:
    """Return the pairs [position, depth] [m] where a depth profile bends."""
    slope = np.diff(depth) / np.diff(position)
    bent = np.abs(np.diff(slope)) > _STRAIGHT
    return [[float(position[i]), float(depth[i])] for i in (0, *(np.flatnonzero(bent) + 1), len(position) - 1)]


def with_blade_depth(trace: Trace) -> Trace:
    """Return a record with the blade's depth at its height.

    A record without height is returned as it is. A rig records the depth that a blade at height 0 would cut, as
    measured beforehand, and the height beside it.
    """
    if trace.height is None or trace.depth is None:
        return trace
    return dataclasses.replace(trace, depth=np.clip(trace.depth - trace.height, 0.0, _MAX_DEPTH))


def fit_bulge(profiles: Sequence[DepthProfile], first: Sequence[float]) -> dict[str, float]:
    """Fit a bulge's edge, crown, rise, and mean depth [m].

    The mean is beyond ``first`` positions. As for pig liver, the mean is over the range where segments are measured,
    not over the thin edge.
    """
    x = np.concatenate([profile.position for profile in profiles])
    B = np.concatenate([profile.depth for profile in profiles])
    beyond = [p.depth[p.position >= min(a, p.position[-1])] for p, a in zip(profiles, first, strict=True)]
    mean = float(np.mean([depths.mean() for depths in beyond]))
    low, high = 1e-4, 0.05
    crown = float(np.clip(B.max(), 1e-3, high))
    if np.ptp(B) < 0.02 * B.mean():
        return {"edge_depth": crown, "crown_depth": crown, "rise_length": 0.06, "mean_depth": mean}

    def misfit(p: Array) -> Array:
        edge, rise = p[1] * math.exp(min(p[0], 0.0)), math.exp(p[2])
        fitted = bulge(x, edge=max(edge, low), crown=max(p[1], edge, low), rise_length=rise, length=LENGTH)
        return np.asarray(fitted - B)

    start = np.array([math.log(max(float(B.min()), low) / crown) - 1e-3, crown, math.log(0.06)])
    bounds = ([math.log(low / high), 1e-3, math.log(1e-3)], [0.0, high, 0.0])
    p = least_squares(misfit, np.clip(start, bounds[0], bounds[1]), bounds=bounds, x_scale=[1.0, 0.01, 1.0]).x
    return {
        "edge_depth": float(max(p[1] * math.exp(p[0]), low)),
        "crown_depth": float(p[1]),
        "rise_length": math.exp(p[2]),
        "mean_depth": mean,
    }


def unit_stiffness(tip: float | Array, depth: DepthProfile, model: CutModel) -> Array:
    """Return K over the material modulus [m] at tips [m]."""
    a = np.clip(tip, 0.0, model.length)
    return np.asarray(model.stiffness(a) * effective_depth(a, depth.at(tip)))


def stiffness_ratio(
    known: float | Array, wanted: float | Array, depth: DepthProfile, model: CutModel | None = None
) -> Array:
    """Return K at ``wanted`` over K at ``known`` tips [m], close together [1].

    In a slab of 2.5 cm K rises more slowly than in proportion to the depth of the cut. Without the model, whose unit
    stiffness is a factor, only depth counts, as within a unit of cutting.
    """
    if model is not None:
        return np.asarray(unit_stiffness(wanted, depth, model) / unit_stiffness(known, depth, model))
    return np.asarray(effective_depth(wanted, depth.at(wanted)) / effective_depth(known, depth.at(known)))
