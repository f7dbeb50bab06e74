"""Finite-element model of a slab whose nodes follow any cut."""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from cutenv._base.arrays import Array
from cutenv._base.validation import in_range, one_of
from cutenv.sim.tissue.continuum import METRES, checked_relative_modulus
from cutenv.sim.tissue.elasticity import lame_parameters
from cutenv.sim.tissue.grid import LENGTH
from cutenv.sim.tissue.lines import WIDTH, CutLine
from cutenv.sim.tissue.mesh import checked_divisions
from cutenv.sim.tissue.split_mesh import (
    SAME_PLACE,
    Crack,
    DoubledMesh,
    MeshPlace,
    SplitMesh,
    SplitStiffness,
    halfway,
    slab_corners,
)


class SteeredModel:
    """Plane model of a clamped slab with steered, growing cuts.

    It is clamped at x = 0.  Places are (x, y): along the slab from the clamp, and across it to the left of its axis
    [m].  A crack goes from corner to corner of the mesh; the next corner moves onto it, and a cell that it crosses is
    split.  Pairs of nodes behind the tip slide along the crack, and neither open nor overlap.  The blade acts on the
    tip.

    A cut that follows the edges of the mesh has the stiffness of :class:`~cutenv.sim.tissue.CutModel`, and along the
    line of ``line`` that of :class:`~cutenv.sim.tissue.PathModel`, on the same mesh.  The slab is factorised once; each
    node that a crack passes takes some solves and a dense system of the unknowns that the cuts have touched, see
    `cutenv.sim.tissue.split_mesh.AugmentedSystem`.

    Parameters
    ----------
    divisions : tuple of int
        Elements across (even) and along the slab.
    width, length : float
        Size of the slab [m], 1 mm to 5 m.
    formulation : {"plane_stress", "plane_strain"}
    poisson : float
        Poisson's ratio [1], 0 to 0.499.
    relative_modulus : array, shape (n_elements,), optional
        Modulus of each element over the common one, in the order of ``CutModel.element_centres``.
    line : CutLine, optional
        Line that the mesh follows, as that of `PathModel`, in a slab of the usual size.
    faces : {"slide", "open"}
        Whether the faces of a cut only slide along it, or move freely.

    Raises
    ------
    ValueError
        If an argument is out of range.

    Attributes
    ----------
    mesh : SplitMesh
        Places, and cells that are split.

    Examples
    --------
    >>> model = SteeredModel()
    >>> model.begin()
    >>> model.cut_to((0.05, 0.0))
    10
    >>> round(float(model.stiffness[0, 0]), 3)
    0.61
    """

    def __init__(
        self,
        divisions: Sequence[int] = (16, 30),
        *,
        width: float = WIDTH,
        length: float = LENGTH,
        formulation: str = "plane_stress",
        poisson: float = 0.3,
        relative_modulus: ArrayLike | None = None,
        line: CutLine | None = None,
        faces: str = "slide",
    ) -> None:
        one_of("formulation", formulation, ("plane_stress", "plane_strain"))
        one_of("faces", faces, ("slide", "open"))
        across, along = checked_divisions("quad8", tuple(divisions))
        size = in_range("width", width, 1e-3, 5.0, "m", METRES), in_range("length", length, 1e-3, 5.0, "m", METRES)
        if line is not None and size != (WIDTH, LENGTH):
            raise ValueError(f"line goes with a slab of {WIDTH:g} x {LENGTH:g} m: leave out width and length.")
        self._lame = lame_parameters(formulation, poisson)
        self.mesh = SplitMesh(slab_corners((across, along), size, line))
        self._element = min(size[0] / across, size[1] / along)
        modulus = np.ones(across * along)
        if relative_modulus is not None:
            modulus = checked_relative_modulus(np.asarray(relative_modulus), across * along)
        self._modulus: Array = modulus.reshape(across, along)[::-1].T
        self._body = SplitStiffness(self.mesh, self._modulus, self._lame, opens=faces == "open")
        self._crack = Crack(self.mesh, self._element)

    def copy(self) -> SteeredModel:
        """Return an independent copy that shares the factorisation."""
        other = copy.copy(self)
        other.mesh = self.mesh.copy()
        other._body = self._body.copy(other.mesh)
        other._crack = self._crack.copy(other.mesh)
        return other

    @property
    def path(self) -> Array:
        """Nodes of the growing cut to its tip [m], (n, 2)."""
        return np.array([self.mesh.at(place) for place in self._crack.corners]).reshape(-1, 2)

    @property
    def tip(self) -> Array:
        """Position of the tip [m], shape (2,)."""
        return self.mesh.at(self._crack.tip).copy()

    @property
    def angle(self) -> float:
        """Crack direction from the slab's axis [rad], positive to the left."""
        return self._crack.angle

    @property
    def n_touched(self) -> int:
        """Number of unknowns that the cuts have touched or added."""
        return len(self._body.system)

    def begin(self, at: ArrayLike = (0.0, 0.0), angle: float = 0.0) -> None:
        """Begin a cut at the nearest corner, moving it there.

        It is at a place on the clamp, on another edge, or within the slab [m], and begins at an angle to the left of
        the axis [rad]. A beginning within the slab is a second tip, which stays where it is.  ValueError if it is
        outside the slab, or there is a cut.
        """
        to = _checked_point(at)
        where = f"({to[0]:g}, {to[1]:g}) m"
        gaps = np.hypot(*np.moveaxis(self.mesh.positions[::2, ::2] - to, -1, 0))
        i, j = np.unravel_index(int(np.argmin(gaps)), gaps.shape)
        corner, far = (2 * int(i), 2 * int(j)), float(gaps[i, j])
        if self._crack.is_used(corner):
            raise ValueError(f"A cut cannot begin at {where}: there is one already.")
        if far > SAME_PLACE * self._element:
            if not self._crack.can_move(corner, to):
                raise ValueError(f"A cut cannot begin at {where}: that is outside the slab, or nearly on its edge.")
            self.mesh.move(corner, to)
            self._body.renew(self.mesh.cells_at(corner))
        self._crack.restart()
        self._take(corner, angle)

    def cut_to(self, point: ArrayLike, angle: float | None = None) -> int:
        """Lead the crack towards a point [m]; return the nodes passed.

        The tip stays behind the point by less than two elements.  ``angle`` is the direction of the crack there [rad];
        by default that from node to node.  ValueError, which names the place, if the crack would meet a cut or come too
        near to a side.
        """
        aim = _checked_point(point)
        passed = 0
        while True:
            way = aim - self.tip
            left = float(np.hypot(*way))
            if self._crack.is_reached(left):
                return passed
            corner, to = self._crack.next_corner(way / left)
            if float(np.hypot(*(to - self.tip))) > left + SAME_PLACE * self._element:
                return passed
            self._grow(corner, to, angle)
            passed += 1

    def go_straight_on(self) -> None:
        """Lead the crack to the next node in its direction."""
        self._grow(*self._crack.next_corner(np.array([math.cos(self.angle), math.sin(self.angle)])), self.angle)

    def advance(self, point: ArrayLike, angle: float | None = None, angle_between: float | None = None) -> None:
        """Grow the crack by one node, which moves to a point [m].

        It is about an element away.  ``angle`` and ``angle_between`` are the directions of the crack there, and
        half-way [rad]; by default that from node to node.  ValueError if no node of the mesh can move there.
        """
        to = _checked_point(point)
        nearest = self._crack.nearest(lambda corner: to)
        if nearest is None:
            raise ValueError(
                f"No node can move to ({to[0]:g}, {to[1]:g}) m from the tip at ({self.tip[0]:g}, {self.tip[1]:g}) m: "
                f"advance by about an element, {1e3 * self._element:g} mm."
            )
        self._grow(nearest[0], to, angle, angle_between)

    @property
    def compliance(self) -> Array:
        """Tip compliance times modulus and thickness in x, y, (2, 2)."""
        unknowns = self._tip_unknowns()
        load = np.zeros((len(self._body.system), 2))
        load[unknowns, [0, 1]] = 1.0
        return self._body.system.solve(load)[unknowns]

    @property
    def stiffness(self) -> Array:
        """Tip stiffness over modulus and thickness [1], (2, 2).

        Along the crack and to its left.
        """
        return self._along_and_left(self.compliance)

    def converted_stiffness(self, element: float) -> Array:
        """Return the stiffness with square elements of a size [m] at the tip.

        Nodes that moved onto the crack, and triangles, make elements of other sizes and shapes at every tip, which a
        point force feels; see :mod:`cutenv.sim.tissue.elasticity`.
        """
        size = in_range("element", element, 1e-4, 1.0, "m", METRES)
        excess = self._body.local_excess(self._crack.tip, size, self._element)
        return self._along_and_left(self.compliance - excess)

    def displacement(self, force: ArrayLike) -> Array:
        """Return places' displacement times modulus and thickness [N].

        ``force``, (2,), is along the slab and to its left [N]; the result is as ``mesh.positions``, on a cut the mean
        of both faces.
        """
        load = np.zeros(len(self._body.system))
        load[self._tip_unknowns()] = np.asarray(force, dtype=float)
        return self._body.motion(self._body.system.solve(load[:, np.newaxis])[:, 0], load)

    def pushed(self, forces: ArrayLike | None = None, pressure: float = 0.0) -> float:
        """Return twice the stored energy, times modulus [N2].

        ``forces`` are on every place, as ``mesh.positions``, at unit thickness [N]; ``pressure`` is on both faces of
        the cut that grows, for a model whose faces open [N/m2].
        """
        load = self._body.loads(np.zeros_like(self.mesh.positions) if forces is None else forces)
        for one, other in zip(self._crack.corners, self._crack.corners[1:], strict=False):
            ahead = self.mesh.at(other) - self.mesh.at(one)
            left = pressure * np.array([-ahead[1], ahead[0]])
            for place, share in ((one, 1.0 / 6.0), (halfway(one, other), 4.0 / 6.0), (other, 1.0 / 6.0)):
                self._body.push_faces(load, place, share * left)
        return float(load @ self._body.system.solve(load[:, np.newaxis])[:, 0])

    def outlines(self, force: ArrayLike = (0.0, 0.0), opening: float = 0.0) -> list[Array]:
        """Return displaced element outlines, each (3 or 4, 2) [m].

        ``force``, (2,), is along the slab and to its left, over modulus and thickness [m]; ``opening`` the distance by
        which the faces of cuts are drawn apart, far from the tip [m].
        """
        load = np.zeros(len(self._body.system))
        load[self._tip_unknowns()] = np.asarray(force, dtype=float)
        local = self._body.system.solve(load[:, np.newaxis])[:, 0]
        return self._body.outlines(self._body.motion(local, load), local, opening, self.tip)

    def doubled_mesh(self) -> DoubledMesh:
        """Return the mesh with doubled cut nodes for another program."""
        return self._body.doubled_mesh(self._crack.tip)

    def _along_and_left(self, compliance: Array) -> Array:
        """Return the stiffness in the frame of the crack's direction."""
        c, s = math.cos(self.angle), math.sin(self.angle)
        frame = np.array([[c, -s], [s, c]])
        return np.asarray(np.linalg.inv(frame.T @ compliance @ frame), dtype=np.float64)

    def _tip_unknowns(self) -> list[int]:
        if self.mesh.is_clamped(self._crack.tip):
            raise ValueError("The cut has not left the clamp: lead it on.")
        return self._body.touched(self._crack.tip)

    def _take(self, corner: MeshPlace, angle: float) -> None:
        self._crack.take(corner, angle)
        self._body.touched(corner)

    def _grow(self, corner: MeshPlace, to: Array, angle: float | None, angle_between: float | None = None) -> None:
        """Move a corner to the tip, split the cell, double nodes."""
        last, mesh = self._crack.tip, self.mesh
        middle = halfway(last, corner)
        if corner[0] != last[0] and corner[1] != last[1]:
            self._body.split(last, corner)
        mesh.move(corner, to)
        chord = mesh.direction(last, corner)
        self._body.double(middle, chord if angle_between is None else angle_between, last, corner)
        if len(self._crack.corners) > 1:
            own = self._crack.angles[-1] if angle is not None else _mean_angle(self._crack.last_chord, chord)
            self._body.double(last, own, self._crack.corners[-2], corner)
        elif not self.mesh.is_clamped(last) and mesh.on_edge(last):
            self._body.double(last, self._crack.angles[-1] if angle is not None else chord, None, corner)
        self._take(corner, chord if angle is None else angle)
        self._body.renew(sorted({cell for place in (last, middle, corner) for cell in mesh.cells_at(place)}))


def _mean_angle(one: float, other: float) -> float:
    return math.atan2(math.sin(one) + math.sin(other), math.cos(one) + math.cos(other))


def _checked_point(point: ArrayLike) -> Array:
    given = np.asarray(point, dtype=float)
    if given.shape != (2,) or not np.isfinite(given).all():
        raise ValueError(f"point = {point!r}: give two finite numbers, along and across the slab [m].")
    return given
