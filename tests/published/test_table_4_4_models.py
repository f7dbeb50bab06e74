"""Table 4.4: the modulus of one cut at four Poisson's ratios, 8-node plane stress.

LEM is the measured slope over kappa and depth: the ratio of two columns is the inverse ratio of the unit
stiffnesses at that place.
"""

from __future__ import annotations

from functools import cache

import pytest

from cutenv.tissue.cut_model import CutModel
from cutenv.tissue.tables import table

TABLE = table("4.4")
ROWS = range(len(TABLE["distance_cm"]))
RATIOS = (0.4, 0.45, 0.499)


@cache
def model(formulation: str, poisson: float) -> CutModel:
    return CutModel(formulation=formulation, poisson=poisson)


def name_of(row: int) -> str:
    return f"{TABLE['distance_cm'][row]:.2f}cm"


def printed(row: int, poisson: float) -> tuple[float, float]:
    """Modulus [Pa] and half a unit of its last printed digit over it."""
    column = f"lem_quad8_plane_stress_poisson_{poisson:g}_Pa"
    lem = TABLE[column][row]
    return lem, TABLE.resolution[column] / 2 / lem


def check_ratio(row: int, poisson: float, formulation: str) -> None:
    lem, rounding = printed(row, poisson)
    reference, reference_rounding = printed(row, 0.3)
    a = TABLE["distance_cm"][row] / 100
    ratio = model("plane_stress", 0.3).stiffness(a) / model(formulation, poisson).stiffness(a)
    assert ratio == pytest.approx(lem / reference, rel=0.01 + rounding + reference_rounding)


@pytest.mark.parametrize("poisson", RATIOS)
@pytest.mark.parametrize("row", ROWS, ids=name_of)
def test_modulus_over_that_at_poisson_0_3(row: int, poisson: float) -> None:
    check_ratio(row, poisson, "plane_stress")


@pytest.mark.parametrize("poisson", RATIOS)
@pytest.mark.parametrize("row", ROWS, ids=name_of)
def test_plane_strain_does_not_pass_for_plane_stress(row: int, poisson: float) -> None:
    with pytest.raises(AssertionError):
        check_ratio(row, poisson, "plane_strain")
