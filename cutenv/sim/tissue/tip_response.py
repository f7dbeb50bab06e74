"""Displacement under a unit blade force at each tip.

It is from one factorisation of the tied specimen, and interpolated between tips.

The blade stands on the tip pair, which is still tied, and pushes along the line, away from the clamp. Tying
every pair gives the matrix A; one sparse factorisation of it and one solve per tip node serve all tips. On a
mirror-symmetric specimen this is the complete solution: load and faces lie on the mirror line, the faces carry no
shear, and untying them changes nothing.

Otherwise the pairs behind the tip slip. With the slips s as further unknowns, in order from the clamp,

    [A    B] [q]   [f]
    [B^T  C] [s] = [0],      S = C - B^T A^-1 B = L L^T,

a tip frees the first n of them, so that the leading n x n block of S, and with it the leading block of the
one Cholesky factor L, serves that tip. Where the rows from n on are zeros, L^-1 and L^-T act like the leading
block's inverses: no tip needs a separate solve.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.interpolate import PchipInterpolator
from scipy.linalg import cholesky, solve_triangular
from scipy.sparse import csr_array
from scipy.sparse.linalg import SuperLU, splu

from cutenv._base.arrays import Array, Indices
from cutenv.sim.tissue.elasticity import elastic_form, mixed_stiffness, solid_stiffness
from cutenv.sim.tissue.mesh import ALONG, CutMesh


@dataclass(frozen=True, kw_only=True, eq=False)
class TipResponse:
    """Response to a unit blade force, for every tip."""

    stiffness: Array  # blade force over displacement of the tip, (n_tips,)
    fields: Array  # displacement of every node, (n_tips, n_nodes, dim)


def stiffness_matrix(
    mesh: CutMesh, formulation: str, poisson: float, relative_modulus: Array | None = None
) -> csr_array[np.float64]:
    """Assemble the unconstrained halves' stiffness at unit modulus.

    In 2-D, at unit thickness, it is a pure number, in 3-D in metres.  For a mixed element it is the indefinite matrix
    of displacements and pressures, in plane strain.  ``relative_modulus`` is that of each element over the common one.
    """
    modulus = np.ones(len(mesh.elements)) if relative_modulus is None else relative_modulus
    if mesh.kind.has_pressure:
        return mixed_stiffness(mesh.basis, mesh.pressure_basis, poisson, modulus)
    if formulation == "solid":
        return solid_stiffness(mesh.basis.with_element(mesh.kind.element()), poisson, modulus)
    return csr_array(elastic_form(formulation, poisson, modulus).assemble(mesh.basis))


def factorise(
    stiffness: csr_array[np.float64], constraints: csr_array[np.float64], *, definite: bool = True
) -> SuperLU:
    """Factorise the stiffness of the free unknowns.

    If it is positive definite, minimum degree ordering on the symmetric pattern without pivoting takes about half
    the time of the default ordering; the matrix of a mixed element is not, and is pivoted.
    """
    constrained = (constraints.T @ stiffness @ constraints).tocsc()
    return sparse_factors(constrained) if definite else splu(constrained)


def sparse_factors(matrix: Any) -> SuperLU:
    """Factorise a positive definite sparse matrix, in columns."""
    return splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})


def blade_unknowns(mesh: CutMesh, constraints: csr_array[np.float64]) -> Indices:
    """Return free unknowns the blade moves, shape (n_tips, n_through)."""
    rows = mesh.dim * mesh.tip_pairs[..., 0] + ALONG  # a tied pair is one unknown: the left node is enough
    return constraints.indices[constraints.indptr[rows]].astype(np.int64)  # the one entry of each row


def tip_responses(mesh: CutMesh, stiffness: csr_array[np.float64], *, slipping: bool) -> TipResponse:
    """Solve for all tips with one factorisation.

    ``stiffness`` is that of the unconstrained halves, see :func:`stiffness_matrix`.  On a mirror-symmetric specimen the
    result without ``slipping`` behind the tip is the same, at a fraction of the effort.
    """
    tied = mesh.constraints()
    factors = factorise(stiffness, tied, definite=not mesh.kind.has_pressure)
    n_free = tied.shape[1]
    blade = blade_unknowns(mesh, tied)
    n_tips, n_through = blade.shape

    loads = np.zeros((n_free, blade.size))
    loads[blade.ravel(), np.arange(blade.size)] = 1.0
    per_node_force = factors.solve(loads).reshape(n_free, n_tips, n_through)
    compliance = per_node_force[blade, np.arange(n_tips)[:, np.newaxis]]  # (n_tips, n_through, n_through)
    if slipping:
        forces = stiffness @ mesh.slips
        b = tied.T @ forces
        coupled = factors.solve(b.toarray())  # A^-1 B
        factor = cholesky((mesh.slips.T @ forces).toarray() - b.T @ coupled, lower=True)  # L
        driven = solve_triangular(factor, coupled[blade.ravel()].T, lower=True)  # L^-1 B^T A^-1 f
        driven = driven.reshape(-1, n_tips, n_through) * mesh.slips_behind[:, :, np.newaxis]
        compliance = compliance + np.einsum("stm,stn->tmn", driven, driven)

    # All tip nodes move equally; their forces add up to the blade's.
    node_forces = np.linalg.solve(compliance, np.ones((n_tips, n_through, 1)))[:, :, 0]
    tip_stiffness = node_forces.sum(axis=1)
    shares = node_forces / tip_stiffness[:, np.newaxis]
    free = np.einsum("ftm,tm->ft", per_node_force, shares)  # q
    displacement = tied @ free
    if slipping:
        slips = -solve_triangular(factor, np.einsum("stm,tm->st", driven, shares), lower=True, trans="T")  # s
        displacement += mesh.slips @ slips - tied @ (coupled @ slips)
    fields = np.ascontiguousarray(displacement[: mesh.nodes.size].T).reshape(n_tips, *mesh.nodes.shape)
    return TipResponse(stiffness=tip_stiffness, fields=fields)


@dataclass(frozen=True, kw_only=True, eq=False)
class TipInterpolation:
    """Interpolation of stiffness and displacement over cut length.

    Mid-side nodes are not used as tips: their response to a point load is different.  ``tips`` are the cut lengths at
    which a tip stands on element corners [m], ``response`` that to a unit blade force there.
    """

    mesh: CutMesh
    tips: Array
    response: TipResponse

    @cached_property
    def _curve(self) -> PchipInterpolator:
        return PchipInterpolator(self.tips, self.response.stiffness)

    def stiffness(self, cut_length: Array) -> Array:
        """Interpolate by PCHIP, constant below the first corner."""
        return np.asarray(self._curve(np.maximum(cut_length, self.tips[0])), dtype=np.float64)

    def shape(self, cut_length: float) -> Array:
        """Return nodes' displacement per tip displacement, (n_nodes, dim).

        The fields per unit force for a tip on the corners to either side are blended linearly, and scaled so
        that the point at the cut length, on the straight line between these corners, moves by one.
        """
        shape, first, w = self._blended(cut_length)
        at_corners = shape[self.mesh.tip_pairs[first : first + 2], ALONG].mean(axis=(1, 2))
        shape /= (1.0 - w) * at_corners[0] + w * at_corners[1]
        return shape

    def shared(self, cut_length: float) -> Array:
        """Return nodes' displacement per force shared between corners, (n_nodes, dim).

        From the second row of elements around the tip on it is the displacement by a force between them. Below the
        first corner the clamp takes the rest.
        """
        blended: Array = self._blended(cut_length)[0] * min(cut_length / self.tips[0], 1.0)
        return blended

    def _blended(self, cut_length: float) -> tuple[Array, int, float]:
        """Return the blended field, the first one, and the second's weight."""
        place = max(cut_length / self.tips[0] - 1.0, 0.0)  # in elements, from the first tip
        first = min(int(place), len(self.tips) - 2)
        w = place - first
        fields = self.response.fields
        blend: Array = (1.0 - w) * fields[first] + w * fields[first + 1]
        # The mid-side pair between the corners slips behind the farther tip; ahead of this one it is tied.
        ahead = self.mesh.pairs[self.mesh.nodes[self.mesh.pairs[:, 0], ALONG] >= cut_length]
        blend[ahead, ALONG] = blend[ahead, ALONG].mean(axis=1, keepdims=True)
        return blend, first, w
