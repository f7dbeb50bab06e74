"""Recorded cut as solids of triangles: specimen, plane, blade, handle.

The recorded cut is shown at evenly spaced instants: blade, force, tip and elastic field. The solids are the specimen,
the plane of a cut, and a No. 10 blade in a No. 3 handle in the tissue.

Outline and pose of the blade are those of the scene (`cutenv.display.viewer.scene_parts`); x runs through its
thickness.

The specimen is the finite-element lattice extruded to the depth of cut, displaced instant by instant. It has points of
its own, and surfaces with such points as vertices: an upper and a lower lattice, the rim, the two faces of the cut,
lines between elements, and the target's sheet. The field is plane, so a point's height is constant. The opening of the
cut is an illustration, added to the field across the specimen; its front leans as the blade does.

The plane of a cut along which the blade also moves up and down has floor of the cut, wanted depth, layer below. It is
seen where the near half of the specimen is taken off. Its rows of points run along the cut line and move with the
finite-element field; the open cut, an illustration, closes toward its floor.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from cutenv._base.arrays import Array, Indices
from cutenv._base.validation import in_range, one_of
from cutenv.display.viewer.drawn_slab import Slab
from cutenv.display.viewer.scene import derived_quantities
from cutenv.display.viewer.scene_parts import (
    BELOW,
    BLADE_LENGTH,
    CHORD,
    EDGE_END,
    HANDLE_START,
    HANDLE_WIDTHS,
    NARROWED,
    blade_edge,
)
from cutenv.records.measurement import DepthProfile
from cutenv.records.measurement.depth import LAYER_DEPTH_KEY, WANTED_DEPTH_KEY, wanted_depth
from cutenv.records.scoring.scored_cut import ScoredCut
from cutenv.sim.tissue import CutModel
from cutenv.sim.tissue.grid import SPACING
from cutenv.sim.trace import Trace

COLOURINGS = ("displacement", "energy")
"""Quantities that the tissue's colour can show."""
INSTANTS = 160
"""Number of instants shown of a record; a page grows with it."""

_FLATTEST = math.radians(10.0)  # least angle of a blade that can be drawn
_CURE = (
    "A cut is drawn where the blade was: give the columns, or what was constant, as in "
    "--map time=t force=Fx position=x[mm] angle=90deg depth=20mm --unit N."
)


@dataclass(frozen=True, kw_only=True, eq=False)
class ShownCut:
    """Cut at the instants that are shown.

    SI and radians, arrays of shape (n,).

    Attributes
    ----------
    name : str
        Name of the record.
    time : ndarray
        Time since the record's first instant [s].
    force, position, speed, angle : ndarray
        Recorded force [N], position [m], speed [m/s] and angle [rad].
    tip : ndarray
        Position of the crack tip, in tissue at rest [m]; estimated, 0 to the specimen's length.
    shift : ndarray
        Distance by which the elastic force carries the tip along the line [m].
    depth : DepthProfile
        Depth of cut by position.
    modulus : float
        Local effective modulus from which tip and field are computed [Pa].
    tip_source : str
        "return stroke" or "estimated".
    angle_known : bool
        True if the record holds the angle; otherwise the blade is drawn upright.
    target : float or None
        Target length, from the clamp [m].
    model : CutModel
        Finite-element model whose field displaces the tissue.
    whole_time, whole_force : ndarray of shape (m,)
        The record's own instants [s] and force [N].
    height : ndarray or None
        Height of the blade's lower end [m]; 0 cuts as deep as ``depth``.  None if the record does not hold it.
    floor, wanted : DepthProfile or None
        Depth of the floor of the cut below the surface as it is at the end, and the wanted depth, by position; None
        where there is no height, or no wanted depth.
    layer : float or None
        Depth below the surface at which another layer begins [m].
    """

    name: str
    time: Array
    force: Array
    position: Array
    speed: Array
    angle: Array
    tip: Array
    shift: Array
    depth: DepthProfile
    modulus: float
    tip_source: str
    angle_known: bool
    target: float | None
    model: CutModel
    whole_time: Array
    whole_force: Array
    height: Array | None = None
    floor: DepthProfile | None = None
    wanted: DepthProfile | None = None
    layer: float | None = None

    @classmethod
    def of(cls, trace: Trace, *, target: float | None = None, instants: int = INSTANTS) -> ShownCut:
        """Compute what is shown of a record.

        Parameters
        ----------
        trace : Trace
            Record with position and depth, and force in newtons.
        target : float, optional
            Target length, from the clamp [m], 0.005 to 0.15; by default the record's own ``target_length_m``, if any.
        instants : int
            Number of instants, 2 to 2000, evenly spaced in time; at most as many as the record has.

        Raises
        ------
        ValueError
            If the record lacks a necessary column, or the blade lies flat or leaves the specimen.
        """
        count = int(in_range("instants", instants, 2, 2000, "1", "A page with 160 has about 6 MB."))
        try:
            trace.require("position", "depth", by="view")
        except ValueError as error:
            raise ValueError(f"{error} {_CURE}") from None
        trace.require_newtons(by="view")
        position = np.asarray(trace.position)
        angle = np.full(len(trace), math.pi / 2) if trace.angle is None else trace.angle
        _check_angle(angle)
        cut = ScoredCut(trace=trace, target_length=_target(trace, target))
        model, depth = cut.model, cut.profile if trace.height is None else DepthProfile.recorded(trace, by="view")
        # The reading that is nearest to each of the evenly spaced instants.
        even = np.linspace(trace.time[0], trace.time[-1], min(count, len(trace)))
        shown = np.unique(np.searchsorted(0.5 * (trace.time[1:] + trace.time[:-1]), even))
        tip = np.clip(cut.tip[shown], 0.0, model.length)
        stiffness = cut.stiffness(cut.modulus, tip)
        speed = trace.blade_speed if trace.speed is None else trace.speed
        return cls(
            name=str(trace.metadata.get("name", "cut")),
            time=trace.time[shown] - trace.time[0],
            force=trace.force[shown],
            position=position[shown],
            speed=speed[shown],
            angle=angle[shown],
            tip=tip,
            shift=cut.elastic_force[shown] / stiffness,
            depth=depth,
            modulus=cut.modulus,
            tip_source=cut.tip_source,
            angle_known=trace.angle is not None,
            target=cut.target_length,
            model=model,
            whole_time=trace.time - trace.time[0],
            whole_force=trace.force,
            **_of_height(trace, cut, shown),
        )

    def __len__(self) -> int:
        return len(self.time)

    def field(self, i: int) -> Array:
        """Return the nodes' displacement at an instant [m], shape (n_nodes, dim)."""
        a = float(self.tip[i])
        # The tip moves by F/(kappa E B); with E = B = 1 that force is kappa times the shift.
        return self.model.displacement(a, float(self.model.stiffness(a) * self.shift[i]), modulus=1.0, thickness=1.0)


def _target(trace: Trace, given: float | None) -> float | None:
    if given is not None:
        return given
    own = trace.metadata.get("target_length_m")
    return (
        None
        if own is None
        else in_range("target_length_m", own, 0.005, 0.15, "m", "Give --target-length 80mm instead.")
    )


def _of_height(trace: Trace, cut: ScoredCut, shown: Indices) -> dict[str, Any]:
    if trace.height is None:
        return {}
    # The whole record is shown, also of a cut that did not come to an end.
    whole = trace if "end" in trace.metadata else trace.with_metadata({**trace.metadata, "end": "unknown"})
    floor = (cut if whole is trace else dataclasses.replace(cut, trace=whole)).floor
    wanted, layer = trace.metadata.get(WANTED_DEPTH_KEY), trace.metadata.get(LAYER_DEPTH_KEY)
    cure = "12 mm is 0.012."
    return {
        "height": trace.height[shown],
        "floor": DepthProfile(position=np.arange(len(floor), dtype=np.float64) * SPACING, depth=floor),
        "wanted": None if wanted is None else wanted_depth(wanted, name=f"metadata {WANTED_DEPTH_KEY}"),
        "layer": None if layer is None else in_range(f"metadata {LAYER_DEPTH_KEY}", layer, 0.0005, 0.1, "m", cure),
    }


def _check_angle(angle: Array) -> None:
    worst = float(angle[np.argmax(np.abs(angle - math.pi / 2))])
    if not _FLATTEST <= worst <= math.pi - _FLATTEST:
        raise ValueError(
            f"angle = {math.degrees(worst):.0f} deg lies flat; a blade is drawn from 10 to 170 deg against the "
            "surface. Upright is 90 deg: if the record counts from upright, map it again."
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Surface:
    """Triangles between vertices [m]: shapes (n_vertices, 3) and (n_faces, 3)."""

    vertices: Array
    faces: Indices

    @classmethod
    def joined(cls, *surfaces: Surface) -> Surface:
        """Join several surfaces into one."""
        starts = np.cumsum([0, *(len(part.vertices) for part in surfaces)])
        return cls(
            vertices=np.concatenate([part.vertices for part in surfaces]),
            faces=np.concatenate([part.faces + start for part, start in zip(surfaces, starts, strict=False)]),
        )


def grid_faces(rows: int, columns: int) -> Indices:
    """Return triangles of vertices by row, shape (2 (rows - 1) (columns - 1), 3)."""
    number = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]
    return np.concatenate([np.stack([a, b, c], axis=-1), np.stack([a, c, d], axis=-1)]).reshape(-1, 3)


def swept(sections: Array) -> Surface:
    """Return a closed skin around sections, shape (n_sections, n_points, 3) [m]."""
    around = np.concatenate([sections, sections[:, :1]], axis=1)
    quads = np.stack([around[:-1, :-1], around[1:, :-1], around[1:, 1:], around[:-1, 1:]], axis=-2).reshape(-1, 4, 3)
    parts = [_quads(quads)]
    for end in (sections[0], sections[-1]):
        fan = [[0, k, k + 1] for k in range(1, len(end) - 1)]
        parts.append(Surface(vertices=end, faces=np.array(fan)))
    return Surface.joined(*parts)


def box(low: tuple[float, float, float], high: tuple[float, float, float]) -> Surface:
    """Return a box between two corners [m]."""
    (x0, y0, z0), (x1, y1, z1) = low, high
    outline = [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]
    return swept(np.array([[(x, y, z) for x, y in outline] for z in (z0, z1)]))


def _quads(quads: Array) -> Surface:
    first = 4 * np.arange(len(quads))[:, None]
    faces = np.concatenate([first + np.array(corners) for corners in ([0, 1, 2], [0, 2, 3])])
    return Surface(vertices=quads.reshape(-1, 3), faces=faces)


BLADE_THICKNESS = 0.0004
"""Thickness of the blade [m]."""

_BEVEL = 0.0016  # [m] width of the ground bevel
_HANDLE_THICKNESS = 0.0024  # [m]


class ScalpelPose(NamedTuple):
    """Scalpel's origin along and above the specimen's lower face [m], and angle [rad]."""

    along: float
    height: float
    angle: float


def pose(position: float, angle: float, depth: float, level: float = 0.0) -> ScalpelPose:
    """Return the pose with the edge in the surface at ``position``.

    The position of the edge is from the clamp [m], the angle against the surface [rad], below 90 degrees leaning
    forward. ``depth`` is the height of the surface there, that of the cut of a blade at level 0, and ``level`` the
    height of the blade's lower end [m].
    """
    given = {"blade": position, "tip": position, "angle": angle, "level": level}
    scene = derived_quantities(given | {"depth_at": lambda along: depth + 0.0 * along})
    return ScalpelPose(along=float(scene["scalpel_along"]), height=float(scene["scalpel_height"]), angle=angle)


def blade() -> Surface:
    """Return the blade, ground on both sides."""
    edge = blade_edge()
    shoulder = np.array([[-NARROWED, EDGE_END + 0.0022], [-NARROWED, BLADE_LENGTH]])
    front = np.concatenate([edge, shoulder])
    back = np.full(len(front), -CHORD)
    back[-2:] += NARROWED
    half = 0.5 * BLADE_THICKNESS
    sections = []
    for (y, z), spine in zip(front, back, strict=True):
        ground = max(y - _BEVEL, spine)
        sections.append([(0.0, y, z), (half, ground, z), (half, spine, z), (-half, spine, z), (-half, ground, z)])
    return swept(np.array(sections))


def handle() -> Surface:
    """Return the handle's lower part: a neck and a bevelled bar."""
    middle = -0.5 * CHORD
    thickness = (0.5, 1.0, 1.0, 1.3, 1.3)
    stations = [
        (HANDLE_START + z, width, share * _HANDLE_THICKNESS)
        for (z, width), share in zip(HANDLE_WIDTHS, thickness, strict=True)
    ]
    return swept(np.array([_bar(middle, width, thickness, z) for z, width, thickness in stations]))


def _bar(middle: float, width: float, thickness: float, z: float) -> list[tuple[float, float, float]]:
    y, x = 0.5 * width, 0.5 * thickness
    inner = 0.7 * y
    corners = [(x, inner), (0.55 * x, y), (-0.55 * x, y), (-x, inner), (-x, -inner), (-0.55 * x, -y), (0.55 * x, -y)]
    return [(a, middle + b, z) for a, b in [*corners, (x, -inner)]]


BOTTOM = -BELOW
"""Height of the specimen's lower face, as the side view draws it [m]."""
PLANE_ROWS = ("floor", "layer", "below layer", "wanted", "below wanted")
"""Rows of points, in order."""
_LAYER_ASIDE, _WANTED_ASIDE = 0.05e-3, 0.1e-3  # toward the near half, so that one is drawn upon the other [m]
_LINE = 0.6e-3  # thickness of the wanted depth's line [m]


def plane_rows(cut: ShownCut, along: Array, surface: Array) -> Array:
    """Return unloaded rows, (across, along, up) [m], shape (5, n, 3).

    The cut has height; without a wanted depth or a layer, their rows lie at the lower face, and are not to be drawn.
    Positions are from the clamp, the surface is its height there [m], shape (n,).
    """
    assert cut.floor is not None
    floor = np.maximum(surface - cut.floor.at(along), BOTTOM)
    layer = np.full_like(along, BOTTOM) if cut.layer is None else np.maximum(surface - cut.layer, BOTTOM)
    wanted = np.full_like(along, BOTTOM)
    if cut.wanted is not None:
        wanted = np.maximum(surface - cut.wanted.at(along), BOTTOM + 0.5 * _LINE)
    heights = floor, layer, np.full_like(along, BOTTOM), wanted + 0.5 * _LINE, wanted - 0.5 * _LINE
    aside = 0.0, _LAYER_ASIDE, _LAYER_ASIDE, _WANTED_ASIDE, _WANTED_ASIDE
    return np.stack([
        np.column_stack([np.full_like(along, x), along, z]) for x, z in zip(aside, heights, strict=True)
    ])  # fmt: skip


SUBDIVISIONS = (2, 8)
"""Cells for one element, across and along: the drawn tip of the cut is off by one cell at most, 1.25 mm."""
SHEET_HEIGHT = 0.012
"""Height of the target's sheet above the tissue [m]."""
_AVERAGED = 0.002  # [m] to either side, over which the recorded depth is averaged
_UP, _DOWN = 0, 1


@dataclass(frozen=True, kw_only=True, eq=False)
class Skin:
    """Surface or lines of the solid: numbers of its points, and its parts."""

    points: Indices
    parts: Indices


class SlabSolid:
    """Specimen of a shown cut, as a solid.

    ``rest`` are its points without load, shape (n_points, 3): across from the cut line, along from the clamp, up from
    the plane to which a blade at height 0 cuts [m]. ``bottom`` is the height of the lower face [m].
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
        """Return both sides of the cut line, with height the far one."""
        n = self._number
        if self.cut.height is None:
            return self._in_order([n[:, 0, -1, :], n[:, 1, 0, :]])
        return self._in_order([np.stack([n[_UP, 0, -1], self._rows[0]])])

    @cached_property
    def plane(self) -> dict[str, Skin]:
        """Return the plane of the cut, by name.

        Empty for a record without height.

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
        """Return the number of cut parts of :attr:`cut_faces`."""
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
        """Return the target as a sheet moving with the tissue, or None."""
        if self._n_sheet == 0:
            return None
        points = 2 * self.n_lattice + np.arange(self._n_sheet)
        return Skin(points=points, parts=grid_faces(2, self._n_sheet // 2))

    def displacement(self, i: int) -> Array:
        """Return point displacements, (across, along) [m], shape (n_points, 2), cut open."""
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
        """Return the cut's end at rest in upper and lower face [m]."""
        tip = float(self.cut.tip[i])
        if self.cut.height is not None:
            return tip, 0.0
        reach = float(self._height(np.array(tip))) / math.tan(float(self.cut.angle[i]))
        return tip, float(np.clip(tip - reach, 0.0, self.cut.model.length))

    def amount(self, i: int, colour: str) -> Array:
        """Return the colouring quantity at the upper lattice, shape (n_lattice,).

        It is the displacement of the field [m], without the opening, or the strain energy density [J/m3], averaged over
        the elements that meet at a node, separately on each side of the cut.
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
    """Return walls between two rows of points each, shape (2, n)."""
    parts, start = [], 0
    for row in rows:
        parts.append(grid_faces(*row.shape) + start)
        start += row.size
    return Skin(points=np.concatenate([row.ravel() for row in rows]), parts=np.concatenate(parts))
