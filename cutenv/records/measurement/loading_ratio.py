"""Loading ratio: force rise while cutting over that without growth."""

from __future__ import annotations

import math
from collections.abc import Callable

from cutenv._base.validation import in_range
from cutenv.sim.tissue.description import measured_liver
from cutenv.sim.tissue.effective_modulus import checked_angle, checked_speed

LoadingRatio = Callable[[float, float | None], float]  # function from speed [m/s] and angle [rad] to r [1]
_SLACK = 1e-6  # [rad], for angles converted to degrees and back
_SPEED_SLACK = 0.02  # relative tolerance of the speed, which a record gives with noise


def loading_ratio(speed: float, angle: float | None) -> float:
    """Return r = min(1, LEM(v, theta)/E0) of pig liver.

    Speeds [m/s] are 0 to 0.1; outside the measured 0.001 to 0.0254 the nearest measured one is used. Angles [rad] are
    pi/4 to pi/2; another one, or what looks like another unit, is an error.

    As in the law (``measured_liver``): Table 5.6, depth-normalised plane stress, its means at 90 and the line at 45
    degrees. E0 is the value for v -> 0 at 90 degrees, itself a local effective modulus: the LEMs enter the law only by
    this ratio; its stiffness is that of the material.
    """
    if angle is None:
        raise TypeError("the loading ratio of pig liver needs the angle of the blade; else give loading_ratio.")
    theta = angle
    for end in (math.pi / 4, math.pi / 2):
        theta = end if abs(theta - end) < _SLACK else theta
    liver = measured_liver()
    modulus = liver.local_effective_modulus(float(checked_speed(speed)), float(checked_angle(theta)))
    return min(1.0, modulus / liver.intercept_90)


def loading_ratio_of(given: float | LoadingRatio | None, *, low: float = 0.0) -> LoadingRatio:
    """Return the ratio as function: pig liver's (None) or constant."""
    if given is None:
        return loading_ratio
    if callable(given):
        return given
    number = in_range("loading_ratio", given, low, 1.0, "1", "It is LEM over quasi-static modulus.")
    return lambda speed, angle: number


def in_measured_range(speed: float) -> bool:
    """Return True if the ratio was measured at ``speed`` [m/s]."""
    liver = measured_liver()
    return (1.0 - _SPEED_SLACK) * liver.speed_min <= speed <= (1.0 + _SPEED_SLACK) * liver.speed_max
