"""Table 4.5: LEM at Poisson's ratio 0.5; the printed numbers among themselves."""

from __future__ import annotations

import numpy as np
import pytest
from printed_digits import check_ratio

from cutenv.tissue.tables import table

T = table("4.5")
ROWS = range(len(T["distance_cm"]))
QUAD8 = "lem_quad8_plane_stress_Pa"


@pytest.mark.parametrize("row", ROWS)
@pytest.mark.parametrize("element", ["quad8", "quad4"])
def test_ratio_columns_hold_what_they_are_named(row, element):
    check_ratio(T, row, f"lem_{element}_plane_stress_Pa", T[f"ratio_{element}_to_hex20"][row])


@pytest.mark.parametrize("row", ROWS)
def test_ratio_columns_are_not_each_others(row):
    with pytest.raises(AssertionError, match="is not"):
        check_ratio(T, row, QUAD8, T["ratio_quad4_to_hex20"][row])


def test_8_node_column_is_that_of_poissons_ratio_0_499_in_table_4_4():
    other = table("4.4")
    np.testing.assert_array_equal(T["distance_cm"], other["distance_cm"])
    np.testing.assert_array_equal(T[QUAD8], other["lem_quad8_plane_stress_poisson_0.499_Pa"])
    assert (T[QUAD8] != other["lem_quad8_plane_stress_poisson_0.4_Pa"]).any()
