"""Pages of a cut in 3-D, straight or along any curve, each one file that opens from disk and loads nothing else."""

from __future__ import annotations

import base64
import hashlib
import itertools
import json
import math
from pathlib import Path
from typing import Any

import numpy as np

from cutenv._base.arrays import Array
from cutenv._base.document import render
from cutenv._base.output import atomic_write
from cutenv._base.validation import one_of
from cutenv.viewer import palette
from cutenv.viewer.scene_parts import HANDLE_LENGTH
from cutenv.viewer.solid import solid_scene
from cutenv.viewer.solid.curved_cut import OPENING, CurvedCut, CurvedSolid
from cutenv.viewer.solid.shown_cut import COLOURINGS, ShownCut
from cutenv.viewer.solid.solids import SlabSolid, pose

ARROW_PER_NEWTON = 0.01
"""Length of the force's arrow [m/N]."""
_ARROW_ABOVE = 0.014  # [m] above the tissue
_GROUND = 0.006  # [m] below the specimen, on which its shadow falls
_CHART_WIDTH, _CHART_HEIGHT = 1000, 100  # of the force's chart, in its own units
_BINS = 500  # of the chart, each from its least to its greatest force
_HERE = Path(__file__).parent


def write_view(path: Path, cut: ShownCut, *, colour: str = "displacement") -> int:
    """Write the page of a cut, as a whole or not at all.

    Parameters
    ----------
    path : Path
        Path of the page (.html).
    cut : ShownCut
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
    document = view_page(cut, colour=one_of("colour", colour, COLOURINGS)).encode("utf-8")
    with atomic_write(path) as part:
        part.write_bytes(document)
    return len(document)


def view_page(cut: ShownCut, *, colour: str = "displacement") -> str:
    """Return the page of a cut as text; equal for equal cuts."""
    one_of("colour", colour, COLOURINGS)
    solid = SlabSolid(cut)
    packed = solid_scene.commands(solid)  # a missing meshcat is noticed here, before its files are looked for
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
        "units_per_metre": solid_scene.UNITS_PER_METRE,
        "displacement_step_m": step,
        "palette": colours,
        "arrow_m_per_N": ARROW_PER_NEWTON,
        "arrow_above_m": _ARROW_ABOVE,
        "in_picture_m": _rounded(solid_scene.in_picture(solid), 5),
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
    return render(_HERE / "view.html", values, filters={"digest": digest})


def _told(solid: SlabSolid) -> dict[str, Any]:
    """Return the data for the page's script, instant by instant; the unit is in every name."""
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
    """Return positions along the upper face, and its heights there [m]."""
    along, first = np.unique(lattice[:, 1], return_index=True)
    return along, lattice[first, 2]


def _chart(cut: ShownCut) -> dict[str, Any]:
    """Return the whole record's force over time as points of a line, in the chart's units; height of zero; top [N]."""
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


def as_base64(data: bytes) -> str:
    """Return bytes as text for a page."""
    return base64.b64encode(data).decode("ascii")


def digest(code: str) -> str:
    """Return the digest by which a page's policy admits a script."""
    return as_base64(hashlib.sha256(code.encode()).digest())


def _rounded(values: Array, digits: int) -> Any:
    # "-0" and "0" would make two different pages of one cut.
    return (np.round(values, digits) + 0.0).tolist()


def write_curved_view(path: Path, cut: CurvedCut) -> int:
    """Write the page of a slab, its cuts and its blade, as a whole or not at all.

    Parameters
    ----------
    path : Path
        Path of the page (.html).
    cut : CurvedCut
        Slab that was cut.

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
    document = curved_page(cut).encode("utf-8")
    with atomic_write(path) as part:
        part.write_bytes(document)
    return len(document)


def curved_page(cut: CurvedCut) -> str:
    """Return the page as text."""
    solid = CurvedSolid(cut)
    packed = solid_scene.curved_commands(solid)
    viewer, licences = meshcat_viewer()
    along, height, _ = pose(0.0, cut.angle, solid.depth)
    (x, y), heading = cut.blade, cut.heading
    told = {
        "commands": [as_base64(each) for each in packed],
        "units_per_metre": solid_scene.UNITS_PER_METRE,
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
    return render(_HERE / "curved.html", values, filters={"digest": digest})
