"""Isotropic linear elasticity: plane stress, plane strain, the solid, and mixed (thesis, Appendices A and B).

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
"""

from __future__ import annotations

from typing import Any, cast

import numpy as np
from scipy.sparse import block_array, csr_array, kron
from scipy.sparse.linalg import spsolve
from skfem import Basis, BilinearForm
from skfem.helpers import ddot, div, sym_grad
from skfem.models.elasticity import lame_parameters as solid_lame_parameters
from skfem.models.elasticity import linear_elasticity
from skfem.models.elasticity import plane_stress as plane_stress_lame_parameters

from cutenv._base.arrays import Array
from cutenv._base.validation import in_range, one_of

FORMULATIONS = ("plane_stress", "plane_strain", "solid")
LARGEST_POISSON = 0.499
POISSON_CURE = f'Take {LARGEST_POISSON} for an incompressible tissue, or element="quad8_mixed" in plane strain.'


def lame_parameters(formulation: str, poisson: float) -> tuple[float, float]:
    """Return the Lame parameters of a material with unit Young's modulus.

    Parameters
    ----------
    formulation : {"plane_stress", "plane_strain", "solid"}
        Plane stress replaces lambda by ``2 lambda mu / (lambda + 2 mu)``; plane strain and the solid share
        theirs.
    poisson : float
        Poisson's ratio [1], 0 to 0.499.

    Returns
    -------
    lam, mu : float
        Lame parameters in units of Young's modulus.

    Raises
    ------
    ValueError
        If the formulation is unknown or Poisson's ratio out of range.
    """
    one_of("formulation", formulation, FORMULATIONS)
    nu = in_range("poisson", poisson, 0.0, LARGEST_POISSON, "1", POISSON_CURE)
    parameters = plane_stress_lame_parameters if formulation == "plane_stress" else solid_lame_parameters
    lam, mu = parameters(1.0, nu)
    return float(lam), float(mu)


def elastic_form(formulation: str, poisson: float, modulus: Array) -> BilinearForm:
    """Return the weak form of elasticity with an element-wise modulus.

    Parameters
    ----------
    formulation : {"plane_stress", "plane_strain", "solid"}
    poisson : float
        Poisson's ratio [1], 0 to 0.499.
    modulus : ndarray of shape (n_elements,)
        Young's modulus of each element [Pa], or relative to a common one [1].

    Returns
    -------
    skfem.BilinearForm
        Form to be assembled on a basis of vector elements.
    """
    lam, mu = lame_parameters(formulation, poisson)
    per_element: Any = modulus[:, np.newaxis]  # against scikit-fem's (n_elements, n_quadrature_points)
    return cast(BilinearForm, linear_elasticity(lam * per_element, mu * per_element))


def solid_stiffness(basis: Basis, poisson: float, modulus: Array) -> csr_array[np.float64]:
    """Assemble the stiffness of a solid from products of derivatives of its scalar shape functions.

    The same matrix as from :func:`elastic_form`, to rounding; for bricks of 60 vector functions fifty times as fast,
    because only the pairs of their 20 scalar ones are integrated.

    Parameters
    ----------
    basis : skfem.Basis
        Basis of the scalar element whose vector element the unknowns belong to.
    poisson : float
        Poisson's ratio [1], 0 to 0.499.
    modulus : ndarray of shape (n_elements,)
        Young's modulus of each element [Pa], or relative to a common one [1].

    Returns
    -------
    csr_array of shape (n_unknowns, n_unknowns)
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
    """Return the mean strain energy per volume of each element at unit modulus, shape (n_elements,) [1].

    Parameters
    ----------
    basis : skfem.Basis
        Basis of vector elements.
    displacement : ndarray of shape (n_unknowns,)
        Displacement of each unknown [m].
    formulation : {"plane_stress", "plane_strain", "solid"}
    poisson : float
        Poisson's ratio [1], 0 to 0.499.
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

    Parameters
    ----------
    basis, pressure : skfem.Basis
        Bases of vector and of scalar elements on one mesh, with one quadrature rule.
    poisson : float
        Poisson's ratio [1], 0 to 0.5.
    modulus : ndarray of shape (n_elements,)
        Young's modulus of each element over a common one [1].

    Returns
    -------
    csr_array of shape (n_unknowns, n_unknowns)

    Raises
    ------
    ValueError
        If Poisson's ratio is out of range.
    """
    shear, coupling, volume = _blocks(basis, pressure, poisson, modulus)
    return csr_array(block_array([[shear, coupling.T], [coupling, -volume]]))


def mixed_strain_energy_density(
    basis: Basis, pressure: Basis, displacement: Array, poisson: float, modulus: Array
) -> Array:
    """Return the mean strain energy per volume of each element, shape (n_elements,) [1], pressure included.

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
