"""Stiffness K(a) along the cut of a slab with a field of moduli, cut B(a) deep.

A specimen is a slab, 8 x 15 cm and T thick.  K is the blade force over the blade's displacement with the tip at a:

    K(a) = T g(a, B/T) [(1 - c) k(a) + c l(a)]

k is the 2-D model's stiffness per thickness in the field of moduli, averaged as by a point load
(:mod:`~cutenv.tissue.varying_modulus`).  g is the effect of partial depth of cut, from bricks.  A shallow blade is
affected more by its near surroundings: the share c(a, B/T) of its stiffness is l = kappa E of the two rows of elements
at the tip (``scripts/derivations/partial_depth.py``).  In a uniform slab that is cut through, K = E kappa(a) B.

The field's 301 points become the moduli of 15 rows of elements by their means over each centimetre; between tips on the
rows' borders k and l are interpolated as in ``CutModel`` (PCHIP), and below the first border they keep its value.
One compiled routine serves single specimens and batches, bit for bit.
"""

from __future__ import annotations

import json
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cutenv._base import resources
from cutenv._base.arrays import Array, Struct
from cutenv._engine.jit import njit, njit_inline, njit_internal
from cutenv.tissue.grid import LENGTH, N_POINTS
from cutenv.tissue.tables import FOLDER
from cutenv.tissue.varying_modulus import UNKNOWNS, Condensed, condensed

ROWS = 15
"""Number of rows of elements along the cut, one centimetre each."""
THICKNESS = 0.025
"""Thickness T of a slab of liver (thesis 3.2) [m]."""
DEPTHS = np.linspace(0.0, 1.0, 51)
"""Values of B/T in the table of partial depth."""
_IN_ROW = (N_POINTS - 1) // ROWS  # points of a field per row
_STEPS = len(DEPTHS) - 1

SLAB: np.dtype[Any] = np.dtype(
    (
        np.record,
        [
            *((name, "f8", (ROWS, UNKNOWNS, UNKNOWNS)) for name in ("lower", "across", "upper")),
            ("uniform", "f8", (ROWS,)),  # stiffness by the condensed model at modulus 1
            ("tips", "f8", (ROWS,)),  # kappa of the full model at the tips
            ("kappa", "f8", (N_POINTS,)),  # kappa of the full model at every point
            ("ratio", "f8", (ROWS, _STEPS + 1)),  # g, by tip and depth
            ("share", "f8", (ROWS, _STEPS + 1)),  # c
        ],
    )
)
"""Structured dtype of the model data from which K(a) of any specimen is computed."""


@lru_cache(maxsize=8)
def slab_of(element: str, formulation: str, poisson: float) -> NDArray[Any]:
    """Return the :data:`SLAB` of a plane model of the default mesh, shape (1,), read-only.

    That of pig liver is stored in ``assets/derived/slab.json``, so that every machine starts from the same digits;
    others are computed.

    Raises
    ------
    ValueError
        For a solid model: thickness is treated by the table of partial depth, which bricks gave.
    """
    if formulation == "solid":
        raise ValueError(
            "element = 'hex20' is a solid model, which has no plane stiffness: describe tissue by 'quad8' moduli; "
            "CutModel.convert_modulus takes a modulus from one model to the other."
        )
    slab = np.zeros(1, SLAB)
    kept = _kept("slab")
    if [kept[name] for name in ("element", "formulation", "poisson")] == [element, formulation, poisson]:
        parts = Condensed(*(np.array(kept[name]) for name in Condensed._fields))
    else:
        from cutenv.tissue.cut_model import CutModel

        parts = condensed(CutModel(element=element, formulation=formulation, poisson=poisson))
    for name in ("lower", "across", "upper"):
        slab[0][name] = getattr(parts, name)
    table = _kept("partial_depth")
    slab[0]["ratio"], slab[0]["share"] = table["stiffness_ratio"], table["local_share"]
    slab[0]["tips"] = parts.kappa
    _prepare(slab)
    slab.setflags(write=False)
    return slab


@lru_cache(maxsize=2)
def _kept(name: str) -> dict[str, Any]:
    content: dict[str, Any] = json.loads(resources.path(f"{FOLDER}/{name}.json").read_text())
    return content


@njit
def _prepare(slabs: Array) -> None:
    uniform, tips, kappa = np.ones(ROWS), np.empty(ROWS), np.empty(N_POINTS)  # not the record's, of another type,
    tip_stiffness(slabs[0], np.ones(ROWS), uniform)  # for which the functions would be compiled again
    for j in range(ROWS):
        slabs[0].uniform[j], tips[j] = uniform[j], slabs[0].tips[j]
    between_tips(tips, kappa)
    for i in range(N_POINTS):
        slabs[0].kappa[i] = kappa[i]


def stiffness_along(slab: NDArray[Any], modulus: Array, depth: Array, thickness: float) -> Array:
    """Return K at each point of a specimen, shape (301,) [N/m].

    Parameters
    ----------
    slab : array of :data:`SLAB`, shape (1,)
    modulus, depth : array, shape (301,)
        Modulus of the material [Pa]; depth of the cut [m], up to ``thickness`` [m].
    """
    stiffness, effective, share = np.empty(N_POINTS), np.empty(N_POINTS), np.empty(N_POINTS)
    partial_depth(slab, depth, thickness, effective, share)
    _stiffness_along(slab, modulus, effective, share, stiffness)
    return stiffness


@njit
def _stiffness_along(slabs: Array, modulus: Array, effective: Array, share: Array, stiffness: Array) -> None:
    fill_stiffness(slabs[0], modulus, effective, share, stiffness)


def row_means(modulus: Array) -> Array:
    """Return the modulus of each row of elements, shape (15,), from a field, shape (301,): trapezoidal means."""
    rows = np.empty(ROWS)
    _fill_rows(modulus, rows)
    return rows


@njit_internal
def _fill_rows(modulus: Array, rows: Array) -> None:
    for j in range(ROWS):
        first = j * _IN_ROW
        total = 0.5 * (modulus[first] + modulus[first + _IN_ROW])
        for i in range(first + 1, first + _IN_ROW):
            total += modulus[i]
        rows[j] = total / _IN_ROW


def local_modulus(rows: Array) -> Array:
    """Return the mean modulus of the rows on either side of each tip, shape (15,)."""
    local = np.empty(ROWS)
    _fill_local(rows, local)
    return local


@njit_internal
def _fill_local(rows: Array, local: Array) -> None:
    for j in range(ROWS - 1):
        local[j] = 0.5 * (rows[j] + rows[j + 1])
    local[ROWS - 1] = rows[ROWS - 1]


@njit_internal
def fill_stiffness(slab: Struct, modulus: Array, effective: Array, share: Array, stiffness: Array) -> None:
    """Fill ``stiffness``, shape (301,), with K [N/m]; ``effective`` and ``share`` are from :func:`partial_depth`."""
    far, near = np.empty(N_POINTS), np.empty(N_POINTS)
    mean = cut_through(slab, modulus, far, near)
    for i in range(N_POINTS):
        stiffness[i] = mean * (far[i] + share[i] * (near[i] - far[i])) * effective[i]


@njit
def cut_through_along(slabs: Array, modulus: Array, far: Array, near: Array) -> float:
    """Fill k and l, shape (301,), as :func:`cut_through` does; return the mean modulus [Pa]."""
    return cut_through(slabs[0], modulus, far, near)


@njit_internal
def cut_through(slab: Struct, modulus: Array, far: Array, near: Array) -> float:
    """Fill k and l over the mean modulus, shape (301,), of a slab that is cut through; return that mean [Pa]."""
    rows, local, plane = np.empty(ROWS), np.empty(ROWS), np.empty(ROWS)
    _fill_rows(modulus, rows)
    total = 0.0
    for j in range(ROWS):
        total += rows[j]
    mean = total / ROWS
    for j in range(ROWS):
        rows[j] /= mean
    tip_stiffness(slab, rows, plane)
    _fill_local(rows, local)
    for j in range(ROWS):  # relative to the uniform slab, for which the full model's value is kept
        plane[j] = slab.tips[j] * (plane[j] / slab.uniform[j])
        local[j] *= slab.tips[j]
    between_tips(plane, far)
    between_tips(local, near)
    return mean


@njit_internal
def tip_stiffness(slab: Struct, rows: Array, stiffness: Array) -> None:
    """Fill ``stiffness``, shape (15,), with the plane model's, tip on each border, for the moduli ``rows``.

    The matrix is block tridiagonal.  The part on either side of a border acts on it as a spring matrix: elimination
    from the clamp gives the one, from the free end the other.  The tip is the last unknown of their sum: eliminating
    the others leaves K as the last pivot.
    """
    springs = np.empty((ROWS, UNKNOWNS, UNKNOWNS))
    work = np.empty((UNKNOWNS, UNKNOWNS))
    coupling = np.empty((UNKNOWNS, UNKNOWNS))
    for p in range(UNKNOWNS):
        for q in range(UNKNOWNS):
            springs[0, p, q] = rows[0] * slab.upper[0, p, q]
    for j in range(1, ROWS):  # from the clamp
        for p in range(UNKNOWNS):
            for q in range(UNKNOWNS):
                work[p, q] = springs[j - 1, p, q] + rows[j] * slab.lower[j, p, q]
                coupling[p, q] = rows[j] * slab.across[j, p, q]
                springs[j, p, q] = rows[j] * slab.upper[j, p, q]
        _eliminate(work, coupling, springs[j])
    beyond = np.zeros((UNKNOWNS, UNKNOWNS))
    for j in range(ROWS - 1, -1, -1):  # from the free end
        for p in range(UNKNOWNS):
            for q in range(UNKNOWNS):
                work[p, q] = springs[j, p, q] + beyond[p, q]
        stiffness[j] = _last_pivot(work)
        if j > 0:
            for p in range(UNKNOWNS):
                for q in range(UNKNOWNS):
                    work[p, q] = beyond[p, q] + rows[j] * slab.upper[j, p, q]
                    coupling[p, q] = rows[j] * slab.across[j, q, p]
                    beyond[p, q] = rows[j] * slab.lower[j, p, q]
            _eliminate(work, coupling, beyond)


@njit_inline
def _factorise(matrix: Array) -> None:
    """Factorise in place as L D L^T, by columns: D on the diagonal, L below."""
    for p in range(UNKNOWNS):
        for q in range(p + 1, UNKNOWNS):
            factor = matrix[q, p] / matrix[p, p]
            for k in range(q, UNKNOWNS):
                matrix[k, q] -= factor * matrix[k, p]
        for q in range(p + 1, UNKNOWNS):
            matrix[q, p] /= matrix[p, p]


@njit_internal
def _last_pivot(matrix: Array) -> float:
    _factorise(matrix)
    return matrix[UNKNOWNS - 1, UNKNOWNS - 1]  # type: ignore[no-any-return]


@njit_internal
def _eliminate(matrix: Array, coupling: Array, springs: Array) -> None:
    """Subtract C^T M^-1 C from ``springs``, for a ``matrix`` M and a ``coupling`` C, which are both overwritten."""
    _factorise(matrix)
    for p in range(1, UNKNOWNS):  # C becomes L^-1 C
        for k in range(p):
            factor = matrix[p, k]
            for q in range(UNKNOWNS):
                coupling[p, q] -= factor * coupling[k, q]
    for k in range(UNKNOWNS):
        share = 1.0 / matrix[k, k]
        for p in range(UNKNOWNS):
            factor = coupling[k, p] * share
            for q in range(UNKNOWNS):
                springs[p, q] -= factor * coupling[k, q]


@njit_internal
def between_tips(at_tips: Array, along: Array) -> None:
    """Fill ``along``, shape (301,), by interpolating values at the 15 tips: PCHIP, constant below the first."""
    slopes = np.empty(ROWS)
    for j in range(1, ROWS - 1):  # in units of a row
        before, after = at_tips[j] - at_tips[j - 1], at_tips[j + 1] - at_tips[j]
        slopes[j] = 2.0 * before * after / (before + after) if before * after > 0.0 else 0.0
    slopes[0] = _end_slope(at_tips[1] - at_tips[0], at_tips[2] - at_tips[1])
    last = ROWS - 1
    slopes[last] = _end_slope(at_tips[last] - at_tips[last - 1], at_tips[last - 1] - at_tips[last - 2])
    for i in range(_IN_ROW):
        along[i] = at_tips[0]
    for j in range(last):
        rise = at_tips[j + 1] - at_tips[j]
        second = 3.0 * rise - 2.0 * slopes[j] - slopes[j + 1]
        third = slopes[j] + slopes[j + 1] - 2.0 * rise
        for k in range(_IN_ROW):
            t = k / _IN_ROW
            along[(j + 1) * _IN_ROW + k] = at_tips[j] + t * (slopes[j] + t * (second + t * third))
    along[ROWS * _IN_ROW] = at_tips[last]


@njit_internal
def _end_slope(near: float, far: float) -> float:
    """Return PCHIP's one-sided slope at an end, shape preserved: Fritsch and Butland's three-point formula."""
    slope = 0.5 * (3.0 * near - far)
    if slope * near <= 0.0:
        return 0.0
    if near * far < 0.0 and abs(slope) > 3.0 * abs(near):
        return 3.0 * near
    return slope


@njit
def partial_depth(slabs: Array, depth: Array, thickness: float, effective: Array, share: Array) -> None:
    """Fill ``effective`` with the effective depth T g [m] and ``share`` with c, for the depth at each of 301 points."""
    for i in range(N_POINTS):
        effective[i], share[i] = at_depth(slabs[0], i, depth[i], thickness)


@njit_inline
def at_depth(slab: Struct, i: int, depth: float, thickness: float) -> tuple[float, float]:
    """Return T g [m] and c for a tip at point ``i``: linear in both directions, constant below the first tip."""
    place = min(max(i / _IN_ROW - 1.0, 0.0), ROWS - 1.0)
    j = min(int(place), ROWS - 2)
    w = place - j
    level = min(depth / thickness, 1.0) * _STEPS
    k = min(int(level), _STEPS - 1)
    v = level - k
    ratio, share = slab.ratio, slab.share
    g = (1.0 - w) * (ratio[j, k] + v * (ratio[j, k + 1] - ratio[j, k])) + w * (
        ratio[j + 1, k] + v * (ratio[j + 1, k + 1] - ratio[j + 1, k])
    )
    c = (1.0 - w) * (share[j, k] + v * (share[j, k + 1] - share[j, k])) + w * (
        share[j + 1, k] + v * (share[j + 1, k + 1] - share[j + 1, k])
    )
    return thickness * g, c


def effective_depth(cut_length: ArrayLike, depth: ArrayLike, thickness: float = THICKNESS) -> Array:
    """Return T g(a, B/T) [m]: in a slab of modulus E, K = E kappa(a) times this; B itself where it is cut through.

    Parameters
    ----------
    cut_length, depth : array_like
        Distance of the tip from the clamp, and depth of the cut [m]; broadcast.  If the cut is deeper than the slab,
        the slab counts as equally thick.
    thickness : float
        Thickness of the slab [m].

    Returns
    -------
    ndarray of float64
        Effective depth [m], of the broadcast shape.

    Notes
    -----
    The table is from bricks with a Poisson's ratio of 0.3 and T = 2.5 cm (``scripts/derivations/partial_depth.py``).
    It holds for elements of 1 cm, as ``CutModel`` has: on smaller ones a shallow cut is less stiff.
    """
    a, B = np.broadcast_arrays(np.asarray(cut_length, np.float64), np.asarray(depth, np.float64))
    ratio = np.asarray(_kept("partial_depth")["stiffness_ratio"])
    place = np.clip(a / (LENGTH / ROWS) - 1.0, 0.0, ROWS - 1.0)
    level = np.clip(B / thickness, 0.0, 1.0) * _STEPS
    j, k = np.minimum(place.astype(int), ROWS - 2), np.minimum(level.astype(int), _STEPS - 1)
    w, v = place - j, level - k
    g = (1.0 - w) * ((1.0 - v) * ratio[j, k] + v * ratio[j, k + 1])
    g += w * ((1.0 - v) * ratio[j + 1, k] + v * ratio[j + 1, k + 1])
    return np.asarray(np.maximum(thickness, B) * g)
