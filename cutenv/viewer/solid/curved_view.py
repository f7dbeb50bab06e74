"""Page of a slab with cuts along any curve, in 3-D: one file that opens from disk."""

from __future__ import annotations

import json
import math
from pathlib import Path

from cutenv._base.atomic_file import atomic_write
from cutenv._base.document import render
from cutenv.viewer.solid import solid_scene
from cutenv.viewer.solid.curved_cut import OPENING, CurvedCut
from cutenv.viewer.solid.curved_solid import CurvedSolid
from cutenv.viewer.solid.scalpel import pose
from cutenv.viewer.solid.view_page import as_base64, digest, meshcat_viewer

_HERE = Path(__file__).parent


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
