"""Stiffness K(a) of a slab with varying modulus and depth.

It is that along the cut, B(a) deep, in a field of moduli.

A specimen is a slab, 8 x 15 cm and T thick.  K is the blade force over the blade's displacement with the tip at a:

    K(a) = T g(a, B/T) [(1 - c) k(a) + c l(a)]

k is the 2-D model's stiffness per thickness in the field of moduli, averaged as by a point load.  g is the effect of
partial depth of cut, from bricks.  A shallow blade is affected more by its near surroundings: the share c(a, B/T) of
its stiffness is l = kappa E of the two rows of elements at the tip (``scripts/derivations/partial_depth.py``).  In a
uniform slab that is cut through, K = E kappa(a) B.

The field's 301 points become the moduli of 15 rows of elements by their means over each centimetre; between tips on the
rows' borders k and l are interpolated as in ``CutModel`` (PCHIP), and below the first border they keep its value.
One compiled routine serves single specimens and batches, bit for bit.

The 2-D models are by zone, or condensed statically, with Galerkin projection. A row of elements has one modulus, so its
stiffness is that modulus times one matrix, the same for every row.  By symmetry half of it is enough; its inner nodes
are eliminated, which leaves the 17 unknowns of the nodes on either border (8-node elements, 8 across): exactly the full
model.  On every border the displacements that blades cause, in fields of moduli of all kinds, are close to a space of
few dimensions, spanned by the leading singular vectors of such displacements.  Projecting the model there (Galerkin)
changes K by less than 0.15 % in fields of a coefficient of variation up to 0.5 (``scripts/derivations/slab.py``).
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cutenv._base import resources
from cutenv._base.arrays import Array, Indices, Struct
from cutenv._base.validation import array_in_range
from cutenv._engine.jit import njit, njit_inline, njit_internal
from cutenv.sim.tissue.grid import LENGTH, N_POINTS, field_modes, lognormal_sigma
from cutenv.sim.tissue.tables import FOLDER

if TYPE_CHECKING:
    from cutenv.sim.tissue.cut_model import CutModel


_PARTS = 50  # parts of a row over which its thickness is averaged


def zoned_model(
    model: CutModel, borders: ArrayLike, moduli: ArrayLike, *, depth: Callable[[Array], ArrayLike] | None = None
) -> CutModel:
    """Return a model with zones along the cut.

    Each row of elements across the specimen gets the mean of modulus times thickness over its length.  The k - 1
    ``borders`` [m] increase between 0 and the length; the k ``moduli``, from the clamp on, are over a common one [1],
    or in pascals, and then the methods take ``modulus=1``.  ``depth`` gives the thickness [m] of a plane model at
    distances from the clamp [m], as `cutenv.records.measurement.DepthProfile.at`; the methods then take
    ``thickness=model.thickness``.

    Raises
    ------
    ValueError
        If borders do not increase or leave the specimen, there are not as many moduli as zones, a value is out of
        range, the model's modulus is not uniform, or ``depth`` is given for bricks.

    Examples
    --------
    >>> soft, stiff = 20e3, 60e3  # Pa
    >>> model = zoned_model(CutModel(), [0.05], [soft, stiff])
    >>> round(model.stiffness(0.04) / (CutModel().stiffness(0.04) * soft), 2)
    1.07
    """
    if depth is not None and model.dim == 3:
        raise ValueError("depth goes with plane models: bricks have one thickness. Ask for element='quad8'.")
    if model.relative_modulus is not None:
        raise ValueError("the model has a relative_modulus already: give one of a uniform modulus.")
    assert model.divisions is not None  # the model has settled them
    rows = _row_moduli(model, borders, moduli, depth).reshape(-1, *[1] * (model.dim - 2))
    return replace(model, relative_modulus=(np.ones(model.divisions) * rows).ravel())


def _row_moduli(
    model: CutModel, borders: ArrayLike, moduli: ArrayLike, depth: Callable[[Array], ArrayLike] | None
) -> Array:
    """Return each element row's modulus, optionally times relative depth, shape (n_rows,)."""
    inner = np.atleast_1d(np.asarray(borders, dtype=np.float64))
    values = np.atleast_1d(array_in_range("moduli", moduli, 1e-6, 1e6, "1", "They are moduli of zones, or in pascals."))
    edges = np.concatenate(([0.0], inner, [model.length]))
    if inner.ndim != 1 or not (np.diff(edges) > 0.0).all():
        raise ValueError(f"borders = {inner.tolist()} m must increase between 0 and the length, {model.length:g} m.")
    if values.shape != (len(inner) + 1,):
        raise ValueError(f"{len(inner)} borders make {len(inner) + 1} zones; {values.size} moduli were given.")
    tips = model.tips
    rows = np.concatenate(([0.0], tips))
    # Every part of a row lies in one zone: the parts end at the borders too.
    cuts = np.unique(np.concatenate((np.linspace(0.0, model.length, _PARTS * len(tips) + 1), rows, edges)))
    middle, part = 0.5 * (cuts[:-1] + cuts[1:]), np.diff(cuts)
    product = values[np.searchsorted(inner, middle)]
    if depth is not None:
        cure = "The depth along the cut is a thickness in metres, and positive."
        product = product * array_in_range("depth", depth(middle), 1e-5, 1.0, "m", cure) / model.thickness
    row = np.searchsorted(tips, middle)
    return np.asarray(np.bincount(row, product * part) / np.bincount(row, part))


UNKNOWNS = 8  # number of unknowns kept on each border between rows
_FIELDS, _FIELD_CV, _FIELD_POINTS, _FIELD_LENGTH = 60, 0.5, 20, 0.020  # sample fields for the basis; points per row


class Condensed(NamedTuple):
    """Condensed row stiffness in border unknowns, for modulus and thickness 1.

    The last unknown of a border is the displacement of the tip there; the others do not move the tip.
    """

    lower: Array  # a row's border nearer to the clamp with itself, (n_rows, 8, 8)
    across: Array  # with the farther one
    upper: Array  # farther with itself
    kappa: Array  # unit stiffness of the full model, with the tip on each farther border [1], (n_rows,)


def condensed(model: CutModel) -> Condensed:
    """Condense a plane model of uniform modulus."""
    row, n = _row_stiffness(model)
    n_rows = len(model.tips)
    shapes: list[list[Array]] = [[] for _ in range(n_rows)]
    for rows in _fields(n_rows):
        compliance = np.linalg.inv(_assembled(row, n, rows))
        at_tips = compliance[:, ::n] / np.diag(compliance)[::n]  # for a unit displacement of each tip
        for border in range(n_rows):
            shapes[border].append(at_tips[border * n : (border + 1) * n])
    bases = [_basis(np.concatenate(each, axis=1)) for each in shapes]
    below = [np.zeros((n, UNKNOWNS)), *bases[:-1]]  # the clamp does not move
    lower, across, upper = row[:n, :n], row[:n, n:], row[n:, n:]
    return Condensed(
        lower=np.array([b.T @ lower @ b for b in below]),
        across=np.array([b.T @ across @ a for b, a in zip(below, bases, strict=True)]),
        upper=np.array([a.T @ upper @ a for a in bases]),
        kappa=np.asarray(model.stiffness(model.tips)),
    )


def _row_stiffness(model: CutModel) -> tuple[Array, int]:
    """Return a row's stiffness, lower border first, and unknowns per border.

    The first unknown of a border is the displacement along the cut of its node on the line.
    """
    from cutenv.sim.tissue.mesh import ACROSS, ALONG, ELEMENT_KINDS, CutMesh
    from cutenv.sim.tissue.tip_response import stiffness_matrix

    assert model.divisions is not None
    across, along = model.divisions[:2]
    strip = CutMesh(kind=ELEMENT_KINDS[model.element], divisions=(across, 1), size=(model.width, model.length / along))
    whole = stiffness_matrix(strip, model.formulation, model.poisson).toarray()
    right = strip.half_steps[:, ACROSS] > 0
    right[strip.pairs[:, 1]] = True

    def unknowns(half_step: int) -> Indices:
        nodes = np.flatnonzero(right & (strip.half_steps[:, ALONG] == half_step))
        nodes = nodes[np.argsort(strip.half_steps[nodes, ACROSS])]
        return np.stack([2 * nodes, 2 * nodes + 1], axis=1).ravel()[1:]  # on the line nothing moves across

    border = unknowns(0)
    kept = np.concatenate([border, unknowns(2)])
    inner = unknowns(1) if strip.kind.has_midside_nodes else np.array([], dtype=np.int64)
    coupled = whole[np.ix_(inner, kept)]
    stiffness = whole[np.ix_(kept, kept)] - coupled.T @ np.linalg.solve(whole[np.ix_(inner, inner)], coupled)
    return 2.0 * stiffness, len(border)  # both halves


def _assembled(row: Array, n: int, rows: Array) -> Array:
    """Assemble the half slab's stiffness, clamped at the lowest border."""
    whole = np.zeros(((len(rows) + 1) * n, (len(rows) + 1) * n))
    for j, modulus in enumerate(rows):
        both = slice(j * n, (j + 2) * n)
        whole[both, both] += modulus * row
    return whole[n:, n:]


def _fields(n_rows: int) -> list[Array]:
    """Return rows' moduli, uniform and varied, for the basis."""
    modes = field_modes(_FIELD_POINTS * n_rows + 1, 0.01 / _FIELD_POINTS, _FIELD_LENGTH)
    rng = np.random.default_rng(0)
    unit = rng.standard_normal((_FIELDS, len(modes))) @ modes
    field = np.exp(lognormal_sigma(_FIELD_CV) * unit)
    rows = field[:, :-1].reshape(_FIELDS, n_rows, _FIELD_POINTS).mean(axis=2)
    return [np.ones(n_rows), *rows]


def _basis(shapes: Array) -> Array:
    """Return a border's basis, (n, 8), whose last alone moves the tip."""
    leading = np.linalg.svd(shapes, full_matrices=False)[0][:, :UNKNOWNS]
    tip = leading[0]  # how each moves the tip
    rest = np.linalg.svd(tip[np.newaxis])[2][1:].T  # combinations that do not
    return np.column_stack([leading @ rest, leading @ tip / (tip @ tip)])


ROWS = 15  # number of rows of elements along the cut, one centimetre each
THICKNESS = 0.025  # thickness T of a slab of liver (thesis 3.2) [m]
DEPTHS = np.linspace(0.0, 1.0, 51)  # values of B/T in the table of partial depth
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
    """Return a plane model's :data:`SLAB`, shape (1,), read-only.

    That of pig liver is stored in ``assets/derived/slab.json``, so that every machine starts from the same digits;
    others are computed.  ValueError for a solid model: thickness is treated by the table of partial depth, which bricks
    gave.
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
        from cutenv.sim.tissue.cut_model import CutModel

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
    """Return K along a specimen, shape (301,) [N/m].

    ``modulus`` [Pa] and ``depth`` [m] of the cut, up to ``thickness`` [m], are of shape (301,).
    """
    stiffness, effective, share = np.empty(N_POINTS), np.empty(N_POINTS), np.empty(N_POINTS)
    partial_depth(slab, depth, thickness, effective, share)
    _stiffness_along(slab, modulus, effective, share, stiffness)
    return stiffness


@njit
def _stiffness_along(slabs: Array, modulus: Array, effective: Array, share: Array, stiffness: Array) -> None:
    fill_stiffness(slabs[0], modulus, effective, share, stiffness)


def row_means(modulus: Array) -> Array:
    """Return trapezoidal row means, (15,), of a modulus field, (301,)."""
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
    """Return the mean modulus of rows around each tip, (15,)."""
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
    """Fill ``stiffness``, (301,), with K [N/m] after :func:`partial_depth`."""
    far, near = np.empty(N_POINTS), np.empty(N_POINTS)
    mean = cut_through(slab, modulus, far, near)
    for i in range(N_POINTS):
        stiffness[i] = mean * (far[i] + share[i] * (near[i] - far[i])) * effective[i]


@njit
def cut_through_along(slabs: Array, modulus: Array, far: Array, near: Array) -> float:
    """Fill k and l, (301,), by :func:`cut_through`; return modulus [Pa]."""
    return cut_through(slabs[0], modulus, far, near)


@njit_internal
def cut_through(slab: Struct, modulus: Array, far: Array, near: Array) -> float:
    """Fill k and l, (301,), over the mean modulus; return it [Pa]."""
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
    """Fill plane-model ``stiffness``, (15,), tip on each border.

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
    """Factorise in place as L D L^T, D diagonal, L below."""
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
    """Subtract C^T M^-1 C from ``springs``; overwrite ``matrix`` and ``coupling``."""
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
    """Fill ``along``, (301,), with PCHIP-interpolated tip values, constant before the first."""
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
    """Return PCHIP's one-sided, shape-preserving end slope (Fritsch and Butland)."""
    slope = 0.5 * (3.0 * near - far)
    if slope * near <= 0.0:
        return 0.0
    if near * far < 0.0 and abs(slope) > 3.0 * abs(near):
        return 3.0 * near
    return slope


@njit
def partial_depth(slabs: Array, depth: Array, thickness: float, effective: Array, share: Array) -> None:
    """Fill effective depth T g [m] and ``share`` c by depth."""
    for i in range(N_POINTS):
        effective[i], share[i] = at_depth(slabs[0], i, depth[i], thickness)


@njit_inline
def at_depth(slab: Struct, i: int, depth: float, thickness: float) -> tuple[float, float]:
    """Interpolate T g [m] and c bilinearly, constant below the first tip."""
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
    """Return effective depth T g(a, B/T) [m].

    In a slab of modulus E, K = E kappa(a) times this; it is B itself where the slab is cut through.  A cut deeper than
    the slab counts as one through a slab of its depth; a and B [m] broadcast.

    The table is from bricks with a Poisson's ratio of 0.3 and T = 2.5 cm (``scripts/derivations/partial_depth.py``). It
    holds for elements of 1 cm, as ``CutModel`` has: on smaller ones a shallow cut is less stiff.
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
