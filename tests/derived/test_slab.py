"""The stiffness along a slab: the plane model's with the field of moduli, and bricks' where it is not cut through."""

from __future__ import annotations

import numpy as np
import pytest
from derive_partial_depth import stiffness_by_depth
from reproduction.elements import model

from cutenv.tissue.condensation import condensed
from cutenv.tissue.cut_model import CutModel
from cutenv.tissue.field import field_modes
from cutenv.tissue.nominal import nominal_stiffness, nominal_tissue
from cutenv.tissue.slab import THICKNESS, row_means, slab_of, stiffness_along
from cutenv.tissue.specimen import N_POINTS, SPACING, Specimen

Y = np.arange(N_POINTS) * SPACING
ONES = np.ones(N_POINTS)
SLAB = slab_of("quad8", "plane_stress", 0.3)


def field(seed: int, sigma: float) -> np.ndarray:
    modes = field_modes(N_POINTS, SPACING, 0.020)
    return np.asarray(40e3 * np.exp(sigma * (np.random.default_rng(seed).standard_normal(len(modes)) @ modes)))


def check_against_the_full_model(stiffness: np.ndarray, modulus: np.ndarray, element: str, formulation: str) -> None:
    """K over T to 0.2 % of CutModel's with the moduli of its rows of elements."""
    full = CutModel(element=element, formulation=formulation, relative_modulus=np.tile(row_means(modulus) / 40e3, 8))
    assert stiffness / THICKNESS / 40e3 == pytest.approx(np.asarray(full.stiffness(Y)), rel=2e-3)


@pytest.mark.parametrize(
    ("element", "formulation"), [("quad8", "plane_stress"), ("quad8", "plane_strain"), ("quad4", "plane_stress")]
)
def test_cut_through_it_is_the_plane_model_with_the_field(element, formulation):
    slab = slab_of(element, formulation, 0.3)
    for seed in range(3):
        modulus = field(seed, 0.4)
        through = stiffness_along(slab, modulus, THICKNESS * ONES, THICKNESS)
        check_against_the_full_model(through, modulus, element, formulation)
        with pytest.raises(AssertionError):
            check_against_the_full_model(through * np.linspace(1.0, 1.01, N_POINTS), modulus, element, formulation)
        local = modulus * np.asarray(model(element, formulation).stiffness(Y)) * THICKNESS
        with pytest.raises(AssertionError):  # the modulus of the place, as if a point load averaged nothing
            check_against_the_full_model(local, modulus, element, formulation)


def test_a_uniform_slab_that_is_cut_through_has_e_kappa_b():
    even = stiffness_along(SLAB, 40e3 * ONES, 0.02 * ONES, 0.02)
    assert even == pytest.approx(40e3 * 0.02 * np.asarray(CutModel().stiffness(Y)), rel=1e-12)


def test_the_kept_model_is_the_one_that_is_computed():
    computed = condensed(CutModel())
    assert SLAB[0]["tips"] == pytest.approx(computed.kappa, rel=1e-9)
    kept_trace, trace = (np.trace(values, axis1=1, axis2=2) for values in (SLAB[0]["upper"], computed.upper))
    assert kept_trace == pytest.approx(trace, rel=1e-6)


def check_against_bricks(table: np.ndarray, bricks: np.ndarray) -> None:
    assert table == pytest.approx(bricks, rel=0.03)


def test_a_cut_of_partial_depth_is_as_stiff_as_bricks_say():
    borders = np.array([0.0, 0.0013, 0.0027, 0.0055, 0.0095, 0.0145, 0.0195, 0.025])  # few, and not the table's
    bricks = stiffness_by_depth(borders, np.ones(15))
    for n, depth in enumerate(borders[1:-1], start=1):
        along = stiffness_along(SLAB, ONES, depth * ONES, THICKNESS)[20:260:20]
        through = stiffness_along(SLAB, ONES, THICKNESS * ONES, THICKNESS)[20:260:20]
        check_against_bricks(along / through, bricks[:12, n] / bricks[:12, -1])
        with pytest.raises(AssertionError):  # as if it were proportional to the depth
            check_against_bricks(np.full(12, depth / THICKNESS), bricks[:12, n] / bricks[:12, -1])


def test_deeper_is_stiffer_and_an_edge_of_no_depth_still_pushes_a_patch():
    depths = np.linspace(1e-4, THICKNESS, 80)
    stiffness = np.array([stiffness_along(SLAB, ONES, depth * ONES, THICKNESS) for depth in depths])
    assert np.all(np.diff(stiffness, axis=0) > 0.0)
    assert 0.05 < stiffness[0, 100] / stiffness[-1, 100] < 0.15


def test_the_mean_tissue_at_any_depth_is_the_mean_specimen():
    mean = Specimen.mean()
    nominal = nominal_tissue(mean.tissue)[0]
    expected = [nominal_stiffness(nominal, i, float(mean.depth[i])) for i in range(N_POINTS)]
    assert expected == pytest.approx(mean.stiffness(), rel=1e-9)


def test_a_solid_model_is_refused_with_the_cure():
    with pytest.raises(ValueError, match="convert_modulus"):
        slab_of("hex20", "solid", 0.3)
