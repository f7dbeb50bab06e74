"""Table 4.2: its 4-node columns come from an element that the text does not name, and are not a target.

A fully integrated 4-node element is stiffer than the 8-node one on the same mesh, so that its modulus must
come out lower; the printed ones are higher. What is printed is softer than any conforming 4-node element,
which points to one-point integration with hourglass control.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from cutenv.tissue.cut_model import CutModel
from cutenv.tissue.tables import ThesisTable, table

FOUR_NODES, EIGHT_NODES = table("4.2"), table("4.1")
ROWS = range(len(FOUR_NODES["distance_cm"]))
FORMULATIONS = ("plane_stress", "plane_strain")


@cache
def model(element: str, formulation: str) -> CutModel:
    return CutModel(element, formulation)


def name_of(row: int) -> str:
    return f"{FOUR_NODES['distance_cm'][row]:.2f}cm"


def ratio_in_the_table(row: int, formulation: str) -> tuple[float, float]:
    """LEM of the 4-node column over that of the 8-node one, and the relative rounding of the print."""

    def printed(source: ThesisTable, column: str) -> tuple[float, float]:
        return source[column][row], source.resolution[column] / 2 / source[column][row]

    four, rounding_4 = printed(FOUR_NODES, f"lem_quad4_{formulation}_Pa")
    eight, rounding_8 = printed(EIGHT_NODES, f"lem_quad8_{formulation}_Pa")
    return four / eight, rounding_4 + rounding_8


def ratio_of_the_models(row: int, formulation: str) -> float:
    a = FOUR_NODES["distance_cm"][row] / 100
    return model("quad8", formulation).stiffness(a) / model("quad4", formulation).stiffness(a)


def test_both_tables_list_the_same_places_and_bricks() -> None:
    assert (FOUR_NODES["distance_cm"] == EIGHT_NODES["distance_cm"]).all()
    assert (FOUR_NODES["lem_hex20_Pa"] == EIGHT_NODES["lem_hex20_Pa"]).all()


@pytest.mark.xfail(
    strict=True,
    raises=AssertionError,
    reason="the 4-node element of Table 4.2 is not named and is softer than a fully integrated one",
)
@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize("row", ROWS, ids=name_of)
def test_4_node_over_8_node_elements(row: int, formulation: str) -> None:
    ratio, rounding = ratio_in_the_table(row, formulation)
    assert ratio_of_the_models(row, formulation) == pytest.approx(ratio, rel=0.015 + rounding)


def check_stiffer_than_8_nodes(ratio: float) -> None:
    """On one mesh of rectangles the 8-node element can do all that the 4-node one can: LEM4 < LEM8."""
    assert ratio < 1.0


@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize("row", ROWS, ids=name_of)
def test_our_4_node_element_is_stiffer_than_the_8_node_one(row: int, formulation: str) -> None:
    check_stiffer_than_8_nodes(ratio_of_the_models(row, formulation))


@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize("row", ROWS, ids=name_of)
def test_the_printed_4_node_element_is_not(row: int, formulation: str) -> None:
    with pytest.raises(AssertionError):
        check_stiffer_than_8_nodes(ratio_in_the_table(row, formulation)[0])


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_the_difference_is_twelve_to_forty_five_percent(formulation: str) -> None:
    """Largest near the clamp."""
    differences = np.array(
        [ratio_of_the_models(row, formulation) / ratio_in_the_table(row, formulation)[0] - 1 for row in ROWS]
    )
    assert differences.min() == pytest.approx(-0.45, abs=0.02)
    assert differences.max() == pytest.approx(-0.12, abs=0.02)
    assert np.argmin(differences) == 0
