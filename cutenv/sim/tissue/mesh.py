"""Mesh of the specimen with doubled nodes on cut lines.

These are the cut line, and the lines of earlier cuts.

Axes: x across the specimen (cut line at x = 0), y along it from the clamped edge at y = 0, z through the
thickness. The cut runs along the centre line, or beside it. Every node on that line exists twice, also the one at
the clamp. The two nodes of a pair are tied by constraints, see :meth:`CutMesh.constraints`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from skfem import Basis, MeshHex, MeshQuad
from skfem.element import Element, ElementHexS2, ElementQuad1, ElementQuadS2, ElementVector

from cutenv._base.arrays import Array, Indices

ACROSS, ALONG = 0, 1  # x and y; the components of a vector and the axes of an array shaped like ``divisions``

# Corners of an element as steps along x, y (and z): counter-clockwise, the lower face first (VTK's order).
_QUAD_CORNERS = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
_HEX_CORNERS = np.array([[*xy, z] for z in (0, 1) for xy in _QUAD_CORNERS])

Number = TypeVar("Number", bound=np.generic)


def read_only(array: NDArray[Number]) -> NDArray[Number]:
    """Make the array read-only and return it."""
    array.flags.writeable = False
    return array


@dataclass(frozen=True)
class ElementKind:
    """Properties of an element by name: type, quadrature, default mesh.

    ``quadrature_degree`` selects scikit-fem's full Gauss rule: 2 x 2, 3 x 3 and 3 x 3 x 3 points; with `reduced`
    integration one point fewer in each direction. `has_pressure`: an additional unknown on every corner.
    """

    element: type[Element]
    quadrature_degree: int
    divisions: tuple[int, ...]
    has_midside_nodes: bool
    has_pressure: bool = False

    @property
    def dim(self) -> int:
        """Number of space dimensions."""
        return len(self.divisions)

    def reduced(self) -> ElementKind:
        """Return the element with two Gauss points per axis.

        ValueError for a linear element, whose hourglass modes one point would not resist, and for a mixed one.
        """
        if not self.has_midside_nodes or self.has_pressure:
            raise ValueError('integration="reduced" goes with "quad8" and "hex20". Take one, or integration="full".')
        return replace(self, quadrature_degree=3)


# The divisions are the thesis's (sections 4.1 to 4.3): elements of 1 x 1 cm, bricks of 1 x 1 x 0.25 cm.
ELEMENT_KINDS = {
    "quad4": ElementKind(ElementQuad1, quadrature_degree=3, divisions=(8, 15), has_midside_nodes=False),
    "quad8": ElementKind(ElementQuadS2, quadrature_degree=5, divisions=(8, 15), has_midside_nodes=True),
    "quad8_mixed": ElementKind(
        ElementQuadS2, quadrature_degree=5, divisions=(8, 15), has_midside_nodes=True, has_pressure=True
    ),
    "hex20": ElementKind(ElementHexS2, quadrature_degree=5, divisions=(8, 15, 4), has_midside_nodes=True),
}


def checked_divisions(element: str, divisions: Sequence[int] | None) -> tuple[int, ...]:
    """Return a mesh's divisions, by default the thesis's.

    ValueError unless there are as many whole numbers as dimensions, the first even, and none too small.
    """
    usual = ELEMENT_KINDS[element].divisions
    if divisions is None:
        return usual
    counts = np.asarray(divisions)
    if counts.shape != (len(usual),) or not np.issubdtype(counts.dtype, np.integer):
        raise ValueError(f"divisions of {element} must be {len(usual)} whole numbers, got {divisions!r}. Try {usual}.")
    across, along, *through = (int(n) for n in counts)
    if across < 2 or across % 2:
        raise ValueError(
            f"divisions[0] = {across} must be even and at least 2: the cut line is the centre line and runs "
            f"along element edges. Take {max(across + across % 2, 2)}."
        )
    if along < 2 or min(through, default=1) < 1:
        raise ValueError(
            f"divisions = {divisions!r} must have at least 2 elements along the cut and 1 through the "
            f"thickness. Try {usual}."
        )
    return (across, along, *through)


@dataclass(frozen=True, kw_only=True, eq=False)
class CutMesh:
    """Nodes and elements of the specimen, with pairs of nodes across the cut.

    Unknowns are numbered node by node, ``dim * node + component``, as in scikit-fem: first the corners, then the
    mid-side nodes; the pressures of a mixed element, one per corner, come last.  ``divisions`` are elements across,
    along and, in 3-D, through the specimen, ``size`` the same in [m], ``shift`` the elements from the centre line to
    the cut line, towards +x, and ``earlier`` those from the cut line to each earlier cut, with its length in elements.
    """

    kind: ElementKind
    divisions: tuple[int, ...]
    size: tuple[float, ...]
    shift: int = 0
    earlier: tuple[tuple[int, int], ...] = ()

    @property
    def dim(self) -> int:
        """Number of space dimensions."""
        return len(self.divisions)

    @property
    def line(self) -> int:
        """Number of elements from the edge at -x to the cut."""
        return self.divisions[ACROSS] // 2 + self.shift

    @property
    def _lines(self) -> list[int]:
        """Numbers of elements from the -x edge to each doubled line."""
        return sorted([self.line, *(self.line + beside for beside, _ in self.earlier)])

    @cached_property
    def corners(self) -> Array:
        """Positions of the element corners [m], shape (n_corners, dim)."""
        axes = [np.linspace(0.0, size, n + 1) for size, n in zip(self.size, self.divisions, strict=True)]
        x = axes[ACROSS] - self.size[ACROSS] / 2 - self.shift * self.size[ACROSS] / self.divisions[ACROSS]
        x[self.line] = 0.0
        axes[ACROSS] = np.insert(x, self._lines, x[self._lines])  # these lines exist twice
        return read_only(np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, self.dim))

    @cached_property
    def elements(self) -> Indices:
        """Corner nodes of each element, shape (n_elements, 4 or 8).

        Counter-clockwise; in 3-D the lower face, then the upper one. Elements are in the order of
        ``numpy.ndindex(divisions)``: the index along x varies slowest.
        """
        cells = np.indices(self.divisions).reshape(self.dim, -1)
        cells[ACROSS] += np.searchsorted(self._lines, cells[ACROSS], side="right")  # over the second copy of each line
        steps = _QUAD_CORNERS if self.dim == 2 else _HEX_CORNERS
        grid = (self.divisions[ACROSS] + 1 + len(self._lines), *(n + 1 for n in self.divisions[1:]))
        corners = cells[:, :, np.newaxis] + steps.T[:, np.newaxis, :]
        elements: Indices = np.ravel_multi_index(tuple(corners), grid)
        return read_only(elements)

    @cached_property
    def skfem_mesh(self) -> MeshQuad | MeshHex:
        """Equivalent scikit-fem mesh, with edges along the line doubled."""
        if self.dim == 2:
            return MeshQuad(np.ascontiguousarray(self.corners.T), np.ascontiguousarray(self.elements.T))
        # scikit-fem numbers a brick's corners as those of its unit mesh.
        order = [np.flatnonzero((corner == _HEX_CORNERS).all(axis=1))[0] for corner in MeshHex().p.T]
        return MeshHex(np.ascontiguousarray(self.corners.T), np.ascontiguousarray(self.elements[:, order].T))

    @cached_property
    def basis(self) -> Basis:
        """scikit-fem basis of vector elements with the kind's Gauss integration."""
        element = ElementVector(self.kind.element())
        return Basis(self.skfem_mesh, element, intorder=self.kind.quadrature_degree)

    @cached_property
    def pressure_basis(self) -> Basis:
        """scikit-fem basis of continuous bilinear pressure for a mixed element."""
        return self.basis.with_element(ElementQuad1())

    @property
    def n_unknowns(self) -> int:
        """Number of displacements and pressures."""
        return self.nodes.size + (len(self.corners) if self.kind.has_pressure else 0)

    @cached_property
    def nodes(self) -> Array:
        """Positions of all nodes [m], shape (n_nodes, dim)."""
        if not self.kind.has_midside_nodes:
            return self.corners
        mesh = self.skfem_mesh
        edges = mesh.facets if self.dim == 2 else mesh.edges
        return read_only(np.vstack([self.corners, self.corners[edges].mean(axis=0)]))

    def interpolated(self, field: Array, points: Array) -> Array:
        """Interpolate nodal values, (n_nodes, n), at points [m], (n_points, dim).

        A point on a line of doubled nodes belongs to the right face.
        """
        step = np.array(self.size) / np.array(self.divisions)
        places = points / step
        places[:, ACROSS] += self.line
        # Twelve digits: a point on an edge is the same point after rounding.
        cells = np.clip(np.floor(np.round(places, 12)).astype(np.int64), 0, np.array(self.divisions) - 1)
        number = np.ravel_multi_index(tuple(cells.T), self.divisions)
        local = (places - cells).T if self.dim == 2 else 1.0 - (places - cells).T  # scikit-fem's brick is upside down
        found = np.zeros((len(points), field.shape[1]))
        for k, nodes in enumerate(self.element_nodes[:, number]):
            found += self.basis.elem.elem.lbasis(local, k)[0][:, np.newaxis] * field[nodes]
        return found

    @cached_property
    def element_nodes(self) -> Indices:
        """Elements' nodes in shape function order, shape (n_local, n_elements)."""
        return read_only(self.basis.element_dofs[:: self.dim] // self.dim)

    @cached_property
    def half_steps(self) -> Indices:
        """Nodes' positions in half elements, shape (n_nodes, dim)."""
        step = np.array(self.size) / np.array(self.divisions) / 2
        return read_only(np.rint(self.nodes / step).astype(np.int64))

    @cached_property
    def pairs(self) -> Indices:
        """Facing nodes, (left, right), from clamp to free end, (n_pairs, 2)."""
        return self._pairs_beside(0)

    def _pairs_beside(self, beside: int) -> Indices:
        """Return the facing nodes of a parallel line, as in `pairs`."""
        on_line = np.flatnonzero(self.half_steps[:, ACROSS] == 2 * beside)
        from_the_clamp = on_line[np.lexsort(self.half_steps[on_line, ALONG:].T[::-1])]
        # Elements are numbered from -x to +x: those on the left come first.
        left = (self.line + beside) * (len(self.elements) // self.divisions[ACROSS])
        is_left = np.isin(from_the_clamp, self.basis.element_dofs[:, :left] // self.dim)
        return read_only(np.column_stack([from_the_clamp[is_left], from_the_clamp[~is_left]]))

    @cached_property
    def _pair_half_steps(self) -> Indices:
        """Pairs' positions along the line in half elements, shape (n_pairs,)."""
        along: Indices = self.half_steps[self.pairs[:, 0], ALONG]
        return along

    @cached_property
    def tip_pairs(self) -> Indices:
        """Pairs at each tip, (left, right), shape (n_tips, n_through, 2).

        A tip stands on the corners of the elements. In 3-D the mid-side nodes between these corners through
        the thickness belong to it as well.
        """
        along = self._pair_half_steps
        at_corners: Indices = self.pairs[(along > 0) & (along % 2 == 0)]
        return at_corners.reshape(self.divisions[ALONG], -1, 2)

    @cached_property
    def slips(self) -> csr_array[np.float64]:
        """Unknowns' motion per unit slip of pairs, shape (n_unknowns, n_slips).

        Pairs from the clamp (without it) to the last tip (without it). A slip moves the right face along +y by half
        of it and the left one along -y by half, so that on a mirror-symmetric specimen it does not couple to the
        load.
        """
        left, right = self.pairs[self._may_slip].T
        rows = self.dim * np.concatenate([left, right]) + ALONG
        columns = np.tile(np.arange(left.size), 2)
        halves = np.repeat([-0.5, 0.5], left.size)
        return csr_array((halves, (rows, columns)), shape=(self.n_unknowns, left.size))

    @cached_property
    def slips_behind(self) -> NDArray[np.bool_]:
        """Mask of slips strictly behind each tip, shape (n_slips, n_tips)."""
        tips = np.arange(1, self.divisions[ALONG] + 1)
        behind: NDArray[np.bool_] = self._pair_half_steps[self._may_slip, np.newaxis] < 2 * tips
        return read_only(behind)

    @cached_property
    def _may_slip(self) -> NDArray[np.bool_]:
        """Mask of pairs between clamp and free end, shape (n_pairs,)."""
        along = self._pair_half_steps
        return (along > 0) & (along < 2 * self.divisions[ALONG])

    def constraints(self, tip: int = -1) -> csr_array[np.float64]:
        """Return the motion of every unknown per free one, under constraints.

        Nodes on the clamped edge do not move. A tied pair shares all components of its displacement. A pair strictly
        behind the tip slips along the line and shares the rest: across it, so that the faces neither open nor overlap,
        and in 3-D through the thickness, since the faces may slide along the line but not leave it. The same holds for
        the faces of earlier cuts behind where these ended.  Tips are counted from 0 at the first corner from the clamp;
        -1 ties every pair, the number of tips unties every pair.
        """
        unknown = np.arange(self.nodes.size).reshape(-1, self.dim)
        follows = unknown.copy()
        for beside, cut in ((0, tip + 1), *self.earlier):
            left, right = self._pairs_beside(beside).T
            slips = self.half_steps[left, ALONG] < 2 * cut
            if beside and cut == self.divisions[ALONG]:
                slips[:] = True  # an earlier cut through the free end
            follows[right] = unknown[left]
            follows[right[slips], ALONG] = unknown[right[slips], ALONG]
        clamped = self.half_steps[:, ALONG] == 0
        pressures = np.arange(unknown.size, self.n_unknowns)
        rows = np.concatenate([unknown[~clamped].ravel(), pressures])
        leaders, columns = np.unique(np.concatenate([follows[~clamped].ravel(), pressures]), return_inverse=True)
        return csr_array((np.ones(rows.size), (rows, columns)), shape=(self.n_unknowns, leaders.size))
