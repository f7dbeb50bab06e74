"""Table 5.3: twelve cuts at 90 degrees and 1.27 cm/s."""

from __future__ import annotations

import numpy as np
import pytest
from printed_digits import FORMULATIONS, check_average_row, check_printed

from cutenv.tissue.tables import table

T = table("5.3")

# With these digits the sample SD (13.3, 12.1) rounds alike; Tables 5.1, 5.2 and 5.4 tell the two apart.


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_printed_average_is_the_mean_of_the_twelve_cuts(formulation):
    check_average_row(T, f"lem_{formulation}_Pa", "mean")


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_printed_sd_of_the_averages_is_the_population_sd(formulation):
    check_average_row(T, f"lem_{formulation}_Pa", "sd")


@pytest.mark.parametrize("row", range(12))
def test_plane_strain_gives_the_lower_modulus_and_spread(row):
    assert T["lem_plane_strain_Pa"][row] < T["lem_plane_stress_Pa"][row]
    assert T["sd_plane_strain_Pa"][row] < T["sd_plane_stress_Pa"][row]


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_averages_are_the_90_degree_values_of_table_5_5(formulation):
    by_speed = table("5.5")
    row = int(np.flatnonzero(by_speed["speed_cm_s"] == 1.27)[0])
    column = f"lem_{formulation}_Pa"
    check_printed(T.printed_mean[column].value, by_speed[f"lem_{formulation}_90_deg_Pa"][row], 1000)
    check_printed(T.printed_population_sd[column].value, by_speed[f"sd_{formulation}_90_deg_Pa"][row], 1000)
