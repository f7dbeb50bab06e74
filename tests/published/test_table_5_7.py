"""Table 5.7: LEM by speed and angle, force per depth of cut, Poisson's ratio 0.499."""

from __future__ import annotations

import numpy as np
import pytest
from printed_digits import FORMULATIONS, cases_by_speed, check_falls_with_speed, check_fit_within_scatter

from cutenv.tissue.cut_model import CutModel
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


def check_poisson(poisson: float):
    """Plane strain over plane stress is that of 8-node elements of this Poisson's ratio, to 3 %."""
    a = np.linspace(0.02, 0.09, 8)
    stress, strain = (np.asarray(CutModel("quad8", f, poisson).stiffness(a)) for f in FORMULATIONS)
    for angle_deg in (90, 45):
        printed = T[f"lem_plane_strain_{angle_deg}_deg_Pa"] / T[f"lem_plane_stress_{angle_deg}_deg_Pa"]
        assert printed.mean() == pytest.approx((stress / strain).mean(), rel=0.03)


def test_erratum_the_ratio_is_that_of_poissons_ratio_0_43():
    assert any("not those of Tables 4.4 and 5.6" in erratum for erratum in T.errata)
    check_poisson(0.43)
    with pytest.raises(AssertionError):
        check_poisson(0.499)


def test_erratum_the_plane_stress_moduli_exceed_those_of_table_5_6_by_more_than_half():
    for angle_deg in (90, 45):
        column = f"lem_plane_stress_{angle_deg}_deg_Pa"
        assert (T[column] / table("5.6")[column] > 1.5).all()
