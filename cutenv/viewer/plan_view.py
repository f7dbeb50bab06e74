"""View from above of a cut along a drawn line: the slab at rest, the line, the cut, blade and tip in their places."""

from __future__ import annotations

import numpy as np

from cutenv._base.arrays import Array
from cutenv.task.gentle_cutting import ShownPath
from cutenv.task_quantities import TIP_TOLERANCE
from cutenv.viewer import palette
from cutenv.viewer.canvas import Canvas
from cutenv.viewer.scene import Layout
from cutenv.viewer.scene_parts import CHORD
from cutenv.viewer.views import draw_tip

TITLE = "from above, to scale: tissue at rest"
_HALF_BLADE = 0.001  # [m]
_OUTLINE = np.array([[0.0, 0.0], [-0.4, -1.0], [-1.0, -1.0], [-1.0, 1.0], [-0.4, 1.0]])  # shares of chord, half width
_LETTERS = 16


def pixels(layout: Layout, places: Array) -> Array:
    """Return the pixels of places along and across the slab, to the left [m], shape (n, 2)."""
    return layout.place("above", np.stack([-places[..., 1], places[..., 0]], axis=-1))


def draw_plan(canvas: Canvas, layout: Layout, shown: ShownPath, width: float, length: float) -> None:
    """Draw the view; ``width`` and ``length`` are the slab's [m]."""
    corners = np.array([[0.0, 0.5], [1.0, 0.5], [1.0, -0.5], [0.0, -0.5]]) * (length, width)
    canvas.area(pixels(layout, corners), palette.TISSUE[0], palette.TISSUE_EDGE)
    inside = shown.line[(np.abs(shown.line[:, 1]) <= 0.5 * width) & (shown.line[:, 0] <= length)]
    canvas.dashes(pixels(layout, inside[: shown.target + 1]), palette.TARGET, dash=5.0, width=1.6)
    canvas.dashes(pixels(layout, inside[shown.target :]), palette.QUIET, dash=3.0)
    _draw_target(canvas, layout, shown)
    if len(shown.cut) > 1:
        canvas.line(pixels(layout, shown.cut), palette.GAP, 3.0)
    ahead = shown.heading / np.hypot(*shown.heading)
    left = np.array([-ahead[1], ahead[0]])
    blade = shown.blade + CHORD * _OUTLINE[:, :1] * ahead + _HALF_BLADE * _OUTLINE[:, 1:] * left
    canvas.line(pixels(layout, np.stack([shown.tip, shown.blade])), palette.QUIET)
    canvas.area(pixels(layout, blade), palette.STEEL, palette.INK)
    tip = pixels(layout, shown.tip)
    draw_tip(canvas, tip)
    canvas.text("tip", (float(tip[0]) - 6, float(tip[1]) + 16), size=_LETTERS, colour=palette.INK, anchor="midright")


def _draw_target(canvas: Canvas, layout: Layout, shown: ShownPath) -> None:
    """Draw where the cut is to end, across the line."""
    along = shown.line[shown.target] - shown.line[shown.target - 1]
    along /= np.hypot(*along)
    left = np.array([-along[1], along[0]])
    at = shown.line[shown.target]
    around = ((-1, -1), (1, -1), (1, 1), (-1, 1))
    ends = [at + off * TIP_TOLERANCE * along + side * 0.008 * left for off, side in around]
    canvas.area(pixels(layout, np.array(ends)), palette.TARGET, opacity=0.3)
    canvas.line(pixels(layout, np.stack([at - 0.008 * left, at + 0.008 * left])), palette.TARGET, 2.0)
