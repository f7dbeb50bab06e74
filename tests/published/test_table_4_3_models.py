"""Table 4.3: the size of the three models, exactly."""

from __future__ import annotations

import pytest

from cutenv.tissue.cut_model import CutModel
from cutenv.tissue.tables import table

TABLE = table("4.3")
MODELS = {
    (3, 20): ("hex20", "solid"),
    (2, 8): ("quad8", "plane_stress"),
    (2, 4): ("quad4", "plane_stress"),
}
ROWS = [tuple(int(TABLE[c][row]) for c in ("dimensions", "nodes_per_element")) for row in range(3)]


def check_counts(row: int, model: CutModel) -> None:
    assert model.n_elements == TABLE["n_elements"][row]
    assert model.n_nodes == TABLE["n_nodes"][row]
    assert model.n_equations == TABLE["n_equations"][row]


@pytest.mark.parametrize("row", range(3), ids=[f"{MODELS[kind][0]}" for kind in ROWS])
def test_counts(row: int) -> None:
    model = CutModel(*MODELS[ROWS[row]])
    assert model.dim == TABLE["dimensions"][row]
    check_counts(row, model)


@pytest.mark.parametrize("row", range(3), ids=[f"{MODELS[kind][0]}" for kind in ROWS])
def test_counts_of_another_mesh_do_not_pass(row: int) -> None:
    element, formulation = MODELS[ROWS[row]]
    turned = (10, 12, 4) if element == "hex20" else (10, 12)  # as many elements, other nodes
    with pytest.raises(AssertionError):
        check_counts(row, CutModel(element, formulation, divisions=turned))


@pytest.mark.parametrize("row", range(3), ids=[f"{MODELS[kind][0]}" for kind in ROWS])
def test_relative_model_size(row: int) -> None:
    """Unknowns over those of the bricks; printed as 1.0, 0.1 and 0.04."""
    bricks = CutModel("hex20", "solid").n_equations
    printed = TABLE["relative_model_size"][row]
    resolution = 0.01 if printed < 0.1 else 0.1
    ratio = CutModel(*MODELS[ROWS[row]]).n_equations / bricks
    assert ratio == pytest.approx(printed, abs=resolution / 2)
