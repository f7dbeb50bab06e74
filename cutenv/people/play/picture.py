"""Picture of a cut by a person.

Tissue from above, handle from the side, force as colour, bar and trace.
"""

from __future__ import annotations

import itertools
import math

import numpy as np

from cutenv.display.viewer import palette, views
from cutenv.display.viewer.canvas import Canvas, Points
from cutenv.display.viewer.drawn_slab import Slab, drawn_slab_of
from cutenv.display.viewer.palette import Colour
from cutenv.display.viewer.scene import ForceTrace, Layout, Moment
from cutenv.display.viewer.views import draw_rows
from cutenv.people.play.overlays import draw_countdown, draw_end_card, draw_ready_card
from cutenv.people.play.view_state import ViewState
from cutenv.sim.tissue.grid import depth_below

LAYOUT = Layout(
    scale=3200.0, cut_line=214.0, blade_end=572.0, chart_top=618.0, chart_bottom=692.0, column=600.0
)  # fmt: skip
HELP = "space: next   {choices}m: free mouse   F11: full screen   esc: end        mouse: hand   {wheel}"
_CHOICES = "r: again   c: class   p: practice   "

_SMALL, _NORMAL = 16, 19
_MARGIN = 16
_SIDE_TOP = 358.0  # [px] top of the side view
_RECENT = 6.0  # [s] of the trace over time


class PlayPicture:
    """Painter of a session's picture; needs no display.

    Without practice the tip is not marked: as for a surgeon, only the motion of the tissue shows it.
    """

    def __init__(self) -> None:
        self.layout = LAYOUT
        self._practised = False
        self._canvas = Canvas(self.layout.width, self.layout.height, palette.PAPER)
        self._serial = 0
        self._drawn = 0
        self._slab: Slab
        self._trace: ForceTrace
        self._standing: Canvas

    def draw(self, sight: ViewState) -> Canvas:
        """Return this moment's picture, on a canvas reused next call."""
        moment, canvas, layout = sight.moment, self._canvas, self.layout
        self._keep_up(sight)
        canvas.paste(self._standing)
        shown = {"hand", *moment.conditions} | ({"truth"} if sight.practice else set())
        quantities = moment.quantities(hand=sight.hand, angle=None if sight.pose is None else sight.pose.angle)
        tint = views.tint(moment.force, quantities) if sight.shown.force else palette.STEEL
        sheet = views.Sheet(canvas, layout, quantities, shown, tint)
        above = None
        if moment.shown_path is None:
            views.draw_from_above(sheet, self._slab)
        else:
            above = views.PLAN_TITLE if sight.practice else views.GIVING_TITLE
            views.draw_plan(sheet, moment.shown_path, self._slab, truth=sight.practice, hand=sight.hand_place)
        views.draw_from_the_side(sheet, (_SIDE_TOP + 6.0, layout.column - 16))
        views.draw_titles(sheet, self._slab.model.width, _SIDE_TOP - 2, above=above)
        views.draw_present(canvas, layout, moment, self._trace, force_shown=sight.shown.trace)
        _draw_header(canvas, layout, sight)
        _draw_title(canvas, layout, sight)
        if sight.shown.force:
            _draw_force(canvas, layout, moment, tint)
        if sight.shown.trace:
            _draw_recent(canvas, layout, sight, self._trace.high)
        else:
            canvas.text(sight.feedback_words, (layout.column, 230), size=_NORMAL, colour=palette.QUIET)
        _draw_numbers(canvas, layout, sight)
        _draw_missing(canvas, layout, sight)
        if sight.leader and sight.phase == "cutting":
            at, colour = (layout.column - 24, layout.header + 16), palette.TARGET
            canvas.text(sight.leader, at, size=20, colour=colour, anchor="midright", ground=palette.PAPER)
        if sight.practice:
            _draw_hidden(canvas, layout, sight)
        else:
            _draw_advice(canvas, layout, moment, shared=bool(sight.leader))
        if sight.phase == "ready":
            draw_ready_card(canvas, layout, sight)
        elif sight.phase == "countdown":
            draw_countdown(canvas, layout, sight)
        elif sight.phase == "ended":
            draw_end_card(canvas, layout, sight)
        return canvas

    def _keep_up(self, sight: ViewState) -> None:
        """Draw a cut's fixed parts once, and extend the force trace."""
        fresh = sight.serial != self._serial or sight.practice != self._practised
        self._practised = sight.practice
        if sight.serial != self._serial:
            self.layout = LAYOUT if sight.moment.shown_depth is None else LAYOUT.with_depth()
            self._serial, self._drawn = sight.serial, 0
            self._trace = ForceTrace()
            self._slab = drawn_slab_of(sight.model)
        scale = self._trace.low, self._trace.high
        # A hidden force does not stretch the axis either: all of it is drawn once it is shown.
        new = sight.readings[self._drawn :] if sight.shown.trace else sight.readings[:0]
        felt = self._trace.add(new if len(new) else None)
        self._drawn += len(new)
        if fresh or (self._trace.low, self._trace.high) != scale:
            self._standing = self._draw_standing(sight)
            views.draw_force(self._standing, self.layout, self._trace, self._trace.whole())
        elif felt:
            views.draw_force(self._standing, self.layout, self._trace, self._trace.latest())

    def _draw_standing(self, sight: ViewState) -> Canvas:
        layout, model, moment = self.layout, self._slab.model, sight.moment
        canvas = Canvas(layout.width, layout.height, palette.PAPER)
        views.draw_clamp(canvas, layout, model.width)
        shown = ("layer",) if sight.practice and moment.conditions else ()
        views.draw_parts(views.Sheet(canvas, layout, moment.quantities(), shown), "side", standing=True)
        views.draw_ruler(canvas, layout, model.length)
        views.draw_axes(canvas, layout, moment, self._trace)
        wheel = "wheel: tilt   arrows: hand" if moment.shown_path is not None else "wheel, arrows: tilt"
        wheel = "wheel, arrows: depth, with shift tilt" if moment.conditions else wheel
        words = HELP.format(choices="" if sight.task else _CHOICES, wheel=wheel)
        canvas.text(words, (layout.clamp - 20, layout.height - 13), size=_SMALL, colour=palette.QUIET)
        return canvas


def _draw_header(canvas: Canvas, layout: Layout, sight: ViewState) -> None:
    moment = sight.moment
    ground, words = palette.HEADER_COLOUR, f"Cut gently, until the tip stands at {moment.target * 1e3:.1f} mm"
    if sight.phase == "ended":
        ground = palette.SUCCESS if moment.success else palette.FAILURE
        words = moment.verdict or "given up"
        if not sight.shown.result:
            ground, words = palette.HEADER_COLOUR, "the cut has ended"
    canvas.bar(0, 0, layout.width, layout.header, ground)
    middle = layout.header / 2 + 1
    canvas.text(words[:1].upper() + words[1:], (_MARGIN, middle), size=25, colour=palette.PAPER)
    clock = f"{moment.time:.1f} s of {moment.deadline:.0f} s"
    canvas.text(clock, (layout.width - _MARGIN, middle), size=20, colour=palette.PAPER, anchor="midright")
    if sight.practice:
        badge = (layout.width - _MARGIN - 150, middle)
        canvas.text(
            "PRACTICE", badge, size=18, colour=palette.HEADER_COLOUR, anchor="midright", ground=palette.COST_COLOUR
        )


def _draw_title(canvas: Canvas, layout: Layout, sight: ViewState) -> None:
    """Draw what is cut, and by whom."""
    title = sight.specimen_class if sight.task else f"{sight.specimen_class}, number {sight.number + 1}"
    if sight.count is not None:
        title += f"; {sight.finished} of {sight.count} cut"
    canvas.text(title, (layout.column, 62), size=_NORMAL, colour=palette.INK)
    if sight.operator:
        right = layout.width - _MARGIN
        canvas.text(sight.operator, (right, 62), size=_NORMAL, colour=palette.QUIET, anchor="midright")


def _draw_force(canvas: Canvas, layout: Layout, moment: Moment, tint: Colour) -> None:
    """Draw the force as number and as bar, coloured by load."""
    left, right, force = layout.column, layout.width - _MARGIN, moment.force
    depth = depth_below(moment.depth, moment.blade)
    allowed, limit = moment.force_allowed_per_depth * depth, moment.force_limit_per_depth * depth
    canvas.text(f"{round(force, 2) + 0.0:.2f} N", (left, 98), size=46, colour=palette.FORCE)
    canvas.text("force on the blade", (right, 90), size=_SMALL, colour=palette.QUIET, anchor="midright")
    canvas.text(f"limit here {limit:.1f} N", (right, 110), size=_SMALL, colour=palette.LIMIT, anchor="midright")

    top, bottom = 124.0, 144.0
    scale = (right - left) / (1.1 * limit)
    canvas.bar(left, top, right, bottom, palette.PANEL)
    canvas.bar(left, top, left + scale * min(abs(force), 1.1 * limit), bottom, tint)
    canvas.dashes(_upright(left + scale * allowed, top - 3, bottom + 3), palette.COST_COLOUR, dash=4.0, width=2.0)
    canvas.line(_upright(left + scale * limit, top - 3, bottom + 3), palette.LIMIT, 2.0)
    canvas.text("costs", (left + scale * allowed, bottom + 11), size=14, colour=palette.QUIET, anchor="center")
    canvas.text("limit", (left + scale * limit, bottom + 11), size=14, colour=palette.QUIET, anchor="center")


def _upright(x: float, top: float, bottom: float) -> Points:
    return np.array([[x, top], [x, bottom]])


def _draw_recent(canvas: Canvas, layout: Layout, sight: ViewState, highest: float) -> None:
    """Draw the force over the last seconds, up to ``highest`` [N]."""
    left, right, top, bottom = layout.column + 16.0, float(layout.width - _MARGIN), 190.0, 272.0
    canvas.text(f"force [N], last {_RECENT:.0f} s", (left, top - 10), size=14, colour=palette.QUIET)
    canvas.bar(left, top, right, bottom, palette.PANEL)
    readings = sight.readings[-round(_RECENT * 1000) :: 10]
    zero = bottom - 8.0
    step = 2 if highest <= 8.0 else 5
    for newtons in range(0, int(highest) + 1, step):
        y = zero - (zero - top) * newtons / highest
        canvas.line(np.array([[left, y], [right, y]]), palette.RULE if newtons else palette.QUIET)
        canvas.text(f"{newtons}", (left - 5, y), size=14, colour=palette.QUIET, anchor="midright")
    if len(readings) > 1:
        now = sight.readings["time"][-1]
        places = right - (right - left) * (now - readings["time"]) / _RECENT
        heights = zero - (zero - top) * readings["force"] / highest
        canvas.clip(left, top, right, bottom)
        canvas.line(np.stack([places, heights], axis=-1), palette.FORCE)
        canvas.unclip()


def _draw_numbers(canvas: Canvas, layout: Layout, sight: ViewState) -> None:
    moment = sight.moment
    to_target = (moment.target - moment.blade) * 1e3
    ahead = f"{round((sight.hand - moment.blade) * 1e3, 1) + 0.0:.1f} mm"
    rows: list[tuple[str, str, Colour]] = [
        ("blade to target", f"{round(to_target, 1) + 0.0:.1f} mm", palette.TARGET),
        (
            "hand ahead of the blade",
            ahead if sight.shown.force else "not shown",
            palette.HAND,
        ),  # a spring: it tells the force
        ("speed of the blade", f"{round(moment.speed * 100, 1) + 0.0:.1f} cm/s", palette.INK),
        ("angle of the blade", f"{math.degrees(moment.angle):.0f}°", palette.INK),
    ]
    depth = moment.depth_at_blade
    if depth is not None:
        rows.insert(1, ("blade below the wanted depth", f"{round(1e3 * depth, 1) + 0.0:+.1f} mm", palette.TARGET))
    if moment.shown_path is not None:
        rows.insert(1, ("blade to the left of the line", f"{1e3 * moment.shown_path.aside:+.1f} mm", palette.TARGET))
        if sight.shown.force and len(sight.lateral_force):
            rows.append(("force to the right", f"{sight.lateral_force[-1]:+.2f} N", palette.FORCE))
    if sight.chosen_class != sight.specimen_class:
        rows.append(("next class", sight.chosen_class, palette.INK))
    draw_rows(canvas, layout, itertools.count(296, 25), rows, size=21)


def _draw_missing(canvas: Canvas, layout: Layout, sight: ViewState) -> None:
    """Draw what is missing to finish below the top view."""
    for k, words in enumerate(reversed(sight.missing)):
        line = f"to finish: {words}" if k == len(sight.missing) - 1 else words
        at = layout.column - 24, _SIDE_TOP - 22 - 24 * k
        canvas.text(line, at, size=22, colour=palette.TARGET, anchor="midright", ground=palette.PAPER)


def _draw_hidden(canvas: Canvas, layout: Layout, sight: ViewState) -> None:
    """Draw quantities that cannot be measured during a cut."""
    truth, moment = sight.truth, sight.moment
    top = 440.0
    canvas.text("practice: hidden quantities", (layout.column, top), size=_NORMAL, colour=palette.FAILURE)
    rows: list[tuple[str, str, Colour]] = [
        ("tip", f"{moment.tip * 1e3:.1f} mm", palette.INK),
        ("tip behind the blade", f"{moment.lag * 1e3:.1f} mm", palette.INK),
        ("fracture resistance at the tip", f"{truth['fracture_resistance_J_m2']:.0f} J/m²", palette.INK),
        ("modulus at the tip", f"{truth['modulus_Pa'] / 1e3:.1f} kPa", palette.INK),
        ("excess force to start a run", f"{100 * truth['initiation_excess']:.0f} %", palette.INK),
        ("energy stored in the tissue", f"{1e3 * truth['stored']:.1f} mJ", palette.INK),
        ("work so far", f"{1e3 * truth['work']:.1f} mJ", palette.INK),
        ("cut by runs of the crack", f"{1e3 * truth['uncontrolled_m']:.1f} mm in {truth['units']}", palette.INK),
    ]
    draw_rows(canvas, layout, itertools.count(top + 26, 25), rows, size=21)


def _draw_advice(canvas: Canvas, layout: Layout, moment: Moment, *, shared: bool) -> None:
    """Draw instructions in place of hidden quantities."""
    lines: tuple[str, ...] = (
        "The green marks are your hand: the blade hangs on it",
        "by a spring. The tip of the cut is behind the blade;",
        "pull, and it follows in sudden runs.",
        "",
        "Lean the blade to start the crack at less force.",
        "Raise it upright before the end: else a wedge stays.",
        "Then draw back until nothing pulls, and hold still:",
        "near the target, that finishes the cut.",
    )
    if moment.conditions:
        lines = ("Keep the blade at the dashed depth: wheel, or arrows.", "", *lines[:3], *lines[4:])
    elif moment.shown_path is not None:
        lines = (
            "The blade points where you move. The cut trails it",
            "and cuts corners: lead it a little outside.",
            "",
            *lines[:3],
            *lines[4:],
        )
    elif shared:
        lines = (
            "Hold space, the mouse button or the button of your",
            "handle, and the blade follows your hand from where",
            "it is; let go, and the agent cuts on.",
            "The record says who held it, and when.",
            *lines[3:],
        )
    for k, words in enumerate(lines):
        canvas.text(words, (layout.column, 446 + 22 * k), size=17, colour=palette.QUIET)
