"""Isotropic linear elasticity of the specimen: plane stress, plane strain and the solid (thesis, Appendix A).

The parameters and the weak form are scikit-fem's; this module selects them by name and writes them as the
matrices printed in Appendix A.

Erratum. Appendix A's shear entries, ``1 - nu`` and ``1 - 2 nu``, belong to the tensor shear strain ``eps_xy =
gamma_xy / 2``. With the engineering shear strain ``gamma_xy`` that finite elements use they are half as
large. Used as printed with engineering strain, the shear modulus would be twice the isotropic one, and the
result would depend on the direction of the axes.
"""

from __future__ import annotations

from typing import Any, cast

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array, kron
from skfem import Basis
from skfem.assembly import BilinearForm
from skfem.models.elasticity import lame_parameters as solid_lame_parameters
from skfem.models.elasticity import linear_elasticity
from skfem.models.elasticity import plane_stress as plane_stress_lame_parameters

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


def elastic_form(formulation: str, poisson: float, modulus: NDArray[np.float64]) -> BilinearForm:
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


def solid_stiffness(basis: Basis, poisson: float, modulus: NDArray[np.float64]) -> csr_array[np.float64]:
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


def strain_energy_density(
    basis: Basis, displacement: NDArray[np.float64], formulation: str, poisson: float
) -> NDArray[np.float64]:
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
    mean: NDArray[np.float64] = (density * basis.dx).sum(axis=1) / basis.dx.sum(axis=1)
    return mean
