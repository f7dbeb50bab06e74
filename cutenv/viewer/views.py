"""Views of a cut: the slab from above, and the blade in it from the side."""

from __future__ import annotations

import math

import numpy as np

from cutenv.tissue.grid import depth_below
from cutenv.viewer import palette
from cutenv.viewer.canvas import Canvas, Colour, Points
from cutenv.viewer.drawn_slab import Slab
from cutenv.viewer.scene import (
    Layout,
    Moment,
    blade_from_above,
    blade_from_the_side,
    front_from_the_side,
    surface,
)

LARGEST_DISPLACEMENT = 0.012
"""Displacement at the dark end of the tissue's colours [m]."""

_CLAMP = 20  # [px]
_LETTERS, _TARGET_LETTERS = 16, 19
_CORNERS = ((0, 0), (1, 0), (1, 1), (0, 1))  # corners of a cell, in order around it


def draw_clamp(canvas: Canvas, layout: Layout, width: float) -> None:
    """Draw the clamp in both views, with their titles."""
    half = 0.5 * layout.scale * width
    top, bottom = layout.cut_line - half, layout.cut_line + half
    canvas.hatch(layout.clamp - _CLAMP, top - 2, layout.clamp, bottom + 2, palette.QUIET)
    canvas.hatch(layout.clamp - _CLAMP, layout.blade_end - 44, layout.clamp, layout.blade_end, palette.QUIET)
    beside = (layout.clamp - _CLAMP - 4, bottom - 30)
    canvas.text("clamp", beside, size=_LETTERS, colour=palette.QUIET, anchor="midright", upwards=True)
    words = "from above: tissue displaced to scale; cut shown open: illustration"
    canvas.text(words, (layout.clamp, top - 29), size=_LETTERS, colour=palette.QUIET)


def draw_section_at_rest(canvas: Canvas, layout: Layout, moment: Moment) -> None:
    """Draw the uncut tissue from the side: the bulge of the liver above the level of the blade's lower end."""
    top = surface(moment.depth)
    section = np.concatenate([top, [[top[-1, 0], 0.0], [0.0, 0.0]]])
    canvas.area(layout.from_the_side(section), palette.TISSUE[0], palette.TISSUE_EDGE)


def draw_ruler(canvas: Canvas, layout: Layout, length: float) -> None:
    """Draw centimetres from the clamp, for both views and the chart."""
    level = layout.blade_end + 3
    for centimetres in range(round(length * 100) + 1):
        x = layout.along(centimetres / 100)
        labelled = centimetres % 5 == 0
        canvas.line(np.array([[x, level], [x, level + (7 if labelled else 4)]]), palette.INK)
        if labelled:
            words = f"{centimetres}" if centimetres else "0 cm"
            canvas.text(words, (x, level + 8), size=_LETTERS, anchor="midtop")


def draw_from_above(canvas: Canvas, layout: Layout, moment: Moment, slab: Slab) -> None:
    """Draw the displaced slab with the target, the open cut, blade and tip."""
    draw_slab(canvas, layout, moment, slab)
    draw_blade_from_above(canvas, layout, moment)
    draw_tip_from_above(canvas, layout, moment, "tip (hidden from the agent)")


def draw_slab(canvas: Canvas, layout: Layout, moment: Moment, slab: Slab) -> None:
    """Draw the displaced slab with the target and the open cut."""
    displacement = slab.displacement(moment.tip, moment.lag)
    _draw_tissue(canvas, layout, moment, slab, displacement)

    tolerance = moment.tolerance
    low, target, high = (
        layout.from_above(slab.line_across(displacement, moment.target + d)) for d in (-tolerance, 0.0, tolerance)
    )
    canvas.area(np.concatenate([low, high[::-1]]), palette.TARGET, opacity=0.3)
    canvas.line(target, palette.TARGET, 2.0)
    words = f"target {moment.target * 1e3:.1f} ± {tolerance * 1e3:.0f} mm"
    above = (float(target[0, 0]), float(target[0, 1]) - 3)
    canvas.text(words, above, size=_TARGET_LETTERS, colour=palette.TARGET, anchor="midbottom")

    canvas.area(layout.from_above(slab.cut_outline(displacement, moment.tip)), palette.GAP)


def draw_blade_from_above(canvas: Canvas, layout: Layout, moment: Moment, colour: Colour = palette.STEEL) -> None:
    """Draw the blade's section at the surface, and the part above it."""
    depth = depth_below(moment.depth, moment.blade)
    section, overhang = blade_from_above(moment.blade, moment.angle, depth)
    canvas.area(layout.from_above(section), colour, palette.INK)
    canvas.area(layout.from_above(overhang), palette.STEEL_LIGHT, palette.INK, opacity=0.5)


def draw_tip_from_above(canvas: Canvas, layout: Layout, moment: Moment, words: str) -> None:
    """Draw the tip where the blade has carried it, with its label."""
    tip = layout.from_above(np.array([0.0, moment.tip + moment.lag]))
    beside = np.array([min(float(tip[0]) + 16, 470.0), float(tip[1]) - 38])
    canvas.line(np.stack([tip, beside + np.array([4.0, 8.0])]), palette.INK)
    draw_tip(canvas, tip)
    canvas.text(words, (beside[0], beside[1]), size=_LETTERS, ground=palette.PAPER)


def _draw_tissue(canvas: Canvas, layout: Layout, moment: Moment, slab: Slab, displacement: Points) -> None:
    lattice = layout.from_above(slab.opened(slab.rest + displacement, moment.tip))
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


def draw_from_the_side(canvas: Canvas, layout: Layout, moment: Moment) -> None:
    """Draw the cut part of the tissue at rest, the target, the blade at its angle, and the tip behind it."""
    draw_target(canvas, layout, moment, layout.blade_end - 84, layout.blade_end)
    cut = front_from_the_side(moment.tip, moment.angle, moment.depth)
    canvas.area(layout.from_the_side(cut), palette.CUT_FACE)

    depth = depth_below(moment.depth, moment.blade)
    blade = layout.from_the_side(blade_from_the_side(moment.blade, moment.angle, depth))
    canvas.clip(0, layout.blade_end - 116, layout.column - 20, layout.blade_end + 1)
    canvas.area(blade, palette.STEEL, palette.INK)
    canvas.unclip()

    tip = layout.from_the_side(np.array([moment.tip, depth_below(moment.depth, moment.tip)]))
    edge = layout.from_the_side(np.array([moment.blade, depth]))
    if moment.lag > 0.0:
        canvas.line(np.stack([tip, edge]), palette.INK, 3.0)
        ahead = (float(edge[0]) + 8, min(float(edge[1]) + 14, layout.blade_end - 9))
        canvas.text(f"lag {moment.lag * 1e3:.1f} mm", ahead, size=_LETTERS)
    draw_tip(canvas, tip)
    words = f"from the side: tissue at rest, blade at {math.degrees(moment.angle):.0f}°"
    canvas.text(words, (layout.clamp, layout.blade_end - 127), size=_LETTERS, colour=palette.QUIET)


def draw_tip(canvas: Canvas, at: Points) -> None:
    """Draw the mark of the crack tip, which is hidden from agents."""
    canvas.area(at + 6.0 * np.array([[0, -1], [1, 0], [0, 1], [-1, 0]]), palette.TIP, palette.INK)


def draw_target(canvas: Canvas, layout: Layout, moment: Moment, top: float, bottom: float) -> None:
    """Draw the target line with its tolerance, at its position in tissue at rest."""
    low, middle, high = (layout.along(moment.target + d) for d in (-moment.tolerance, 0.0, moment.tolerance))
    draw_band(canvas, low, middle, high, top, bottom)


def draw_band(canvas: Canvas, low: float, middle: float, high: float, top: float, bottom: float) -> None:
    """Draw a line with a band around it."""
    band = np.array([[low, top], [high, top], [high, bottom], [low, bottom]])
    canvas.area(band, palette.TARGET, opacity=0.3)
    canvas.line(np.array([[middle, top], [middle, bottom]]), palette.TARGET, 2.0)
