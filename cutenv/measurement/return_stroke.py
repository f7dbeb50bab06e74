"""The return stroke: the blade leaves the tip, and friction is left (section 6.2, Figures 6.5 to 6.7)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from cutenv.measurement.depth import DepthProfile
from cutenv.measurement.strokes import Stroke, bin_means, bins_of_travel, strokes
from cutenv.trace import Trace

Array = NDArray[np.float64]

_BIN = 0.2e-3  # [m] of travel: equal weight to every place, whatever the speed
_TURNS = 0.4e-3  # [m] from the turn, over which friction and a sensor with a delay follow the reversal; left out
_PLAIN_LENGTH = 2e-3  # [m] of plain friction behind the tip: with less, tip and friction are not told apart
_LOADED_LENGTH = 1e-3  # [m] besides: in less, a slope through some bins passes for the tissue's
_PUSHED_BACK = 0.1  # of the largest force: more than a sensor's zero is off
_SINGULAR = 1e-12  # determinant of the normal equations over the product of their diagonal
_UNLOADED = 3.0  # residual standard deviations: a smaller elastic force at the turn is none
_VARIES = 0.5  # of the greatest depth behind the tip is the least one there, or less: else offset and friction are one
_CORRELATED = 5.0  # times an error that independent bins would have: depth is measured with one that lasts 10 mm


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
        K of the unloading [N/m], free of the growth that accompanies loading; 0 if the tip was already unloaded when
        the blade turned.
    offset, offset_error : float
        The force's constant part, and its standard error [N]; 0 unless it was asked for.
    """

    stop: int
    tip: float
    friction_per_depth: float
    stiffness: float
    offset: float = 0.0
    offset_error: float = 0.0


def fit_return_stroke(trace: Trace, depth: DepthProfile, *, with_offset: bool = False) -> ReturnStroke | None:
    """Fit the way back from the deepest point: F = K max(x - a, 0) - f B(x) + c, by least squares in K, f, c and a.

    The first 0.4 mm are left out: friction turns over with the bristles of tissue that stick to the blade, and the
    sensor follows with a delay.

    Parameters
    ----------
    trace : Trace
        With position; force in any unit.
    depth : DepthProfile
        Of the cut.
    with_offset : bool
        True: c is the offset of a sensor whose zero is not known. False: c = 0.

    Returns
    -------
    ReturnStroke or None
        None if the blade did not come back, or not far enough past the tip, or cut no depth; with an offset also if
        depth varies by less than a factor of 2 behind the tip, so that offset and friction look alike.
    """
    (position,) = trace.require("position", by="fit_return_stroke")
    way_back = _way_back(trace, position)
    if not way_back:
        return None
    x, F = (np.concatenate(parts) for parts in zip(*(_binned(trace, position, s) for s in way_back), strict=True))
    turn = float(x.max())
    x, F = (values[x < turn - _TURNS] for values in (x, F))
    B = depth.at(x)
    if not len(x) or not B.any() or float(np.ptp(x)) < _PLAIN_LENGTH + _LOADED_LENGTH:
        return None
    lowest, highest = float(x.min()) + _PLAIN_LENGTH, float(x.max())

    def misfit(a: float) -> float:
        return _hinge(x, F, B, a, with_offset).squares

    places = np.linspace(lowest, highest, 200)
    best = int(np.argmin([misfit(a) for a in places]))
    if best == 0:
        return None
    around = (float(places[best - 1]), float(places[min(best + 1, len(places) - 1)]))
    tip = float(minimize_scalar(misfit, bounds=around, method="bounded").x)
    fit = _hinge(x, F, B, tip, with_offset)
    noise = float(np.sqrt(fit.squares / len(x)))
    if fit.stiffness * (turn - tip) < _UNLOADED * noise:
        # Nothing to unload: the tip stood at the blade, or the blade in the open crack.
        tip = turn
        fit = _hinge(x, F, B, tip, with_offset)
    plain = B[x <= tip]
    if with_offset and plain.min() > _VARIES * plain.max():
        return None
    if -fit.friction * float(B.mean()) > _PUSHED_BACK * float(trace.force.max()):
        return None  # what looks plain still pushes the blade back: elastic, not friction
    return ReturnStroke(
        stop=way_back[-1].stop,
        tip=tip,
        friction_per_depth=max(fit.friction, 0.0),
        stiffness=fit.stiffness,
        offset=fit.offset,
        offset_error=_CORRELATED * noise / math.sqrt(len(plain)) * _inflation(plain) if with_offset else 0.0,
    )


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


class _Hinge(NamedTuple):
    """The best F = K max(x - a, 0) - f B + c for a tip, and its sum of squares [N2]."""

    stiffness: float  # K [N/m]
    friction: float  # f [N/m]
    offset: float  # c [N]
    squares: float


def _hinge(x: Array, F: Array, B: Array, a: float, with_offset: bool) -> _Hinge:
    h = np.maximum(x - a, 0.0)
    h0, B0, F0 = (float(values.mean()) if with_offset else 0.0 for values in (h, B, F))
    # About their means the three are free of the constant.
    dh, dB, dF = h - h0, B - B0, F - F0
    hh, hB, BB, hF, BF = float(dh @ dh), float(dh @ dB), float(dB @ dB), float(dh @ dF), float(dB @ dF)
    determinant = hh * BB - hB**2
    # With no reading before the tip, or one, only friction can be told.
    K = (hF * BB - BF * hB) / determinant if determinant > _SINGULAR * hh * BB else 0.0
    f = (K * hB - BF) / BB if BB > 0.0 else 0.0
    residual = dF - K * dh + f * dB
    return _Hinge(K, f, F0 - K * h0 + f * B0, float(residual @ residual))


def _inflation(B: Array) -> float:
    """By how much larger than that of a mean the standard error of a constant is beside a multiple of B [1]."""
    return math.sqrt(float(np.mean(B**2)) / max(float(B.var()), _SINGULAR * float(np.mean(B**2))))
