"""Isotropic linear elasticity.

Plane stress, plane strain, the solid, and mixed (thesis, Appendices A and B).

The parameters and the weak form are scikit-fem's; this module selects them by name and writes them as the
matrices printed in Appendix A.

Erratum. Appendix A's shear entries, ``1 - nu`` and ``1 - 2 nu``, belong to the tensor shear strain ``eps_xy =
gamma_xy / 2``. With the engineering shear strain ``gamma_xy`` that finite elements use they are half as
large. Used as printed with engineering strain, the shear modulus would be twice the isotropic one, and the
result would depend on the direction of the axes.

Mixed displacement-pressure elasticity in plane strain is for Poisson's ratios up to 0.5 (Appendix B). A displacement
model of a nearly incompressible material locks: its elements cannot keep their volume and still bend. Here the
pressure p is a separate unknown, continuous and bilinear in each half of the specimen, beside quadratic displacements
(Taylor-Hood). Per Young's modulus, with mu = 1/(2 (1 + nu)) and the bulk modulus K = 1/(3 (1 - 2 nu)),

    [A   B^T] [u]   [f]     A: 2 mu (eps : eps - (div u)^2 / 3),  B: -p div u,  C: p^2 / K.
    [B   -C ] [p] = [0],

At nu = 0.5 C vanishes: around each corner the volume is kept in the mean. Under a point load a model with smooth
pressure is more compliant than one with displacements alone, by the same amount on every mesh: kappa is lower than that
of the 8-node element, and moduli found with the two differ (`CutModel.convert_modulus`).

Here too: stiffness of single 8-node quadrilaterals and 6-node triangles, and compliance of those around a node.
In a continuum a point force moves its own place without limit; in a model the elements around it set the limit.  How
far, tells a patch of these elements whose border moves as the whole plane does under the force (Kelvin's solution): its
compliance C depends on the size and the shape of the elements, and on no border.  A compliance at a crack tip converts
from one mesh to another by the difference of their C.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Hashable, Sequence
from functools import lru_cache
from typing import Any, cast

import numpy as np
from scipy.sparse import block_array, csr_array, kron
from scipy.sparse.linalg import spsolve
from skfem import Basis, BilinearForm
from skfem.element import Element, ElementQuadS2, ElementTriP2
from skfem.helpers import ddot, div, sym_grad
from skfem.models.elasticity import lame_parameters as solid_lame_parameters
from skfem.models.elasticity import linear_elasticity
from skfem.models.elasticity import plane_stress as plane_stress_lame_parameters
from skfem.quadrature import get_quadrature

from cutenv._base.arrays import Array, Indices
from cutenv._base.validation import in_range, one_of

FORMULATIONS = ("plane_stress", "plane_strain", "solid")
LARGEST_POISSON = 0.499
POISSON_CURE = f'Take {LARGEST_POISSON} for an incompressible tissue, or element="quad8_mixed" in plane strain.'


def lame_parameters(formulation: str, poisson: float) -> tuple[float, float]:
    """Return the Lame parameters at unit Young's modulus.

    Plane stress replaces lambda by ``2 lambda mu / (lambda + 2 mu)``; plane strain and the solid share theirs.
    ValueError for an unknown formulation, or a Poisson's ratio outside 0 to 0.499.
    """
    one_of("formulation", formulation, FORMULATIONS)
    nu = in_range("poisson", poisson, 0.0, LARGEST_POISSON, "1", POISSON_CURE)
    parameters = plane_stress_lame_parameters if formulation == "plane_stress" else solid_lame_parameters
    lam, mu = parameters(1.0, nu)
    return float(lam), float(mu)


def elastic_form(formulation: str, poisson: float, modulus: Array) -> BilinearForm:
    """Return the weak form of elasticity, to be assembled on vector elements.

    ``modulus`` of each element is in [Pa], or relative to a common one [1].
    """
    lam, mu = lame_parameters(formulation, poisson)
    per_element: Any = modulus[:, np.newaxis]  # against scikit-fem's (n_elements, n_quadrature_points)
    return cast(BilinearForm, linear_elasticity(lam * per_element, mu * per_element))


def solid_stiffness(basis: Basis, poisson: float, modulus: Array) -> csr_array[np.float64]:
    """Assemble a solid's stiffness from derivatives of scalar shape functions.

    The same matrix as from :func:`elastic_form`, to rounding; for bricks of 60 vector functions fifty times as fast,
    because only the pairs of their 20 scalar ones are integrated.  ``basis`` is that of the scalar element whose vector
    element the unknowns belong to.
    """
    lam, mu = lame_parameters("solid", poisson)
    per_element: Any = modulus[:, np.newaxis]

    def product(a: int, b: int) -> csr_array[np.float64]:
        form = BilinearForm(lambda u, v, _: per_element * v.grad[a] * u.grad[b])
        return csr_array(form.assemble(basis))

    products = {(a, b): product(a, b) for a in range(3) for b in range(a, 3)}
    products |= {(b, a): csr_array(products[a, b].T) for a, b in ((0, 1), (0, 2), (1, 2))}
    laplacian = products[0, 0] + products[1, 1] + products[2, 2]
    stiffness = kron(mu * laplacian, np.eye(3))
    for (a, b), block in products.items():
        place = np.zeros((3, 3))
        place[a, b] = 1.0
        stiffness = stiffness + kron(lam * block + mu * block.T, place)
    return csr_array(stiffness)


def strain_energy_density(basis: Basis, displacement: Array, formulation: str, poisson: float) -> Array:
    """Return each element's strain energy density at unit modulus, (n_elements,) [1].

    ``displacement`` is that of each unknown [m].
    """
    lam, mu = lame_parameters(formulation, poisson)
    gradient = np.asarray(basis.interpolate(displacement).grad)  # (dim, dim, n_elements, n_quadrature_points)
    strain = 0.5 * (gradient + gradient.swapaxes(0, 1))
    dilation = np.einsum("ii...", strain)
    density = 0.5 * lam * dilation**2 + mu * np.einsum("ij...,ij...", strain, strain)
    mean: Array = (density * basis.dx).sum(axis=1) / basis.dx.sum(axis=1)
    return mean


def mixed_stiffness(basis: Basis, pressure: Basis, poisson: float, modulus: Array) -> csr_array[np.float64]:
    """Assemble the symmetric indefinite matrix of displacements, then pressures, at unit thickness.

    The bases, of vector and of scalar elements, share mesh and quadrature rule; ``modulus`` is each element's over a
    common one.  ValueError for a Poisson's ratio outside 0 to 0.5.
    """
    shear, coupling, volume = _blocks(basis, pressure, poisson, modulus)
    return csr_array(block_array([[shear, coupling.T], [coupling, -volume]]))


def mixed_strain_energy_density(
    basis: Basis, pressure: Basis, displacement: Array, poisson: float, modulus: Array
) -> Array:
    """Return strain energy density including pressure, by element, (n_elements,) [1].

    The arguments are those of :func:`mixed_stiffness`, and the displacement of shape (n_unknowns,) [m].
    """
    _, coupling, volume = _blocks(basis, pressure, poisson, modulus)
    per_element = modulus[:, np.newaxis]
    gradient = np.asarray(basis.interpolate(displacement).grad)  # (2, 2, n_elements, n_quadrature_points)
    strain = 0.5 * (gradient + gradient.swapaxes(0, 1))
    distortion = np.einsum("ij...,ij...", strain, strain) - np.einsum("ii...", strain) ** 2 / 3
    density = distortion / (2 * (1 + poisson)) * per_element
    if poisson < 0.5:
        p = np.asarray(pressure.interpolate(spsolve(volume.tocsc(), coupling @ displacement)))
        density += 1.5 * (1 - 2 * poisson) * p**2 / per_element
    mean: Array = (density * basis.dx).sum(axis=1) / basis.dx.sum(axis=1)
    return mean


def _blocks(basis: Basis, pressure: Basis, poisson: float, modulus: Array) -> tuple[Any, Any, Any]:
    nu = in_range("poisson", poisson, 0.0, 0.5, "1", "0.5 is incompressible.")
    per_element: Any = modulus[:, np.newaxis]  # against scikit-fem's (n_elements, n_quadrature_points)

    def shear(u: Any, v: Any, _: Any) -> Any:
        return per_element / (1 + nu) * (ddot(sym_grad(u), sym_grad(v)) - div(u) * div(v) / 3)

    def coupling(u: Any, q: Any, _: Any) -> Any:
        return -div(u) * q

    def volume(p: Any, q: Any, _: Any) -> Any:
        return 3 * (1 - 2 * nu) * p * q / per_element

    return (
        BilinearForm(shear).assemble(basis),
        BilinearForm(coupling).assemble(basis, pressure),
        BilinearForm(volume).assemble(pressure),
    )


_QUADRATURE_DEGREE = 5  # 3 x 3 Gauss points, as in the model of a straight cut; exact for the triangle


def element_stiffness(positions: Array, lam: float, mu: float) -> Array:
    """Return 8-node quadrilaterals' or 6-node triangles' stiffness at unit thickness.

    ``positions``, (n, m, 2), are the nodes of n elements in the order of their m shape functions [m]; the result is (n,
    2 m, 2 m).
    """
    gradients, weights = _shapes(positions.shape[1])
    jacobian = np.einsum("gma,nmi->ngia", gradients, positions)
    inverse, size = np.linalg.inv(jacobian), np.linalg.det(jacobian) * weights
    slopes = np.einsum("gma,ngai->ngmi", gradients, inverse)
    weighted = slopes * size[:, :, np.newaxis, np.newaxis]
    products = np.einsum("ngmi,ngkj->nmikj", weighted, slopes, optimize=True)
    same = products[:, :, 0, :, 0] + products[:, :, 1, :, 1]
    stiffness = lam * products + mu * products.transpose(0, 1, 4, 3, 2)
    stiffness[:, :, 0, :, 0] += mu * same
    stiffness[:, :, 1, :, 1] += mu * same
    n = 2 * positions.shape[1]
    return stiffness.reshape(-1, n, n)  # type: ignore[no-any-return]


@lru_cache(maxsize=2)
def _shapes(nodes: int) -> tuple[Array, Array]:
    """Return Gauss-point shape slopes, (n_points, m, 2), and weights, (n_points,)."""
    element: Element = ElementQuadS2() if nodes == 8 else ElementTriP2()
    points, weights = get_quadrature(element, _QUADRATURE_DEGREE)
    slopes = np.stack([element.lbasis(points, k)[1] for k in range(nodes)])  # (m, 2, n_points)
    return np.ascontiguousarray(slopes.transpose(2, 0, 1)), np.asarray(weights)


def local_compliance(
    elements: Sequence[Sequence[Hashable]], position: Callable[[Any], Array], node: Hashable, lam: float, mu: float
) -> Array:
    """Return a node's displacement per force on it, shape (2, 2).

    It lies inside a patch of 8-node quadrilaterals and 6-node triangles, given by their nodes, corners first, and
    ``position`` of a node [m].
    """
    number: dict[Hashable, int] = {}
    for nodes in elements:
        for each in nodes:
            number.setdefault(each, len(number))
    places = np.array([position(each) for each in number])
    size = 2 * len(number)
    stiffness = np.zeros((size, size))
    for count in (8, 6):
        alike = np.array(
            [[number[each] for each in nodes] for nodes in elements if len(nodes) == count], dtype=np.int64
        )
        if alike.size:
            unknowns = _unknowns(alike).reshape(len(alike), -1)
            for rows, block in zip(unknowns, element_stiffness(places[alike], lam, mu), strict=True):
                stiffness[np.ix_(rows, rows)] += block
    on_border = np.zeros(len(number), dtype=bool)
    on_border[[number[each] for each in _border(elements)]] = True
    fixed, free = _unknowns(np.flatnonzero(on_border)).ravel(), _unknowns(np.flatnonzero(~on_border)).ravel()
    moved = _kelvin(places[on_border] - places[number[node]], lam, mu).reshape(-1, 2)
    own = _unknowns(np.array([number[node]])).ravel()
    load = np.zeros((size, 2))
    load[own, [0, 1]] = 1.0
    answer = np.zeros((size, 2))
    answer[free] = np.linalg.solve(stiffness[np.ix_(free, free)], load[free] - stiffness[np.ix_(free, fixed)] @ moved)
    return answer[own]


@lru_cache(maxsize=16)
def square_compliance(size: float, lam: float, mu: float) -> float:
    """Return 8-node squares' local compliance along and across; coupling is zero."""
    steps = [(a, b) for a in range(-2, 2) for b in range(-2, 2)]
    quad = ((0, 0), (2, 0), (2, 2), (0, 2), (1, 0), (2, 1), (1, 2), (0, 1))
    elements = [[(2 * a + i, 2 * b + j) for i, j in quad] for a, b in steps]
    return float(local_compliance(elements, lambda p: 0.5 * size * np.array(p), (0, 0), lam, mu)[0, 0])


def _unknowns(nodes: Indices) -> Indices:
    return 2 * nodes[..., np.newaxis] + np.arange(2)


def _border(elements: Sequence[Sequence[Hashable]]) -> set[Hashable]:
    """Return nodes on edges of only one element."""
    edges: Counter[frozenset[Hashable]] = Counter()
    middles: dict[frozenset[Hashable], Hashable] = {}
    for nodes in elements:
        n = len(nodes) // 2
        corners, between = nodes[:n], nodes[n:]
        for k in range(n):
            edge = frozenset((corners[k], corners[(k + 1) % n]))
            edges[edge] += 1
            middles[edge] = between[k]
    return {node for edge, count in edges.items() if count == 1 for node in (*edge, middles[edge])}


def _kelvin(gaps: Array, lam: float, mu: float) -> Array:
    """Return the displacement under a unit force [m], (n, 2, 2).

    ``gaps`` are the offsets from the force; a translation remains undetermined.
    """
    nu = lam / (2.0 * (lam + mu))  # of plane strain
    square = (gaps**2).sum(axis=1)[:, np.newaxis, np.newaxis]
    both = gaps[:, :, np.newaxis] * gaps[:, np.newaxis, :] / square
    factor = 1.0 / (8.0 * math.pi * mu * (1.0 - nu))
    answer: Array = factor * (both - 0.5 * (3.0 - 4.0 * nu) * np.log(square) * np.eye(2))
    return answer
