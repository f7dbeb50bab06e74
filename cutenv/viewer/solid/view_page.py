"""Page of a cut in 3-D: meshcat's viewer, the scene and every instant in one file that loads nothing else."""

from __future__ import annotations

import base64
import hashlib
import html
import itertools
import json
from pathlib import Path
from typing import Any

import numpy as np

from cutenv._base.arrays import Array
from cutenv._base.atomic_file import atomic_write
from cutenv._base.validation import one_of
from cutenv.viewer import palette
from cutenv.viewer.solid import solid_scene
from cutenv.viewer.solid.scalpel import HANDLE_LENGTH, pose
from cutenv.viewer.solid.shown_cut import COLOURINGS, ShownCut
from cutenv.viewer.solid.slab_solid import SlabSolid

ARROW_PER_NEWTON = 0.01
"""Length of the force's arrow [m/N]."""
_ARROW_ABOVE = 0.014  # [m] above the tissue
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
        If meshcat is not installed.
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
    viewer, licences = _meshcat()
    player = (_HERE / "player.js").read_text(encoding="utf-8")
    amounts = np.stack([solid.amount(i, colour) for i in range(len(cut))])
    displacements = np.stack([solid.displacement(i) for i in range(len(cut))])
    # 16 bits cover 10 mm in steps of 0.3 um; 256 steps are enough for the colours.
    step = max(float(np.abs(displacements).max()), 1e-6) / 32767
    greatest = max(float(amounts.max()), 1e-12)
    share = amounts / greatest if colour == "displacement" else np.sqrt(amounts / greatest)
    told = _told(solid) | {
        "commands": [_base64(each) for each in packed],
        "units_per_metre": solid_scene.UNITS_PER_METRE,
        "displacement_step_m": step,
        "palette": palette.TISSUE if colour == "displacement" else palette.ENERGY,
        "arrow_m_per_N": ARROW_PER_NEWTON,
        "arrow_above_m": _ARROW_ABOVE,
        "in_picture_m": _rounded(solid_scene.in_picture(solid), 5),
    }
    blocks = {
        "told": json.dumps(told, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c"),
        "rest": _base64(solid.rest.astype("<f4").tobytes()),
        "displacements": _base64(np.rint(displacements / step).astype("<i2").tobytes()),
        "amounts": _base64(np.rint(255 * share).astype(np.uint8).tobytes()),
        "licences": licences.replace("<", "&lt;"),
    }
    data = "\n".join(f'<script type="text/plain" id="{name}">{text}</script>' for name, text in blocks.items())
    hashes = " ".join(f"'sha256-{_base64(hashlib.sha256(code.encode()).digest())}'" for code in (viewer, player))
    policy = f"default-src 'none'; script-src {hashes}; style-src 'unsafe-inline'; img-src data: blob:"
    title = html.escape(f"{cut.name} in 3-D")
    return (
        f'<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{policy}">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f'<meta name="color-scheme" content="light dark">\n<title>{title}</title>\n'
        f"<style>{(_HERE / 'player.css').read_text(encoding='utf-8')}</style>\n</head>\n<body>\n"
        f"{_body(cut, title, colour, greatest)}\n{data}\n"
        f"<script>{viewer}</script>\n<script>{player}</script>\n</body>\n</html>\n"
    )


def _told(solid: SlabSolid) -> dict[str, Any]:
    """Return the data for the page's script, instant by instant; the unit is in every name."""
    cut = solid.cut
    depth = cut.depth.at(cut.position)
    poses = np.array([pose(*each) for each in zip(cut.position, cut.angle, depth, strict=True)])
    lattice = solid.rest[: solid.n_lattice]
    skins = {f"tissue/{name}": skin for name, skin in solid.lattices.items()} | {"tissue/faces": solid.cut_faces}
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
    }


def _profile(lattice: Array) -> tuple[Array, Array]:
    """Return positions along the upper face, and its heights there [m]."""
    along, first = np.unique(lattice[:, 1], return_index=True)
    return along, lattice[first, 2]


def _body(cut: ShownCut, title: str, colour: str, greatest: float) -> str:
    tip = "tip (estimated)" if cut.tip_source == "estimated" else "tip (from return stroke)"
    shown = [
        ("time", "time"),
        ("force", "force"),
        ("speed", "speed"),
        ("angle", "angle"),
        ("blade", "blade at"),
        ("tip", tip),
    ]
    readout = "".join(f'<div><dt>{label}</dt><dd id="shown-{name}">–</dd></div>' for name, label in shown)
    labels = {
        "target": _target_label(cut),
        "clamp": "clamp",
        "arrow": "",
        "tip-mark": tip,
        "opened": "cut drawn open: illustration",
    }
    floating = "".join(f'<span class="label" id="label-{name}" hidden>{text}</span>' for name, text in labels.items())
    chart, high = _chart(cut)
    return f"""<header><h1>{title}</h1><dl id="readout">{readout}</dl></header>
<main>
<div id="stage">
<div id="pane" role="img" aria-label="The specimen, the scalpel in it and the target; drag to turn"></div>
<div id="labels">{floating}</div>
{_legend(colour, greatest)}
<p id="trouble" role="alert" hidden></p>
</div>
<form id="controls" autocomplete="off">
<div class="chart"><span class="scale">{html.escape(high)}</span>{chart}<i id="cursor"></i></div>
<input id="slider" type="range" min="0" max="{len(cut) - 1}" step="1" value="0" aria-label="time">
<div class="buttons"><button id="play" type="button">play</button>
<label>playback <select id="pace"><option value="0.25">¼ ×</option><option value="1" selected>1 ×</option>
<option value="4">4 ×</option></select></label>
<label><input id="see-through" type="checkbox"> see through the tissue</label>
<button id="turn-back" type="button">reset view</button></div>
</form>
</main>
<details><summary>What is drawn, and what is illustration</summary>
<ul>{"".join(f"<li>{html.escape(note)}</li>" for note in _notes(cut, colour))}</ul></details>"""


def _target_label(cut: ShownCut) -> str:
    return "" if cut.target is None else f"target {1e3 * cut.target:.0f} mm"


def _legend(colour: str, greatest: float) -> str:
    colours = palette.TISSUE if colour == "displacement" else palette.ENERGY
    stops = ",".join(f"rgb({r},{g},{b})" for r, g, b in colours[::9])
    if colour == "displacement":
        title, ticks = "displacement [mm]", [f"{1e3 * greatest * t:.1f}" for t in (0.0, 0.5, 1.0)]
    else:
        title, ticks = "strain energy density [J/m³]", [f"{greatest * t**2:.0f}" for t in (0.0, 0.5, 1.0)]
    shown = "".join(f"<span>{tick}</span>" for tick in ticks)
    return (
        f'<div id="legend"><b>{title}</b><i style="background:linear-gradient(90deg,{stops})"></i>'
        f"<div>{shown}</div></div>"
    )


def _chart(cut: ShownCut) -> tuple[str, str]:
    """Return the whole record's force over time as a line, and the label of its top."""
    low, high = min(float(cut.whole_force.min()), 0.0), max(float(cut.whole_force.max()), 0.1)
    borders = np.unique(np.linspace(0, len(cut.whole_force), _BINS + 1).astype(int))
    points = []
    for start, stop in itertools.pairwise(borders.tolist()):
        part = cut.whole_force[start:stop]
        for k in sorted({int(part.argmin()), int(part.argmax())}):
            x = _CHART_WIDTH * cut.whole_time[start + k] / cut.whole_time[-1]
            points.append(f"{x:.1f},{_CHART_HEIGHT * (high - part[k]) / (high - low):.1f}")
    zero = _CHART_HEIGHT * high / (high - low)
    svg = (
        f'<svg viewBox="0 0 {_CHART_WIDTH} {_CHART_HEIGHT}" preserveAspectRatio="none" role="img" '
        f'aria-label="force over time, up to {high:.1f} N"><path class="zero" d="M0,{zero:.1f}H{_CHART_WIDTH}"/>'
        f'<polyline points="{" ".join(points)}"/></svg>'
    )
    return svg, f"force, up to {high:.1f} N"


def _notes(cut: ShownCut, colour: str) -> list[str]:
    steps = np.diff(cut.time)
    notes = [
        f"{len(cut)} instants of the record, every {1e3 * float(np.median(steps)):.0f} ms; the chart below the picture "
        "holds the whole record.",
        f"The tissue is displaced by the finite-element model's field for the tip and the elastic force at the instant "
        f"(local effective modulus {1e-3 * cut.modulus:.1f} kPa), to scale, nothing exaggerated. Its faces slide along "
        "the cut line and stay in contact: the open cut is an illustration, and its front leans as the blade does.",
        "The tip is estimated: blade less elastic force over stiffness, to 1 mm, 4 mm at worst."
        if cut.tip_source == "estimated"
        else "The tip is estimated with the stiffness and the friction from the return stroke.",
        "The depth of cut was recorded along the line; it is drawn the same across the specimen, and held beyond the "
        "last place that the blade reached. The lower face is drawn flat.",
        f"No. 10 blade of 42.5 mm by 7 mm and 0.4 mm in the lower {1e3 * HANDLE_LENGTH:.0f} mm of a No. 3 handle, to "
        "scale; its edge meets the surface where the record has the blade.",
        f"The arrow is the force on the blade along the cut, {1e3 * ARROW_PER_NEWTON:.0f} mm for 1 N.",
    ]
    if not cut.angle_known:
        notes.append("The record holds no angle: the blade is drawn upright.")
    if cut.target is not None:
        notes.append("The target is a mark on the tissue, so its sheet moves with the tissue.")
    if colour == "energy":
        notes.append(
            "Strain energy density: the mean of each element, averaged where elements meet; colours by its square "
            "root. A point load's grows without bound as elements shrink: compare only pictures of one mesh."
        )
    return notes


def _meshcat() -> tuple[str, str]:
    """Return meshcat's viewer, and its licences."""
    import meshcat  # an extra, and slow to import

    folder = Path(meshcat.viewer_assets_path())
    viewer = (folder / "dist" / "main.min.js").read_text(encoding="utf-8")
    if "</script" in viewer.lower() or "<!--" in viewer:
        raise RuntimeError("this version of meshcat has a viewer that cannot stand in a page; install meshcat 0.3.2.")
    texts = ("LICENSE", "dist/main.min.js.LICENSE.txt", "dist/main.min.js.THIRD_PARTY_LICENSES.json")
    return viewer, "\n\n".join((folder / name).read_text(encoding="utf-8") for name in texts)


def _base64(data: bytes) -> str:
    return base64.b64encode(data).decode("ascii")


def _rounded(values: Array, digits: int) -> Any:
    # "-0" and "0" would make two different pages of one cut.
    return (np.round(values, digits) + 0.0).tolist()
