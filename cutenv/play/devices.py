"""Common input devices, mouse and gamepad, and a hand that follows a script."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

from cutenv._base.validation import in_range
from cutenv.cutting.dtypes import TICK
from cutenv.play.hand_model import FASTEST
from cutenv.play.haptics import Stylus
from cutenv.task.depth_terms import DESCENT_SCALE
from cutenv.tissue.specimen import LENGTH, SPACING

_UPRIGHT, INCLINED = math.pi / 2, math.pi / 4
TRAVEL = LENGTH - SPACING
"""Greatest distance of the hand from the clamp [m]."""
NOTCH = math.radians(5.0)
"""Tilt for one notch of the wheel [rad]."""
LOWERED_BY_NOTCH, LEVEL_REACH = 0.0005, 0.02
"""Change of level for one notch of the wheel, and the farthest from that at the start [m]."""
BEHIND = 0.008
"""Distance from a hand to the tip of its cut, of a blade on a spring and tissue that it drags along [m]."""
LEAD = 0.003
"""Farthest that a mouse leads the hand [m]: enough for the hand's full speed, and it stops 0.2 s after the mouse."""
STICK_DEAD_ZONE = 0.12
"""Share of a stick's travel around its middle that is ignored."""


def _within_travel(position: float) -> float:
    return min(max(position, 0.0), TRAVEL)


def _within_angles(angle: float) -> float:
    return min(max(angle, INCLINED), _UPRIGHT)


def _within_reach(level: float) -> float:
    return min(max(level, -LEVEL_REACH), LEVEL_REACH)


def _beyond_slack(name: str, stick: float) -> float:
    """Return how far a stick is held beyond what is ignored around its middle, -1 to 1."""
    held = in_range(name, stick, -1.01, 1.01, "1", "Axes of a gamepad reach from -1 to 1.")
    slack = max(abs(held) - STICK_DEAD_ZONE, 0.0) / (1.0 - STICK_DEAD_ZONE)
    return math.copysign(min(slack, 1.0), held)


class MouseDevice:
    """Mouse, pen or finger that leads the hand from wherever it was at the start; the wheel tilts or lowers."""

    coupling = None

    def __init__(self) -> None:
        self.position, self.angle, self.level = 0.0, _UPRIGHT, 0.0

    def open(self) -> None:
        """Begin a cut at the clamp, upright, at the level where the blade stands."""
        self.position, self.angle, self.level = 0.0, _UPRIGHT, 0.0

    def move(self, distance: float) -> None:
        """Move the hand by ``distance`` along the cut line [m], as far as it can follow: see :meth:`keep_near`."""
        self.position = _within_travel(self.position + in_range("distance", distance, -10.0, 10.0, "m"))

    def keep_near(self, hand: float) -> None:
        """Forget what leads the ``hand`` [m] by more than :data:`LEAD`: a quick flick must not run the cut away."""
        self.position = _within_travel(min(max(self.position, hand - LEAD), hand + LEAD))

    def turn(self, notches: float) -> None:
        """Turn the wheel: toward the person (negative) leans the blade, away from them raises it."""
        self.angle = _within_angles(self.angle + NOTCH * in_range("notches", notches, -1e3, 1e3, "1"))

    def lower(self, notches: float) -> None:
        """Turn the wheel where the blade's depth is led: toward the person (negative) lowers it, away raises it."""
        moved = LOWERED_BY_NOTCH * in_range("notches", notches, -1e3, 1e3, "1")
        self.level = _within_reach(self.level + moved)

    def read(self) -> Stylus:
        """Return the position of the hand [m], the angle of the blade [rad] and its level [m]."""
        return Stylus(self.position, self.angle, level=self.level)

    def push(self, force: float) -> None:
        """Ignore the force: a mouse cannot push, so the force is only seen."""

    def close(self) -> None:
        """Do nothing: there is no device to release."""


class GamepadDevice:
    """Gamepad whose stick moves the hand, faster the farther it is pushed, and whose trigger leans the blade.

    A stick springs back and has 2 cm of travel: a position on it would be too coarse for a tolerance of 3 mm, so it
    sets a speed, up to the fastest measured.  A second stick lowers and raises the blade in the same way, as fast as an
    agent does at most.
    """

    coupling = None

    def __init__(self) -> None:
        self._position, self._stick, self._trigger = 0.0, 0.0, 0.0
        self._level, self._second = 0.0, 0.0

    def open(self) -> None:
        """Begin a cut at the clamp, at the level where the blade stands."""
        self._position = self._level = 0.0

    def hold(self, stick: float, trigger: float, second: float = 0.0) -> None:
        """Set sticks and trigger from now on.

        Parameters
        ----------
        stick : float
            Position of the stick, -1 (back) to 1 (forward).
        trigger : float
            Position of the trigger, 0 (released, upright) to 1 (pulled, 45 degrees).
        second : float
            Position of the second stick, -1 (away from the person: raise) to 1 (toward them: lower).
        """
        self._stick, self._second = _beyond_slack("stick", stick), _beyond_slack("second", second)
        self._trigger = in_range("trigger", trigger, 0.0, 1.0, "1", "Put an axis of -1 to 1 to 0 to 1.")

    def read(self) -> Stylus:
        """Advance the hand by a millisecond; return its position [m], and angle [rad] and level [m] of the blade."""
        # The square leaves room for slow cuts near the middle.
        speed = FASTEST * self._stick * abs(self._stick)
        self._position = _within_travel(self._position + speed * TICK)
        self._level = _within_reach(self._level - DESCENT_SCALE * self._second * TICK)
        return Stylus(self._position, _UPRIGHT - self._trigger * (_UPRIGHT - INCLINED), level=self._level)

    def push(self, force: float) -> None:
        """Ignore the force: a gamepad cannot push along the cut, so the force is only seen."""

    def close(self) -> None:
        """Do nothing: there is no device to release."""


class Motion(NamedTuple):
    """Position of the hand [m], angle [rad] and level [m] of the blade that a script demands."""

    position: float
    angle: float
    level: float = 0.0


class ScriptedDevice:
    """Hand that follows a script, for tests and demonstrations: every read is a millisecond later.

    Parameters
    ----------
    script : callable
        Maps the time since the cut began [s] to a :class:`Motion`.
    """

    coupling = None

    def __init__(self, script: Callable[[float], Motion]) -> None:
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
        return Stylus(_within_travel(wanted.position), _within_angles(wanted.angle), level=wanted.level)

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
    lean: float = math.radians(60.0),
    level: Callable[[float], float] = lambda position: 0.0,
) -> ScriptedDevice:
    """Return a hand with a beginner's plan: forward at one speed, upright near the end, back until nothing pulls.

    Parameters
    ----------
    target : float
        Target position of the tip, from the clamp [m].
    speed : float
        Forward speed [m/s].
    lead : float
        Distance by which the hand goes beyond the target, because the force holds blade and tip behind it [m].
    lean : float
        Angle of the blade during the cut [rad].
    level : callable
        Level of the blade above that at the start [m], by a place [m]; it is led by that of the tip, which is
        :data:`BEHIND` the hand.
    """
    in_range("target", target, 0.005, TRAVEL, "m", "Lengths are in metres: 80 mm is 0.08.")
    in_range("speed", speed, 1e-4, FASTEST, "m/s", "Speeds are in m/s: 1.27 cm/s is 0.0127.")
    farthest = min(target + lead, TRAVEL)
    there = farthest / speed
    back = 0.050

    def script(time: float) -> Motion:
        if time < there:
            position = speed * time
            tilt = lean if 0.005 < position < farthest - 0.015 else _UPRIGHT
            return Motion(position, tilt, level(max(position - BEHIND, 0.0)))
        position = max(farthest - speed * (time - there), farthest - back)
        return Motion(position, _UPRIGHT, level(farthest - BEHIND))

    return ScriptedDevice(script)
