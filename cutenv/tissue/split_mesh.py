"""Mesh of 8-node quadrilaterals that a crack passes: nodes move onto it, cells split along it; and the crack itself.

Places are counted in half elements, (along, across), both even at a corner and both odd at the middle of a cell, where
there is a node only once the cell is split into two 6-node triangles.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from cutenv._base.arrays import Array, Indices
from cutenv.tissue.lines import CutLine
from cutenv.tissue.mesh import ELEMENT_KINDS, CutMesh
from cutenv.tissue.path_model import PathMesh

MeshPlace = tuple[int, int]
"""MeshPlace of a node in half elements, along and across."""

AROUND: tuple[MeshPlace, ...] = ((2, 0), (2, 2), (2, -2), (0, 2), (0, -2), (-2, 2), (-2, -2), (-2, 0))
"""Steps to the eight corners around a corner."""
_QUAD: tuple[MeshPlace, ...] = ((0, 0), (2, 0), (2, 2), (0, 2), (1, 0), (2, 1), (1, 2), (0, 1))
_SAME = 1e-11  # [m]


class Part(NamedTuple):
    """A finite element: the places of its nodes, in the order of its shape functions."""

    places: tuple[MeshPlace, ...]

    @property
    def corners(self) -> tuple[MeshPlace, ...]:
        """Places of its corners, counter-clockwise."""
        return self.places[: len(self.places) // 2]


class SplitMesh:
    """Quadrilaterals in rows and columns, some of them split into triangles.

    Parameters
    ----------
    corners : array, shape (n_along + 1, n_across + 1, 2)
        Position of each corner, along the slab and across it to the left [m].

    Attributes
    ----------
    positions : array, shape (2 n_along + 1, 2 n_across + 1, 2)
        Of all places [m].
    """

    def __init__(self, corners: Array) -> None:
        n_along, n_across = corners.shape[0] - 1, corners.shape[1] - 1
        self.cells: MeshPlace = (n_along, n_across)
        self.positions: Array = np.zeros((2 * n_along + 1, 2 * n_across + 1, 2))
        self.positions[::2, ::2] = corners
        self.positions[1::2, ::2] = 0.5 * (corners[1:] + corners[:-1])
        self.positions[::2, 1::2] = 0.5 * (corners[:, 1:] + corners[:, :-1])
        self.split: dict[MeshPlace, tuple[Part, Part]] = {}
        self.moved: set[MeshPlace] = set()
        """Cells that no longer have their first shape."""

    def copy(self) -> SplitMesh:
        """Return an independent copy."""
        other = object.__new__(SplitMesh)
        other.cells, other.positions = self.cells, self.positions.copy()
        other.split, other.moved = dict(self.split), set(self.moved)
        return other

    def within(self, place: MeshPlace) -> bool:
        """Return whether there is such a place."""
        return 0 <= place[0] <= 2 * self.cells[0] and 0 <= place[1] <= 2 * self.cells[1]

    def at(self, place: MeshPlace) -> Array:
        """Return the position of a place [m], shape (2,)."""
        return self.positions[place]  # type: ignore[no-any-return]

    def parts(self, cell: MeshPlace) -> tuple[Part, ...]:
        """Return the elements of a cell: itself, or its two triangles."""
        return self.split.get(cell) or (whole(cell),)

    def cells_at(self, place: MeshPlace) -> list[MeshPlace]:
        """Return the cells that touch a place: four around a corner, two beside an edge, one around its middle."""
        a, b = place
        rows = {(a - 1) // 2, a // 2}
        columns = {(b - 1) // 2, b // 2}
        return [(i, j) for i in sorted(rows) for j in sorted(columns) if self._is_cell(i, j)]

    def move(self, corner: MeshPlace, to: Array) -> None:
        """Move a corner to a position [m]; the nodes in the middle of its edges follow."""
        if np.array_equal(self.positions[corner], to):
            return
        self.positions[corner] = to
        self.moved.update(self.cells_at(corner))
        for step in ((2, 0), (0, 2), (-2, 0), (0, -2)):
            other = corner[0] + step[0], corner[1] + step[1]
            if self.within(other):
                self.positions[halfway(corner, other)] = 0.5 * (self.positions[corner] + self.positions[other])
        for cell in self.cells_at(corner):
            self._place_middle(cell)

    def split_cell(self, one: MeshPlace, other: MeshPlace) -> MeshPlace:
        """Split the cell of which two corners are opposite into triangles; return it."""
        cell = (min(one[0], other[0]) // 2, min(one[1], other[1]) // 2)
        self.split[cell] = _triangles(one, other)
        self.moved.add(cell)
        self._place_middle(cell)
        return cell

    def thinnest_after(self, corner: MeshPlace, to: Array, crossed_from: MeshPlace | None = None) -> float:
        """Return the least of twice the area at a corner of the elements around ``corner`` if it moved ``to`` [m2].

        ``crossed_from``: opposite corner of the cell that would be split.
        """
        x, y = float(to[0]), float(to[1])
        least = math.inf
        for cell in self.cells_at(corner):
            parts = self.parts(cell)
            if crossed_from is not None and halfway(corner, crossed_from) == (2 * cell[0] + 1, 2 * cell[1] + 1):
                parts = _triangles(corner, crossed_from)
            for part in parts:
                p = [(x, y) if each == corner else tuple(self.positions[each].tolist()) for each in part.corners]
                for k in range(len(p)):
                    (x_0, y_0), (x_1, y_1), (x_2, y_2) = p[k - 2], p[k - 1], p[k]
                    least = min(least, (x_2 - x_1) * (y_0 - y_1) - (y_2 - y_1) * (x_0 - x_1))
        return least

    def direction(self, one: MeshPlace, other: MeshPlace) -> float:
        """Return the angle to the slab's axis of the way from a place to another [rad], positive to the left."""
        return math.atan2(*(self.at(other) - self.at(one))[::-1])

    def is_clamped(self, place: MeshPlace) -> bool:
        """Return whether a place lies on the clamp."""
        return place[0] == 0

    def on_edge(self, corner: MeshPlace) -> bool:
        """Return whether a corner lies on the slab's outline."""
        return any(corner[axis] in (0, 2 * self.cells[axis]) for axis in (0, 1))

    def leaves_edge(self, corner: MeshPlace, to: Array) -> bool:
        """Return whether a corner on the slab's outline would leave it."""
        gaps = abs(np.asarray(to) - self.positions[corner])
        return any(corner[axis] in (0, 2 * self.cells[axis]) and gaps[axis] > _SAME for axis in (0, 1))

    def _place_middle(self, cell: MeshPlace) -> None:
        if cell in self.split:
            first, second = self.split[cell][0].corners, self.split[cell][1].corners
            shared = [corner for corner in first if corner in second]
            self.positions[2 * cell[0] + 1, 2 * cell[1] + 1] = 0.5 * (self.at(shared[0]) + self.at(shared[1]))

    def _is_cell(self, i: int, j: int) -> bool:
        return 0 <= i < self.cells[0] and 0 <= j < self.cells[1]


def halfway(one: MeshPlace, other: MeshPlace) -> MeshPlace:
    """Return the place in the middle of two corners."""
    return (one[0] + other[0]) // 2, (one[1] + other[1]) // 2


def whole(cell: MeshPlace) -> Part:
    """Return the quadrilateral of a cell."""
    return Part(tuple((2 * cell[0] + a, 2 * cell[1] + b) for a, b in _QUAD))


def cell_places(cells: MeshPlace) -> Indices:
    """Return the places of the nodes of all cells, shape (n_cells, 8, 2), the first index varying slowest."""
    first = np.indices(cells).reshape(2, -1).T[:, np.newaxis]
    return 2 * first + np.array(_QUAD)  # type: ignore[no-any-return]


def slab_corners(divisions: tuple[int, int], size: tuple[float, float], line: CutLine | None) -> Array:
    """Return the corners of a slab's mesh along it and across it to the left, shape (along + 1, across + 1, 2) [m].

    With a ``line`` the mesh follows it, as that of :class:`~cutenv.tissue.PathModel`; without, it is a straight cut's.
    """
    kind = ELEMENT_KINDS["quad8"]
    mesh = (
        CutMesh(kind=kind, divisions=divisions, size=size)
        if line is None
        else PathMesh(kind=kind, divisions=divisions, size=size, drawn=line)
    )
    grid = mesh.corners.reshape(divisions[0] + 2, divisions[1] + 1, 2)
    single = np.delete(grid, mesh.line, axis=0)[::-1].swapaxes(0, 1)
    return np.stack((single[..., 1], -single[..., 0]), axis=-1)


def _triangles(one: MeshPlace, other: MeshPlace) -> tuple[Part, Part]:
    """Return the two halves of the cell of which two corners are opposite."""
    a, b = min(one[0], other[0]), min(one[1], other[1])
    if (other[0] - one[0]) * (other[1] - one[1]) > 0:
        first, second = ((0, 0), (2, 0), (2, 2)), ((0, 0), (2, 2), (0, 2))
    else:
        first, second = ((2, 0), (2, 2), (0, 2)), ((2, 0), (0, 2), (0, 0))
    return _triangle([(a + i, b + j) for i, j in first]), _triangle([(a + i, b + j) for i, j in second])


def _triangle(corners: list[MeshPlace]) -> Part:
    a, b, c = corners
    return Part((a, b, c, halfway(a, b), halfway(b, c), halfway(a, c)))


SAME_PLACE = 1e-9
"""Largest distance between places that are the same, in elements."""
_THINNEST = 0.1  # of a cell: an element that would become smaller at a corner is no way for the crack
_ON_THE_WAY = 0.3  # of an element: a node that is nearer to the tip is no next one


class Crack:
    """The crack that grows, among earlier ones.

    Parameters
    ----------
    mesh : SplitMesh
        Mesh that it passes.
    element : float
        Size of an element [m].

    Attributes
    ----------
    corners : list of tuple of int
        Corners that it has passed, the last of them the tip.
    angles : list of float
        Its direction at each [rad], to the left of the slab's axis.
    """

    def __init__(self, mesh: SplitMesh, element: float) -> None:
        self.mesh, self.element = mesh, element
        self.corners: list[MeshPlace] = []
        self.angles: list[float] = []
        self._used: set[MeshPlace] = set()

    def copy(self, mesh: SplitMesh) -> Crack:
        """Return an independent copy in a copy of the mesh."""
        other = Crack(mesh, self.element)
        other.corners, other.angles, other._used = list(self.corners), list(self.angles), set(self._used)
        return other

    @property
    def tip(self) -> MeshPlace:
        """Place of the tip.

        Raises
        ------
        ValueError
            If no cut has begun.
        """
        if not self.corners:
            raise ValueError("The model has no cut yet: begin one.")
        return self.corners[-1]

    @property
    def angle(self) -> float:
        """Direction at the tip [rad], to the left of the slab's axis; raises as :attr:`tip`."""
        _ = self.tip
        return self.angles[-1]

    @property
    def last_chord(self) -> float:
        """Direction from the last corner but one to the tip [rad]."""
        return self.mesh.direction(self.corners[-2], self.tip)

    def is_used(self, corner: MeshPlace) -> bool:
        """Return whether this crack or an earlier one has passed a corner."""
        return corner in self._used

    def restart(self) -> None:
        """Leave the corners to the earlier cracks, for another one to begin."""
        self.corners, self.angles = [], []

    def take(self, corner: MeshPlace, angle: float) -> None:
        """Make a corner the tip, with the crack's direction there [rad]."""
        self.corners.append(corner)
        self.angles.append(angle)
        self._used.add(corner)

    def is_reached(self, distance: float) -> bool:
        """Return whether a point at a distance from the tip [m] is too near for another corner."""
        return distance < _ON_THE_WAY * self.element

    def can_move(self, corner: MeshPlace, to: Array) -> bool:
        """Return whether a corner can move to a point [m]: on its edge, and with no element too thin."""
        if self.mesh.leaves_edge(corner, to):
            return False
        start = self.corners[-1] if self.corners else corner
        crossed = start if corner[0] != start[0] and corner[1] != start[1] else None
        return self.mesh.thinnest_after(corner, to, crossed) > _THINNEST * self.element**2

    def nearest(self, to: Callable[[MeshPlace], Array | None]) -> tuple[MeshPlace, Array] | None:
        """Return the corner around the tip that moves least to become the next, and where to, if there is one.

        Parameters
        ----------
        to : callable
            Gives the point to which a corner would move [m], or nothing if it is not on the way.
        """
        found = []
        for step in AROUND:
            corner = self.tip[0] + step[0], self.tip[1] + step[1]
            if not self.mesh.within(corner) or corner in self._used or self.mesh.is_clamped(corner):
                continue
            crosses = step[0] != 0 and step[1] != 0
            if crosses and tuple(n // 2 for n in halfway(self.tip, corner)) in self.mesh.split:
                continue
            point = to(corner)
            if point is not None and self.can_move(corner, point):
                found.append((math.dist(point, self.mesh.at(corner)), corner, (float(point[0]), float(point[1]))))
        if not found:
            return None
        _, corner, place = min(found)
        return corner, np.array(place)

    def next_corner(self, direction: Array) -> tuple[MeshPlace, Array]:
        """Return the corner that the crack passes next in a direction, and where it meets the way [m].

        Raises
        ------
        ValueError
            If a cut or a side is there.
        """
        tip, end = self.mesh.at(self.tip), float(self.mesh.positions[-1, 0, 0])

        def foot(corner: MeshPlace) -> Array | None:
            gap = self.mesh.at(corner) - tip
            along = float(gap @ direction)
            if corner[0] == 2 * self.mesh.cells[0]:  # a corner on the free end stays on it
                along = (end - tip[0]) / direction[0] if direction[0] > 0.0 else -1.0
            if self.is_reached(along):
                return None
            to: Array = tip + along * direction
            return self.mesh.at(corner) if math.dist(to, self.mesh.at(corner)) <= SAME_PLACE * self.element else to

        found = self.nearest(foot)
        if found is None:
            raise ValueError(f"The crack cannot go on from ({tip[0]:.4f}, {tip[1]:.4f}) m: a cut or a side is there.")
        return found
