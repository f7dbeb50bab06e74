"""Table 4.1: one cut, 20-node bricks against 8-node plane elements; the printed numbers among themselves."""

from __future__ import annotations

import pytest
from printed_digits import FORMULATIONS, check_ratio

from cutenv.tissue.tables import table

T = table("4.1")
ROWS = range(len(T["distance_cm"]))
TRUNCATED = pytest.mark.xfail(reason="4.75 cm: 35000/36900 is at least 0.946, printed 0.94 (cut off, not rounded)")
CASES = [
    pytest.param(row, formulation, marks=TRUNCATED if (row, formulation) == (3, "plane_strain") else ())
    for row in ROWS
    for formulation in FORMULATIONS
]


def check_both_ratios(row: int, labels: tuple[str, str]) -> None:
    """The two ratio columns hold plane stress and plane strain, in this order, if named so by ``labels``."""
    for formulation, label in zip(FORMULATIONS, labels, strict=True):
        check_ratio(T, row, f"lem_quad8_{formulation}_Pa", T[f"ratio_{label}_to_hex20"][row])


@pytest.mark.parametrize(("row", "formulation"), CASES)
def test_ratio_columns_hold_what_they_are_named(row, formulation):
    check_ratio(T, row, f"lem_quad8_{formulation}_Pa", T[f"ratio_{formulation}_to_hex20"][row])


@pytest.mark.parametrize("row", ROWS)
def test_under_the_printed_labels_no_row_of_ratios_fits(row):
    with pytest.raises(AssertionError, match="is not"):
        check_both_ratios(row, labels=("plane_strain", "plane_stress"))


def test_the_swapped_ratio_columns_are_stated_as_an_erratum():
    assert any("under each other's labels" in erratum for erratum in T.errata)


@pytest.mark.parametrize("row", ROWS)
def test_brick_modulus_lies_between_plane_strain_and_plane_stress(row):
    plane_strain, plane_stress = T["lem_quad8_plane_strain_Pa"][row], T["lem_quad8_plane_stress_Pa"][row]
    assert plane_strain <= T["lem_hex20_Pa"][row] <= plane_stress
