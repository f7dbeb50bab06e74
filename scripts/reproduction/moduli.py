"""The measured moduli: printed averages, fits and equations of chapter 5 from its tables."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from cutenv.tissue import local_effective_modulus, measured_fracture_resistance, measured_liver, quasi_static_modulus
from cutenv.tissue.effective_modulus import linear_fit, power_fit
from cutenv.tissue.tables import table
from reproduction.drawn_tables import CUTS
from reproduction.printed_equations import LINEAR, POWER
from reproduction.rows import Comparison, Row, hits, near, printed_as, unclaimed

MISPRINTED = ("5.3 coefficient", "5.10 intercept")  # see the errata of Tables 5.5 and 5.7
DEPTH_NORMALISED = {"5.5": False, "5.6": True}  # Table 5.7 is an erratum


def averages(quick: bool) -> Comparison:
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
    return Comparison(
        title="Printed averages and population SDs recomputed",
        source="Tables 5.1-5.4",
        ours=f"{hits(rows)} equal, one erratum corrected",
        tolerance="printed digits",
        rows=tuple(rows),
        notes=table("5.1").errata[:2],
    )


def equations(quick: bool) -> Comparison:
    """Compare equations 5.1 to 5.10 with fits to Tables 5.5 to 5.7."""
    rows = []
    for equation, number, angle_deg, formulation, slope, intercept, digit in LINEAR:
        fit = linear_fit(number, angle_deg=angle_deg, formulation=formulation)
        of = f"({equation}) {angle_deg} deg {formulation.replace('_', ' ')}"
        rows.append(printed_as(f"{of}: slope, kPa s/cm", slope, fit.slope / 1e5, digit))
        row = printed_as(f"{of}: intercept, kPa", intercept, fit.intercept / 1e3, digit)
        rows.append(unclaimed(row) if f"{equation} intercept" in MISPRINTED else row)
    for equation, formulation, coefficient, exponent in POWER:
        power = power_fit(formulation=formulation)
        of = f"({equation}) 45 deg {formulation.replace('_', ' ')}"
        row = printed_as(f"{of}: coefficient, kPa", coefficient, power.modulus_at_reference / 1e3, 0.01)
        rows.append(unclaimed(row) if f"{equation} coefficient" in MISPRINTED else row)
        rows.append(printed_as(f"{of}: exponent", exponent, power.exponent, 0.01))
    return Comparison(
        title="Fits of LEM against speed, equations 5.1-5.10",
        source="Tables 5.5-5.7",
        ours=f"{hits(rows)} coefficients to the last digit",
        tolerance="printed digits",
        rows=tuple(rows),
        notes=(table("5.5").errata[0], table("5.6").errata[0], table("5.7").errata[0]),
    )


def fits(quick: bool) -> Comparison:
    """Compare the fits with the means from which they were made, within the printed SD."""
    rows: list[Row] = []
    for number, per_depth in DEPTH_NORMALISED.items():
        data = table(number)
        for angle_deg in (90, 45):
            for formulation in ("plane_stress", "plane_strain"):
                mean, sd = (data[f"{x}_{formulation}_{angle_deg}_deg_Pa"] / 1e3 for x in ("lem", "sd"))
                for v, m, s in zip(data["speed_cm_s"], mean, sd, strict=True):
                    if not np.isfinite(m):
                        continue
                    fitted = local_effective_modulus(
                        v / 100, math.radians(angle_deg), formulation, depth_normalised=per_depth
                    )
                    what = f"Table {number}, {angle_deg} deg {formulation.replace('_', ' ')}, {v:.2f} cm/s, kPa"
                    row = near(what, m, fitted / 1e3, absolute=s, form=".1f")
                    rows.append(replace(row, tolerance=f"SD {s:g}"))
    return Comparison(
        title="LEM(speed, angle) of every hypothesis against the measured means",
        source="Tables 5.5, 5.6",
        ours=f"{hits(rows)} means within one SD of the line",
        tolerance="printed SD",
        rows=tuple(rows),
        notes=("A straight line through these means passes some of them at more than the printed SD.",),
    )


def law_of_speed(quick: bool) -> Comparison:
    """Compare the cutting law's LEM(v, theta) with the means: within two standard errors of them."""
    rows = []
    data, liver = table("5.6"), measured_liver()
    for angle_deg in (90, 45):
        mean, sd = (data[f"{x}_plane_stress_{angle_deg}_deg_Pa"] / 1e3 for x in ("lem", "sd"))
        for v, m, s in zip(data["speed_cm_s"], mean, sd, strict=True):
            error = s / math.sqrt(CUTS)
            lem = liver.local_effective_modulus(v / 100, math.radians(angle_deg)) / 1e3
            row = near(f"{angle_deg} deg, {v:.2f} cm/s, kPa", m, lem, absolute=2.0 * error, form=".1f")
            rows.append(replace(row, tolerance=f"2 SE {2.0 * error:.1f}"))
    return Comparison(
        title="LEM(speed, angle) that the law of cutting follows, against the measured means, plane stress",
        source="Table 5.6",
        ours=f"{hits(rows)} means within two standard errors",
        tolerance="two standard errors",
        rows=tuple(rows),
        notes=(
            "At 90 degrees isotonic regression of the means, which the thesis's line misses at 1.27 and 2.54 cm/s; at "
            "45 degrees the thesis's line.",
        ),
    )


def constants(quick: bool) -> Comparison:
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
    return Comparison(
        title="Quasi-static modulus; fracture resistance (apparent)",
        source="(5.5); Table 6.1",
        ours=f"{quasi_static_modulus() / 1e3:.1f} kPa; {resistance.mean:.0f} +- {resistance.sd:.0f} J/m2",
        tolerance="printed digits, SD",
        rows=tuple(rows),
        notes=data.errata,
    )
