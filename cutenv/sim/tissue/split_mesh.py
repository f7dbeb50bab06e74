"""Mesh of 8-node quadrilaterals that a crack passes, and its stiffness.

Nodes move onto the crack, cells split along it. Places are counted in half elements, (along, across), both even at a
corner and both odd at the middle of a cell, where there is a node only once the cell is split into two 6-node
triangles. Moved nodes, split cells and jumps behind the tip change the stiffness.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import lu_factor, lu_solve
from scipy.sparse import coo_array

from cutenv._base.arrays import Array, Indices
from cutenv.sim.tissue.elasticity import element_stiffness, local_compliance, square_compliance
from cutenv.sim.tissue.lines import CutLine
from cutenv.sim.tissue.mesh import ELEMENT_KINDS, CutMesh
from cutenv.sim.tissue.path_model import PathMesh
from cutenv.sim.tissue.tip_response import sparse_factors

MeshPlace = tuple[int, int]  # place of a node in half elements, along and across

AROUND: tuple[MeshPlace, ...] = ((2, 0), (2, 2), (2, -2), (0, 2), (0, -2), (-2, 2), (-2, -2), (-2, 0))
"""Steps to the eight corners around a corner."""
_QUAD: tuple[MeshPlace, ...] = ((0, 0), (2, 0), (2, 2), (0, 2), (1, 0), (2, 1), (1, 2), (0, 1))
_SAME = 1e-11  # [m]


class Part(NamedTuple):
    """Places of a finite element's nodes, in the order of its shape functions."""

    places: tuple[MeshPlace, ...]

    @property
    def corners(self) -> tuple[MeshPlace, ...]:
        """Places of its corners, counter-clockwise."""
        return self.places[: len(self.places) // 2]


class SplitMesh:
    """Rows of quadrilaterals, some of them split into triangles.

    ``corners``, (n_along + 1, n_across + 1, 2), are along the slab and across it to the left [m]; ``positions`` are
    those of all places, (2 n_along + 1, 2 n_across + 1, 2).
    """

    def __init__(self, corners: Array) -> None:
        n_along, n_across = corners.shape[0] - 1, corners.shape[1] - 1
        self.cells: MeshPlace = (n_along, n_across)
        self.positions: Array = np.zeros((2 * n_along + 1, 2 * n_across + 1, 2))
        self.positions[::2, ::2] = corners
        self.positions[1::2, ::2] = 0.5 * (corners[1:] + corners[:-1])
        self.positions[::2, 1::2] = 0.5 * (corners[:, 1:] + corners[:, :-1])
        self.split: dict[MeshPlace, tuple[Part, Part]] = {}
        self.moved: set[MeshPlace] = set()  # cells that no longer have their first shape

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
        """Return a cell's elements: itself, or its two triangles."""
        return self.split.get(cell) or (whole(cell),)

    def cells_at(self, place: MeshPlace) -> list[MeshPlace]:
        """Return the cells that touch a place: one, two or four."""
        a, b = place
        rows = {(a - 1) // 2, a // 2}
        columns = {(b - 1) // 2, b // 2}
        return [(i, j) for i in sorted(rows) for j in sorted(columns) if self._is_cell(i, j)]

    def move(self, corner: MeshPlace, to: Array) -> None:
        """Move a corner [m] and the mid-side nodes of its edges."""
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
        """Split a cell between two opposite corners into triangles; return it."""
        cell = (min(one[0], other[0]) // 2, min(one[1], other[1]) // 2)
        self.split[cell] = _triangles(one, other)
        self.moved.add(cell)
        self._place_middle(cell)
        return cell

    def thinnest_after(self, corner: MeshPlace, to: Array, crossed_from: MeshPlace | None = None) -> float:
        """Return twice the least element area after moving ``corner`` over ``crossed_from``'s cell [m2]."""
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
        """Return the direction between places [rad], to the slab axis's left."""
        return math.atan2(*(self.at(other) - self.at(one))[::-1])

    def is_clamped(self, place: MeshPlace) -> bool:
        """Return whether a place lies on the clamp."""
        return place[0] == 0

    def on_edge(self, corner: MeshPlace) -> bool:
        """Return whether a corner lies on the slab's outline."""
        return any(corner[axis] in (0, 2 * self.cells[axis]) for axis in (0, 1))

    def leaves_edge(self, corner: MeshPlace, to: Array) -> bool:
        """Return True if a corner would leave the slab's outline."""
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
    """Return all cells' node places, (n_cells, 8, 2), first index slowest."""
    first = np.indices(cells).reshape(2, -1).T[:, np.newaxis]
    return 2 * first + np.array(_QUAD)  # type: ignore[no-any-return]


def slab_corners(divisions: tuple[int, int], size: tuple[float, float], line: CutLine | None) -> Array:
    """Return mesh corners, (along + 1, across + 1, 2) [m].

    Across is to the left.  With a ``line`` the mesh follows it, as that of :class:`~cutenv.sim.tissue.PathModel`;
    without, it is a straight cut's.
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
    """Return the triangles of a cell split between opposite corners."""
    a, b = min(one[0], other[0]), min(one[1], other[1])
    if (other[0] - one[0]) * (other[1] - one[1]) > 0:
        first, second = ((0, 0), (2, 0), (2, 2)), ((0, 0), (2, 2), (0, 2))
    else:
        first, second = ((2, 0), (2, 2), (0, 2)), ((2, 0), (0, 2), (0, 0))
    return _triangle([(a + i, b + j) for i, j in first]), _triangle([(a + i, b + j) for i, j in second])


def _triangle(corners: list[MeshPlace]) -> Part:
    a, b, c = corners
    return Part((a, b, c, halfway(a, b), halfway(b, c), halfway(a, c)))


SAME_PLACE = 1e-9  # largest distance between places that are the same, in elements
_THINNEST = 0.1  # of a cell: an element that would become smaller at a corner is no way for the crack
_ON_THE_WAY = 0.3  # of an element: a node that is nearer to the tip is no next one


class Crack:
    """The crack that grows, among earlier ones, in a mesh of elements of a size [m].

    ``corners`` are those that it has passed, the last of them the tip, ``angles`` its direction at each [rad], to the
    left of the slab's axis.
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
        """Place of the tip; raises ValueError if no cut has begun."""
        if not self.corners:
            raise ValueError("The model has no cut yet: begin one.")
        return self.corners[-1]

    @property
    def angle(self) -> float:
        """Direction at the tip [rad], leftward; raises as :attr:`tip`."""
        _ = self.tip
        return self.angles[-1]

    @property
    def last_chord(self) -> float:
        """Direction from the last corner but one to the tip [rad]."""
        return self.mesh.direction(self.corners[-2], self.tip)

    def is_used(self, corner: MeshPlace) -> bool:
        """Return True if any crack has passed a corner."""
        return corner in self._used

    def restart(self) -> None:
        """Assign all corners to earlier cracks, and begin another."""
        self.corners, self.angles = [], []

    def take(self, corner: MeshPlace, angle: float) -> None:
        """Make a corner the tip, with its direction [rad]."""
        self.corners.append(corner)
        self.angles.append(angle)
        self._used.add(corner)

    def is_reached(self, distance: float) -> bool:
        """Return True if ``distance`` from the tip [m] allows no corner."""
        return distance < _ON_THE_WAY * self.element

    def can_move(self, corner: MeshPlace, to: Array) -> bool:
        """Return True if a corner can move to a point [m] without thin elements."""
        if self.mesh.leaves_edge(corner, to):
            return False
        start = self.corners[-1] if self.corners else corner
        crossed = start if corner[0] != start[0] and corner[1] != start[1] else None
        return self.mesh.thinnest_after(corner, to, crossed) > _THINNEST * self.element**2

    def nearest(self, to: Callable[[MeshPlace], Array | None]) -> tuple[MeshPlace, Array] | None:
        """Return the least-moved corner to become next, with its target by ``to`` [m]."""
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
        """Return next corner and target [m]; ValueError at a cut or side."""
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


_CAPACITY = 256  # local unknowns by which the matrices grow
_NEW = -1


class SparseFactors:
    """Factorisation of a positive definite matrix, shared by copies, made anew when unpickled."""

    def __init__(self, matrix: Any) -> None:
        self._matrix = matrix
        self.solve: Callable[[Array], Array] = sparse_factors(matrix).solve

    def __deepcopy__(self, memo: dict[int, Any]) -> SparseFactors:
        return self

    def __reduce__(self) -> tuple[type[SparseFactors], tuple[Any]]:
        return SparseFactors, (self._matrix,)


class AugmentedSystem:
    """Sparse system with small changes, solved by its first factorisation.

    The matrix A is factorised once.  What changes, D, touches some of its unknowns, and brings new ones of its own; the
    touched and the new ones are the local unknowns w.  Under loads f on them

        (I + G D) w = G f,      G: the part of A^-1 that belongs to w; a new unknown has only its row of D w = f.

    G grows by a solve for every touched unknown.  This is the Schur complement of the augmented matrices of Yeung,
    Crouch and Pothen (2016, arXiv:1603.04479); it is dense and solved directly, as a cut through a plane model touches
    hundreds of unknowns, where theirs touches thousands and iterates.
    """

    def __init__(self, factors: SparseFactors, n: int) -> None:
        self._factors, self._n = factors, n
        self._G, self._D, self._H = (np.zeros((_CAPACITY, _CAPACITY)) for _ in range(3))  # H = G D
        self._place: Indices = np.full(n, _NEW)
        self._numbers: list[int] = []
        self._solved: tuple[Array, NDArray[np.int32]] | None = None

    def __len__(self) -> int:
        return len(self._numbers)

    def copy(self) -> AugmentedSystem:
        """Return an independent copy that shares the factorisation."""
        other = object.__new__(AugmentedSystem)
        other._factors, other._n, other._solved = self._factors, self._n, self._solved
        other._G, other._D, other._H = (_enlarged(m, len(self)) for m in (self._G, self._D, self._H))
        other._place, other._numbers = self._place.copy(), list(self._numbers)
        return other

    def local(self, number: int) -> int:
        """Return a touched unknown's index among the local ones."""
        return int(self._place[number])

    def add_unknown(self, number: int = _NEW) -> int:
        """Return the place of a new local unknown."""
        n = len(self)
        if n == len(self._G):
            self._G, self._D, self._H = (_enlarged(m, n) for m in (self._G, self._D, self._H))
        self._numbers.append(number)
        if number == _NEW:
            self._G[n, n] = 1.0
        return n

    def touch(self, numbers: Sequence[int]) -> None:
        """Make matrix unknowns local; negative numbers are skipped."""
        new = [number for number in dict.fromkeys(numbers) if number >= 0 and self._place[number] < 0]
        if not new:
            return
        first = len(self)
        for number in new:
            self._place[number] = self.add_unknown(number)
        loads = np.zeros((self._n, len(new)))
        loads[new, np.arange(len(new))] = 1.0
        known = self._known
        columns = self._factors.solve(loads)[np.array(self._numbers)[known]]
        n = len(self)
        self._G[known, first:n] = columns
        self._G[first:n, known] = columns.T
        self._H[first:n, :n] = self._G[first:n, :n] @ self._D[:n, :n]
        self._solved = None

    def change(self, unknowns: Indices, by: Array) -> None:
        """Add ``by``, (k, k), to k local unknowns' entries."""
        n = len(self)
        self._D[np.ix_(unknowns, unknowns)] += by
        self._H[:n, unknowns] += self._G[:n, unknowns] @ by
        self._solved = None

    def solve(self, loads: Array) -> Array:
        """Return local unknowns under local loads, both (n_local, k)."""
        n = len(self)
        if self._solved is None or len(self._solved[0]) != n:
            matrix = self._H[:n, :n].copy()
            known = self._known
            matrix[known, known] += 1.0
            self._solved = lu_factor(matrix, overwrite_a=True, check_finite=False)
        answer: Array = lu_solve(self._solved, self._G[:n, :n] @ loads, check_finite=False)
        return answer

    def spread(self, local: Array, loads: Array) -> Array:
        """Return all unknowns, (n,), from local ones and loads, (n_local,)."""
        n, known = len(self), self._known
        push = loads - self._D[:n, :n] @ local
        whole = np.zeros(self._n)
        whole[np.array(self._numbers)[known]] = push[known]
        answer: Array = self._factors.solve(whole)
        return answer

    @property
    def _known(self) -> Indices:
        """Places of the local unknowns that the matrix has."""
        return np.flatnonzero(np.array(self._numbers) >= 0)


def _enlarged(matrix: Array, used: int) -> Array:
    larger = np.zeros((used + _CAPACITY, used + _CAPACITY))
    larger[:used, :used] = matrix[:used, :used]
    return larger


class DoubledMesh(NamedTuple):
    """Slab with its cuts, along and to the left, for any finite-element program."""

    nodes: Array  # [m], shape (n, 2)
    quadrilaterals: Indices
    """Nodes of the 8-node elements: corners counter-clockwise, then the middles of the edges from each, (m, 8)."""
    triangles: Indices
    """Nodes of the 6-node elements: corners, then the middles of the edges 1-2, 2-3, 1-3, shape (k, 6)."""
    pairs: Indices  # nodes on the left and the right face of a cut behind its tip, shape (p, 2)
    directions: Array  # direction in which either pair may slide, shape (p, 2)
    clamped: Indices  # nodes that do not move
    tip: int  # node that the blade pulls at


class SplitStiffness:
    """Stiffness of a slab clamped at x = 0, factorised once.

    Each doubled node has a jump: by half of it either face moves along the crack, the left one back and the right one
    forth; faces that open have a second one, across.  ``mesh`` has no cut yet; ``modulus`` is that of its cells over a
    common one, (n_along, n_across), and ``lame`` the Lame parameters of unit Young's modulus.
    """

    def __init__(self, mesh: SplitMesh, modulus: Array, lame: tuple[float, float], *, opens: bool) -> None:
        self._mesh, self._modulus, self._lame, self._opens = mesh, modulus, lame, opens
        cells = cell_places(mesh.cells)
        a, b = cells[..., 0], cells[..., 1]
        self._whole: Array = modulus.reshape(-1, 1, 1) * element_stiffness(mesh.positions[a, b], *lame)
        free = np.zeros(mesh.positions.shape[:2], dtype=bool)
        free[a, b] = True
        free[0] = False  # clamped
        n = int(2 * free.sum())
        self._number: Indices = np.full((*free.shape, 2), -1)
        self._number[free] = np.arange(n).reshape(-1, 2)
        unknowns = self._number[a, b].reshape(len(cells), -1)
        rows, columns = np.broadcast_arrays(unknowns[:, :, np.newaxis], unknowns[:, np.newaxis, :])
        kept = (rows >= 0) & (columns >= 0)
        matrix = coo_array((self._whole[kept], (rows[kept], columns[kept])), shape=(n, n))
        self.system = AugmentedSystem(SparseFactors(matrix.tocsc()), n)
        self._shares: dict[MeshPlace, tuple[Indices, Array]] = {}
        self._middles: dict[MeshPlace, tuple[int, int]] = {}
        self._jumps: dict[MeshPlace, tuple[tuple[int, Array], ...]] = {}
        self._sides: dict[tuple[Part, MeshPlace], float] = {}

    def copy(self, mesh: SplitMesh) -> SplitStiffness:
        """Return a copy for a copied mesh, sharing the factorisation."""
        other = copy.copy(self)
        other._mesh, other.system = mesh, self.system.copy()
        other._shares, other._middles = dict(self._shares), dict(self._middles)
        other._jumps, other._sides = dict(self._jumps), dict(self._sides)
        return other

    def touched(self, place: MeshPlace) -> list[int]:
        """Return a node's local unknowns, created on first use."""
        numbers = self._number[place].tolist()
        self.system.touch(numbers)
        return [self.system.local(number) for number in numbers if number >= 0]

    def split(self, one: MeshPlace, other: MeshPlace) -> None:
        """Split the cell between opposite corners; its middle becomes a node."""
        cell = self._mesh.split_cell(one, other)
        sides = [(place, self._sides.get((whole(cell), place))) for place in whole(cell).places]
        self._sides.update({(part, place): side for part in self._mesh.parts(cell) for place, side in sides if side})
        self._middles[cell] = (self.system.add_unknown(), self.system.add_unknown())

    def double(self, place: MeshPlace, angle: float, before: MeshPlace | None, after: MeshPlace) -> None:
        """Give a node at ``angle`` [rad] jumps, and its elements sides.

        ``before`` and ``after`` are the corners between which it lies on the crack; none before it: it lies on an edge.
        """
        along = np.array([math.cos(angle), math.sin(angle)])
        directions = [along, np.array([-along[1], along[0]])] if self._opens else [along]
        self._jumps[place] = tuple((self.system.add_unknown(), direction) for direction in directions)
        at = self._mesh.at(place)
        ahead = self._mesh.at(after) - at
        back = self._mesh.at(before) - at if before is not None else -ahead
        for cell in self._mesh.cells_at(place):
            for part in self._mesh.parts(cell):
                if place in part.places:
                    centre = np.mean([self._mesh.at(corner) for corner in part.corners], axis=0) - at
                    self._sides[part, place] = -0.5 if _turn(ahead, centre) < _turn(ahead, back) else 0.5

    def renew(self, cells: Sequence[MeshPlace]) -> None:
        """Update cells' contributions to their shape, parts and jumps."""
        self.system.touch([n for cell in cells for p in whole(cell).places for n in self._number[p].tolist()])
        for cell in cells:
            unknowns, share = self._share(cell)
            if cell in self._shares:
                old, before = self._shares[cell]
                self.system.change(old, -before)
            self.system.change(unknowns, share)
            self._shares[cell] = unknowns, share

    def local_excess(self, tip: MeshPlace, size: float, element: float) -> Array:
        """Return elements' compliance at a tip beyond squares', (2, 2).

        At the free end, where there are none around it, that is the excess of squares of the size ``element``.
        """
        mesh, (a, b) = self._mesh, tip
        square = square_compliance(size, *self._lame) * np.eye(2)
        if a == 2 * mesh.cells[0]:
            local = square_compliance(element, *self._lame) * np.eye(2)
        else:
            rows, columns = range(a // 2 - 2, a // 2 + 2), range(b // 2 - 2, b // 2 + 2)
            around = [(i, j) for i in rows for j in columns if 0 <= i < mesh.cells[0] and 0 <= j < mesh.cells[1]]
            parts = [part.places for cell in around for part in mesh.parts(cell)]
            local = local_compliance(parts, mesh.positions.__getitem__, tip, *self._lame)
        modulus = float(np.mean([self._modulus[cell] for cell in mesh.cells_at(tip)]))
        return (local - square) / modulus

    def loads(self, forces: ArrayLike) -> Array:
        """Return forces on places, like ``mesh.positions``, as local loads."""
        given = np.asarray(forces, dtype=float)
        given_at = [(int(a), int(b)) for a, b in np.argwhere(given.any(axis=2))]
        places = [place for place in given_at if not self._mesh.is_clamped(place)]
        unknowns = [self.touched(place) for place in places]
        load = np.zeros(len(self.system))
        for place, both in zip(places, unknowns, strict=True):
            load[both] = given[place]
        return load

    def push_faces(self, load: Array, place: MeshPlace, apart: Array) -> None:
        """Add opposite forces [N] on a doubled node's faces."""
        for unknown, direction in self._jumps.get(place, ()):
            load[unknown] -= float(apart @ direction)

    def motion(self, local: Array, load: Array) -> Array:
        """Return every place's motion from local unknowns and loads."""
        motion: Array = np.append(self.system.spread(local, load), 0.0)[self._number]
        for cell, unknowns in self._middles.items():
            motion[2 * cell[0] + 1, 2 * cell[1] + 1] = local[list(unknowns)]
        return motion

    def doubled_mesh(self, tip: MeshPlace) -> DoubledMesh:
        """Return the mesh with a node per face of cuts."""
        number: dict[tuple[MeshPlace, float], int] = {}
        positions: list[Array] = []
        elements: dict[int, list[list[int]]] = {8: [], 6: []}
        for cell in np.ndindex(self._mesh.cells):
            for part in self._mesh.parts((cell[0], cell[1])):
                nodes = []
                for place in part.places:
                    key = place, self._sides.get((part, place), 0.0)
                    if key not in number:
                        number[key] = len(positions)
                        positions.append(self._mesh.at(place))
                    nodes.append(number[key])
                elements[len(nodes)].append(nodes)
        jumps = sorted(self._jumps)
        return DoubledMesh(
            np.array(positions), np.array(elements[8]), np.array(elements[6], dtype=np.int64).reshape(-1, 6),
            np.array([(number[place, -0.5], number[place, 0.5]) for place in jumps]).reshape(-1, 2),
            np.array([self._jumps[place][0][1] for place in jumps]).reshape(-1, 2),
            np.array([n for (place, _), n in number.items() if place[0] == 0]), number[tip, 0.0],
        )  # fmt: skip

    def outlines(self, motion: Array, local: Array, opening: float, tip: Array) -> list[Array]:
        """Return displaced outlines [m], faces ``opening`` apart, less near the ``tip``."""
        found = []
        for cell in np.ndindex(self._mesh.cells):
            for part in self._mesh.parts((cell[0], cell[1])):
                corners = []
                for place in part.corners:
                    at = self._mesh.at(place) + motion[place]
                    side = self._sides.get((part, place), 0.0)
                    for unknown, (x, y) in self._jumps[place] if side else ():
                        gap = opening * math.sqrt(min(math.dist(self._mesh.at(place), tip) / 0.02, 1.0))
                        at = at + side * (local[unknown] * np.array([x, y]) + gap * np.array([y, -x]))
                    corners.append(at)
                found.append(np.array(corners))
        return found

    def _share(self, cell: MeshPlace) -> tuple[Indices, Array]:
        """Return a cell's local unknowns and the change of its stiffness."""
        first = self._whole[cell[0] * self._mesh.cells[1] + cell[1]]
        columns: dict[int, int] = {}
        terms = [(self._moves(whole(cell), columns, plain=True), -first)]
        for part in self._mesh.parts(cell):
            stiffness = first
            if cell in self._mesh.moved:
                positions = np.array([self._mesh.at(place) for place in part.places])[np.newaxis]
                stiffness = self._modulus[cell] * element_stiffness(positions, *self._lame)[0]
            terms.append((self._moves(part, columns), stiffness))
        n = len(columns)
        total = np.zeros((n, n))
        for moves, stiffness in terms:
            motion = np.zeros((len(stiffness), n))
            for row, column, weight in moves:
                motion[row, column] += weight
            total += motion.T @ stiffness @ motion
        return np.fromiter(columns, dtype=np.int64, count=n), 0.5 * (total + total.T)

    def _moves(self, part: Part, columns: dict[int, int], *, plain: bool = False) -> list[tuple[int, int, float]]:
        """Return the map from local unknowns to a part's motion."""
        moves = []
        for k, place in enumerate(part.places):
            if place[0] % 2 and place[1] % 2:
                unknowns: Sequence[int] = self._middles[place[0] // 2, place[1] // 2]
            else:
                unknowns = [self.system.local(n) if n >= 0 else -1 for n in self._number[place].tolist()]
            for axis, unknown in enumerate(unknowns):
                if unknown >= 0:
                    moves.append((2 * k + axis, columns.setdefault(unknown, len(columns)), 1.0))
            side = 0.0 if plain else self._sides.get((part, place), 0.0)
            for unknown, direction in self._jumps[place] if side else ():
                column = columns.setdefault(unknown, len(columns))
                moves += [(2 * k + axis, column, side * float(direction[axis])) for axis in (0, 1)]
        return moves


def _turn(start: Array, end: Array) -> float:
    """Return the left turn between directions [rad], 0 to 2 pi."""
    return math.atan2(start[0] * end[1] - start[1] * end[0], float(start @ end)) % (2.0 * math.pi)
