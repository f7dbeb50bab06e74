"""Input devices mouse and gamepad, and a scripted hand."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

from cutenv._base.validation import in_range
from cutenv.people.play.hand_model import MAX_HAND_SPEED
from cutenv.people.play.haptics import Stylus
from cutenv.sim.cutting.dtypes import TICK
from cutenv.sim.cutting.law import grid_index, lerp
from cutenv.sim.tissue.lines import WIDTH, CutLine
from cutenv.sim.tissue.specimen import LENGTH, SPACING
from cutenv.task.depth import DESCENT_SCALE

_UPRIGHT, INCLINED = math.pi / 2, math.pi / 4
_LEAN = math.radians(60.0)  # of a beginner's blade during the cut
TRAVEL = LENGTH - SPACING
"""Greatest distance of the hand from the clamp [m]."""
NOTCH = math.radians(5.0)
"""Tilt for one notch of the wheel [rad]."""
LOWERED_BY_NOTCH, LEVEL_REACH = 0.0005, 0.02
"""Change of level for one notch of the wheel, and the farthest from that at the start [m]."""
BEHIND = 0.008
"""Distance from a hand to the tip of its cut, of a blade on a spring and tissue that it drags along [m]."""
_SHORT, _FREED = 0.0025, 0.050
"""Way of a watched tip to the target at which the hand turns back, as a run may come yet, and its way back [m]."""
_SLOWER_FROM, _UPRIGHT_FROM, _CREEP = 0.020, 0.016, 0.3
"""Ways of that tip to there from which on hand is slower, blade upright [m]; least share of the hand's speed."""
LEAD = 0.003
"""Farthest that a mouse leads the hand [m]: enough for the hand's full speed, and it stops 0.2 s after the mouse."""
KEY_SPEED = 0.0127
"""Speed of a hand that arrow keys move [m/s]: half the fastest."""
STICK_DEAD_ZONE = 0.12
"""Share of a stick's travel around its middle that is ignored."""


def _within_slab(position: float, across: float) -> tuple[float, float]:
    return min(max(position, 0.0), TRAVEL), min(max(across, -0.5 * WIDTH), 0.5 * WIDTH)


def within_angles(angle: float) -> float:
    """Return the nearest possible blade angle [rad], upright to 45 degrees."""
    return min(max(angle, INCLINED), _UPRIGHT)


def _within_reach(level: float) -> float:
    return min(max(level, -LEVEL_REACH), LEVEL_REACH)


def _beyond_slack(name: str, stick: float) -> float:
    """Return a stick's deflection beyond its dead zone, -1 to 1."""
    held = in_range(name, stick, -1.01, 1.01, "1", "Axes of a gamepad reach from -1 to 1.")
    slack = max(abs(held) - STICK_DEAD_ZONE, 0.0) / (1.0 - STICK_DEAD_ZONE)
    return math.copysign(min(slack, 1.0), held)


def _pressed(held: bool) -> frozenset[str]:
    return frozenset({"next"}) if held else frozenset()


class LedHand:
    """Hand that a pointer or a stick leads from the clamp.

    Nothing pushes it, so a force is only seen. Position and across are the wanted place along the slab, and across it
    to the left, level that of the blade above the start [m], angle the blade's [rad]. While a stick or a key is held,
    the place moves on by itself with a velocity along and across [m/s]; while the button is ``held``, the blade is
    taken from an agent.
    """

    coupling = None

    def __init__(self) -> None:
        self.angle, self.velocity, self.held = _UPRIGHT, (0.0, 0.0), False
        self.open()

    def open(self) -> None:
        """Begin a cut at the clamp, at the blade's level."""
        self.position = self.across = self.level = 0.0

    def move(self, distance: float, across: float = 0.0) -> None:
        """Move the place by ``distance`` and ``across`` [m], within reach."""
        in_range("distance", distance, -10.0, 10.0, "m")
        in_range("across", across, -10.0, 10.0, "m")
        self.position, self.across = _within_slab(self.position + distance, self.across + across)

    def keep_near(self, hand: float, across: float = 0.0) -> None:
        """Limit the lead over this place to :data:`LEAD`."""
        ahead, aside = self.position - hand, self.across - across
        distance = math.hypot(ahead, aside)
        if distance > LEAD:
            ahead, aside = LEAD * (ahead / distance), LEAD * (aside / distance)
            self.position, self.across = _within_slab(hand + ahead, across + aside)

    def read(self) -> Stylus:
        """Advance a millisecond; return place [m], angle [rad] and level [m]."""
        along, across = self.velocity
        self.position, self.across = _within_slab(self.position + along * TICK, self.across + across * TICK)
        return Stylus(self.position, self.angle, _pressed(self.held), self.level, self.across)

    def push(self, force: float) -> None:
        """Ignore the force: what is held cannot push."""

    def close(self) -> None:
        """Do nothing: there is no device to release."""


class MouseDevice(LedHand):
    """Mouse, pen or finger that leads the hand.

    It leads from wherever it was at the start; the wheel tilts or lowers.
    """

    def open(self) -> None:
        """Begin a cut at the clamp, upright, at the blade's level."""
        super().open()
        self.angle = _UPRIGHT

    def turn(self, notches: float) -> None:
        """Lean (negative, toward the person) or raise the blade by wheel."""
        self.angle = within_angles(self.angle + NOTCH * in_range("notches", notches, -1e3, 1e3, "1"))

    def lower(self, notches: float) -> None:
        """Lower (negative, toward the person) or raise the level by wheel."""
        moved = LOWERED_BY_NOTCH * in_range("notches", notches, -1e3, 1e3, "1")
        self.level = _within_reach(self.level + moved)

    def hold_keys(self, along: float, across: float) -> None:
        """Move the hand by arrow keys at :data:`KEY_SPEED`; -1, 0 or 1."""
        size = KEY_SPEED / max(math.hypot(along, across), 1.0)
        self.velocity = size * along, size * across


class GamepadDevice(LedHand):
    """Gamepad whose stick moves the hand and trigger leans the blade.

    The hand is faster the farther the stick is pushed.

    A stick springs back and has 2 cm of travel: a position on it would be too coarse for a tolerance of 3 mm, so it
    sets a speed, up to the fastest measured.  A second stick lowers and raises the blade in the same way, as fast as an
    agent does at most.
    """

    def __init__(self) -> None:
        super().__init__()
        self._second = 0.0

    def hold(self, stick: float, trigger: float, second: float = 0.0, sideways: float = 0.0) -> None:
        """Set sticks and trigger from now on.

        Sticks are from -1 (back; second: away from the person, raise; sideways: away, to the left) to 1, the trigger
        from 0 (released, upright) to 1 (pulled, 45 degrees).
        """
        along, across = _beyond_slack("stick", stick), -_beyond_slack("sideways", sideways)
        # The size of the deflection leaves room for slow cuts near the middle.
        size = MAX_HAND_SPEED * min(math.hypot(along, across), 1.0)
        self.velocity, self._second = (size * along, size * across), _beyond_slack("second", second)
        pulled = in_range("trigger", trigger, 0.0, 1.0, "1", "Put an axis of -1 to 1 to 0 to 1.")
        self.angle = _UPRIGHT - pulled * (_UPRIGHT - INCLINED)

    def read(self) -> Stylus:
        """Move the hand by the sticks for a millisecond; return its :class:`Stylus`."""
        self.level = _within_reach(self.level - DESCENT_SCALE * self._second * TICK)
        return super().read()


class HandMotion(NamedTuple):
    """Hand [m], angle [rad], level and place across [m], button held."""

    position: float
    angle: float
    level: float = 0.0
    across: float = 0.0
    held: bool = False


class ScriptedDevice:
    """Hand that follows a script, for tests and demonstrations.

    Every read is a millisecond later. The script maps the time since the cut began [s] to a :class:`HandMotion`.
    """

    coupling = None

    def __init__(self, script: Callable[[float], HandMotion]) -> None:
        self._script = script
        self._reads = 0
        self.pushed = 0.0

    def open(self) -> None:
        """Start the script again."""
        self._reads = 0

    def read(self) -> Stylus:
        """Return the script's hand and blade for this millisecond."""
        wanted = self._script(self._reads * TICK)
        self._reads += 1
        place, across = _within_slab(wanted.position, wanted.across)
        return Stylus(place, within_angles(wanted.angle), _pressed(wanted.held), wanted.level, across)

    def push(self, force: float) -> None:
        """Store the force that a person would feel [N]."""
        self.pushed = force

    def close(self) -> None:
        """Do nothing: there is no device to release."""


def simple_hand(
    target: float,
    *,
    speed: float = 0.0127,
    lead: float = 0.022,
    level: Callable[[float], float] = lambda position: 0.0,
    line: CutLine | None = None,
) -> ScriptedDevice:
    """Return a beginner's scripted hand: forward, upright, back.

    It goes beyond the target [m] by ``lead`` [m], because the force holds blade and tip behind it, at a speed [m/s].
    The level of the blade above that at the start [m] is led by the place of the tip, which is :data:`BEHIND` the hand.
    Without a line it goes straight on.
    """
    in_range("target", target, 0.005, TRAVEL, "m", "Lengths are in metres: 80 mm is 0.08.")
    in_range("speed", speed, 1e-4, MAX_HAND_SPEED, "m/s", "Speeds are in m/s: 1.27 cm/s is 0.0127.")
    farthest = min(target + lead, TRAVEL)
    there = farthest / speed
    back = 0.050

    def script(time: float) -> HandMotion:
        if time < there:
            position = speed * time
            tilt = _LEAN if 0.005 < position < farthest - 0.015 else _UPRIGHT
            return _at(line, position, tilt, level(max(position - BEHIND, 0.0)))
        position = max(farthest - speed * (time - there), farthest - back)
        return _at(line, position, _UPRIGHT, level(farthest - BEHIND))

    return ScriptedDevice(script)


def watching_hand(
    tip: Callable[[], float],
    target: float,
    *,
    level: Callable[[float], float] = lambda position: 0.0,
    line: CutLine | None = None,
) -> ScriptedDevice:
    """Return a scripted hand that slows and returns by the tip.

    ``tip`` returns the place of the crack tip now, along the cut from the clamp [m]; the rest is as of
    :func:`simple_hand`.
    """
    in_range("target", target, 0.005, TRAVEL, "m", "Lengths are in metres: 80 mm is 0.08.")
    place, farthest = 0.0, math.inf

    def script(time: float) -> HandMotion:
        nonlocal place, farthest
        if time == 0.0:
            place, farthest = 0.0, math.inf
        left = target - _SHORT - tip()
        if left <= 0.0 or place >= TRAVEL:
            farthest = min(farthest, place)
        if farthest < math.inf:
            place = max(place - KEY_SPEED * TICK, farthest - _FREED)
            return _at(line, place, _UPRIGHT, level(tip()))
        place += KEY_SPEED * TICK * min(max(left / _SLOWER_FROM, _CREEP), 1.0)
        tilt = _LEAN if 0.005 < place and left > _UPRIGHT_FROM else _UPRIGHT
        return _at(line, place, tilt, level(max(place - BEHIND, 0.0)))

    return ScriptedDevice(script)


def _at(line: CutLine | None, position: float, angle: float, level: float) -> HandMotion:
    if line is None:
        return HandMotion(position, angle, level)
    i, share = grid_index(position)
    return HandMotion(float(lerp(line.x, i, share)), angle, level, float(lerp(line.y, i, share)))
