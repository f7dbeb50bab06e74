"""Tables 4.6 to 4.11: mean LEM of six cuts on five meshes; the printed numbers among themselves."""

from __future__ import annotations

import numpy as np
import pytest

from cutenv.tissue.tables import table

EXPERIMENTS = tuple(f"4.{number}" for number in range(6, 12))
MESHES = table("4.12")
DOUBTFUL = 1  # the mesh of 838 nodes


def check_logarithm(number: str, level: int) -> None:
    """The mean LEM grows with the logarithm of the element size, as under a point load, to 2 %.

    The line starts at the coarsest mesh and is fitted to the three finer ones that are not in doubt.
    """
    refinement = -np.log(MESHES["element_area_cm2"]) / 2
    growth = table(number)["mean_lem_Pa"] / table(number)["mean_lem_Pa"][0] - 1
    trusted = [2, 3, 4]
    slope = (refinement[trusted] @ growth[trusted]) / (refinement[trusted] @ refinement[trusted])
    assert abs(growth[level] - slope * refinement[level]) <= 0.02


@pytest.mark.parametrize("number", EXPERIMENTS)
def test_meshes_are_those_of_table_4_12(number):
    for column in ("level", "n_nodes", "n_elements"):
        np.testing.assert_array_equal(table(number)[column], MESHES[column])


@pytest.mark.parametrize("level", [2, 3, 4])
@pytest.mark.parametrize("number", EXPERIMENTS)
def test_mean_modulus_grows_with_the_logarithm_of_the_element_size(number, level):
    check_logarithm(number, level)


@pytest.mark.parametrize("number", EXPERIMENTS)
def test_erratum_the_mean_at_838_nodes_does_not(number):
    assert any("838 nodes in Tables 4.6 to 4.11" in erratum for erratum in MESHES.errata)
    with pytest.raises(AssertionError):
        check_logarithm(number, DOUBTFUL)
