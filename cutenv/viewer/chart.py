"""Chart of the force over the position of the blade, below the views and at their scale."""

from __future__ import annotations

import math

import numpy as np

from cutenv.viewer import palette
from cutenv.viewer.canvas import Canvas, Points
from cutenv.viewer.scene import ForceTrace, Layout, Moment, surface
from cutenv.viewer.views import draw_target

_LETTERS = 16
_LINES = 6  # lines of the grid, about


def draw_axes(canvas: Canvas, layout: Layout, moment: Moment, trace: ForceTrace) -> None:
    """Draw the axes, the force limit, and the force above which costs begin; both follow the depth of cut."""
    limit = surface(moment.depth)
    left, right = layout.clamp, layout.along(float(limit[-1, 0]))
    title = "force [N] over the position of the blade"
    canvas.text(title, (left, layout.chart_top - 11), size=_LETTERS, colour=palette.QUIET)
    canvas.bar(left, layout.chart_top, right, layout.chart_bottom, palette.PANEL)
    step = next(s for s in (2, 5, 10, 20, 50, 100, 1000) if (trace.high - trace.low) / s < _LINES)
    for newtons in range(math.ceil(trace.low / step) * step, math.floor(trace.high) + 1, step):
        y = float(layout.in_chart(np.array([0.0, newtons]), trace.low, trace.high)[1])
        canvas.line(np.array([[left, y], [right, y]]), palette.RULE if newtons else palette.INK)
        canvas.text(f"{newtons}", (left - 6, y), size=_LETTERS, anchor="midright")

    def at(force_per_depth: float) -> Points:
        return layout.in_chart(limit * np.array([1.0, force_per_depth]), trace.low, trace.high)

    canvas.clip(left, layout.chart_top, right, layout.chart_bottom)
    canvas.line(at(moment.force_limit_per_depth), palette.LIMIT, 2.0)
    canvas.dashes(at(moment.force_allowed_per_depth), palette.COST_COLOUR, width=2.0)
    canvas.unclip()


def draw_force(canvas: Canvas, layout: Layout, trace: ForceTrace, force: Points) -> None:
    """Draw part of the trace: (position of the blade [m], force [N]), shape (n, 2)."""
    if len(force) > 1:
        canvas.line(layout.in_chart(force, trace.low, trace.high), palette.FORCE)


def draw_present(
    canvas: Canvas, layout: Layout, moment: Moment, trace: ForceTrace, *, force_shown: bool = True
) -> None:
    """Draw the target, and the present force if it is shown."""
    draw_target(canvas, layout, moment, layout.chart_top, layout.chart_bottom)
    if not force_shown:
        return
    now = layout.in_chart(np.array([moment.blade, moment.force]), trace.low, trace.high)
    canvas.line(np.array([[now[0], layout.chart_top], now]), palette.QUIET)
    canvas.disc(now, 5, palette.FORCE)
