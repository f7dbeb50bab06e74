"""Table 5.7: LEM by speed and angle, force per depth of cut, Poisson's ratio 0.499."""

from __future__ import annotations

import pytest
from printed_digits import FORMULATIONS, cases_by_speed, check_falls_with_speed, check_fit_within_scatter

from cutenv.tissue.tables import table

T = table("5.7")
CASES = cases_by_speed(
    T,
    misses={
        (3, 90, "plane_stress"),
        (4, 90, "plane_stress"),
        *((row, 90, "plane_strain") for row in (3, 4, 6)),
    },
)


def test_modulus_falls_with_speed():
    check_falls_with_speed(T)


@pytest.mark.parametrize(("row", "angle_deg", "formulation"), CASES)
def test_fit_passes_within_the_printed_scatter(row, angle_deg, formulation):
    check_fit_within_scatter(T, row, angle_deg, formulation, poisson=0.499)


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_the_fit_at_45_degrees_fails_the_same_check_at_90(formulation):
    with pytest.raises(AssertionError, match="the fit gives"):
        check_fit_within_scatter(T, row=0, angle_deg=90, formulation=formulation, of_angle_deg=45, poisson=0.499)


@pytest.mark.parametrize(("speed_cm_s", "mean_kPa", "sd_kPa"), [(0.1, 82, 17), (1.27, 69, 12), (2.54, 38, 9)])
def test_text_of_section_5_5_agrees(speed_cm_s, mean_kPa, sd_kPa):
    row = T["speed_cm_s"].tolist().index(speed_cm_s)
    assert T["lem_plane_stress_90_deg_Pa"][row] == 1000 * mean_kPa
    assert T["sd_plane_stress_90_deg_Pa"][row] == 1000 * sd_kPa
