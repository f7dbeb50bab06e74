"""Mixed displacement-pressure elasticity in plane strain, for Poisson's ratios up to 0.5 (thesis, Appendix B).

A displacement model of a nearly incompressible material locks: its elements cannot keep their volume and still
bend. Here the pressure p is a separate unknown, continuous and bilinear in each half of the specimen, beside
quadratic displacements (Taylor-Hood). Per Young's modulus, with mu = 1/(2 (1 + nu)) and the bulk modulus
K = 1/(3 (1 - 2 nu)),

    [A   B^T] [u]   [f]     A: 2 mu (eps : eps - (div u)^2 / 3),  B: -p div u,  C: p^2 / K.
    [B   -C ] [p] = [0],

At nu = 0.5 C vanishes: around each corner the volume is kept in the mean. Under a point load a model with smooth
pressure is more compliant than one with displacements alone, by the same amount on every mesh: kappa is lower than that
of the 8-node element, and moduli found with the two differ (`CutModel.convert_modulus`).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import block_array, csr_array
from scipy.sparse.linalg import spsolve
from skfem import Basis, BilinearForm
from skfem.helpers import ddot, div, sym_grad

from cutenv._base.validation import in_range


def mixed_stiffness(
    basis: Basis, pressure: Basis, poisson: float, modulus: NDArray[np.float64]
) -> csr_array[np.float64]:
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
    basis: Basis, pressure: Basis, displacement: NDArray[np.float64], poisson: float, modulus: NDArray[np.float64]
) -> NDArray[np.float64]:
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
    mean: NDArray[np.float64] = (density * basis.dx).sum(axis=1) / basis.dx.sum(axis=1)
    return mean


def _blocks(basis: Basis, pressure: Basis, poisson: float, modulus: NDArray[np.float64]) -> tuple[Any, Any, Any]:
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
