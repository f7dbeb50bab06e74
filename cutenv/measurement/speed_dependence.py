"""The local effective modulus against speed and angle of the blade: a level and a fall at 45 and at 90 degrees.

At 45 degrees it falls in a straight line; at 90 in the steps of pig liver (``measured_liver().falls_90``), by a size of
its own: cuts at a few speeds tell how far it falls, not in which way.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cutenv.tissue.description import measured_liver
from cutenv.tissue.fall import speed_on_line

Array = NDArray[np.float64]

UPRIGHT, INCLINED = math.pi / 2, math.pi / 4
BETWEEN = math.radians(67.5)
"""Steeper cuts are counted with the upright ones, flatter ones with the inclined [rad]."""
LEAST_SPEED_RATIO = 1.5
"""Of the fastest over the slowest cut, from which on a fall with speed can be told."""
LEAST_SHARE = 0.1
"""Least share of the fall at 90 degrees, between the slowest and the fastest cut, that tells its size."""
LEAST_FIT = 0.1
"""Of a cut's modulus: a line that gives less at its speed and angle counts as giving this."""
_SLACK = math.radians(0.5)  # beyond 45 and 90 degrees, for angles set by hand and read from a scale
_ROUNDS = 3  # of re-weighting: the scatter is proportional to the modulus


@dataclass(frozen=True, kw_only=True)
class SpeedDependence:
    """LEM(v, theta) = intercept + slope u(v) at 45 and at 90 degrees, linear in the angle between.

    u is the speed at 45 degrees; at 90 it is :func:`cutenv.tissue.fall.speed_on_line` of pig liver's steps.

    Attributes
    ----------
    intercept_90, intercept_45 : float
        For v -> 0 [Pa].
    slope_90, slope_45 : float
        [Pa s/m].
    measured : frozenset of str
        Which of the four the cuts tell; the others are pig liver's, in proportion.
    """

    intercept_90: float
    slope_90: float
    intercept_45: float
    slope_45: float
    measured: frozenset[str]

    def modulus(self, speed: float, angle: float | None) -> float:
        """LEM [Pa] at a speed [m/s] and an angle [rad] between 45 and 90 degrees; upright for None."""
        return float(self.moduli(speed, UPRIGHT if angle is None else angle))

    def moduli(self, speeds: ArrayLike, angles: ArrayLike) -> Array:
        """LEM [Pa] of many cuts at once, shapes (n,)."""
        v, w = np.asarray(speeds), _uprightness(angles)
        upright, inclined = self.intercept_90 + self.slope_90 * on_line(v), self.intercept_45 + self.slope_45 * v
        return np.asarray((1.0 - w) * inclined + w * upright)

    def loading_ratio(self, speed: float, angle: float | None) -> float:
        """Loading ratio r = min(1, LEM(v, theta)/E0) [1], at least 0.01: E0 is the intercept at 90 degrees."""
        return min(1.0, max(self.modulus(abs(speed), angle) / self.intercept_90, 0.01))


def fit_speed_dependence(speeds: ArrayLike, angles: ArrayLike, moduli: ArrayLike) -> SpeedDependence:
    """Fit cuts' mean moduli by least squares of relative deviations.

    Parameters
    ----------
    speeds, angles, moduli : array_like of shape (n,)
        Of the cuts [m/s], [rad], [Pa].

    Returns
    -------
    SpeedDependence
        Where no cut was steeper than 67.5 degrees, or none flatter, or the speeds at such angles differ by less
        than a factor of 1.5, pig liver's ratio stands in and `measured` says so.

    Raises
    ------
    ValueError
        If there is no cut.
    """
    v, theta, E = (np.asarray(values, np.float64) for values in (speeds, angles, moduli))
    if not len(v):
        raise ValueError("no cut to fit the modulus to: give one or more.")
    tie, free = _ties(v, theta)
    w = _uprightness(theta)
    # Columns of intercept_90, slope_90, intercept_45, slope_45.
    design = np.stack([w, w * on_line(v), 1.0 - w, (1.0 - w) * v], axis=1) @ tie
    scale = np.abs(design).max(axis=0)
    weight = 1.0 / E
    for _ in range(_ROUNDS):
        (q, *_) = np.linalg.lstsq(design / scale * weight[:, None], E * weight, rcond=None)
        fitted = design / scale @ q
        weight = 1.0 / np.maximum(fitted, LEAST_FIT * E)
    values = [float(value) for value in tie @ (q / scale)]
    return SpeedDependence(
        intercept_90=values[0], slope_90=values[1], intercept_45=values[2], slope_45=values[3], measured=free
    )


def on_line(speed: ArrayLike) -> Array:
    """Speed [m/s] at which a straight line would have fallen as far as pig liver's steps have at ``speed``."""
    return speed_on_line(speed, measured_liver().falls_90)


def _tell_the_fall(speeds: Array, angle: int) -> bool:
    """True if cuts at these speeds [m/s] tell how far the LEM falls at 45 or 90 degrees."""
    differ = bool(speeds.max() >= LEAST_SPEED_RATIO * speeds.min() > 0.0)
    if angle == 90:
        least = LEAST_SHARE * float(on_line(np.inf))
        return differ and float(np.ptp(on_line(speeds))) >= least
    return differ


def _uprightness(angle: ArrayLike) -> Array:
    """0 at 45 degrees, 1 at 90."""
    return np.clip((np.asarray(angle) - INCLINED) / (UPRIGHT - INCLINED), 0.0, 1.0)


def is_between_the_measured(angle: float) -> bool:
    """Whether an angle [rad] lies between 45 and 90 degrees, half a degree allowed."""
    return INCLINED - _SLACK <= angle <= UPRIGHT + _SLACK


def _ties(v: Array, theta: Array) -> tuple[Array, frozenset[str]]:
    """Matrix from free to all four parameters, (4, n_free), and the names of those that are free."""
    tissue = measured_liver()
    liver = {
        90: (tissue.intercept_90, tissue.slope_90),
        45: (tissue.intercept_45, tissue.slope_45),
    }
    steep = theta >= BETWEEN
    groups = {90: v[steep], 45: v[~steep]}
    known = [angle for angle, speeds in groups.items() if len(speeds)]
    columns, free = [], set()
    for angle in known:
        row = 0 if angle == 90 else 2
        other, ratio = 2 - row, [its / own for its, own in zip(liver[135 - angle], liver[angle], strict=True)]
        tied = len(known) == 1  # the other angle then follows this one
        intercept = np.zeros(4)
        intercept[row] = 1.0
        intercept[other] = ratio[0] * tied
        free.add(f"intercept_{angle}")
        if _tell_the_fall(groups[angle], angle):
            slope = np.zeros(4)
            slope[row + 1] = 1.0
            slope[other + 1] = ratio[1] * tied
            free.add(f"slope_{angle}")
            columns += [intercept, slope]
        else:
            intercept[row + 1] = liver[angle][1] / liver[angle][0]
            intercept[other + 1] = ratio[1] * intercept[row + 1] * tied
            columns.append(intercept)
    return np.stack(columns, axis=1), frozenset(free)
