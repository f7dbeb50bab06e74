"""Constitutive matrices of Appendix A: the erratum in their shear entries, and agreement with scikit-fem."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray
from reproduction.constitutive import constitutive_matrix
from skfem.models.elasticity import linear_stress

from cutenv.tissue.elasticity import elastic_form, lame_parameters
from cutenv.tissue.mesh import ELEMENT_KINDS, CutMesh
from cutenv.tissue.tables import table
from cutenv.tissue.tip_response import stiffness_matrix

POISSON = (0.0, 0.3, 0.45, 0.499)
PLANE = ("plane_stress", "plane_strain")


def as_printed(formulation: str, nu: float) -> NDArray[np.float64]:
    """Appendix A as it is printed."""
    if formulation == "plane_stress":
        return np.array([[1, nu, 0], [nu, 1, 0], [0, 0, 1 - nu]]) / (1 - nu**2)
    matrix = np.array([[1 - nu, nu, 0], [nu, 1 - nu, 0], [0, 0, 1 - 2 * nu]])
    return matrix / ((1 + nu) * (1 - 2 * nu))


def strain_rotation(angle: float, shear_factor: float) -> NDArray[np.float64]:
    """Turn (xx, yy, shear) strain; the shear entry is ``shear_factor`` times the tensor component."""
    c, s = np.cos(angle), np.sin(angle)
    k = shear_factor
    return np.array(
        [
            [c * c, s * s, 2 * c * s / k],
            [s * s, c * c, -2 * c * s / k],
            [-c * s * k, c * s * k, c * c - s * s],
        ]
    )


def check_isotropy(matrix: NDArray[np.float64], shear_factor: float) -> None:
    """The same strain, seen in turned axes, has the same stress in turned axes (stress has factor 1)."""
    for angle in (0.3, np.pi / 4, 1.1):
        turned = strain_rotation(angle, 1.0) @ matrix
        assert turned == pytest.approx(matrix @ strain_rotation(angle, shear_factor), rel=1e-10, abs=1e-12)


@pytest.mark.parametrize("formulation", PLANE)
@pytest.mark.parametrize("nu", POISSON)
def test_plane_matrices_are_isotropic_with_engineering_strain(formulation: str, nu: float) -> None:
    check_isotropy(constitutive_matrix(formulation, nu), shear_factor=2.0)


@pytest.mark.parametrize("formulation", PLANE)
@pytest.mark.parametrize("nu", POISSON)
def test_erratum_printed_matrices_are_not_isotropic_with_engineering_strain(formulation: str, nu: float) -> None:
    assert any("Appendix A's shear entries" in erratum for erratum in table("4.1").errata)
    with pytest.raises(AssertionError):
        check_isotropy(as_printed(formulation, nu), shear_factor=2.0)


@pytest.mark.parametrize("formulation", PLANE)
@pytest.mark.parametrize("nu", POISSON)
def test_erratum_printed_matrices_are_right_for_tensor_strain(formulation: str, nu: float) -> None:
    check_isotropy(as_printed(formulation, nu), shear_factor=1.0)
    halved_shear = as_printed(formulation, nu) @ np.diag([1.0, 1.0, 0.5])
    assert constitutive_matrix(formulation, nu) == pytest.approx(halved_shear, rel=1e-12)


@pytest.mark.parametrize("nu", POISSON)
def test_shear_entries_are_the_corrected_ones(nu: float) -> None:
    plane_stress = constitutive_matrix("plane_stress", nu) * (1 - nu**2)
    plane_strain = constitutive_matrix("plane_strain", nu) * ((1 + nu) * (1 - 2 * nu))
    assert plane_stress[2, 2] == pytest.approx((1 - nu) / 2, rel=1e-12)
    assert plane_strain[2, 2] == pytest.approx((1 - 2 * nu) / 2, rel=1e-12)


@pytest.mark.parametrize("formulation", ["plane_stress", "plane_strain", "solid"])
def test_matrices_give_the_stress_of_the_weak_form(formulation: str) -> None:
    stress_of = linear_stress(*lame_parameters(formulation, 0.37))
    matrix = constitutive_matrix(formulation, 0.37)
    dim = 3 if formulation == "solid" else 2
    shears = [(1, 2), (0, 2), (0, 1)] if dim == 3 else [(0, 1)]
    entries = [*((i, i) for i in range(dim)), *shears]
    for column, (i, j) in enumerate(entries):
        strain = np.zeros((dim, dim, 1, 1))
        strain[i, j] = strain[j, i] = 1.0 if i == j else 0.5  # unit engineering strain
        stress = stress_of(strain)[:, :, 0, 0]
        assert matrix[:, column] == pytest.approx([stress[entry] for entry in entries], rel=1e-12, abs=1e-14)


def test_plane_stress_leaves_the_faces_free_and_plane_strain_keeps_them_in_place() -> None:
    nu = 0.3
    solid = constitutive_matrix("solid", nu)
    in_plane = [0, 1, 5]
    assert constitutive_matrix("plane_strain", nu) == pytest.approx(solid[np.ix_(in_plane, in_plane)])
    compliance = np.linalg.inv(solid)[np.ix_(in_plane, in_plane)]
    assert constitutive_matrix("plane_stress", nu) == pytest.approx(np.linalg.inv(compliance))


def test_uniaxial_stress_meets_youngs_modulus() -> None:
    for formulation in ("plane_stress", "solid"):
        compliance = np.linalg.inv(constitutive_matrix(formulation, 0.45))
        assert compliance[0, 0] == pytest.approx(1.0, rel=1e-12)
        assert compliance[0, 1] == pytest.approx(-0.45, rel=1e-12)


def test_plane_strain_is_the_stiffer_the_nearer_to_incompressible() -> None:
    stiffnesses = [constitutive_matrix("plane_strain", nu)[0, 0] for nu in POISSON]
    assert all(softer < stiffer for softer, stiffer in pairwise(stiffnesses))


@pytest.mark.parametrize("nu", [-0.1, 0.5, float("nan")])
def test_poisson_out_of_range_is_refused_with_its_range(nu: float) -> None:
    with pytest.raises(ValueError, match=r"poisson = .* is outside 0 to 0\.499\. Take 0\.499"):
        lame_parameters("plane_strain", nu)


def test_a_misspelt_formulation_names_the_nearest() -> None:
    with pytest.raises(ValueError, match="Did you mean 'plane_stress'"):
        constitutive_matrix("planestress", 0.3)


def check_brick_stiffness(poisson: float, modulus: NDArray[np.float64]) -> None:
    """The fast assembly of bricks has the entries of the weak form, here at Poisson's ratio 0.3."""
    mesh = CutMesh(kind=ELEMENT_KINDS["hex20"], divisions=(2, 2, 1), size=(0.08, 0.15, 0.01))
    weak_form = elastic_form("solid", 0.3, np.arange(1.0, 5.0)).assemble(mesh.basis)
    assert abs(stiffness_matrix(mesh, "solid", poisson, modulus) - weak_form).max() < 1e-14 * abs(weak_form).max()


def test_bricks_are_assembled_as_the_weak_form_has_them() -> None:
    check_brick_stiffness(0.3, np.arange(1.0, 5.0))
    for poisson, modulus in ((0.31, np.arange(1.0, 5.0)), (0.3, np.ones(4))):
        with pytest.raises(AssertionError):
            check_brick_stiffness(poisson, modulus)
