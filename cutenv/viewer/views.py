"""Views of a cut: the parts of the scene from above, from the side and in the chart, drawn on a canvas."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any, NamedTuple

import numpy as np

from cutenv.viewer import palette
from cutenv.viewer.canvas import Canvas, Points
from cutenv.viewer.drawn_slab import Slab
from cutenv.viewer.formula import SceneFormula
from cutenv.viewer.palette import Colour
from cutenv.viewer.scene import Layout, rest_places, scene_label
from cutenv.viewer.scene_parts import (
    LARGEST_DISPLACEMENT,
    PARTS,
    RULER_LABELLED,
    RULER_STEP,
    TINT,
    Hatched,
    ScenePart,
)

_LETTERS, _LABEL_LETTERS = 16, 19
_CORNERS = ((0, 0), (1, 0), (1, 1), (0, 1))  # corners of a cell, in order around it
_ANCHORS = {"center": "midbottom", "left": "midleft"}
_CLAMP = Hatched()
_TINT = [(role, SceneFormula(text)) for role, text in TINT]


class Sheet(NamedTuple):
    """Canvas with the moment to be drawn on it.

    Attributes
    ----------
    canvas, layout : Canvas, Layout
    quantities : dict
        Those of the moment.
    shown : collection of str
        Conditions that hold: "truth", "hand", "force", "layer", and those of the moment.
    blade : tuple of int
        Colour of the blade.
    """

    canvas: Canvas
    layout: Layout
    quantities: dict[str, Any]
    shown: Collection[str] = ()
    blade: Colour = palette.STEEL


def tint(force: float, quantities: Mapping[str, Any]) -> Colour:
    """Return the blade's colour at a force [N]."""
    stops = [formula(quantities) for _, formula in _TINT]
    channels = zip(*(palette.LIGHT[role] for role, _ in _TINT), strict=True)
    red, green, blue = (round(float(np.interp(abs(force), stops, channel))) for channel in channels)
    return red, green, blue


def draw_clamp(canvas: Canvas, layout: Layout, width: float) -> None:
    """Draw the clamp from above and from the side, with its name."""
    edge = layout.along(-_CLAMP.length)
    top, bottom = (float(layout.place("above", np.array([sign * width, 0.0]))[1]) for sign in (-0.5, 0.5))
    canvas.hatch(edge, top - 2, layout.clamp, bottom + 2, palette.QUIET)
    jaw = float(layout.place("side", np.array([0.0, _CLAMP.height]))[1])
    canvas.hatch(edge, jaw, layout.clamp, layout.blade_end, palette.QUIET)
    canvas.text("clamp", (edge - 4, bottom - 30), size=_LETTERS, colour=palette.QUIET, anchor="midright", upwards=True)


def draw_titles(sheet: Sheet, width: float, side_top: float, *, above: str | None = None) -> None:
    """Draw what the views show, above them; the view from the side begins at ``side_top`` [px].

    ``above`` is the title of the view from above, where it is not the scene's.
    """
    layout, quantities = sheet.layout, sheet.quantities
    top = float(layout.place("above", np.array([-0.5 * width, 0.0]))[1]) - 29
    for words, height in (
        (above or scene_label("above", quantities), top),
        (scene_label("side", quantities), side_top),
    ):
        sheet.canvas.text(words, (layout.clamp, height), size=_LETTERS, colour=palette.QUIET)


def draw_ruler(canvas: Canvas, layout: Layout, length: float) -> None:
    """Draw centimetres from the clamp, for both views and the chart."""
    level = layout.blade_end + 3
    for k in range(round(length / RULER_STEP) + 1):
        x = layout.along(k * RULER_STEP)
        labelled = k % RULER_LABELLED == 0
        canvas.line(np.array([[x, level], [x, level + (7 if labelled else 4)]]), palette.INK)
        if labelled:
            words = f"{100 * k * RULER_STEP:.0f}" if k else "0 cm"
            canvas.text(words, (x, level + 8), size=_LETTERS, anchor="midtop")


def draw_from_above(sheet: Sheet, slab: Slab) -> None:
    """Draw the displaced slab, and everything upon it."""
    quantities = sheet.quantities
    displacement = slab.displacement(quantities["tip"], quantities["lag"])
    _draw_tissue(sheet.canvas, sheet.layout, quantities["tip"], slab, displacement)
    values = quantities | {"half_width": 0.5 * slab.model.width}
    draw_parts(sheet._replace(quantities=values), "above", tissue=(slab, displacement))


def draw_from_the_side(sheet: Sheet, box: tuple[float, float]) -> None:
    """Draw the blade at its angle, the target, and the rest; only within ``box``, its upper and its right end [px]."""
    sheet.canvas.clip(0, box[0], box[1], sheet.layout.blade_end + 1)
    draw_parts(sheet, "side")
    sheet.canvas.unclip()


def draw_parts(sheet: Sheet, view: str, *, standing: bool = False, tissue: tuple[Slab, Points] | None = None) -> None:
    """Draw the parts of a view; either those that stay during a cut or the others.

    Parameters
    ----------
    sheet : Sheet
    view : {"above", "side", "chart"}
    standing : bool
        True for the parts that stay.
    tissue : tuple, optional
        Slab and displacement of its lattice, for parts that it carries.
    """
    canvas, layout, quantities = sheet.canvas, sheet.layout, sheet.quantities
    if view == "chart":
        canvas.clip(layout.clamp, layout.chart_top, layout.column - 4, layout.chart_bottom)
    for part in PARTS:
        if part.view == view and part.standing is standing and (not part.shown or part.shown in sheet.shown):
            places, own = rest_places(part, quantities)
            if part.carried and tissue is not None:
                slab, displacement = tissue
                places = slab.carried(displacement, quantities["tip"], own[:, 0], places)
            chart = quantities["chart_low"], quantities["chart_high"]
            _draw_part(sheet, part, layout.place(view, places, chart))
    if view == "chart":
        canvas.unclip()


def _draw_part(sheet: Sheet, part: ScenePart, points: Points) -> None:
    canvas, colours = sheet.canvas, palette.LIGHT | {"tint": sheet.blade}
    if part.words:
        at = float(points[0, 0]), float(points[0, 1]) - (3 if part.align == "center" else 0)
        anchor, size = _ANCHORS[part.align], _LABEL_LETTERS if part.carried else _LETTERS
        canvas.text(scene_label(part.words, sheet.quantities), at, size=size, colour=colours[part.line], anchor=anchor)
        return
    for outline in points[:, None, :] + np.array(part.mark) if part.mark else [points]:
        edge = colours[part.line] if part.line else None
        if part.fill:
            canvas.area(outline, colours[part.fill], edge, opacity=part.opacity)
        elif edge is not None and part.dash:
            canvas.dashes(outline, edge, dash=part.dash, width=part.width)
        elif edge is not None:
            canvas.line(outline, edge, part.width)


def _draw_tissue(canvas: Canvas, layout: Layout, tip: float, slab: Slab, displacement: Points) -> None:
    lattice = layout.place("above", slab.opened(slab.rest + displacement, tip))
    rows, columns = lattice.shape[1] - 1, lattice.shape[2] - 1
    cells = np.stack([lattice[:, i : i + rows, j : j + columns] for i, j in _CORNERS], axis=-2)
    amount = np.hypot(displacement[..., 0], displacement[..., 1])
    mean = np.mean([amount[:, i : i + rows, j : j + columns] for i, j in _CORNERS], axis=0)
    shades = len(palette.TISSUE) * mean / LARGEST_DISPLACEMENT
    shades = np.clip(shades, 0, len(palette.TISSUE) - 1).astype(np.int64)
    canvas.cells(cells.reshape(-1, 4, 2), [palette.TISSUE[k] for k in shades.ravel().tolist()])
    across, along = slab.subdivisions
    for side in lattice:
        for line in (*side[::across], *side[:, ::along].swapaxes(0, 1)):
            canvas.line(line, palette.MESH)


def draw_tip(canvas: Canvas, at: Points) -> None:
    """Draw the mark of the crack tip, as in the legend."""
    (tip,) = (part for part in PARTS if part.name == "tip")
    canvas.area(at + np.array(tip.mark), palette.TIP, palette.INK)


def draw_band(canvas: Canvas, middle: float, half: float, top: float, bottom: float) -> None:
    """Draw a line with a band around it, as in the legend."""
    low, high = middle - half, middle + half
    band = np.array([[low, top], [high, top], [high, bottom], [low, bottom]])
    canvas.area(band, palette.TARGET, opacity=0.3)
    canvas.line(np.array([[middle, top], [middle, bottom]]), palette.TARGET, 2.0)
