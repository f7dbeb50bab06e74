"""Cards over the picture.

Instructions, countdown, and the end card with score and faults in plain words.
"""

from __future__ import annotations

import math
import textwrap

import numpy as np

from cutenv._base.unit_table import NAMED_UNITS
from cutenv.display.viewer import palette
from cutenv.display.viewer.canvas import Canvas
from cutenv.display.viewer.scene import Layout
from cutenv.people.play.course_progress import GIVEN_UP
from cutenv.people.play.view_state import ViewState
from cutenv.records.scoring import ScoreCard
from cutenv.records.scoring.score_card import DISCLAIMER

_LEFT, _RIGHT, _TOP = 110.0, 850.0, 74.0  # of a card [px]
_PX_PER_POINT, _LABEL_WIDTH = 3.4, 54.0  # of the bars of the score
_EDGE = 26.0
_VEIL = 0.55
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


def _panel(canvas: Canvas, layout: Layout, bottom: float) -> None:
    """Veil the background, and draw a sheet on it."""
    whole = np.array(
        [[0.0, layout.header], [layout.width, layout.header], [layout.width, layout.height], [0.0, layout.height]]
    )
    canvas.area(whole, palette.PAPER, opacity=_VEIL)
    corners = np.array([[_LEFT, _TOP], [_RIGHT, _TOP], [_RIGHT, bottom], [_LEFT, bottom]])
    canvas.area(corners + np.array([4.0, 5.0]), palette.QUIET, opacity=0.35)
    canvas.area(corners, palette.PAPER, palette.QUIET)


def draw_ready_card(canvas: Canvas, layout: Layout, sight: ViewState) -> None:
    """Draw the instructions, and the choices for the next cut."""
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


def draw_countdown(canvas: Canvas, layout: Layout, sight: ViewState) -> None:
    """Draw the countdown."""
    middle = layout.along(0.075), layout.cut_line
    canvas.disc(np.array(middle), 70.0, palette.PAPER)
    canvas.text(f"{max(math.ceil(sight.countdown), 1)}", middle, size=130, colour=palette.TARGET, anchor="center")
    words = "hand at the clamp"
    canvas.text(words, (middle[0], middle[1] + 88), size=19, anchor="center", ground=palette.PAPER)


def draw_end_card(canvas: Canvas, layout: Layout, sight: ViewState) -> None:
    """Draw the end card: score, numbers, faults and advice."""
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
