"""Pages of a cut in 3-D, straight or along any curve.

Each is one file that opens from disk and loads nothing else. The scene is in meshcat's commands, packed as its viewer
reads them, without starting or contacting a server.

Meshcat's ``Visualizer`` starts a web server that listens on every interface and outlives the program; only its
descriptions of objects are used here. One unit of the scene is 10 cm, which suits the viewer's lights.
"""

from __future__ import annotations

import itertools
import json
import math
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cutenv._base.arrays import Array
from cutenv._base.document import as_base64, render, script_digest
from cutenv._base.output import atomic_write
from cutenv._base.validation import one_of
from cutenv.display.viewer import palette
from cutenv.display.viewer.scene_parts import BLADE_LENGTH, HANDLE_LENGTH
from cutenv.display.viewer.solid.curved_cut import OPENING, CurvedCut, CurvedSolid
from cutenv.display.viewer.solid.solids import COLOURINGS, ShownCut, SlabSolid, Surface, blade, box, handle, pose, swept

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
    """Return commands for the scene's objects, at rest and origin."""
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
    """Return the commands for a slab with any cuts."""
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
    """Return corners the first view must show, shape (n, 3) [m]."""
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
    """Return the clamp's jaws and bolts, from height ``bottom`` to ``edge`` [m]."""
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
    colour: Rgb = (255, 255, 255)
    opacity: float = 1.0
    shininess: float = 12.0


_WHITE = _Paint()


class _Stage:
    """Objects by path, packed at once, named so that a page is repeatable."""

    def __init__(self) -> None:
        from meshcat import commands, geometry  # an extra, and slow to import
        from meshcat.path import Path

        self._commands: Any = commands
        self._geometry: Any = geometry
        self._path: Any = Path
        self.packed: list[bytes] = []

    def surface(self, path: str, surface: Surface, paint: _Paint = _WHITE, *, coloured: bool | Array = False) -> None:
        """Add triangles; ``coloured`` gives each vertex a colour."""
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
        """Add an arrow along y: centred unit shaft, and head."""
        for part, length, top, bottom in (
            ("shaft", 1.0 / UNITS_PER_METRE, _ARROW_RADIUS, _ARROW_RADIUS),
            ("head", _HEAD_LENGTH, 0.0, _HEAD_RADIUS),
        ):
            shape = self._geometry.Cylinder(
                UNITS_PER_METRE * length, radiusTop=UNITS_PER_METRE * top, radiusBottom=UNITS_PER_METRE * bottom
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
    """Name of a property that meshcat's ``lower()`` leaves as written."""

    def lower(self) -> str:
        return str(self)


def _number(colour: Rgb) -> int:
    red, green, blue = colour
    return (red << 16) | (green << 8) | blue


ARROW_PER_NEWTON = 0.01
"""Length of the force's arrow [m/N]."""
_ARROW_ABOVE = 0.014  # [m] above the tissue
_GROUND = 0.006  # [m] below the specimen, on which its shadow falls
_CHART_WIDTH, _CHART_HEIGHT = 1000, 100  # of the force's chart, in its own units
_BINS = 500  # of the chart, each from its least to its greatest force
_HERE = Path(__file__).parent


def write_view(path: Path, cut: ShownCut, *, colour: str = "displacement") -> int:
    """Write the page of a cut atomically.

    Parameters
    ----------
    colour : {"displacement", "energy"}
        Quantity that the tissue's colour shows.

    Returns
    -------
    int
        Size of the page [bytes].

    Raises
    ------
    ValueError
        If the colour is unknown.
    ImportError
        If meshcat or Jinja2 is not installed.
    OSError
        If the page cannot be written.
    """
    return _write(path, view_page(cut, colour=one_of("colour", colour, COLOURINGS)))


def view_page(cut: ShownCut, *, colour: str = "displacement") -> str:
    """Return the page of a cut as deterministic text."""
    one_of("colour", colour, COLOURINGS)
    solid = SlabSolid(cut)
    packed = commands(solid)  # a missing meshcat is noticed here, before its files are looked for
    viewer, licences = meshcat_viewer()
    amounts = np.stack([solid.amount(i, colour) for i in range(len(cut))])
    displacements = np.stack([solid.displacement(i) for i in range(len(cut))])
    # 16 bits cover 10 mm in steps of 0.3 um; 256 steps are enough for the colours.
    step = max(float(np.abs(displacements).max()), 1e-6) / 32767
    greatest = max(float(amounts.max()), 1e-12)
    share = amounts / greatest if colour == "displacement" else np.sqrt(amounts / greatest)
    colours = palette.TISSUE if colour == "displacement" else palette.ENERGY
    told = _told(solid) | {
        "commands": [as_base64(each) for each in packed],
        "units_per_metre": UNITS_PER_METRE,
        "displacement_step_m": step,
        "palette": colours,
        "arrow_m_per_N": ARROW_PER_NEWTON,
        "arrow_above_m": _ARROW_ABOVE,
        "in_picture_m": _rounded(in_picture(solid), 5),
    }
    blocks = {
        "told": json.dumps(told, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c"),
        "rest": as_base64(solid.rest.astype("<f4").tobytes()),
        "displacements": as_base64(np.rint(displacements / step).astype("<i2").tobytes()),
        "amounts": as_base64(np.rint(255 * share).astype(np.uint8).tobytes()),
        "licences": licences.replace("<", "&lt;"),
    }
    values = {
        "cut": cut,
        "colour": colour,
        "palette": colours,
        "greatest": greatest,
        "interval": float(np.median(np.diff(cut.time))),
        "handle_length": HANDLE_LENGTH,
        "arrow_per_newton": ARROW_PER_NEWTON,
        "chart": _chart(cut),
        "blocks": blocks,
        "viewer": viewer,
        "player": (_HERE / "player.js").read_text(encoding="utf-8"),
    }
    return render(_HERE / "view.html", values, filters={"digest": script_digest})


def _told(solid: SlabSolid) -> dict[str, Any]:
    """Return the script's data by instant, with units in names."""
    cut = solid.cut
    depth = cut.depth.at(cut.position)
    height = np.zeros(len(cut)) if cut.height is None else cut.height
    poses = np.array([pose(*each) for each in zip(cut.position, cut.angle, depth, height, strict=True)])
    lattice = solid.rest[: solid.n_lattice]
    skins = {f"tissue/{name}": skin for name, skin in solid.lattices.items()} | {"tissue/faces": solid.cut_faces}
    skins |= {f"tissue/{name}": skin for name, skin in solid.plane.items()}
    if solid.sheet is not None:
        skins["target"] = solid.sheet
    tip_height = np.interp(cut.tip, *_profile(lattice))
    return {
        "time_s": _rounded(cut.time, 4),
        "force_N": _rounded(cut.force, 3),
        "position_m": _rounded(cut.position, 6),
        "speed_m_s": _rounded(cut.speed, 6),
        "angle_rad": _rounded(cut.angle, 5),
        "tip_m": _rounded(cut.tip, 6),
        "tip_shown_m": _rounded(cut.tip + cut.shift, 6),
        "tip_height_m": _rounded(tip_height, 6),
        "shift_m": _rounded(cut.shift, 6),
        "surface_m": _rounded(depth, 6),
        "scalpel_along_m": _rounded(poses[:, 0], 6),
        "scalpel_height_m": _rounded(poses[:, 1], 6),
        "duration_s": round(float(cut.whole_time[-1]), 4),
        "first_instant": int(np.argmax(cut.force)),
        "target_m": cut.target,
        "specimen_m": [cut.model.width, cut.model.length],
        "n_lattice": solid.n_lattice,
        "skins": {name: skin.points.tolist() for name, skin in skins.items()},
        "cut_parts": [solid.cut_parts(i) for i in range(len(cut))],
        "lines": solid.lines.parts.ravel().tolist(),
        "ground_m": solid.bottom - _GROUND,
        "plane": list(solid.plane),
        "below_m": _rounded(depth - height, 6),
        "wanted_m": None if cut.wanted is None else _rounded(cut.wanted.at(cut.position), 6),
    }


def _profile(lattice: Array) -> tuple[Array, Array]:
    """Return positions along the upper face, and heights [m]."""
    along, first = np.unique(lattice[:, 1], return_index=True)
    return along, lattice[first, 2]


def _chart(cut: ShownCut) -> dict[str, Any]:
    """Return force points in chart units, zero's height, and top [N]."""
    low, high = min(float(cut.whole_force.min()), 0.0), max(float(cut.whole_force.max()), 0.1)
    borders = np.unique(np.linspace(0, len(cut.whole_force), _BINS + 1).astype(int))
    points = []
    for start, stop in itertools.pairwise(borders.tolist()):
        part = cut.whole_force[start:stop]
        for k in sorted({int(part.argmin()), int(part.argmax())}):
            x = _CHART_WIDTH * cut.whole_time[start + k] / cut.whole_time[-1]
            points.append(f"{x:.1f},{_CHART_HEIGHT * (high - part[k]) / (high - low):.1f}")
    zero = _CHART_HEIGHT * high / (high - low)
    return {"width": _CHART_WIDTH, "height": _CHART_HEIGHT, "points": " ".join(points), "zero": zero, "high": high}


def meshcat_viewer() -> tuple[str, str]:
    """Return meshcat's viewer, and its licences."""
    import meshcat  # an extra, and slow to import

    folder = Path(meshcat.viewer_assets_path())
    viewer = (folder / "dist" / "main.min.js").read_text(encoding="utf-8")
    if "</script" in viewer.lower() or "<!--" in viewer:
        raise RuntimeError("this version of meshcat has a viewer that cannot stand in a page; install meshcat 0.3.2.")
    texts = ("LICENSE", "dist/main.min.js.LICENSE.txt", "dist/main.min.js.THIRD_PARTY_LICENSES.json")
    return viewer, "\n\n".join((folder / name).read_text(encoding="utf-8") for name in texts)


def _write(path: Path, document: str) -> int:
    content = document.encode("utf-8")
    with atomic_write(path) as part:
        part.write_bytes(content)
    return len(content)


def _rounded(values: Array, digits: int) -> Any:
    # "-0" and "0" would make two different pages of one cut.
    return (np.round(values, digits) + 0.0).tolist()


def write_curved_view(path: Path, cut: CurvedCut) -> int:
    """Write the page of a slab along a curve atomically.

    Returns
    -------
    int
        Size of the page [bytes].

    Raises
    ------
    ImportError
        If meshcat or Jinja2 is not installed.
    OSError
        If the page cannot be written.
    """
    return _write(path, curved_page(cut))


def curved_page(cut: CurvedCut) -> str:
    """Return the page as text."""
    solid = CurvedSolid(cut)
    packed = curved_commands(solid)
    viewer, licences = meshcat_viewer()
    along, height, _ = pose(0.0, cut.angle, solid.depth)
    (x, y), heading = cut.blade, cut.heading
    told = {
        "commands": [as_base64(each) for each in packed],
        "units_per_metre": UNITS_PER_METRE,
        "scalpel_m": [along * math.sin(-heading) - y, along * math.cos(heading) + x, height],
        "scalpel_rad": [cut.angle - 0.5 * math.pi, heading],
        "middle_m": [0.0, 0.062, 0.0],
    }
    values = {
        "title": cut.name,
        "opening": OPENING,
        "told": json.dumps(told, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c"),
        "licences": licences.replace("<", "&lt;"),
        "viewer": viewer,
        "script": (_HERE / "curved.js").read_text(encoding="utf-8"),
    }
    return render(_HERE / "curved.html", values, filters={"digest": script_digest})
