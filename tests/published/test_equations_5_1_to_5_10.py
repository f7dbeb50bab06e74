"""Equations 5.1 to 5.10: LEM against speed, recomputed from Tables 5.5 to 5.7 to the printed digits."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from printed_digits import check_printed

sys.path.insert(0, str(Path(__file__).parents[2] / "scripts"))
from reproduction.printed_equations import LINEAR, POWER

from cutenv.tissue.effective_modulus import linear_fit, power_fit
from cutenv.tissue.tables import table


def check_slope(number, angle_deg, formulation, slope, digit):
    per_cm_s = linear_fit(number, angle_deg=angle_deg, formulation=formulation).slope / 100
    check_printed(per_cm_s / 1000, slope, digit)


def check_intercept(number, angle_deg, formulation, intercept, digit):
    fit = linear_fit(number, angle_deg=angle_deg, formulation=formulation)
    check_printed(fit.intercept / 1000, intercept, digit)


@pytest.mark.parametrize(
    ("number", "angle_deg", "formulation", "slope", "digit"),
    [pytest.param(*case[1:5], case.digit, id=case.equation) for case in LINEAR],
)
def test_slope_is_the_printed_one(number, angle_deg, formulation, slope, digit):
    check_slope(number, angle_deg, formulation, slope, digit)


@pytest.mark.parametrize(
    ("number", "angle_deg", "formulation", "intercept", "digit"),
    [pytest.param(*case[1:4], *case[5:], id=case.equation) for case in LINEAR if case.equation != "5.10"],
)
def test_intercept_is_the_printed_one(number, angle_deg, formulation, intercept, digit):
    check_intercept(number, angle_deg, formulation, intercept, digit)


def check_coefficient(formulation, coefficient):
    check_printed(power_fit(formulation=formulation).modulus_at_reference / 1000, coefficient, 0.01)


def test_coefficient_of_the_power_law_is_the_printed_one_in_plane_strain():
    check_coefficient("plane_strain", 22.17)


def test_coefficient_of_the_power_law_is_not_the_printed_one_in_plane_stress():
    with pytest.raises(AssertionError, match="is not printed as"):
        check_coefficient("plane_stress", 24.21)


@pytest.mark.parametrize(
    ("formulation", "exponent"), [pytest.param(case.formulation, case.exponent, id=case.equation) for case in POWER]
)
def test_exponent_of_the_power_law_is_the_printed_one(formulation, exponent):
    check_printed(power_fit(formulation=formulation).exponent, exponent, 0.01)


def test_equation_5_10_is_cut_off_instead_of_rounded():
    assert any("Equation 5.10" in erratum for erratum in table("5.7").errata)
    kPa = linear_fit("5.7", angle_deg=45).intercept / 1000
    assert int(100 * kPa) / 100 == 49.59
    with pytest.raises(AssertionError, match="is not printed as"):
        check_printed(kPa, 49.59, 0.01)


@pytest.mark.parametrize(
    ("printed_label", "slope", "intercept"),
    [((90, "plane_strain"), -7.2, 30.9), ((45, "plane_stress"), -10.6, 44.5)],
    ids=["printed as 5.6", "printed as 5.7"],
)
def test_equations_5_6_and_5_7_contradict_table_5_6_under_their_printed_labels(printed_label, slope, intercept):
    assert any("5.6 and 5.7" in erratum for erratum in table("5.6").errata)
    with pytest.raises(AssertionError, match="is not printed as"):
        check_slope("5.6", *printed_label, slope, 0.1)
    with pytest.raises(AssertionError, match="is not printed as"):
        check_intercept("5.6", *printed_label, intercept, 0.1)


def test_equation_5_3_follows_from_the_63_of_the_text():
    assert any("Equation 5.3" in erratum for erratum in table("5.5").errata)
    data = table("5.5")
    present = np.isfinite(data["lem_plane_stress_45_deg_Pa"])
    kPa = data["lem_plane_stress_45_deg_Pa"][present] / 1000
    assert kPa[0] == 64
    kPa[0] = 63  # "in the neighborhood of 63,000 N/m2", section 5.1
    exponent, log_coefficient = np.polyfit(np.log(data["speed_cm_s"][present]), np.log(kPa), 1)
    check_printed(np.exp(log_coefficient), 24.21, 0.01)
    check_printed(exponent, -0.42, 0.01)


def test_the_equations_have_the_numbers_that_the_text_gives_their_tissue_and_model():
    """ "(5.5) and (5.7) correspond to plane stress ... for 90 and 45 ... while (5.6) and (5.8) ... to plane strain"."""
    numbers = {(case.angle_deg, case.formulation): case.equation for case in LINEAR if case.table == "5.6"}
    assert {number.partition(",")[0]: of for of, number in numbers.items()} == {
        "5.5": (90, "plane_stress"),
        "5.6": (90, "plane_strain"),
        "5.7": (45, "plane_stress"),
        "5.8": (45, "plane_strain"),
    }
