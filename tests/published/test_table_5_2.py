"""Table 5.2: twelve cuts at 90 degrees and 0.1 cm/s."""

from __future__ import annotations

import numpy as np
import pytest
from printed_digits import (
    FORMULATIONS,
    check_average_row,
    check_average_row_fails_with_sample_sd,
    check_printed,
)

from cutenv.tissue.tables import table

T = table("5.2")


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_printed_average_is_the_mean_of_the_twelve_cuts(formulation):
    check_average_row(T, f"lem_{formulation}_Pa", "mean")


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_printed_sd_of_the_averages_is_the_population_sd(formulation):
    check_average_row(T, f"lem_{formulation}_Pa", "sd")


def test_printed_sd_of_the_averages_is_not_the_sample_sd():
    check_average_row_fails_with_sample_sd(T, "lem_plane_strain_Pa")


@pytest.mark.parametrize("row", range(12))
def test_plane_strain_gives_the_lower_modulus_and_spread(row):
    assert T["lem_plane_strain_Pa"][row] < T["lem_plane_stress_Pa"][row]
    assert T["sd_plane_strain_Pa"][row] < T["sd_plane_stress_Pa"][row]


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_averages_are_the_90_degree_values_of_table_5_5(formulation):
    by_speed = table("5.5")
    row = int(np.flatnonzero(by_speed["speed_cm_s"] == 0.1)[0])
    column = f"lem_{formulation}_Pa"
    check_printed(T.printed_mean[column].value, by_speed[f"lem_{formulation}_90_deg_Pa"][row], 1000)
    check_printed(T.printed_population_sd[column].value, by_speed[f"sd_{formulation}_90_deg_Pa"][row], 1000)


def test_text_of_section_5_2_agrees():
    # "for a given liver specimen, the standard deviation ranged between 14,000 N/m2 and up to 34,000 N/m2"
    assert T["sd_plane_strain_Pa"].min() == 14000
    assert T["sd_plane_stress_Pa"].max() == 34000
