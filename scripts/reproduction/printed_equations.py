"""Equations 5.1 to 5.10 as printed, by the number that their tissue and model have in the text of section 5.4.

The text gives (5.5) and (5.6) to 90 degrees in plane stress and strain, (5.7) and (5.8) to 45 degrees. Two stand under
each other's labels: see the erratum of Table 5.6.
"""

from __future__ import annotations

from typing import NamedTuple


class Line(NamedTuple):
    """A straight line of the local effective modulus over the speed."""

    equation: str
    table: str
    angle_deg: int
    formulation: str
    slope: float
    """[kPa/(cm/s)]."""
    intercept: float
    """[kPa]."""
    digit: float
    """Unit of the last printed digit."""


class Power(NamedTuple):
    """A power law of the local effective modulus over the speed in cm/s, at 45 degrees."""

    equation: str
    formulation: str
    coefficient: float
    """[kPa]."""
    exponent: float


LINEAR = (
    Line("5.1", "5.5", 90, "plane_stress", -9.21, 63.26, 0.01),
    Line("5.2", "5.5", 90, "plane_strain", -8.70, 59.18, 0.01),
    Line("5.5", "5.6", 90, "plane_stress", -11.6, 48.4, 0.1),
    Line("5.6, printed as 5.7", "5.6", 90, "plane_strain", -10.6, 44.5, 0.1),
    Line("5.7, printed as 5.6", "5.6", 45, "plane_stress", -7.2, 30.9, 0.1),
    Line("5.8", "5.6", 45, "plane_strain", -6.4, 28.2, 0.1),
    Line("5.9", "5.7", 90, "plane_stress", -18.22, 79.12, 0.01),
    Line("5.10", "5.7", 45, "plane_stress", -11.59, 49.59, 0.01),
)
POWER = (Power("5.3", "plane_stress", 24.21, -0.42), Power("5.4", "plane_strain", 22.17, -0.43))
