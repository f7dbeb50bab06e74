"""Speed and angle dependence of the local effective modulus.

At 45 degrees it falls linearly; at 90 in the steps of pig liver (``measured_liver().falls_90``), by an amount that
is fitted: cuts at a few speeds determine how far it falls, not along which curve.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from cutenv._base.arrays import Array
from cutenv.sim.tissue.description import measured_liver
from cutenv.sim.tissue.effective_modulus import speed_on_line

UPRIGHT, INCLINED = math.pi / 2, math.pi / 4
BETWEEN = math.radians(67.5)  # angle [rad] that separates the upright cuts (steeper) from the inclined ones
LEAST_SPEED_RATIO = 1.5  # smallest ratio of the fastest to the slowest cut from which a fall with speed is fitted
LEAST_SHARE = 0.1
"""Smallest share of the fall at 90 degrees, between the slowest and the fastest cut, from which its size is fitted."""
LEAST_FIT = 0.1  # lower bound of a fitted modulus, as a share of the cut's own at the same speed and angle
_SLACK = math.radians(0.5)  # beyond 45 and 90 degrees, for angles set by hand and read from a scale
_ROUNDS = 3  # of re-weighting: the scatter is proportional to the modulus


@dataclass(frozen=True, kw_only=True)
class SpeedDependence:
    """LEM(v, theta) = intercept + slope u(v) at 45 and 90 degrees.

    Between these angles it is linear. u is the speed at 45 degrees; at 90 it is
    :func:`~cutenv.sim.tissue.effective_modulus.speed_on_line` of pig liver's steps.

    Attributes
    ----------
    intercept_90, intercept_45 : float
        LEM for v -> 0 [Pa].
    slope_90, slope_45 : float
        Change of the LEM with speed [Pa s/m].
    measured : frozenset of str
        Names of the parameters that the cuts determine; the others are pig liver's, in proportion.
    """

    intercept_90: float
    slope_90: float
    intercept_45: float
    slope_45: float
    measured: frozenset[str]

    def modulus(self, speed: float, angle: float | None) -> float:
        """Return the LEM [Pa] at speed [m/s] and angle [rad].

        The angle is between 45 and 90 degrees; None is upright.
        """
        return float(self.moduli(speed, UPRIGHT if angle is None else angle))

    def moduli(self, speeds: ArrayLike, angles: ArrayLike) -> Array:
        """Return the LEM [Pa] of many cuts, shapes (n,)."""
        v, w = np.asarray(speeds), _uprightness(angles)
        upright, inclined = self.intercept_90 + self.slope_90 * on_line(v), self.intercept_45 + self.slope_45 * v
        return np.asarray((1.0 - w) * inclined + w * upright)

    def loading_ratio(self, speed: float, angle: float | None) -> float:
        """Return the loading ratio min(1, LEM(v, theta)/E0) [1], at least 0.01. E0 is ``intercept_90``."""
        return min(1.0, max(self.modulus(abs(speed), angle) / self.intercept_90, 0.01))


def fit_speed_dependence(speeds: ArrayLike, angles: ArrayLike, moduli: ArrayLike) -> SpeedDependence:
    """Fit cuts' mean moduli by relative least squares.

    Parameters
    ----------
    speeds, angles, moduli : array_like of shape (n,)
        Speed [m/s], angle [rad] and mean modulus [Pa] of each cut.

    Returns
    -------
    SpeedDependence
        If no cut was steeper than 67.5 degrees, or none flatter, or the speeds at such angles differ by less than a
        factor of 1.5, pig liver's ratio is used and `measured` lacks the parameter.

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
    """Return the speed [m/s] of equal fall on a straight line.

    The fall is that of pig liver's steps.
    """
    return speed_on_line(speed, measured_liver().falls_90)


def _tell_the_fall(speeds: Array, angle: int) -> bool:
    """Return True if speeds [m/s] determine the LEM's fall."""
    differ = bool(speeds.max() >= LEAST_SPEED_RATIO * speeds.min() > 0.0)
    if angle == 90:
        least = LEAST_SHARE * float(on_line(np.inf))
        return differ and float(np.ptp(on_line(speeds))) >= least
    return differ


def _uprightness(angle: ArrayLike) -> Array:
    """Return 0 at 45 degrees, 1 at 90, linear between."""
    return np.clip((np.asarray(angle) - INCLINED) / (UPRIGHT - INCLINED), 0.0, 1.0)


def is_between_the_measured(angle: float) -> bool:
    """Return True for an angle [rad] within 45 to 90 degrees, or nearly."""
    return INCLINED - _SLACK <= angle <= UPRIGHT + _SLACK


def _ties(v: Array, theta: Array) -> tuple[Array, frozenset[str]]:
    """Return the matrix to all parameters, (4, n_free), and free names."""
    tissue = measured_liver()
    liver = {90: (tissue.intercept_90, tissue.slope_90), 45: (tissue.intercept_45, tissue.slope_45)}
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
