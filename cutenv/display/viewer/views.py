"""Views of a cut on a canvas: parts, words, numbers."""

from __future__ import annotations

import itertools
import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from cutenv._base.arrays import Array
from cutenv.display.viewer import palette
from cutenv.display.viewer.canvas import Canvas, Points
from cutenv.display.viewer.drawn_slab import Slab
from cutenv.display.viewer.palette import Colour
from cutenv.display.viewer.scene import ForceTrace, Layout, Moment, rest_places, scene_label
from cutenv.display.viewer.scene_parts import (
    CHORD,
    CLAMP,
    LARGEST_DISPLACEMENT,
    PARTS,
    RULER_LABELLED,
    RULER_STEP,
    TINT,
    WORDS,
    SceneFormula,
    ScenePart,
)
from cutenv.sim.quantities import TIP_TOLERANCE
from cutenv.sim.tissue.grid import LENGTH, depth_below
from cutenv.task.episode import ShownPath

_LETTERS, _LABEL_LETTERS = 16, 19
_CORNERS = ((0, 0), (1, 0), (1, 1), (0, 1))  # corners of a cell, in order around it
_ANCHORS = {"center": "midbottom", "left": "midleft"}
_TINT = [(role, SceneFormula(text)) for role, text in TINT]


class Sheet(NamedTuple):
    """Canvas with the moment to be drawn on it."""

    canvas: Canvas
    layout: Layout
    quantities: dict[str, Any]  # those of the moment
    shown: Collection[str] = ()  # conditions that hold: "truth", "hand", "force", "layer", and the moment's
    blade: Colour = palette.STEEL


def tint(force: float, quantities: Mapping[str, Any]) -> Colour:
    """Return the blade's colour at a force [N]."""
    stops = [formula(quantities) for _, formula in _TINT]
    channels = zip(*(palette.LIGHT[role] for role, _ in _TINT), strict=True)
    red, green, blue = (round(float(np.interp(abs(force), stops, channel))) for channel in channels)
    return red, green, blue


def draw_clamp(canvas: Canvas, layout: Layout, width: float) -> None:
    """Draw the clamp in both views, with its name."""
    edge = layout.along(-CLAMP["length"])
    top, bottom = (float(layout.place("above", np.array([sign * width, 0.0]))[1]) for sign in (-0.5, 0.5))
    canvas.hatch(edge, top - 2, layout.clamp, bottom + 2, palette.QUIET)
    jaw = float(layout.place("side", np.array([0.0, CLAMP["height"]]))[1])
    canvas.hatch(edge, jaw, layout.clamp, layout.blade_end, palette.QUIET)
    canvas.text("clamp", (edge - 4, bottom - 30), size=_LETTERS, colour=palette.QUIET, anchor="midright", upwards=True)


def draw_titles(sheet: Sheet, width: float, side_top: float, *, above: str | None = None) -> None:
    """Draw what the views show, above them.

    The view from the side begins at ``side_top`` [px].

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
    """Draw centimetres from the clamp, for views and chart."""
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
    """Draw blade, target and the rest between top and right end [px]."""
    sheet.canvas.clip(0, box[0], box[1], sheet.layout.blade_end + 1)
    draw_parts(sheet, "side")
    sheet.canvas.unclip()


def draw_parts(sheet: Sheet, view: str, *, standing: bool = False, tissue: tuple[Slab, Points] | None = None) -> None:
    """Draw the parts of a view.

    Either those that stay during a cut or the others. ``tissue`` is the slab and the displacement of its lattice, for
    parts that it carries.
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
    """Draw the crack tip's mark, as in the legend."""
    (tip,) = (part for part in PARTS if part.name == "tip")
    canvas.area(at + np.array(tip.mark), palette.TIP, palette.INK)


def draw_band(canvas: Canvas, middle: float, half: float, top: float, bottom: float) -> None:
    """Draw a line with a band, as in the legend."""
    low, high = middle - half, middle + half
    band = np.array([[low, top], [high, top], [high, bottom], [low, bottom]])
    canvas.area(band, palette.TARGET, opacity=0.3)
    canvas.line(np.array([[middle, top], [middle, bottom]]), palette.TARGET, 2.0)


_LINES = 6  # lines of the grid, about


def draw_axes(canvas: Canvas, layout: Layout, moment: Moment, trace: ForceTrace) -> None:
    """Draw axes, force limit and cost threshold, which follow the depth of cut."""
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
    """Draw part of the trace, (position [m], force [N]), shape (n, 2)."""
    if len(force) > 1:
        canvas.line(layout.place("chart", force, trace.range), palette.FORCE)


def draw_present(
    canvas: Canvas, layout: Layout, moment: Moment, trace: ForceTrace, *, force_shown: bool = True
) -> None:
    """Draw the target, and any shown present force."""
    shown = ("force",) if force_shown else ()
    draw_parts(Sheet(canvas, layout, moment.quantities(chart=trace.range), shown), "chart")


PLAN_TITLE = "from above, to scale: tissue at rest"
GIVING_TITLE = "from above, to scale; how the tissue gives way is an illustration"
_HALF_BLADE = 0.001  # [m]
_OUTLINE = np.array([[0.0, 0.0], [-0.4, -1.0], [-1.0, -1.0], [-1.0, 1.0], [-0.4, 1.0]])  # shares of chord, half width
_HAND = np.array([[0.0, 9.0], [-6.0, 20.0], [6.0, 20.0]])  # along and beside the blade [px]
_MESH, _FINE = 0.01, 0.0025  # between lines on the tissue, and between the points of one [m]
_CARRIED = 0.012  # over which the tissue gives way around the tip [m], about that of the model; an illustration


def pixels(layout: Layout, places: Array) -> Array:
    """Return pixels of (along, left) places [m], shape (n, 2)."""
    return layout.place("above", np.stack([-places[..., 1], places[..., 0]], axis=-1))


def draw_plan(
    sheet: Sheet, shown: ShownPath, slab: Slab, *, truth: bool = True, hand: tuple[float, float] | None = None
) -> None:
    """Draw the view.

    With ``truth`` the tissue is at rest, and the hidden tip is marked; else the tissue gives way to the blade, as a
    person sees it, so that the cut reaches the blade; how far around it is an illustration. ``hand`` is the place of
    the hand that leads, along and across [m].
    """
    canvas, layout, width, length = sheet.canvas, sheet.layout, slab.model.width, slab.model.length
    corners = np.array([[0.0, 0.5], [1.0, 0.5], [1.0, -0.5], [0.0, -0.5]]) * (length, width)
    canvas.area(pixels(layout, corners), palette.TISSUE[0], palette.TISSUE_EDGE)
    if not truth:
        for row in _lattice(width, length):
            canvas.line(pixels(layout, _given_way(row, shown)), palette.MESH)
    inside = shown.line[(np.abs(shown.line[:, 1]) <= 0.5 * width) & (shown.line[:, 0] <= length)]
    canvas.dashes(pixels(layout, inside[: shown.target + 1]), palette.TARGET, dash=5.0, width=1.6)
    canvas.dashes(pixels(layout, inside[shown.target :]), palette.QUIET, dash=3.0)
    _draw_target(canvas, layout, shown)
    cut = shown.cut if truth else _given_way(shown.cut, shown)
    if len(cut) > 1:
        canvas.line(pixels(layout, cut), palette.GAP, 3.0)
    ahead = shown.heading / np.hypot(*shown.heading)
    left = np.array([-ahead[1], ahead[0]])
    if truth:
        canvas.line(pixels(layout, np.stack([shown.tip, shown.blade])), palette.QUIET)
    if hand is not None:
        for side in (1.0, -1.0):
            mark = np.array(hand) + side * (_HAND[:, :1] * ahead + _HAND[:, 1:] * left) / layout.scale
            canvas.area(pixels(layout, mark), palette.HAND, palette.INK)
    outline = shown.blade + CHORD * _OUTLINE[:, :1] * ahead + _HALF_BLADE * _OUTLINE[:, 1:] * left
    canvas.area(pixels(layout, outline), sheet.blade, palette.INK)
    if truth:
        tip = pixels(layout, shown.tip)
        draw_tip(canvas, tip)
        at = float(tip[0]) - 6, float(tip[1]) + 16
        canvas.text("tip", at, size=_LETTERS, colour=palette.INK, anchor="midright")


def _lattice(width: float, length: float) -> list[Array]:
    """Return lines along and across the slab, shape (n, 2) each [m]."""
    along, across = np.arange(0.0, length + _FINE, _FINE), np.arange(-0.5 * width, 0.5 * width + _FINE, _FINE)
    rows = [np.column_stack((along, np.full(len(along), y))) for y in np.arange(-0.5 * width, 0.5 * width, _MESH)[1:]]
    columns = [np.column_stack((np.full(len(across), x), across)) for x in np.arange(0.0, length, _MESH)[1:]]
    return rows + columns


def _given_way(places: Array, shown: ShownPath) -> Array:
    """Return places at rest, moved as far as the blade carried them."""
    carried = shown.blade - shown.tip
    if float(carried @ shown.heading) <= 0.0:  # in the open cut the blade carries nothing
        return places
    distance = np.hypot(*(places - shown.tip).T)
    moved: Array = places + carried * np.exp(-distance / _CARRIED)[:, np.newaxis]
    return moved


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
    """Draw names and values at heights [px] in the number column."""
    for (name, value, colour), y in zip(rows, heights, strict=False):
        canvas.text(name, (layout.column, y), size=_NORMAL, colour=palette.QUIET)
        canvas.text(value, (layout.width - _MARGIN, y), size=size, colour=colour, anchor="midright")


def draw_reward(canvas: Canvas, layout: Layout, moment: Moment) -> None:
    """Draw the return and its terms: gains right, costs left."""
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
    """Draw the legend of marks and lines."""
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
    return round(value, digits) + 0.0
