"""Words and numbers beside the views: task and end, measured quantities, reward by term, legend."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence

import numpy as np

from cutenv.tissue.grid import depth_below
from cutenv.viewer import palette
from cutenv.viewer.canvas import Canvas
from cutenv.viewer.palette import Colour
from cutenv.viewer.scene import Layout, Moment
from cutenv.viewer.scene_parts import LARGEST_DISPLACEMENT
from cutenv.viewer.views import draw_band, draw_tip

_SMALL, _NORMAL = 16, 19
_MARGIN = 16  # [px]
_NUMBERS, _REWARD, _LEGEND = 72, 286, 604  # [px] from the top to the parts of the column
_TERM_HEIGHT = 20  # [px] height of a row of the reward
_REWARD_REACH = 62  # [px] length of a bar for a term of 1


def draw_header(canvas: Canvas, layout: Layout, moment: Moment) -> None:
    """Draw the task, or how it ended; and the time."""
    ground = palette.HEADER_COLOUR
    if moment.end:
        ground = palette.SUCCESS if moment.success else palette.FAILURE
    canvas.bar(0, 0, layout.width, layout.header, ground)
    middle = layout.header / 2 + 1
    words = moment.verdict or f"Cut gently, until the tip stands at {moment.target * 1e3:.1f} mm"
    canvas.text(words, (_MARGIN, middle), size=25, colour=palette.PAPER)
    clock = f"{moment.time:.1f} s of {moment.deadline:.0f} s"
    canvas.text(clock, (layout.width - _MARGIN, middle), size=20, colour=palette.PAPER, anchor="midright")


def draw_numbers(canvas: Canvas, layout: Layout, moment: Moment) -> None:
    """Draw force, motion and positions."""
    left, right, top = layout.column, layout.width - _MARGIN, _NUMBERS
    limit = moment.force_limit_per_depth * depth_below(moment.depth, moment.blade)
    canvas.text(f"{_rounded(moment.force, 2):.2f} N", (left, top + 9), size=46, colour=palette.FORCE)
    beside = (("force on the blade", palette.QUIET), (f"limit {limit:.2f} N", palette.LIMIT))
    for k, (words, colour) in enumerate(beside):
        canvas.text(words, (right, top + 20 * k), size=_SMALL, colour=colour, anchor="midright")
    rows: tuple[tuple[str, str, Colour], ...] = (
        ("speed", f"{_rounded(moment.speed * 100, 2):.2f} cm/s", palette.INK),
        ("angle of the blade", f"{math.degrees(moment.angle):.0f}°", palette.INK),
        ("blade", f"{moment.blade * 1e3:.1f} mm", palette.INK),
        ("tip (hidden)", f"{moment.tip * 1e3:.1f} mm", palette.INK),
        ("target", f"{moment.target * 1e3:.1f} mm", palette.TARGET),
    )
    draw_rows(canvas, layout, itertools.count(top + 56, 27), rows, size=22)


def draw_rows(
    canvas: Canvas, layout: Layout, heights: Iterator[float], rows: Sequence[tuple[str, str, Colour]], size: int
) -> None:
    """Draw names and values at these heights [px], one below the other, in the column of the numbers."""
    for (name, value, colour), y in zip(rows, heights, strict=False):
        canvas.text(name, (layout.column, y), size=_NORMAL, colour=palette.QUIET)
        canvas.text(value, (layout.width - _MARGIN, y), size=size, colour=colour, anchor="midright")


def draw_reward(canvas: Canvas, layout: Layout, moment: Moment) -> None:
    """Draw the return so far and its terms: gains to the right of the line, costs to the left."""
    left, right, top = layout.column, layout.width - _MARGIN, _REWARD
    canvas.text("return so far", (left, top), size=_NORMAL, colour=palette.QUIET)
    canvas.text(f"{_rounded(sum(moment.totals.values()), 3):.3f}", (right, top), size=30, anchor="midright")
    zero, bottom = left + 150, top + 24 + _TERM_HEIGHT * len(moment.totals)
    canvas.line(np.array([[zero, top + 22], [zero, bottom]]), palette.QUIET)
    for k, (name, value) in enumerate(moment.totals.items()):
        y = top + 36 + _TERM_HEIGHT * k
        end = zero + _REWARD_REACH * min(max(value, -1.0), 1.0)
        colour = palette.GAIN if value > 0.0 else palette.LOSS
        canvas.text(name.replace("_", " "), (left, y), size=_SMALL, colour=palette.QUIET)
        canvas.bar(min(zero, end), y - 6, max(zero, end), y + 7, colour)
        shown = _rounded(value, 3)
        canvas.text(f"{shown:+.3f}" if shown else "0", (right, y), size=_SMALL, anchor="midright")


def draw_legend(canvas: Canvas, layout: Layout) -> None:
    """Draw the legend of the marks and lines in views and chart."""
    left, top = layout.column, _LEGEND
    right, middle = left + len(palette.TISSUE), left + 0.5 * len(palette.TISSUE)
    draw_tip(canvas, np.array([middle, top]))
    draw_band(canvas, middle, 11, top + 15, top + 33)
    for k, colour in enumerate(palette.TISSUE):
        canvas.bar(left + k, top + 41, left + k + 1, top + 56, colour)
    canvas.line(np.array([[left, top + 72], [right, top + 72]]), palette.LIMIT, 2.0)
    canvas.dashes(np.array([[left, top + 96], [right, top + 96]]), palette.COST_COLOUR, width=2.0)
    meanings = (
        "tip, hidden from the agent",
        "target and its tolerance",
        f"displacement, 0 to {LARGEST_DISPLACEMENT * 1e3:.0f} mm",
        "force limit",
        "force above this costs",
    )
    for k, words in enumerate(meanings):
        canvas.text(words, (right + 14, top + 24 * k), size=_SMALL, colour=palette.QUIET)


def _rounded(value: float, digits: int) -> float:
    """Return a rounded value, with a zero without a sign."""
    return round(value, digits) + 0.0
