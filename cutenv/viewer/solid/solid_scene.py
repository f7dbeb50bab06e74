"""Scene as meshcat's commands, packed as its viewer reads them, without starting or contacting a server.

Meshcat's ``Visualizer`` starts a web server that listens on every interface and outlives the program; only its
descriptions of objects are used here. One unit of the scene is 10 cm, which suits the viewer's lights.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cutenv._base.arrays import Array
from cutenv.viewer import palette
from cutenv.viewer.scene_parts import BLADE_LENGTH, HANDLE_LENGTH
from cutenv.viewer.solid.curved_cut import CurvedSolid
from cutenv.viewer.solid.solids import SlabSolid, Surface, blade, box, handle, swept

Rgb = tuple[int, int, int]

UNITS_PER_METRE = 10.0
"""Scene units in one metre."""

_CLAMP_LENGTH, _CLAMP_MARGIN = 0.012, 0.005  # [m] along the specimen, and around it
_JAW = 0.007  # [m] height of each jaw above what it holds
_ARROW_RADIUS, _HEAD_RADIUS, _HEAD_LENGTH = 0.0011, 0.0026, 0.006  # [m]
_TIP_RADIUS = 0.0016  # [m]
_PLANE: dict[str, Rgb] = {
    name: palette.LIGHT[role]
    for name, role in (
        ("near", "cut face"), ("below", "tissue"), ("ahead", "tissue"), ("layer", "layer"), ("wanted", "target"),
    )
}  # fmt: skip
"""Colours of the parts of the cut's plane: those of the side view."""


def commands(solid: SlabSolid) -> list[bytes]:
    """Return the commands for all objects of the scene, at rest and at the origin; the page moves them.

    Raises
    ------
    ImportError
        If meshcat is not installed.
    """
    stage = _Stage()
    for name, skin in solid.lattices.items():
        stage.surface(f"tissue/{name}", _of(solid, skin.points, skin.parts), coloured=True)
    faces = solid.cut_faces
    stage.surface("tissue/faces", _of(solid, faces.points, faces.parts), _Paint(palette.CUT_FACE))
    for name, skin in solid.plane.items():
        stage.surface(f"tissue/{name}", _of(solid, skin.points, skin.parts), _Paint(_PLANE[name]))
    stage.lines("tissue/lines", solid.rest[solid.lines.points], palette.MESH)
    if solid.sheet is not None:
        stage.surface("target", _of(solid, solid.sheet.points, solid.sheet.parts), _Paint(palette.TARGET, opacity=0.34))
    edge = float(solid.rest[solid.rest[:, 1] == 0.0, 2].max())
    stage.furnish(_clamp(solid.cut.model.width, solid.bottom, edge))
    stage.arrow("arrow", palette.ARROW)
    stage.ball("tip", palette.TIP)
    return stage.packed


def curved_commands(solid: CurvedSolid) -> list[bytes]:
    """Return the commands for a slab with any cuts; the page moves the scalpel only.

    Raises
    ------
    ImportError
        If meshcat is not installed.
    """
    stage = _Stage()
    for name in ("top", "bottom", "rim"):
        stage.surface(f"tissue/{name}", solid.skins[name], coloured=solid.colours(solid.skins[name]))
    stage.surface("tissue/faces", solid.skins["faces"], _Paint(palette.CUT_FACE))
    stage.lines("tissue/lines", solid.lines, palette.MESH)
    if solid.wanted is not None:
        stage.lines("target", solid.wanted, palette.TARGET)
    stage.furnish(_clamp(solid.width, 0.0, solid.depth))
    return stage.packed


def in_picture(solid: SlabSolid) -> Array:
    """Return places that the first view must show, shape (n, 3) [m]: corners of specimen and scalpel's range."""
    cut = solid.cut
    low, high = solid.rest.min(axis=0), solid.rest.max(axis=0)
    low -= [_CLAMP_MARGIN, _CLAMP_LENGTH, _JAW]
    high[0] += _CLAMP_MARGIN
    corners = np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])])
    upper = float(np.max(cut.depth.depth)) + 0.7 * (BLADE_LENGTH + HANDLE_LENGTH)
    return np.concatenate([corners, [[0.0, float(cut.position.min()), upper], [0.0, float(cut.position.max()), upper]]])


def _of(solid: SlabSolid, points: NDArray[np.int64], parts: NDArray[np.int64]) -> Surface:
    return Surface(vertices=solid.rest[points], faces=parts)


def _clamp(width: float, bottom: float, edge: float) -> Surface:
    """Return two jaws and two bolts at the edge where the cut starts, from height ``bottom`` to ``edge`` [m] there."""
    half = 0.5 * width + _CLAMP_MARGIN
    jaws = [
        box((-half, -_CLAMP_LENGTH, bottom - 0.6 * _JAW), (half, 0.0, bottom + 0.0005)),
        box((-half, -_CLAMP_LENGTH, edge), (half, 0.0, edge + _JAW)),
        box((-half, -_CLAMP_LENGTH, bottom), (half, -0.8 * _CLAMP_LENGTH, edge)),
    ]
    t = np.linspace(0.0, 2.0 * math.pi, 6, endpoint=False)
    hexagon = 0.0032 * np.stack([np.cos(t), np.sin(t)], axis=-1)
    bolts = []
    for x in (-0.7 * half, 0.7 * half):
        outline = hexagon + np.array([x, -0.5 * _CLAMP_LENGTH])
        levels = (edge + _JAW, edge + _JAW + 0.0025)
        points = [np.column_stack([outline, np.full(6, z)]) for z in levels]
        bolts.append(swept(np.stack(points)))
    return Surface.joined(*jaws, *bolts)


class _Paint(NamedTuple):
    """Look of a surface."""

    colour: Rgb = (255, 255, 255)
    opacity: float = 1.0
    shininess: float = 12.0


_WHITE = _Paint()


class _Stage:
    """Objects by path, each packed at once; named instead of meshcat's random ids, so that a page is repeatable."""

    def __init__(self) -> None:
        from meshcat import commands, geometry  # an extra, and slow to import
        from meshcat.path import Path

        self._commands: Any = commands
        self._geometry: Any = geometry
        self._path: Any = Path
        self.packed: list[bytes] = []

    def surface(self, path: str, surface: Surface, paint: _Paint = _WHITE, *, coloured: bool | Array = False) -> None:
        """Add triangles; with ``coloured`` each vertex has a colour: those given, or the page's."""
        own = coloured is not False
        colours = (np.ones_like(surface.vertices) if coloured is True else np.asarray(coloured)) if own else None
        shape = self._geometry.TriangularMeshGeometry(UNITS_PER_METRE * surface.vertices, surface.faces, colours)
        material = self._geometry.MeshPhongMaterial(
            color=_number(paint.colour),
            opacity=paint.opacity,
            vertexColors=own,
            shininess=paint.shininess,
            depthWrite=paint.opacity == 1.0,
        )
        self._object(path, self._geometry.Mesh(shape, material))

    def furnish(self, clamp: Surface) -> None:
        """Add clamp, scalpel and lights."""
        self.surface("clamp", clamp, _Paint((112, 122, 134), shininess=40))
        self.surface("scalpel/blade", blade(), _Paint(palette.STEEL_LIGHT, shininess=120))
        self.surface("scalpel/handle", handle(), _Paint(palette.STEEL, shininess=70))
        for path in ("Grid", "Axes", "Background", "Lights/PointLightNegativeX"):
            self.set(path, "visible", False)
        self.set("Lights/SpotLight", "visible", True)
        for path, intensity in (
            ("SpotLight", 0.3),
            ("AmbientLight", 0.7),
            ("PointLightPositiveX", 0.0),
            ("FillLight", 0.0),
        ):
            self.set(f"Lights/{path}/<object>", "intensity", intensity)
        self.set("Lights/SpotLight/<object>", "castShadow", True)

    def lines(self, path: str, vertices: Array, colour: Rgb) -> None:
        """Add points, which the page joins by lines."""
        shape = self._geometry.PointsGeometry(np.ascontiguousarray(UNITS_PER_METRE * vertices.T))
        material = self._geometry.LineBasicMaterial(color=_number(colour), opacity=0.75)
        self._object(path, self._geometry.LineSegments(shape, material))

    def arrow(self, path: str, colour: Rgb) -> None:
        """Add an arrow: a shaft of unit length around its middle, and a head; both along y."""
        for part, length, top, bottom in (
            ("shaft", 1.0 / UNITS_PER_METRE, _ARROW_RADIUS, _ARROW_RADIUS),
            ("head", _HEAD_LENGTH, 0.0, _HEAD_RADIUS),
        ):
            shape = self._geometry.Cylinder(
                UNITS_PER_METRE * length,
                radiusTop=UNITS_PER_METRE * top,
                radiusBottom=UNITS_PER_METRE * bottom,
            )
            material = self._geometry.MeshLambertMaterial(color=_number(colour))
            self._object(f"{path}/{part}", self._geometry.Mesh(shape, material))

    def ball(self, path: str, colour: Rgb) -> None:
        """Add a small sphere."""
        shape = self._geometry.Sphere(UNITS_PER_METRE * _TIP_RADIUS)
        material = self._geometry.MeshPhongMaterial(color=_number(colour), shininess=80)
        self._object(path, self._geometry.Mesh(shape, material))

    def set(self, path: str, name: str, value: object) -> None:
        """Set a property of an object."""
        self._send(self._commands.SetProperty(_Key(name), value, self._path(tuple(path.split("/")))))

    def _object(self, path: str, thing: Any) -> None:
        for part, mark in ((thing, "object"), (thing.geometry, "geometry"), (thing.material, "material")):
            part.uuid = f"{path}-{mark}"
        self._send(self._commands.SetObject(thing, path=self._path(tuple(path.split("/")))))

    def _send(self, command: Any) -> None:
        import umsgpack  # comes with meshcat

        self.packed.append(umsgpack.packb(command.lower()))


class _Key(str):
    """Name of a property that is kept as written: meshcat calls ``lower()`` on it, which would break ``castShadow``."""

    def lower(self) -> str:
        return str(self)


def _number(colour: Rgb) -> int:
    red, green, blue = colour
    return (red << 16) | (green << 8) | blue
