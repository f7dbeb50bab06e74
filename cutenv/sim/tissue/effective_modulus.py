"""The local effective modulus by speed and angle.

Fits to Tables 5.5 to 5.7 (equations 5.1 to 5.10), and its fall.

A local effective modulus (LEM) is the modulus measured in a cut: the slope of a loading increment over kappa and the
depth of cut (equations 3.1 and 3.2). It is apparent: in a slab that is not cut through it is higher than the modulus
of the material (``TissueDescription.modulus``), and it contains friction and the lag of the tip. The thesis's force is
the norm of the sensor's three components (sections 3.3.2 and 5.3), so that it contains vertical and lateral force too.

It belongs to the model with which it was found: here 8 x 15 quadratic plane elements on 8 cm x 15 cm (section 4.2),
with the given formulation and Poisson's ratio. ``CutModel.convert_modulus`` converts it to another model.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal, overload

import numpy as np
from numpy.typing import ArrayLike

from cutenv._base.arrays import Array
from cutenv._base.validation import array_in_range, in_range, one_of
from cutenv.sim.tissue.tables import table

Falls = tuple[tuple[float, float, float], ...]
"""Steps of a fall: share of the whole [1], and the two speeds [m/s] between which it is linear."""

MAX_STEPS = 3  # largest number of steps that the cutting law has fields for


def checked_falls(name: str, given: Iterable[Iterable[float]]) -> Falls:
    """Return the steps as a tuple; raise ValueError if invalid."""
    shape = (
        f"{name}: give up to {MAX_STEPS} steps (share, from [m/s], to [m/s]) whose shares sum to 1, or () for a line."
    )
    try:
        falls = tuple((float(share), float(start), float(end)) for share, start, end in given)
    except (TypeError, ValueError):
        raise ValueError(f"{shape} Found {given!r}.") from None
    if len(falls) > MAX_STEPS or (falls and abs(sum(share for share, *_ in falls) - 1.0) > 1e-6):
        raise ValueError(f"{shape} Found {falls!r}.")
    for share, start, end in falls:
        in_range(f"{name}, share", share, 0.0, 1.0, "1", "0.4 is 40 % of the fall.")
        in_range(f"{name}, from", start, 0.0, 0.5, "m/s", "1.27 cm/s is 0.0127.")
        in_range(f"{name}, to", end, start + 1e-6, 0.5, "m/s", "A step ends at a greater speed than it begins.")
    return falls


def end_of_fall(falls: Falls) -> float:
    """Return the speed [m/s] at which the last step ends."""
    return max(end for *_, end in falls)


def speed_on_line(speed: ArrayLike, falls: Falls) -> Array:
    """Return the speed [m/s] of an equal fall on a line.

    The line has the same mean slope; without steps it is ``speed``.
    """
    v = np.asarray(speed, np.float64)
    if not falls:
        return v
    fallen = sum(share * np.clip((v - start) / (end - start), 0.0, 1.0) for share, start, end in falls)
    return np.asarray(end_of_fall(falls) * fallen)


Formulation = Literal["plane_stress", "plane_strain"]

_CM_PER_M = 100
_FORMULATIONS: tuple[Formulation, ...] = ("plane_stress", "plane_strain")
_LARGEST_SPEED = 0.1  # a larger number is not a slow scalpel's speed in m/s but probably one in cm/s
_ANGLE_TOLERANCE = 1e-9  # admits the end points after rounding through degrees and back
_TABLES = {(0.3, True): "5.6", (0.3, False): "5.5", (0.499, True): "5.7"}


@dataclass(frozen=True, kw_only=True)
class SpeedFit:
    """LEM = intercept + slope v, fitted from ``speed_min`` to ``speed_max``."""

    intercept: float  # LEM for v -> 0 [Pa], positive
    slope: float  # [Pa s/m]
    speed_min: float  # [m/s]
    speed_max: float
    source: str  # table, angle, formulation and Poisson's ratio

    def __post_init__(self) -> None:
        """Raise ValueError unless the modulus is positive at every speed."""
        _check_range(self.speed_min, self.speed_max)
        in_range("intercept", self.intercept, 1e-3, 1e9, "Pa", "A modulus is positive.")
        in_range("slope", self.slope, -1e12, 1e12, "Pa s/m")
        in_range("modulus at speed_max", self.intercept + self.slope * self.speed_max, 1e-3, 1e9, "Pa", self.source)

    def modulus(self, speed: ArrayLike) -> Array:
        """Return the LEM [Pa] at ``speed`` [m/s], clamped to measured speeds."""
        v = np.clip(checked_speed(speed), self.speed_min, self.speed_max)
        return np.asarray(self.intercept + self.slope * v)


@dataclass(frozen=True, kw_only=True)
class PowerFit:
    """LEM = modulus_at_reference (v/reference_speed)^exponent, fitted from ``speed_min`` to ``speed_max``."""

    modulus_at_reference: float  # [Pa], positive
    exponent: float
    speed_min: float  # [m/s]
    speed_max: float
    source: str  # table, angle, formulation and Poisson's ratio
    reference_speed: float = 1 / _CM_PER_M  # [m/s]; gives the numbers of equations 5.3 and 5.4

    def __post_init__(self) -> None:
        """Raise ValueError for a fit that is not a modulus."""
        _check_range(self.speed_min, self.speed_max)
        in_range("modulus_at_reference", self.modulus_at_reference, 1e-3, 1e9, "Pa", "A modulus is positive.")
        in_range("exponent", self.exponent, -10.0, 10.0, "1")
        in_range("reference_speed", self.reference_speed, 1e-6, 1.0, "m/s")

    def modulus(self, speed: ArrayLike) -> Array:
        """Return the LEM [Pa] at ``speed`` [m/s], clamped to measured speeds."""
        v = np.clip(checked_speed(speed), self.speed_min, self.speed_max)
        return np.asarray(self.modulus_at_reference * (v / self.reference_speed) ** self.exponent)


@functools.cache
def linear_fit(number: str, *, angle_deg: float = 90, formulation: Formulation = "plane_stress") -> SpeedFit:
    """Fit a line to Table 5.5, 5.6 or 5.7 by least squares.

    At 90 or 45 degrees, valid from 0.001 to 0.0254 m/s: equations 5.1, 5.2 and 5.5 to 5.10; 5.6 and 5.7 are printed
    under each other's labels.  ValueError if there is no such fit; Table 5.5 at 45 deg follows a power law, see
    :func:`power_fit`.
    """
    one_of("table number", number, ("5.5", "5.6", "5.7"))
    if number == "5.5" and angle_deg == 45:
        raise ValueError("Table 5.5 at 45 deg is not linear in speed (equations 5.3, 5.4). Use power_fit.")
    speed, modulus, source = _measured(number, angle_deg, formulation)
    slope, intercept = np.polyfit(speed, modulus, 1)
    return SpeedFit(
        intercept=float(intercept),
        slope=float(slope),
        speed_min=float(speed.min()),
        speed_max=float(speed.max()),
        source=source,
    )


def _isotonic(values: Array) -> Array:
    """Return the nearest non-increasing numbers by the min-max formula."""
    n = range(len(values))
    return np.array([min(max(values[j : k + 1].mean() for k in n[i:]) for j in n[: i + 1]) for i in n])


@functools.cache
def falls(
    number: str, *, angle_deg: float = 90, formulation: Formulation = "plane_stress"
) -> tuple[float, float, Falls]:
    """Fit a non-increasing (isotonic) curve to Table 5.5, 5.6 or 5.7.

    Of all non-increasing curves, linear between the measured speeds, it is the nearest to the means.  Return the LEM at
    the slowest speed [Pa], the mean slope from 0 to the speed at which the last step ends [Pa s/m], and the steps, see
    :mod:`cutenv.sim.tissue.effective_modulus`.
    """
    speed, modulus, _ = _measured(number, angle_deg, formulation)
    level = _isotonic(modulus)
    whole = float(level[0] - level[-1])
    shares = -np.diff(level) / whole
    steps = tuple(
        (float(f"{share:.12g}"), float(v), float(w))
        for share, v, w in zip(shares, speed[:-1], speed[1:], strict=True)
        if share > 0.0
    )
    return float(level[0]), -whole / end_of_fall(steps), steps


@functools.cache
def power_fit(*, formulation: Formulation = "plane_stress") -> PowerFit:
    """Fit Table 5.5's power law (equations 5.3, 5.4) by logarithmic regression.

    It is valid from 0.001 to 0.0254 m/s.  Of the two usual methods the logarithmic one is closer to the printed values:
    24.24 v^-0.424 and 22.17 v^-0.432 against the printed 24.21 v^-0.42 and 22.17 v^-0.43 (kPa, v in cm/s); least
    squares of the moduli themselves give 24.38 and 22.36. The 24.21 results with the 63 kPa of section 5.1's text in
    place of the table's 64.
    """
    speed, modulus, source = _measured("5.5", 45, formulation)
    exponent, log_modulus = np.polyfit(np.log(speed * _CM_PER_M), np.log(modulus), 1)
    return PowerFit(
        modulus_at_reference=math.exp(log_modulus),
        exponent=float(exponent),
        speed_min=float(speed.min()),
        speed_max=float(speed.max()),
        source=source,
    )


def quasi_static_modulus() -> float:
    """Return E0 [Pa], the LEM for v -> 0 at 90 deg.

    It is 48.4 kPa on the thesis's line (Table 5.6, equation 5.5).  ``measured_liver`` follows the means instead, which
    begin at 51 kPa.  E0 is not the modulus of the material, which is lower: see ``TissueDescription.modulus``.
    """
    return linear_fit("5.6", angle_deg=90, formulation="plane_stress").intercept


@overload
def local_effective_modulus(
    speed: float, angle: float, formulation: Formulation = ..., poisson: float = ..., depth_normalised: bool = ...
) -> float: ...


@overload
def local_effective_modulus(
    speed: ArrayLike,
    angle: ArrayLike,
    formulation: Formulation = ...,
    poisson: float = ...,
    depth_normalised: bool = ...,
) -> float | Array: ...


def local_effective_modulus(
    speed: ArrayLike,
    angle: ArrayLike,
    formulation: Formulation = "plane_stress",
    poisson: float = 0.3,
    depth_normalised: bool = True,
) -> float | Array:
    """Return pig liver's mean local effective modulus by speed and angle.

    Parameters
    ----------
    speed : float or array_like
        Magnitude of the cutting speed [m/s], 0 to 0.1. Outside the measured 0.001 to 0.0254 the value at the
        nearest measured speed is used.
    angle : float or array_like
        Blade against surface [rad], pi/4 to pi/2 (upright); linear between the two measured angles. Broadcast
        with ``speed``.
    formulation : str
        ``"plane_stress"`` or ``"plane_strain"``.
    poisson : float
        0.3, or 0.499 (depth-normalised only). 0.499 reads Table 5.7 as printed, which is an erratum: in plane stress
        1.5 to 1.8 times the moduli at 0.3, where the elements and Table 4.4 differ by 2 %. For a model with that ratio
        convert the moduli for 0.3 with ``CutModel.convert_modulus``.
    depth_normalised : bool
        True: from force per depth of cut (Tables 5.6, 5.7). False: from the force as measured, as if every
        cut were 1 cm deep (Table 5.5).

    Returns
    -------
    float or ndarray of float64
        LEM [Pa]; a float for two scalars, else the broadcast shape.

    Raises
    ------
    TypeError, ValueError
        If an argument is not a number, is out of range, or looks like cm/s or degrees.

    Notes
    -----
    Source: Tables 5.5 to 5.7, fitted linearly (power law for Table 5.5 at 45 deg). Livers and cuts scatter
    about it, see ``cutenv.sim.tissue.description``.
    """
    v = checked_speed(speed)
    theta = checked_angle(angle)
    try:
        v, theta = np.broadcast_arrays(v, theta)
    except ValueError:
        raise ValueError(
            f"speed of shape {v.shape} and angle of shape {theta.shape} do not fit together. "
            "Give one number, or equal shapes."
        ) from None
    number = _table_number(poisson, depth_normalised)
    upright = linear_fit(number, angle_deg=90, formulation=formulation)
    inclined: SpeedFit | PowerFit = (
        power_fit(formulation=formulation)
        if number == "5.5"
        else linear_fit(number, angle_deg=45, formulation=formulation)
    )
    share = np.clip((theta - math.radians(45)) / math.radians(45), 0.0, 1.0)
    modulus = (1 - share) * inclined.modulus(v) + share * upright.modulus(v)
    return float(modulus) if modulus.ndim == 0 else modulus


def _table_number(poisson: float, depth_normalised: bool) -> str:
    cure = "Take the modulus at a measured Poisson's ratio and convert it with CutModel.convert_modulus."
    nu = in_range("poisson", poisson, 0.0, 0.5, "1", cure)
    for (measured_poisson, normalised), number in _TABLES.items():
        if math.isclose(nu, measured_poisson, abs_tol=1e-9) and bool(depth_normalised) == normalised:
            return number
    kind = "depth-normalised" if depth_normalised else "not depth-normalised"
    measured = " and ".join(f"{ratio:g}" for ratio, normalised in _TABLES if normalised == bool(depth_normalised))
    raise ValueError(f"poisson = {nu:g} was not measured: the {kind} moduli are for {measured}. {cure}")


def _measured(number: str, angle_deg: float, formulation: Formulation) -> tuple[Array, Array, str]:
    """Return speeds [m/s], mean LEM [Pa] at each, and source."""
    one_of("formulation", formulation, _FORMULATIONS)
    angle = one_of("angle_deg", angle_deg, (90, 45))
    data = table(number)
    speed = data["speed_cm_s"] / _CM_PER_M
    modulus = data[f"lem_{formulation}_{angle:g}_deg_Pa"]
    poisson = next(ratio for (ratio, _), known in _TABLES.items() if known == number)
    present = np.isfinite(modulus)
    source = f"Table {number}, {angle:g} deg, {formulation}, Poisson's ratio {poisson:g}"
    return speed[present], modulus[present], source


def checked_angle(angle: ArrayLike) -> Array:
    """Return angles [rad]; raise outside the measured range, or for degrees."""
    return array_in_range(
        "angle",
        angle,
        math.radians(45) - _ANGLE_TOLERANCE,
        math.radians(90) + _ANGLE_TOLERANCE,
        "rad",
        "Only 45 to 90 degrees were measured. Give radians: 90 looks like degrees, use math.radians(90).",
    )


def checked_speed(speed: ArrayLike) -> Array:
    """Return speeds [m/s]; raise if negative, not finite, or in cm/s."""
    cure = "Give the magnitude in m/s: 2.54 looks like cm/s, which is 0.0254 m/s."
    return array_in_range("speed", speed, 0.0, _LARGEST_SPEED, "m/s", cure)


def _check_range(speed_min: float, speed_max: float) -> None:
    in_range("speed_min", speed_min, 0.0, 1.0, "m/s")
    in_range("speed_max", speed_max, speed_min, 1.0, "m/s", "The range must not be empty or reversed.")
