"""Nearly incompressible tissue: Cook's membrane, and how the point load's compliance grows as elements shrink."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.sparse.linalg import spsolve
from skfem import ElementVector, FacetBasis, LinearForm

from cutenv.tissue.cut_model import CutModel
from cutenv.tissue.mesh import ELEMENT_KINDS, CutMesh, ElementKind
from cutenv.tissue.tip_response import stiffness_matrix

QUAD8, MIXED = ELEMENT_KINDS["quad8"], ELEMENT_KINDS["quad8_mixed"]

# Cook's membrane (R. D. Cook, 1974) under a unit shear force at its free end: deflection in the middle of that end at
# unit modulus. Plane stress, nu = 1/3: 23.97. Plane strain, lambda = 7500 and G = 0.375: 16.4326, by quadratic
# triangles and Richardson extrapolation. Both as P. Krysl's FinEtools and its forerunner state them.
LAME, SHEAR = 7500.0, 0.375
NEARLY_HALF = LAME / 2 / (LAME + SHEAR)
PLANE_STRESS = 23.97
PLANE_STRAIN = 16.4326 * SHEAR * 2 * (1 + NEARLY_HALF)  # per unit Young's modulus


def deflection(kind: ElementKind, divisions: int, formulation: str, poisson: float) -> float:
    """Of the corner (x, y) of a unit square mapped to the tapered panel (48 (44 to 16)); clamped at y = 0."""
    square, panel = (CutMesh(kind=kind, divisions=(divisions, divisions), size=(1.0, 1.0)) for _ in range(2))
    up, along = 0.5 - square.corners[:, 0], square.corners[:, 1]
    panel.__dict__["corners"] = np.column_stack([48 * along, 44 * along + up * (44 - 28 * along)])
    end = square.skfem_mesh.facets_satisfying(lambda x: np.isclose(x[1], 1.0), boundaries_only=True)
    basis = FacetBasis(panel.skfem_mesh, ElementVector(kind.element()), facets=end, intorder=4)
    load = np.zeros(panel.n_unknowns)
    load[: panel.nodes.size] = LinearForm(lambda v, w: v[1] / 16).assemble(basis)
    constraints = square.constraints()
    k = (constraints.T @ stiffness_matrix(panel, formulation, poisson) @ constraints).tocsc()
    middle = square.pairs[-1, 0]
    assert panel.nodes[middle] == pytest.approx([48.0, 52.0])
    return float((constraints @ spsolve(k, constraints.T @ load))[2 * middle + 1])


def check_cook(kind: ElementKind, formulation: str, poisson: float, reference: float) -> None:
    """Within 2 % on 8 x 8 elements, and within half of that error on 16 x 16."""
    coarse, fine = (abs(deflection(kind, n, formulation, poisson) / reference - 1) for n in (8, 16))
    assert coarse < 0.02
    assert fine < coarse / 2


@pytest.mark.parametrize("kind", [QUAD8, QUAD8.reduced()], ids=["full", "reduced"])
def test_cooks_membrane_in_plane_stress(kind: ElementKind) -> None:
    check_cook(kind, "plane_stress", 1 / 3, PLANE_STRESS)


def test_cooks_membrane_nearly_incompressible_with_the_mixed_element() -> None:
    check_cook(MIXED, "plane_strain", NEARLY_HALF, PLANE_STRAIN)


def test_displacements_alone_lock() -> None:
    """Even at 0.499, where the true deflection is larger."""
    with pytest.raises(AssertionError):
        check_cook(QUAD8, "plane_strain", 0.499, PLANE_STRAIN)


def check_kelvin(element: str, poisson: float) -> None:
    """Half as large elements add ln 2 times Kelvin's coefficient to the compliance under a point load, to 2 %."""
    kelvin = (1 + poisson) * (3 - 4 * poisson) / (4 * np.pi * (1 - poisson)) * np.log(2)
    coarse, fine = (CutModel(element, "plane_strain", poisson, divisions=d) for d in ((8, 15), (16, 30)))
    for a in (0.05, 0.07, 0.1):
        assert 1 / fine.stiffness(a) - 1 / coarse.stiffness(a) == pytest.approx(kelvin, rel=0.02)


@pytest.mark.parametrize("poisson", [0.3, 0.499, 0.5])
def test_the_mixed_element_softens_by_kelvins_logarithm_up_to_one_half(poisson: float) -> None:
    check_kelvin("quad8_mixed", poisson)


def compliance_beyond_quad8(poisson: float, divisions: tuple[int, int]) -> float:
    mixed, quad8 = (CutModel(name, "plane_strain", poisson, divisions=divisions) for name in ("quad8_mixed", "quad8"))
    return 1 / mixed.stiffness(0.07) - 1 / quad8.stiffness(0.07)


def test_the_point_load_meets_a_larger_compliance_on_every_mesh_alike() -> None:
    coarse, fine = (compliance_beyond_quad8(0.3, divisions) for divisions in ((8, 15), (16, 30)))
    assert coarse > 0.2
    assert fine == pytest.approx(coarse, rel=0.01)


def test_displacements_alone_do_not_soften_so_at_0_499() -> None:
    check_kelvin("quad8", 0.3)
    with pytest.raises(AssertionError):
        check_kelvin("quad8", 0.499)
