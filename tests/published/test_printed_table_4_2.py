"""Table 4.2: the cut of Table 4.1 with 4-node elements; the printed numbers among themselves."""

from __future__ import annotations

import numpy as np
import pytest
from printed_digits import FORMULATIONS, check_ratio

from cutenv.tissue.tables import ThesisTable, table

T = table("4.2")
ROWS = range(len(T["distance_cm"]))


def check_softer_than_quad8(
    linear: ThesisTable, quadratic: ThesisTable, names: tuple[str, str], formulation: str
) -> None:
    """A softer element needs a larger modulus for the same force."""
    linear_lem = linear[f"lem_{names[0]}_{formulation}_Pa"]
    assert (linear_lem > quadratic[f"lem_{names[1]}_{formulation}_Pa"]).all()


@pytest.mark.parametrize("row", ROWS)
@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_ratio_columns_hold_what_they_are_named(row, formulation):
    check_ratio(T, row, f"lem_quad4_{formulation}_Pa", T[f"ratio_{formulation}_to_hex20"][row])


@pytest.mark.parametrize("row", ROWS)
def test_ratio_columns_are_not_swapped_as_in_table_4_1(row):
    with pytest.raises(AssertionError, match="is not"):
        check_ratio(T, row, "lem_quad4_plane_stress_Pa", T["ratio_plane_strain_to_hex20"][row])


def test_brick_column_repeats_table_4_1():
    np.testing.assert_array_equal(T["lem_hex20_Pa"], table("4.1")["lem_hex20_Pa"])
    np.testing.assert_array_equal(T["distance_cm"], table("4.1")["distance_cm"])


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_4_node_columns_come_from_an_element_softer_than_8_nodes(formulation):
    # Bilinear displacements are among the quadratic ones, so a fully integrated conforming 4-node element is
    # stiffer than the 8-node one on the same mesh and gives a lower LEM. All printed values are higher.
    check_softer_than_quad8(T, table("4.1"), ("quad4", "quad8"), formulation)


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_the_check_of_softness_fails_for_a_stiffer_element(formulation):
    with pytest.raises(AssertionError):
        check_softer_than_quad8(table("4.1"), T, ("quad8", "quad4"), formulation)


def test_the_unnamed_element_is_stated_as_an_erratum():
    assert any("not named" in erratum for erratum in T.errata)
