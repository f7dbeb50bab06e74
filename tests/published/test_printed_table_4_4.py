"""Table 4.4: LEM at four Poisson's ratios; the printed numbers among themselves."""

from __future__ import annotations

import numpy as np
import pytest

from cutenv.tissue.tables import table

T = table("4.4")
COLUMNS = [name for name in T.columns if name.startswith("lem_")]


def check_is_no_ratio(values: np.ndarray) -> None:
    """Ratios of two LEM of one segment are of the order of 1."""
    assert (values > 100).all()


def test_the_column_at_0_3_repeats_the_plane_stress_column_of_table_4_1():
    np.testing.assert_array_equal(T["lem_quad8_plane_stress_poisson_0.3_Pa"], table("4.1")["lem_quad8_plane_stress_Pa"])


@pytest.mark.parametrize("column", COLUMNS)
def test_columns_hold_moduli_although_the_header_says_ratio(column):
    assert any("Ratio of LEM" in erratum for erratum in T.errata)
    check_is_no_ratio(T[column])


def test_the_check_for_moduli_fails_for_the_ratios_of_table_4_1():
    with pytest.raises(AssertionError):
        check_is_no_ratio(table("4.1")["ratio_plane_stress_to_hex20"])


@pytest.mark.parametrize("column", COLUMNS[1:])
def test_poissons_ratio_changes_the_plane_stress_modulus_by_less_than_2_percent(column):
    reference = T["lem_quad8_plane_stress_poisson_0.3_Pa"]
    rounding = T.resolution[column] / reference  # half a digit each of two printed numbers
    assert (np.abs(T[column] / reference - 1) <= 0.02 + rounding).all()
