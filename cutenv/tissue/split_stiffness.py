"""Stiffness of a mesh that a crack passes: what moved nodes, split cells and jumps behind the tip change in it."""

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
from cutenv.tissue.elasticity import element_stiffness, local_compliance, square_compliance
from cutenv.tissue.split_mesh import MeshPlace, Part, SplitMesh, cell_places, whole
from cutenv.tissue.tip_response import sparse_factors

_CAPACITY = 256  # local unknowns by which the matrices grow
_NEW = -1


class SparseFactors:
    """Factorisation of a positive definite sparse matrix; copies share it, and unpickled it is made anew."""

    def __init__(self, matrix: Any) -> None:
        self._matrix = matrix
        self.solve: Callable[[Array], Array] = sparse_factors(matrix).solve

    def __deepcopy__(self, memo: dict[int, Any]) -> SparseFactors:
        return self

    def __reduce__(self) -> tuple[type[SparseFactors], tuple[Any]]:
        return SparseFactors, (self._matrix,)


class AugmentedSystem:
    """Sparse system whose matrix changes little by little, solved by its first factorisation.

    The matrix A is factorised once.  What changes, D, touches some of its unknowns, and brings new ones of its own; the
    touched and the new ones are the local unknowns w.  Under loads f on them

        (I + G D) w = G f,      G: the part of A^-1 that belongs to w; a new unknown has only its row of D w = f.

    G grows by a solve for every touched unknown.  This is the Schur complement of the augmented matrices of Yeung,
    Crouch and Pothen (2016, arXiv:1603.04479); it is dense and solved directly, as a cut through a plane model touches
    hundreds of unknowns, where theirs touches thousands and iterates.

    Parameters
    ----------
    factors : SparseFactors
        Factorisation of the matrix, of size ``n``.
    n : int
        Number of its unknowns.
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
        """Return the place of a touched unknown of the matrix among the local ones."""
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
        """Bring unknowns of the matrix among the local ones; negative numbers are passed over."""
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
        """Add a matrix ``by``, shape (k, k), to the entries of k local unknowns."""
        n = len(self)
        self._D[np.ix_(unknowns, unknowns)] += by
        self._H[:n, unknowns] += self._G[:n, unknowns] @ by
        self._solved = None

    def solve(self, loads: Array) -> Array:
        """Return the local unknowns under loads on them, both of shape (n_local, k)."""
        n = len(self)
        if self._solved is None or len(self._solved[0]) != n:
            matrix = self._H[:n, :n].copy()
            known = self._known
            matrix[known, known] += 1.0
            self._solved = lu_factor(matrix, overwrite_a=True, check_finite=False)
        answer: Array = lu_solve(self._solved, self._G[:n, :n] @ loads, check_finite=False)
        return answer

    def spread(self, local: Array, loads: Array) -> Array:
        """Return all unknowns of the matrix, shape (n,), from the local ones and the loads on them, (n_local,)."""
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
    """A slab with its cuts, as any finite-element program takes it; places along the slab and to its left."""

    nodes: Array
    """[m], shape (n, 2)."""
    quadrilaterals: Indices
    """Nodes of the 8-node elements: corners counter-clockwise, then the middles of the edges from each, (m, 8)."""
    triangles: Indices
    """Nodes of the 6-node elements: corners, then the middles of the edges 1-2, 2-3, 1-3, shape (k, 6)."""
    pairs: Indices
    """Nodes on the left and the right face of a cut behind its tip, shape (p, 2)."""
    directions: Array
    """Direction in which either pair may slide, shape (p, 2)."""
    clamped: Indices
    """Nodes that do not move."""
    tip: int
    """Node that the blade pulls at."""


class SplitStiffness:
    """Stiffness of a slab clamped at x = 0, factorised once.

    Each doubled node has a jump: by half of it either face moves along the crack, the left one back and the right one
    forth; faces that open have a second one, across.

    Parameters
    ----------
    mesh : SplitMesh
        Mesh before any cut.
    modulus : array, shape (n_along, n_across)
        Relative modulus of the cells [1].
    lame : tuple of float
        Lame parameters of unit Young's modulus.
    opens : bool
        Whether the faces open.
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
        """Return an independent copy for a copy of the mesh; it shares the factorisation."""
        other = copy.copy(self)
        other._mesh, other.system = mesh, self.system.copy()
        other._shares, other._middles = dict(self._shares), dict(self._middles)
        other._jumps, other._sides = dict(self._jumps), dict(self._sides)
        return other

    def touched(self, place: MeshPlace) -> list[int]:
        """Return the local unknowns of a node, which it gets if it has none yet."""
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
        """Give a node of the crack, which runs there at an angle [rad], its jumps, and elements around it their sides.

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
        """Bring the shares of cells up to date with their shape, their parts and the jumps of their nodes."""
        self.system.touch([n for cell in cells for p in whole(cell).places for n in self._number[p].tolist()])
        for cell in cells:
            unknowns, share = self._share(cell)
            if cell in self._shares:
                old, before = self._shares[cell]
                self.system.change(old, -before)
            self.system.change(unknowns, share)
            self._shares[cell] = unknowns, share

    def local_excess(self, tip: MeshPlace, size: float, element: float) -> Array:
        """Return what the elements around a tip add to its compliance, beyond squares of a ``size`` [m], shape (2, 2).

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
        """Return forces on all places, shape of ``mesh.positions``, as loads on the local unknowns."""
        given = np.asarray(forces, dtype=float)
        given_at = [(int(a), int(b)) for a, b in np.argwhere(given.any(axis=2))]
        places = [place for place in given_at if not self._mesh.is_clamped(place)]
        unknowns = [self.touched(place) for place in places]
        load = np.zeros(len(self.system))
        for place, both in zip(places, unknowns, strict=True):
            load[both] = given[place]
        return load

    def push_faces(self, load: Array, place: MeshPlace, apart: Array) -> None:
        """Add to loads a force [N] on the left face of a doubled node, and its opposite on the right one."""
        for unknown, direction in self._jumps.get(place, ()):
            load[unknown] -= float(apart @ direction)

    def motion(self, local: Array, load: Array) -> Array:
        """Return the motion of every place, shape of ``mesh.positions``, from the local unknowns and their loads."""
        motion: Array = np.append(self.system.spread(local, load), 0.0)[self._number]
        for cell, unknowns in self._middles.items():
            motion[2 * cell[0] + 1, 2 * cell[1] + 1] = local[list(unknowns)]
        return motion

    def doubled_mesh(self, tip: MeshPlace) -> DoubledMesh:
        """Return the mesh with a node for each face of a cut."""
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
        """Return the outlines of all elements after a motion of the places and of the local unknowns [m].

        Faces of cuts are drawn ``opening`` [m] apart, less within 2 cm of the ``tip``.
        """
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
        """Return the local unknowns of a cell, and its stiffness in them less that of its first shape."""
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
        """Return which motion of a part depends on which column of the local unknowns, and how much."""
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
    """Return the angle from one direction to the left to another [rad], 0 to 2 pi."""
    return math.atan2(start[0] * end[1] - start[1] * end[0], float(start @ end)) % (2.0 * math.pi)
