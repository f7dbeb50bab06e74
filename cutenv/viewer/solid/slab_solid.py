"""Specimen as a solid: the finite-element lattice extruded to the depth of cut, displaced instant by instant.

The solid has points of its own, and surfaces with such points as vertices: an upper and a lower lattice, the rim, the
two faces of the cut, lines between elements, and the target's sheet. The field is plane, so a point's height is
constant. The opening of the cut is an illustration, added to the field across the specimen; its front leans as the
blade does.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from cutenv._base.arrays import Array, Indices
from cutenv._base.validation import one_of
from cutenv.viewer.drawn_slab import Slab
from cutenv.viewer.solid.cut_plane import BOTTOM, plane_rows
from cutenv.viewer.solid.shown_cut import COLOURINGS, ShownCut
from cutenv.viewer.solid.solids import grid_faces

SUBDIVISIONS = (2, 8)
"""Cells for one element, across and along: the drawn tip of the cut is off by one cell at most, 1.25 mm."""
SHEET_HEIGHT = 0.012
"""Height of the target's sheet above the tissue [m]."""
_AVERAGED = 0.002  # [m] to either side, over which the recorded depth is averaged
_UP, _DOWN = 0, 1


@dataclass(frozen=True, kw_only=True, eq=False)
class Skin:
    """Surface or lines of the solid: its vertices as numbers of points, and 3 or 2 vertices for each part."""

    points: Indices
    parts: Indices


class SlabSolid:
    """Specimen of a shown cut, as a solid.

    Parameters
    ----------
    cut : ShownCut

    Attributes
    ----------
    rest : ndarray of shape (n_points, 3)
        Points without load: across from the cut line, along from the clamp, up from the plane to which a blade at
        height 0 cuts [m].
    bottom : float
        Height of the lower face [m].
    """

    def __init__(self, cut: ShownCut) -> None:
        self.cut = cut
        self.slab = Slab(cut.model, SUBDIVISIONS)
        flat = self.slab.rest
        top = self._height(flat[..., 1])
        self.bottom = 0.0 if cut.height is None else BOTTOM
        lower = np.full_like(top, self.bottom)
        layers = [np.concatenate([flat, z[..., None]], axis=-1).reshape(-1, 3) for z in (top, lower)]
        self.n_lattice = len(layers[0])
        if cut.target is not None:
            layers += self._sheet(cut.target)
        self._n_sheet = sum(len(each) for each in layers) - 2 * self.n_lattice
        if cut.height is not None:
            layers += list(plane_rows(cut, flat[0, -1, :, 1], top[0, -1]))
        self.rest: Array = np.concatenate(layers)
        # Point of each place of a layer, (layer, side, across, along), and of the rows of the cut's plane.
        self._number = np.arange(2 * self.n_lattice).reshape(2, *flat.shape[:-1])
        self._rows = np.arange(2 * self.n_lattice + self._n_sheet, len(self.rest)).reshape(-1, flat.shape[2])

    def _height(self, along: Array) -> Array:
        window = np.linspace(-_AVERAGED, _AVERAGED, 17)
        return np.asarray(self.cut.depth.at(along[..., None] + window).mean(axis=-1))

    def _sheet(self, target: float) -> list[Array]:
        line = self.slab.line_across(np.zeros_like(self.slab.rest), target)
        top = float(self._height(np.array(target))) + SHEET_HEIGHT
        return [np.column_stack([line, np.full(len(line), z)]) for z in (top, 0.0)]

    @cached_property
    def lattices(self) -> dict[str, Skin]:
        """Return the upper and lower face, and the rim between them."""
        _, sides, across, along = self._number.shape
        faces = {}
        for name, layer in (("top", _UP), ("bottom", _DOWN)):
            parts = [grid_faces(across, along) + side * across * along for side in range(sides)]
            faces[name] = Skin(points=self._number[layer].ravel(), parts=np.concatenate(parts))
        n = self._number
        # The doubled line occurs twice in the closed rim: the two copies of its ends coincide.
        walls = [n[:, 0, 0, :], n[:, 0, :, -1], n[:, 0, :, 0], n[:, 1, -1, :], n[:, 1, :, -1], n[:, 1, :, 0]]
        faces["rim"] = _walls(walls)
        return faces

    @cached_property
    def cut_faces(self) -> Skin:
        """Return both sides of the cut line, with the parts in order from the clamp on; with height the far one."""
        n = self._number
        if self.cut.height is None:
            return self._in_order([n[:, 0, -1, :], n[:, 1, 0, :]])
        return self._in_order([np.stack([n[_UP, 0, -1], self._rows[0]])])

    @cached_property
    def plane(self) -> dict[str, Skin]:
        """Return the plane of the cut, by name; empty for a record without height.

        That is the near face of the cut, tissue below the floor and ahead of the tip, layer and wanted depth.  Parts of
        the first three are as many and in the same order as those of :attr:`cut_faces`.
        """
        if self.cut.height is None:
            return {}
        upper, lower = self._number[:, 0, -1, :]
        floor, layer, below, wanted, under = self._rows
        skins = {
            "near": self._in_order([np.stack([self._number[_UP, 1, 0], floor])]),
            "below": self._in_order([np.stack([floor, lower])]),
            "ahead": self._in_order([np.stack([upper, lower])]),
        }
        if self.cut.layer is not None:
            skins["layer"] = _walls([np.stack([layer, below])])
        if self.cut.wanted is not None:
            skins["wanted"] = _walls([np.stack([wanted, under])])
        return skins

    def _in_order(self, rows: list[Indices]) -> Skin:
        walls = _walls(rows)
        begin = self.rest[walls.points[walls.parts], 1].min(axis=1)
        return Skin(points=walls.points, parts=walls.parts[np.argsort(begin, kind="stable")])

    def cut_parts(self, i: int) -> int:
        """Return the number of parts of :attr:`cut_faces` that are cut at an instant; none ahead of the tip."""
        faces = self.cut_faces
        begin = self.rest[faces.points[faces.parts], 1].min(axis=1)
        return int(np.count_nonzero(begin < self.cut.tip[i] - 1e-9))

    @cached_property
    def lines(self) -> Skin:
        """Return the lines between elements in the upper face."""
        top, (i, j) = self._number[_UP], SUBDIVISIONS
        pairs = []
        for side in top:  # the far half first
            along, across = side[::i, :], side[:, ::j]
            pairs += [np.stack([along[:, :-1], along[:, 1:]], axis=-1), np.stack([across[:-1], across[1:]], axis=-1)]
        return Skin(points=top.ravel(), parts=np.concatenate([each.reshape(-1, 2) for each in pairs]))

    @cached_property
    def sheet(self) -> Skin | None:
        """Return the target as a sheet across the tissue that moves with it; None without a target."""
        if self._n_sheet == 0:
            return None
        points = 2 * self.n_lattice + np.arange(self._n_sheet)
        return Skin(points=points, parts=grid_faces(2, self._n_sheet // 2))

    def displacement(self, i: int) -> Array:
        """Return the points' displacement at an instant, cut open, (across, along) [m], shape (n_points, 2)."""
        field = self.slab.on_lattice(self.cut.field(i)[:, :2])
        places = self.slab.rest + field
        layers = [(self.slab.opened(places, tip) - self.slab.rest).reshape(-1, 2) for tip in self.front(i)]
        if self.cut.target is not None:
            line = self.slab.line_across(field, self.cut.target)
            rest = self.slab.line_across(np.zeros_like(field), self.cut.target)
            layers += [line - rest] * 2
        layers += [field[0, -1]] * len(self._rows)
        return np.concatenate(layers)

    def front(self, i: int) -> tuple[float, float]:
        """Return the end of the cut in the upper and the lower face of the tissue at rest [m]; with height 0 below."""
        tip = float(self.cut.tip[i])
        if self.cut.height is not None:
            return tip, 0.0
        reach = float(self._height(np.array(tip))) / math.tan(float(self.cut.angle[i]))
        return tip, float(np.clip(tip - reach, 0.0, self.cut.model.length))

    def amount(self, i: int, colour: str) -> Array:
        """Return the quantity that colours the tissue at an instant, at the upper lattice, shape (n_lattice,).

        Parameters
        ----------
        i : int
            Instant.
        colour : {"displacement", "energy"}
            Displacement of the field [m], without the opening; or strain energy density [J/m3], averaged over the
            elements that meet at a node, separately on each side of the cut.
        """
        one_of("colour", colour, COLOURINGS)
        field = self.cut.field(i)
        if colour == "displacement":
            on_lattice = self.slab.on_lattice(field[:, :2])
            return np.asarray(np.hypot(on_lattice[..., 0], on_lattice[..., 1])).ravel()
        model = self.cut.model
        density = model.strain_energy_density(field, self.cut.modulus)
        total, count = np.zeros(model.n_nodes), np.zeros(model.n_nodes)
        np.add.at(total, model.elements, density[:, None])
        np.add.at(count, model.elements, 1.0)
        corners = total / np.maximum(count, 1.0)  # a mid-side node is not a corner of any element
        return self.slab.on_lattice(corners[:, None]).ravel()


def _walls(rows: list[Indices]) -> Skin:
    """Return walls between the upper and the lower row of points in each of ``rows``, shape (2, n)."""
    parts, start = [], 0
    for row in rows:
        parts.append(grid_faces(*row.shape) + start)
        start += row.size
    return Skin(points=np.concatenate([row.ravel() for row in rows]), parts=np.concatenate(parts))
