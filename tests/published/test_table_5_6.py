"""Table 5.6: LEM by speed and angle, force per depth of cut, Poisson's ratio 0.3."""

from __future__ import annotations

import numpy as np
import pytest
from printed_digits import FORMULATIONS, cases_by_speed, check_falls_with_speed, check_fit_within_scatter

from cutenv.tissue.tables import table

T = table("5.6")
CASES = cases_by_speed(T, misses={(6, 90, "plane_stress"), (4, 90, "plane_strain"), (6, 90, "plane_strain")})


def test_modulus_falls_with_speed():
    check_falls_with_speed(T)


@pytest.mark.parametrize(("row", "angle_deg", "formulation"), CASES)
def test_fit_passes_within_the_printed_scatter(row, angle_deg, formulation):
    check_fit_within_scatter(T, row, angle_deg, formulation)


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_the_fit_at_45_degrees_fails_the_same_check_at_90(formulation):
    with pytest.raises(AssertionError, match="the fit gives"):
        check_fit_within_scatter(T, row=0, angle_deg=90, formulation=formulation, of_angle_deg=45)


def check_90_degrees_resists_more(upright: np.ndarray, inclined: np.ndarray) -> None:
    assert (upright >= inclined).all()
    assert upright.mean() > 1.3 * inclined.mean()


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_90_degrees_gives_more_resistance_at_every_speed(formulation):
    check_90_degrees_resists_more(T[f"lem_{formulation}_90_deg_Pa"], T[f"lem_{formulation}_45_deg_Pa"])


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_the_statement_of_section_8_1_that_90_degrees_gives_less_contradicts_the_table(formulation):
    assert any("Section 8.1" in erratum for erratum in T.errata)
    with pytest.raises(AssertionError):
        check_90_degrees_resists_more(T[f"lem_{formulation}_45_deg_Pa"], T[f"lem_{formulation}_90_deg_Pa"])
