"""Table 4.12: nodes and elements of the five meshes of the element-size study, with the two errata."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from cutenv.tissue.cut_model import CutModel
from cutenv.tissue.tables import table

TABLE = table("4.12")
DIVISIONS = [(8, 15), (10, 24), (16, 30), (32, 60), (40, 75)]
LEVELS = range(len(DIVISIONS))


def check_nodes(level: int, n_nodes: float) -> None:
    assert CutModel(divisions=DIVISIONS[level]).n_nodes == n_nodes


def check_elements(level: int, n_elements: float) -> None:
    assert CutModel(divisions=DIVISIONS[level]).n_elements == n_elements


@pytest.mark.parametrize("level", LEVELS[1:])
def test_nodes(level: int) -> None:
    check_nodes(level, TABLE["n_nodes"][level])


@pytest.mark.parametrize("level", [0, 2, 3, 4])
def test_elements(level: int) -> None:
    check_elements(level, TABLE["n_elements"][level])


@pytest.mark.parametrize("level", LEVELS)
def test_element_area(level: int) -> None:
    model = CutModel(divisions=DIVISIONS[level])
    area_cm2 = 1e4 * model.width * model.length / model.n_elements
    assert area_cm2 == pytest.approx(TABLE["element_area_cm2"][level])
    assert 1.0 / area_cm2 == pytest.approx(TABLE["elements_per_area_per_cm2"][level])


def test_erratum_level_1_has_the_438_nodes_of_table_4_3() -> None:
    quad8 = table("4.3")["nodes_per_element"] == 8
    check_nodes(0, table("4.3")["n_nodes"][quad8].item())
    with pytest.raises(AssertionError):
        check_nodes(0, TABLE["n_nodes"][0])


def test_erratum_level_2_has_240_elements() -> None:
    """838 nodes make 10 x 24 elements, and 240 are also what elements of 0.5 cm2 make of 120 cm2."""
    check_elements(1, 120 / TABLE["element_area_cm2"][1])
    with pytest.raises(AssertionError):
        check_elements(1, TABLE["n_elements"][1])


def check_modulus_rises_as_elements_shrink(divisions: list[tuple[int, int]]) -> None:
    """Section 4.4.2: in every experiment. LEM is the measured slope over kappa."""
    a = np.linspace(0.02, 0.12, 6)
    inverse = [1.0 / np.asarray(CutModel(divisions=mesh).stiffness(a)) for mesh in divisions]
    assert all((finer > coarser).all() for coarser, finer in pairwise(inverse))


def test_modulus_rises_as_elements_shrink() -> None:
    check_modulus_rises_as_elements_shrink(DIVISIONS)


def test_modulus_falls_as_elements_grow() -> None:
    with pytest.raises(AssertionError):
        check_modulus_rises_as_elements_shrink(DIVISIONS[::-1])
