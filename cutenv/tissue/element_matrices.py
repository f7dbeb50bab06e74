"""Stiffness of single elements of any shape: 8-node quadrilaterals and 6-node triangles."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from skfem.element import Element, ElementQuadS2, ElementTriP2
from skfem.quadrature import get_quadrature

from cutenv._base.arrays import Array

_QUADRATURE_DEGREE = 5  # 3 x 3 Gauss points, as in the model of a straight cut; exact for the triangle


def element_stiffness(positions: Array, lam: float, mu: float) -> Array:
    """Return the stiffness of 8-node quadrilaterals or 6-node triangles at unit thickness.

    Parameters
    ----------
    positions : array, shape (n, m, 2)
        Nodes of n elements in the order of their m shape functions [m].
    lam, mu : float
        Lame parameters, see :func:`cutenv.tissue.elasticity.lame_parameters`.

    Returns
    -------
    array, shape (n, 2 m, 2 m)
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
    """Return the slopes of the shape functions at the Gauss points, (n_points, m, 2), and the weights, (n_points,)."""
    element: Element = ElementQuadS2() if nodes == 8 else ElementTriP2()
    points, weights = get_quadrature(element, _QUADRATURE_DEGREE)
    slopes = np.stack([element.lbasis(points, k)[1] for k in range(nodes)])  # (m, 2, n_points)
    return np.ascontiguousarray(slopes.transpose(2, 0, 1)), np.asarray(weights)
