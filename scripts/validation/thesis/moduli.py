"""The measured moduli: printed averages, fits and equations of chapter 5 from its tables."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cutenv.sim.tissue import (
    local_effective_modulus,
    measured_fracture_resistance,
    measured_liver,
    quasi_static_modulus,
)
from cutenv.sim.tissue.effective_modulus import linear_fit, power_fit
from cutenv.sim.tissue.tables import table
from scripts.validation.thesis.models import FORMULATIONS
from scripts.validation.thesis.rows import Found, Row, check, hits, near, printed_as, unclaimed

Array = NDArray[np.float64]
CUTS = 6  # cuts behind a mean of Tables 5.5 to 5.7, where no other table lists them (chapter 5)


class Equation(NamedTuple):
    """A line of the local effective modulus [kPa] over the speed [cm/s], in two equations of their logarithms."""

    number: str
    table: str
    angle_deg: int
    formulation: str
    slope: float  # [kPa s/cm], or the exponent
    intercept: float  # [kPa], or the coefficient of the power law
    digit: float  # unit of the last printed digit

    @property
    def is_power(self) -> bool:
        """True for a power law."""
        return self.table == "5.5" and self.angle_deg == 45

    @property
    def name(self) -> str:
        """Number, angle and formulation."""
        return f"({self.number}) {self.angle_deg} deg {self.formulation.replace('_', ' ')}"


EQUATIONS = (
    Equation("5.1", "5.5", 90, "plane_stress", -9.21, 63.26, 0.01),
    Equation("5.2", "5.5", 90, "plane_strain", -8.70, 59.18, 0.01),
    Equation("5.3", "5.5", 45, "plane_stress", -0.42, 24.21, 0.01),
    Equation("5.4", "5.5", 45, "plane_strain", -0.43, 22.17, 0.01),
    Equation("5.5", "5.6", 90, "plane_stress", -11.6, 48.4, 0.1),
    Equation("5.6, printed as 5.7", "5.6", 90, "plane_strain", -10.6, 44.5, 0.1),
    Equation("5.7, printed as 5.6", "5.6", 45, "plane_stress", -7.2, 30.9, 0.1),
    Equation("5.8", "5.6", 45, "plane_strain", -6.4, 28.2, 0.1),
    Equation("5.9", "5.7", 90, "plane_stress", -18.22, 79.12, 0.01),
    Equation("5.10", "5.7", 45, "plane_stress", -11.59, 49.59, 0.01),
)
"""Equations 5.1 to 5.10 by the number that their tissue and model have in the text of section 5.4.

The text gives (5.5) and (5.6) to 90 degrees in plane stress and strain, (5.7) and (5.8) to 45 degrees. Two stand under
each other's labels: see the erratum of Table 5.6.
"""
MISPRINTED = ("5.3", "5.10")  # intercepts; see the errata of Tables 5.5 and 5.7


@check(
    "averages",
    "Printed averages and population SDs recomputed",
    "Tables 5.1-5.4",
    "printed digits",
    notes=table("5.1").errata[:2],
)
def averages(quick: bool) -> Found:
    """Compare the printed "Average" rows of Tables 5.1 to 5.4."""
    rows = []
    for number in ("5.1", "5.2", "5.3", "5.4"):
        data = table(number)
        for name, printed in (("mean", data.printed_mean), ("SD", data.printed_population_sd)):
            for column, (value, digit) in printed.items():
                ours = data[column].mean() if name == "mean" else data[column].std(ddof=0)
                what = column.removeprefix("lem_").removesuffix("_Pa").replace("_", " ").replace(" cm s", " cm/s")
                corrected = 12.81 if abs(value - 13810) < 1 else value / 1e3  # erratum of Table 5.1
                erratum = "" if corrected == value / 1e3 else f" (printed {value / 1e3:g})"
                rows.append(
                    printed_as(f"Table {number}, {what}: {name}{erratum}, kPa", corrected, ours / 1e3, digit / 1e3)
                )
    return rows, f"{hits(rows)} equal, one erratum corrected"


def equation_rows(equation: Equation, number: str, angle_deg: int, formulation: str) -> tuple[Row, Row]:
    """Compare slope and intercept, or exponent and coefficient, with those of the fit to some table's column."""
    if equation.is_power:
        power = power_fit(formulation=formulation)
        fitted, names = (power.exponent, power.modulus_at_reference / 1e3), ("exponent", "coefficient, kPa")
    else:
        line = linear_fit(number, angle_deg=angle_deg, formulation=formulation)
        fitted, names = (line.slope / 1e5, line.intercept / 1e3), ("slope, kPa s/cm", "intercept, kPa")
    slope, intercept = (
        printed_as(f"{equation.name}: {name}", printed, ours, equation.digit)
        for name, printed, ours in zip(names, equation[4:6], fitted, strict=True)
    )
    return slope, intercept


@check(
    "equations",
    "Fits of LEM against speed, equations 5.1-5.10",
    "Tables 5.5-5.7",
    "printed digits",
    notes=tuple(table(number).errata[0] for number in ("5.5", "5.6", "5.7")),
)
def equations(quick: bool) -> Found:
    """Compare equations 5.1 to 5.10 with fits to Tables 5.5 to 5.7."""
    rows = []
    for each in sorted(EQUATIONS, key=lambda each: each.is_power):
        first, second = equation_rows(each, *each[1:4])
        second = unclaimed(second) if each.number in MISPRINTED else second
        rows += [second, first] if each.is_power else [first, second]
    return rows, f"{hits(rows)} coefficients to the last digit"


def means_by_speed(number: str, angle_deg: int, formulation: str) -> tuple[Array, Array, Array]:
    """Return the speeds [cm/s], means and standard deviations [kPa] of Table 5.5, 5.6 or 5.7 that are not missing."""
    data = table(number)
    mean, sd = (data[f"{x}_{formulation}_{angle_deg}_deg_Pa"] / 1e3 for x in ("lem", "sd"))
    present = np.isfinite(mean)
    return data["speed_cm_s"][present], mean[present], sd[present]


def fit_rows(number: str, **hypothesis: float) -> list[Row]:
    """Return the fit beside every mean of a table by speed, within the printed SD."""
    rows: list[Row] = []
    for angle_deg, formulation in itertools.product((90, 45), FORMULATIONS):
        for v, m, s in zip(*means_by_speed(number, angle_deg, formulation), strict=True):
            what = f"Table {number}, {angle_deg} deg {formulation.replace('_', ' ')}, {v:.2f} cm/s, kPa"
            fitted = local_effective_modulus(v / 100, math.radians(angle_deg), formulation, **hypothesis)
            rows.append(replace(near(what, m, fitted / 1e3, absolute=s, form=".1f"), tolerance=f"SD {s:g}"))
    return rows


@check(
    "fits",
    "LEM(speed, angle) of every hypothesis against the measured means",
    "Tables 5.5, 5.6",
    "printed SD",
    misses=tuple(f"Table 5.6, 90 deg plane {of} cm/s" for of in ("stress, 2.54", "strain, 1.65", "strain, 2.54")),
    notes=("A straight line through these means passes some of them at more than the printed SD.",),
)
def fits(quick: bool) -> Found:
    """Compare the fits with the means from which they were made; of Table 5.7, an erratum, see the statements."""
    rows = fit_rows("5.5", depth_normalised=False) + fit_rows("5.6")
    return rows, f"{hits(rows)} means within one SD of the line"


@check(
    "law-of-speed",
    "LEM(speed, angle) that the law of cutting follows, against the measured means, plane stress",
    "Table 5.6",
    "two standard errors",
    notes=(
        "At 90 degrees isotonic regression of the means, which the thesis's line misses at 1.27 and 2.54 cm/s; at "
        "45 degrees the thesis's line.",
    ),
)
def law_of_speed(quick: bool) -> Found:
    """Compare the cutting law's LEM(v, theta) with the means: within two standard errors of them."""
    rows = []
    liver = measured_liver()
    for angle_deg in (90, 45):
        for v, m, s in zip(*means_by_speed("5.6", angle_deg, "plane_stress"), strict=True):
            error = s / math.sqrt(CUTS)
            lem = liver.local_effective_modulus(v / 100, math.radians(angle_deg)) / 1e3
            row = near(f"{angle_deg} deg, {v:.2f} cm/s, kPa", m, lem, absolute=2.0 * error, form=".1f")
            rows.append(replace(row, tolerance=f"2 SE {2.0 * error:.1f}"))
    return rows, f"{hits(rows)} means within two standard errors"


@check(
    "constants",
    "Quasi-static modulus; fracture resistance (apparent)",
    "(5.5); Table 6.1",
    "printed digits, SD",
    notes=table("6.1").errata,
)
def constants(quick: bool) -> Found:
    """Compare the quasi-static modulus and the fracture resistance with which the simulator starts."""
    data = table("6.1")
    resistance = measured_fracture_resistance()
    rows = [printed_as("quasi-static modulus E0, kPa", 48.4, quasi_static_modulus() / 1e3, 0.1)]
    for inches, mean, sd in zip(
        data["cut_length_inch"], data["fracture_resistance_J_m2"], data["sd_fracture_resistance_J_m2"], strict=True
    ):
        row = near(
            f"mean fracture resistance against cuts of {inches:g} inch, J/m2", mean, resistance.mean, absolute=sd
        )
        rows.append(replace(row, tolerance=f"SD {sd:g}"))
    return rows, f"{quasi_static_modulus() / 1e3:.1f} kPa; {resistance.mean:.0f} +- {resistance.sd:.0f} J/m2"
