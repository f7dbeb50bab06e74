"""Chart of the force over the position of the blade, below the views and at their scale."""

from __future__ import annotations

import math

import numpy as np

from cutenv.tissue.grid import LENGTH
from cutenv.viewer import palette
from cutenv.viewer.canvas import Canvas, Points
from cutenv.viewer.scene import ForceTrace, Layout, Moment
from cutenv.viewer.scene_parts import WORDS
from cutenv.viewer.views import Sheet, draw_parts

_LETTERS = 16
_LINES = 6  # lines of the grid, about


def draw_axes(canvas: Canvas, layout: Layout, moment: Moment, trace: ForceTrace) -> None:
    """Draw the axes, the force limit, and the force above which costs begin; both follow the depth of cut."""
    left, right = layout.clamp, layout.along(LENGTH)
    canvas.text(WORDS["chart"], (left, layout.chart_top - 11), size=_LETTERS, colour=palette.QUIET)
    canvas.bar(left, layout.chart_top, right, layout.chart_bottom, palette.PANEL)
    step = next(s for s in (2, 5, 10, 20, 50, 100, 1000) if (trace.high - trace.low) / s < _LINES)
    for newtons in range(math.ceil(trace.low / step) * step, math.floor(trace.high) + 1, step):
        y = float(layout.place("chart", np.array([0.0, newtons]), trace.range)[1])
        canvas.line(np.array([[left, y], [right, y]]), palette.RULE if newtons else palette.INK)
        canvas.text(f"{newtons}", (left - 6, y), size=_LETTERS, anchor="midright")
    draw_parts(Sheet(canvas, layout, moment.quantities(chart=trace.range)), "chart", standing=True)


def draw_force(canvas: Canvas, layout: Layout, trace: ForceTrace, force: Points) -> None:
    """Draw part of the trace: (position of the blade [m], force [N]), shape (n, 2)."""
    if len(force) > 1:
        canvas.line(layout.place("chart", force, trace.range), palette.FORCE)


def draw_present(
    canvas: Canvas, layout: Layout, moment: Moment, trace: ForceTrace, *, force_shown: bool = True
) -> None:
    """Draw the target, and the present force if it is shown."""
    shown = ("force",) if force_shown else ()
    draw_parts(Sheet(canvas, layout, moment.quantities(chart=trace.range), shown), "chart")
