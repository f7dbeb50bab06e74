"""A crack in a mesh whose nodes move onto it: the corners that it has passed, and those that it can pass next."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from cutenv._base.arrays import Array
from cutenv.tissue.split_mesh import AROUND, MeshPlace, SplitMesh, halfway

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
