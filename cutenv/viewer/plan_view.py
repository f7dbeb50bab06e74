"""View from above of a cut along a drawn line: the slab at rest, the line, the cut, blade and tip in their places."""

from __future__ import annotations

import numpy as np

from cutenv._base.arrays import Array
from cutenv.task.episode import ShownPath
from cutenv.task_quantities import TIP_TOLERANCE
from cutenv.viewer import palette
from cutenv.viewer.canvas import Canvas
from cutenv.viewer.drawn_slab import Slab
from cutenv.viewer.scene import Layout
from cutenv.viewer.scene_parts import CHORD
from cutenv.viewer.views import Sheet, draw_tip

TITLE = "from above, to scale: tissue at rest"
GIVING_TITLE = "from above, to scale; how the tissue gives way is an illustration"
_HALF_BLADE = 0.001  # [m]
_OUTLINE = np.array([[0.0, 0.0], [-0.4, -1.0], [-1.0, -1.0], [-1.0, 1.0], [-0.4, 1.0]])  # shares of chord, half width
_HAND = np.array([[0.0, 9.0], [-6.0, 20.0], [6.0, 20.0]])  # along and beside the blade [px]
_LETTERS = 16
_MESH, _FINE = 0.01, 0.0025  # between lines on the tissue, and between the points of one [m]
_CARRIED = 0.012  # over which the tissue gives way around the tip [m], about that of the model; an illustration


def pixels(layout: Layout, places: Array) -> Array:
    """Return the pixels of places along and across the slab, to the left [m], shape (n, 2)."""
    return layout.place("above", np.stack([-places[..., 1], places[..., 0]], axis=-1))


def draw_plan(
    sheet: Sheet, shown: ShownPath, slab: Slab, *, truth: bool = True, hand: tuple[float, float] | None = None
) -> None:
    """Draw the view.

    Parameters
    ----------
    sheet : Sheet
    shown : ShownPath
    slab : Slab
    truth : bool
        True: the tissue is at rest, and the hidden tip is marked. False: the tissue gives way to the blade, as a person
        sees it, so that the cut reaches the blade; how far around it is an illustration.
    hand : tuple of float, optional
        Place of the hand that leads, along and across [m].
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
    """Return lines on the tissue, along and across the slab, each of shape (n, 2) [m]."""
    along, across = np.arange(0.0, length + _FINE, _FINE), np.arange(-0.5 * width, 0.5 * width + _FINE, _FINE)
    rows = [np.column_stack((along, np.full(len(along), y))) for y in np.arange(-0.5 * width, 0.5 * width, _MESH)[1:]]
    columns = [np.column_stack((np.full(len(across), x), across)) for x in np.arange(0.0, length, _MESH)[1:]]
    return rows + columns


def _given_way(places: Array, shown: ShownPath) -> Array:
    """Return places in the tissue at rest where the blade has carried them; the tip is carried to the blade."""
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
