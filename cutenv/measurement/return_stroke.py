"""The return stroke: the blade leaves the tip, and friction is left (section 6.2, Figures 6.5 to 6.7)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from cutenv.measurement.depth import DepthProfile
from cutenv.measurement.strokes import Stroke, bin_means, bins_of_travel, strokes
from cutenv.trace import Trace

Array = NDArray[np.float64]

_BIN = 0.2e-3  # [m] of travel: equal weight to every place, whatever the speed
_PLAIN_LENGTH = 2e-3  # [m] of plain friction behind the tip: with less, tip and friction are not told apart
_PUSHED_BACK = 0.1  # of the largest force: more than a sensor's zero is off
_SINGULAR = 1e-12  # determinant of the normal equations over the product of their diagonal
_UNLOADED = 3.0  # residual standard deviations: a smaller elastic force at the turn is none


@dataclass(frozen=True, kw_only=True)
class ReturnStroke:
    """What the way back from the deepest point of a cut shows.

    Attributes
    ----------
    stop : int
        The stroke ends before this reading of the trace.
    tip : float
        Where the force became plain friction [m]: unloading is elastic, and its zero tells the tip.
    friction_per_depth : float
        Friction on the moving blade per depth of cut [N/m].
    stiffness : float
        K = E0 kappa B of the unloading [N/m], free of the growth that accompanies loading; 0 if the tip was
        already unloaded when the blade turned.
    """

    stop: int
    tip: float
    friction_per_depth: float
    stiffness: float


def fit_return_stroke(trace: Trace, depth: DepthProfile) -> ReturnStroke | None:
    """Fit the way back from the deepest point: F = K max(x - a, 0) - f B(x), by least squares in K, f and a.

    Returns None if the blade did not come back, or not far enough past the tip, or cut no depth.
    """
    (position,) = trace.require("position", by="fit_return_stroke")
    way_back = _way_back(trace, position)
    if not way_back:
        return None
    x, F = (np.concatenate(parts) for parts in zip(*(_binned(trace, position, s) for s in way_back), strict=True))
    B = depth.at(x)
    lowest, highest = float(x.min()) + _PLAIN_LENGTH, float(x.max())
    if highest <= lowest or not B.any():
        return None

    def misfit(a: float) -> float:
        return _hinge(x, F, B, a)[2]

    places = np.linspace(lowest, highest, 200)
    best = int(np.argmin([misfit(a) for a in places]))
    if best == 0:
        return None
    around = (float(places[best - 1]), float(places[min(best + 1, len(places) - 1)]))
    tip = float(minimize_scalar(misfit, bounds=around, method="bounded").x)
    stiffness, friction, squares = _hinge(x, F, B, tip)
    noise = float(np.sqrt(squares / len(x)))
    if stiffness * (highest - tip) < _UNLOADED * noise:
        # Nothing to unload: the tip stood at the blade, or the blade in the open crack.
        friction = float(-(B @ F) / (B @ B))
        tip, stiffness = highest, 0.0
    if -friction * float(B.mean()) > _PUSHED_BACK * float(trace.force.max()):
        return None  # what looks plain still pushes the blade back: elastic, not friction
    return ReturnStroke(stop=way_back[-1].stop, tip=tip, friction_per_depth=max(friction, 0.0), stiffness=stiffness)


def _way_back(trace: Trace, position: Array) -> list[Stroke]:
    """Return the backward strokes between the deepest point and the next forward stroke."""
    deepest = int(np.argmax(position))
    later = [s for s in strokes(trace.time, position) if s.stop > deepest]
    if later and later[0].forward:  # the stroke that led to the deepest point
        later = later[1:]
    ends = next((i for i, stroke in enumerate(later) if stroke.forward), len(later))
    return later[:ends]


def _binned(trace: Trace, position: Array, stroke: Stroke) -> tuple[Array, Array]:
    borders = bins_of_travel(position[stroke.samples], _BIN)
    return bin_means(position[stroke.samples], borders), bin_means(trace.force[stroke.samples], borders)


def _hinge(x: Array, F: Array, B: Array, a: float) -> tuple[float, float, float]:
    """Return K [N/m], f [N/m] and the sum of squares [N2] of the best F = K max(x - a, 0) - f B for a tip."""
    h = np.maximum(x - a, 0.0)
    hh, hB, BB, hF, BF = float(h @ h), float(h @ B), float(B @ B), float(h @ F), float(B @ F)
    determinant = hh * BB - hB**2
    # With no reading before the tip, or one, only friction can be told.
    K = (hF * BB - BF * hB) / determinant if determinant > _SINGULAR * hh * BB else 0.0
    f = (K * hB - BF) / BB
    residual = F - K * h + f * B
    return K, f, float(residual @ residual)
