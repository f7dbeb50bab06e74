"""Finite-element model of a slab, whose mesh follows a drawn line."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import cholesky, solve_triangular
from scipy.sparse import csr_array

from cutenv._base.arrays import Array, Indices
from cutenv._base.validation import in_range, one_of
from cutenv.sim.tissue.continuum import METRES, Continuum, checked_relative_modulus
from cutenv.sim.tissue.elasticity import lame_parameters, local_compliance, square_compliance
from cutenv.sim.tissue.grid import LENGTH
from cutenv.sim.tissue.lines import SIDE_MARGIN, WIDTH, CutLine, length_within, straight
from cutenv.sim.tissue.mesh import ACROSS, ALONG, CutMesh, checked_divisions, read_only
from cutenv.sim.tissue.place_model import TipStiffness, along_whole_line, over_straight
from cutenv.sim.tissue.specimen import Specimen
from cutenv.sim.tissue.tip_response import factorise, stiffness_matrix

_ELEMENT = 0.01  # to whose size and shape the stiffness on a line is converted [m]
_ROUNDING = 1e-10  # of a solution, over modulus and thickness


@dataclass(frozen=True, kw_only=True, eq=False)
class PathMesh(CutMesh):
    """Straight cut's mesh, shifted across onto a drawn line, left to -x."""

    drawn: CutLine

    @cached_property
    def _straight(self) -> CutMesh:
        return CutMesh(kind=self.kind, divisions=self.divisions, size=self.size)

    @cached_property
    def corners(self) -> Array:
        """Positions of the element corners [m], shape (n_corners, 2)."""
        moved = self._straight.corners.copy()
        share = 1.0 - np.abs(moved[:, ACROSS]) / (0.5 * self.size[ACROSS])
        aside = np.clip(
            self.drawn.y, SIDE_MARGIN - 0.5 * WIDTH, 0.5 * WIDTH - SIDE_MARGIN
        )  # beyond its end a line may leave
        moved[:, ACROSS] -= share * np.interp(moved[:, ALONG], self.drawn.x, aside)
        return read_only(moved)

    @cached_property
    def half_steps(self) -> Indices:
        """Nodes' positions before bending, in half elements, shape (n_nodes, 2)."""
        return self._straight.half_steps

    @cached_property
    def directions(self) -> Array:
        """Direction of the line at each pair, shape (n_pairs, 2)."""
        angle = np.interp(self.nodes[self.pairs[:, 0], ALONG], self.drawn.x, self.drawn.angle)
        return np.column_stack((-np.sin(angle), np.cos(angle)))

    @cached_property
    def slips(self) -> csr_array[np.float64]:
        """Unknowns' motion per unit slip along the line, (n_unknowns, n_slips)."""
        pairs, along = self.pairs[self._may_slip], self.directions[self._may_slip]
        rows, halves = [], []
        for nodes, half in zip(pairs.T, (-0.5, 0.5), strict=True):
            for component in (ACROSS, ALONG):
                rows.append(self.dim * nodes + component)
                halves.append(half * along[:, component])
        columns = np.tile(np.arange(len(pairs)), 4)
        places = np.concatenate(halves), (np.concatenate(rows), columns)
        return csr_array(places, shape=(self.n_unknowns, len(pairs)))


@dataclass(frozen=True, eq=False, repr=False)
class PathModel:
    """Plane model of a slab, cut along a drawn line.

    The slab, 8 x 15 cm, is clamped where the line begins.

    The counterpart of :class:`~cutenv.sim.tissue.CutModel` for lines that are not straight; on a straight one it gives
    the same.  Pairs of nodes ahead of the tip are tied; those behind it slide along the line, and neither open nor
    overlap. The blade acts on the tip, along the line and across it.  One factorisation serves all tips.

    Parameters
    ----------
    line : CutLine
        Line of the cut, see :mod:`cutenv.sim.tissue.lines`; the modulus is that of the slab, not laid along the line.
    divisions : tuple of int
        Elements across (even) and along the slab.
    element, formulation, poisson
        As for :class:`~cutenv.sim.tissue.CutModel`; plane ones.
    relative_modulus : array, shape (n_elements,), optional
        Modulus of each element over the common one.

    Raises
    ------
    ValueError
        If an argument is out of range, or the mesh is too distorted.
    """

    line: CutLine
    divisions: tuple[int, ...] = (8, 15)
    element: str = "quad8"
    formulation: str = "plane_stress"
    poisson: float = 0.3
    relative_modulus: Array | None = None

    def __post_init__(self) -> None:
        if self.formulation == "solid":
            raise ValueError('formulation = "solid": a cut along a line has a plane model. Ask for "plane_stress".')
        object.__setattr__(self, "divisions", checked_divisions(self.element, self.divisions))
        if self.relative_modulus is not None:
            modulus = checked_relative_modulus(self.relative_modulus, math.prod(self.divisions))
            object.__setattr__(self, "relative_modulus", modulus)

    @cached_property
    def mesh(self) -> PathMesh:
        """Nodes, elements and pairs."""
        kind = Continuum(
            element=self.element, formulation=self.formulation, poisson=self.poisson, integration="full"
        ).kind
        return PathMesh(kind=kind, divisions=self.divisions, size=(WIDTH, LENGTH), drawn=self.line)

    @cached_property
    def tips(self) -> Array:
        """Arc length at each tip [m], shape (n_tips,), within the slab."""
        x = self.mesh.nodes[self.mesh.tip_pairs[:, 0, 0], ALONG]
        x = x[x <= self.line.x[-1]]  # a long line ends within the slab
        s = np.interp(x, self.line.x, np.linspace(0.0, LENGTH, len(self.line.x)))
        return read_only(s[s <= length_within(self.line)])

    @cached_property
    def stiffness(self) -> Array:
        """Stiffness along the line and left, shape (n_tips, 2, 2).

        It is the force over the displacement, the modulus and the thickness [1].
        """
        turned = np.einsum("tri,trs,tsj->tij", self._frames, self._solved[0], self._frames)
        return read_only(np.linalg.inv(turned[: len(self.tips)]))

    def converted_stiffness(self, element: float) -> Array:
        """Return the tips' stiffness with square elements, shape (n_tips, 2, 2).

        Where the line is oblique, elements are, and a point force feels them; see :mod:`cutenv.sim.tissue.elasticity`.
        ``element`` is the size of the squares [m]; ValueError if it is out of range, or the elements have not 8 nodes.
        """
        one_of("element of the model", self.element, ("quad8",))
        size = in_range("element", element, 1e-4, 1.0, "m", METRES)
        lame = lame_parameters(self.formulation, self.poisson)
        mesh, (across, along) = self.mesh, self.divisions
        tied = np.arange(len(mesh.nodes))
        tied[mesh.pairs[:, 1]] = mesh.pairs[:, 0]
        nodes = tied[mesh.element_nodes.T].reshape(across, along, -1)
        modulus = np.ones((across, along)) if self.relative_modulus is None else self.relative_modulus
        modulus = modulus.reshape(across, along)
        compliance = self._solved[0][: len(self.tips)].copy()
        for k in range(min(len(self.tips), along - 1)):  # at the free end there are no elements around the tip
            rows, columns = slice(max(k - 1, 0), k + 3), slice(max(mesh.line - 2, 0), mesh.line + 2)
            patch = nodes[columns, rows].reshape(-1, nodes.shape[2])
            local = local_compliance(patch.tolist(), mesh.nodes.__getitem__, int(mesh.tip_pairs[k, 0, 0]), *lame)
            own = float(modulus[mesh.line - 1 : mesh.line + 1, k : k + 2].mean())
            compliance[k] -= (local - square_compliance(size, *lame) * np.eye(2)) / own
        frames = self._frames[: len(self.tips)]
        return read_only(np.linalg.inv(np.einsum("tri,trs,tsj->tij", frames, compliance, frames)))

    def displacement(self, tip: int, force: ArrayLike) -> Array:
        """Return nodes' displacement times modulus and thickness [N], (n_nodes, 2).

        ``force``, (2,), is on the tip of that number, along the line and to its left [N].
        """
        tip = int(in_range("tip", tip, 0, len(self.tips) - 1, "1", "Give the number of a tip."))
        unknowns = self._solved[1][:, tip] @ (self._frames[tip] @ np.asarray(force, dtype=float))
        return unknowns.reshape(-1, self.mesh.dim)  # type: ignore[no-any-return]

    @cached_property
    def _frames(self) -> Array:
        """Unit vectors along and left of the line, (n_tips, 2, 2)."""
        nodes = self.mesh.tip_pairs[:, 0, 0]
        place = {int(node): k for k, node in enumerate(self.mesh.pairs[:, 0])}
        along = self.mesh.directions[[place[int(node)] for node in nodes]]
        left = np.column_stack((-along[:, 1], along[:, 0]))
        return np.stack((along, left), axis=-1)

    @cached_property
    def _solved(self) -> tuple[Array, Array]:
        """Compliance, (n_tips, 2, 2), and unknowns' motion, (n_unknowns, n_tips, 2).

        Both in the axes of the mesh.  The slips behind each tip are solved for as in
        :mod:`cutenv.sim.tissue.tip_response`.
        """
        mesh = self.mesh
        whole = stiffness_matrix(mesh, self.formulation, self.poisson, self.relative_modulus)
        tied = mesh.constraints()
        factors = factorise(whole, tied, definite=not mesh.kind.has_pressure)
        rows = mesh.dim * mesh.tip_pairs[:, 0, 0][:, np.newaxis] + np.array([ACROSS, ALONG])
        moved = tied.indices[tied.indptr[rows]].astype(np.int64)  # (n_tips, 2)
        loads = np.zeros((tied.shape[1], moved.size))
        loads[moved.ravel(), np.arange(moved.size)] = 1.0
        free = factors.solve(loads).reshape(-1, *moved.shape)

        forces = whole @ mesh.slips
        coupled = factors.solve((tied.T @ forces).toarray())
        factor = cholesky((mesh.slips.T @ forces).toarray() - (tied.T @ forces).T @ coupled, lower=True)
        driven = solve_triangular(factor, coupled[moved.ravel()].T, lower=True).reshape(-1, *moved.shape)
        driven = driven * mesh.slips_behind[:, :, np.newaxis]
        at_tips = np.stack([free[moved[k], k] for k in range(len(moved))])
        compliance = at_tips + np.einsum("stm,stn->tmn", driven, driven)
        slips = -solve_triangular(factor, driven.reshape(len(factor), -1), lower=True, trans="T")
        motion = tied @ free.reshape(len(free), -1) + mesh.slips @ slips - tied @ (coupled @ slips)
        size = self.mesh.nodes.size
        return compliance, motion[:size].reshape(size, *moved.shape)


def stiffness_on_line(specimen: Specimen, line: CutLine) -> TipStiffness:
    """Return the stiffness of a crack on ``line`` in a specimen.

    It is the specimen's own, times the ratio of the uniform slab's stiffness on the line to that on a straight one as
    long: on a straight line the specimen's own, to the last bit.  Partial depth lowers all its parts alike (assumed).
    """
    tissue = specimen.tissue
    plane = tissue.element, tissue.formulation, tissue.poisson
    found, base = stiffness_at_unit_modulus(line, *plane), straight_stiffness(*plane)
    own, ratio = specimen.stiffness(), over_straight(found, base)
    return TipStiffness(own * ratio.along, own * ratio.coupled, own * ratio.across)


@lru_cache(maxsize=4)
def straight_stiffness(element: str, formulation: str, poisson: float) -> TipStiffness:
    """Return the uniform slab's stiffness along a straight cut [1]."""
    return stiffness_at_unit_modulus(straight(), element, formulation, poisson)


def stiffness_at_unit_modulus(line: CutLine, element: str, formulation: str, poisson: float) -> TipStiffness:
    """Interpolate the uniform slab's stiffness between tips, constant beyond them."""
    return along_whole_line(*stiffness_at_tips(line, element, formulation, poisson))


def stiffness_at_tips(line: CutLine, element: str, formulation: str, poisson: float) -> tuple[Array, Array]:
    """Return tips [m], (n,), and uniform slab stiffness, (n, 2, 2)."""
    model = PathModel(line, element=element, formulation=formulation, poisson=poisson)
    at_tips = model.converted_stiffness(_ELEMENT) if element == "quad8" else model.stiffness
    return model.tips, np.where(abs(at_tips) > _ROUNDING, at_tips, 0.0)  # none is coupled by symmetry
