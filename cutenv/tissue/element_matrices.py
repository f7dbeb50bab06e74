"""Stiffness of single 8-node quadrilaterals and 6-node triangles, and compliance of those around a node.

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
from typing import Any

import numpy as np
from skfem.element import Element, ElementQuadS2, ElementTriP2
from skfem.quadrature import get_quadrature

from cutenv._base.arrays import Array, Indices

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


def local_compliance(
    elements: Sequence[Sequence[Hashable]],
    position: Callable[[Any], Array],
    node: Hashable,
    lam: float,
    mu: float,
) -> Array:
    """Return the displacement of a node per force on it at unit modulus and thickness, shape (2, 2).

    Parameters
    ----------
    elements : sequence of sequences of nodes
        Nodes of 8-node quadrilaterals and 6-node triangles of a patch, corners first; the node lies inside.
    position : callable
        Position of a node [m], shape (2,).
    node : hashable
        Node that the force acts on.
    lam, mu : float
        Lame parameters of unit Young's modulus.
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
    """Return the local compliance of 8-node squares of a size [m] along and across; they have no other."""
    steps = [(a, b) for a in range(-2, 2) for b in range(-2, 2)]
    quad = ((0, 0), (2, 0), (2, 2), (0, 2), (1, 0), (2, 1), (1, 2), (0, 1))
    elements = [[(2 * a + i, 2 * b + j) for i, j in quad] for a, b in steps]
    return float(local_compliance(elements, lambda p: 0.5 * size * np.array(p), (0, 0), lam, mu)[0, 0])


def _unknowns(nodes: Indices) -> Indices:
    return 2 * nodes[..., np.newaxis] + np.arange(2)


def _border(elements: Sequence[Sequence[Hashable]]) -> set[Hashable]:
    """Return the nodes on edges that belong to one element only."""
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
    """Return the displacement of the plane at gaps from a unit force [m], shape (n, 2, 2), but for a translation."""
    nu = lam / (2.0 * (lam + mu))  # of plane strain
    square = (gaps**2).sum(axis=1)[:, np.newaxis, np.newaxis]
    both = gaps[:, :, np.newaxis] * gaps[:, np.newaxis, :] / square
    factor = 1.0 / (8.0 * math.pi * mu * (1.0 - nu))
    answer: Array = factor * (both - 0.5 * (3.0 - 4.0 * nu) * np.log(square) * np.eye(2))
    return answer
