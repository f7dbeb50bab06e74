"""Picture of a cut by a person, and the cards over it.

Tissue from above, handle from the side, force as colour, bar and trace.  The cards are instructions, countdown, and at
the end score and faults in plain words.
"""

from __future__ import annotations

import itertools
import math
import textwrap

import numpy as np

from cutenv._base.unit_table import NAMED_UNITS
from cutenv.display.viewer import palette, views
from cutenv.display.viewer.canvas import Canvas, Points
from cutenv.display.viewer.drawn_slab import Slab, drawn_slab_of
from cutenv.display.viewer.palette import Colour
from cutenv.display.viewer.scene import ForceTrace, Layout, Moment
from cutenv.display.viewer.views import draw_rows
from cutenv.people.play.course_progress import GIVEN_UP
from cutenv.people.play.play_session import ViewState
from cutenv.records.scoring import ScoreCard
from cutenv.records.scoring.score_card import DISCLAIMER
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
_LEFT, _RIGHT, _TOP = 110.0, 850.0, 74.0  # of a card [px]
_PX_PER_POINT, _LABEL_WIDTH = 3.4, 54.0  # of the bars of the score
_EDGE, _VEIL = 26.0, 0.55  # of a card: margin [px]; opacity of the veil behind it
_MOST_FAULTS = 3
_SHOWN = (
    ("tip_error", "tip off target", "mm", 1),
    ("peak_force", "peak force", "N", 2),
    ("largest_jump", "longest run of the crack", "mm", 1),
    ("uncontrolled_share", "share cut by runs", "percent", 0),
    ("force_rate", "change of force", "N_per_s", 1),
    ("duration", "time", "s", 1),
)
"""Metric, its name for the reader, name of the unit, digits."""


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
            _draw_ready_card(canvas, layout, sight)
        elif sight.phase == "countdown":
            _draw_countdown(canvas, layout, sight)
        elif sight.phase == "ended":
            _draw_end_card(canvas, layout, sight)
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


def _panel(canvas: Canvas, layout: Layout, bottom: float) -> None:
    """Veil the background, and draw a sheet on it."""
    whole = np.array(
        [[0.0, layout.header], [layout.width, layout.header], [layout.width, layout.height], [0.0, layout.height]]
    )
    canvas.area(whole, palette.PAPER, opacity=_VEIL)
    corners = np.array([[_LEFT, _TOP], [_RIGHT, _TOP], [_RIGHT, bottom], [_LEFT, bottom]])
    canvas.area(corners + np.array([4.0, 5.0]), palette.QUIET, opacity=0.35)
    canvas.area(corners, palette.PAPER, palette.QUIET)


def _draw_ready_card(canvas: Canvas, layout: Layout, sight: ViewState) -> None:
    _panel(canvas, layout, 416.0 + 24.0 * bool(sight.task))
    x, target = _LEFT + _EDGE, sight.moment.target * 1e3
    canvas.text(f"Cut {target:.0f} mm, gently", (x, _TOP + 40), size=36)
    practice = "on" if sight.practice else "off"
    whose = f"under the code {sight.operator}" if sight.operator else "without a name"
    choices = f"Tissue: {sight.specimen_class} (c: another).   Practice: {practice} (p)."
    course = textwrap.wrap(sight.task, 84) or [choices]
    pad = "Gamepad: left stick and right trigger; begin with its button A."
    wheel = "The wheel leans the blade, down to 45°, and raises it again."
    if sight.moment.conditions:
        pad = "Gamepad: left stick, right stick for the depth, right trigger to lean; begin with its button A."
        wheel = "The wheel lowers the blade to the dashed depth, and raises it; with shift it leans the blade."
    move = "Move the mouse along the cut: your hand follows, the blade hangs on it."
    if sight.moment.shown_path is not None:
        move = "Move the mouse along the dashed line: the blade hangs on your hand, and points where it moves."
        pad = "Arrow keys move the hand, too. Gamepad: left stick and right trigger; begin with its button A."
    if sight.leader:
        move = f"{sight.leader[:1].upper()}{sight.leader[1:]}."
        wheel = (
            "While you hold it, the blade follows your hand: mouse or left and right; the wheel or up and down lean it."
        )
        pad = "Gamepad: hold A, left stick and right trigger. Let go, and the agent cuts on."
    lines = (
        (move, palette.INK),
        (wheel, palette.INK),
        (pad, palette.INK),
        ("Pen or remote desktop: press m if the hand does not move.", palette.INK),
        ("", palette.INK),
        (f"Bring the tip of the cut, which is hidden, to {target:.1f} mm, within 3 mm.", palette.INK),
        ("To finish, near the target: blade upright, draw back until nothing pulls, hold still.", palette.INK),
        ("", palette.INK),
        *((words, palette.TARGET if sight.task else palette.QUIET) for words in course),
        (f"Every cut is recorded, {whose}.", palette.QUIET),
    )  # fmt: skip
    for k, (words, colour) in enumerate(lines):
        canvas.text(words, (x, _TOP + 86 + 24 * k), size=19, colour=colour)
    canvas.text("space or click: begin", (_RIGHT - _EDGE, _TOP + 40), size=24, colour=palette.TARGET, anchor="midright")


def _draw_countdown(canvas: Canvas, layout: Layout, sight: ViewState) -> None:
    middle = layout.along(0.075), layout.cut_line
    canvas.disc(np.array(middle), 70.0, palette.PAPER)
    canvas.text(f"{max(math.ceil(sight.countdown), 1)}", middle, size=130, colour=palette.TARGET, anchor="center")
    words = "hand at the clamp"
    canvas.text(words, (middle[0], middle[1] + 88), size=19, anchor="center", ground=palette.PAPER)


def _draw_end_card(canvas: Canvas, layout: Layout, sight: ViewState) -> None:
    card, moment = sight.card, sight.moment
    verdict = [line for words in sight.verdict for line in textwrap.wrap(words, 92)]
    faults = fault_lines(card, _MOST_FAULTS - bool(verdict)) if sight.shown.result else []
    below = _TOP + 340 + sum(step for _, step, _ in faults) if sight.shown.result else _TOP + 84.0  # the faults
    foot = below + 22 * len(verdict) + 10 * bool(verdict)
    _panel(canvas, layout, foot + 64)
    x, right = _LEFT + _EDGE, _RIGHT - _EDGE
    ended = (moment.verdict or GIVEN_UP) if sight.shown.result else "the cut has ended"
    colour = palette.SUCCESS if moment.success else palette.FAILURE
    colour = colour if sight.shown.result else palette.INK
    canvas.text(ended[:1].upper() + ended[1:], (x, _TOP + 34), size=30, colour=colour)
    if card is None:
        canvas.text("Nothing was cut: nothing to score, and no record.", (x, _TOP + 80), size=20)
    elif sight.shown.result:
        _draw_score(canvas, card, x, right)
        _draw_metrics(canvas, card, x, right, _TOP + 132)
        y = _TOP + 318
        for words, step, fault in faults:
            colour = palette.FAILURE if fault else palette.INK
            canvas.text(words, (x if fault else x + 14, y), size=20 if fault else 17, colour=colour)
            y += step
    for k, words in enumerate(verdict):
        canvas.text(words, (x, below + 22 * k), size=18, colour=palette.TARGET)
    if sight.saved is not None:
        words = f"record: {sight.saved.name}" + ", marked as practice" * sight.practised
        canvas.text(words, (x, foot), size=15, colour=palette.QUIET)
    canvas.text(DISCLAIMER, (x, foot + 19), size=15, colour=palette.QUIET)
    more = "space: next specimen" + "     r: again     c: class     p: practice" * (not sight.task)
    keys = "space: end" if sight.done else more
    canvas.text(keys, (x, foot + 42), size=17, colour=palette.TARGET)


def _draw_score(canvas: Canvas, card: ScoreCard, x: float, right: float) -> None:
    if card.overall_score is None:
        canvas.text(card.headline(), (x, _TOP + 84), size=17, colour=palette.QUIET)
        return
    canvas.text(f"{card.overall_score:.0f}", (right - 62, _TOP + 60), size=76, anchor="midright")
    canvas.text("of 100", (right, _TOP + 72), size=19, colour=palette.QUIET, anchor="midright")
    start = x
    for each in card.points:  # bars of one scale, which together are the score
        length, most = _PX_PER_POINT * each.points, _PX_PER_POINT * each.most
        canvas.bar(start, _TOP + 64, start + most, _TOP + 78, palette.PANEL)
        canvas.bar(start, _TOP + 64, start + length, _TOP + 78, palette.GAIN)
        canvas.text(each.part, (start, _TOP + 90), size=13, colour=palette.QUIET)
        start += max(most, _LABEL_WIDTH) + 6


def _draw_metrics(canvas: Canvas, card: ScoreCard, x: float, right: float, top: float) -> None:
    canvas.text("compared with cuts by scripts", (right, top - 24), size=15, colour=palette.QUIET, anchor="midright")
    for k, (name, words, unit_name, digits) in enumerate(_SHOWN):
        scored, unit, y = card.metrics[name], NAMED_UNITS[unit_name], top + 27 * k
        canvas.text(words, (x, y), size=19, colour=palette.QUIET)
        value = "not known" if scored.value is None else f"{unit.from_si(scored.value):.{digits}f} {unit.sign}"
        canvas.text(value, (x + 330, y), size=20, anchor="midright")
        if scored.percentile is not None:
            start, length = x + 372, right - x - 372 - 130
            canvas.bar(start, y - 6, start + length, y + 6, palette.PANEL)
            canvas.bar(start, y - 6, start + length * scored.percentile / 100, y + 6, palette.GAIN)
            words = f"better than {scored.percentile:.0f} %"
            canvas.text(words, (right, y), size=16, colour=palette.QUIET, anchor="midright")


def fault_lines(card: ScoreCard | None, most: int = _MOST_FAULTS) -> list[tuple[str, int, bool]]:
    """Return lines of faults and advice: text, spacing [px], whether a fault."""
    if card is None:
        return []
    if not card.faults:
        return [("No fault was found.", 30, False)]
    # The end of a cut comes first: there are many runs and pauses but one end. The same advice is given once.
    said: dict[str, list[str]] = {}
    for fault in sorted(card.faults, key=lambda fault: fault.kind in ("lurch", "pause")):
        said.setdefault(fault.try_next, []).append(fault.says)
    lines = []
    for advice, faults in list(said.items())[:most]:
        words = "; ".join(faults)
        lines += [(line, 21, True) for line in textwrap.wrap(words[:1].upper() + words[1:], 80)]
        lines += [(line, 21, False) for line in textwrap.wrap(f"Next time: {advice}.", 100)]
        lines[-1] = (lines[-1][0], 32, False)
    return lines
