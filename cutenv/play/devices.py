"""What most people have: a mouse, a gamepad; and a hand that follows a script."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

from cutenv.cutting.records import TICK
from cutenv.play.hand import FASTEST
from cutenv.play.haptics import Stylus
from cutenv.tissue.specimen import LENGTH, SPACING
from cutenv.validation import in_range

UPRIGHT, INCLINED = math.pi / 2, math.pi / 4
TRAVEL = LENGTH - SPACING
"""As far as the hand goes from the clamp [m]."""
NOTCH = math.radians(5.0)
"""By which one notch of the wheel tilts [rad]."""
DEAD_ZONE = 0.12
"""Share of a stick's reach that is its slack."""


def _within_travel(position: float) -> float:
    return min(max(position, 0.0), TRAVEL)


def _within_angles(angle: float) -> float:
    return min(max(angle, INCLINED), UPRIGHT)


class MouseDevice:
    """The mouse leads the hand as it moves, from wherever it was at the start; the wheel tilts the blade."""

    coupling = None

    def __init__(self) -> None:
        self.position, self.angle = 0.0, UPRIGHT

    def open(self) -> None:
        """Begin a cut at the clamp, upright."""
        self.position, self.angle = 0.0, UPRIGHT

    def move(self, distance: float) -> None:
        """The mouse went by ``distance`` along the cut line [m]."""
        self.position = _within_travel(self.position + in_range("distance", distance, -10.0, 10.0, "m"))

    def turn(self, notches: float) -> None:
        """The wheel was turned: toward the person (negative) leans the blade, away from them raises it."""
        self.angle = _within_angles(self.angle + NOTCH * in_range("notches", notches, -1e3, 1e3, "1"))

    def read(self) -> Stylus:
        """Where mouse and wheel have led hand and blade."""
        return Stylus(self.position, self.angle)

    def push(self, force: float) -> None:
        """A mouse pushes nothing: the force is seen."""

    def close(self) -> None:
        """Nothing to let go."""


class GamepadDevice:
    """The stick moves the hand, faster the farther it is pushed; the trigger leans the blade.

    A stick springs back and has 2 cm of travel: a place on it would be too coarse for a tolerance of 3 mm, so it
    gives a speed, up to the fastest measured.
    """

    coupling = None

    def __init__(self) -> None:
        self._position, self._stick, self._trigger = 0.0, 0.0, 0.0

    def open(self) -> None:
        """Begin a cut at the clamp."""
        self._position = 0.0

    def hold(self, stick: float, trigger: float) -> None:
        """What is held from now on.

        Parameters
        ----------
        stick : float
            -1 (back) to 1 (forward).
        trigger : float
            0 (let go, upright) to 1 (pulled, 45 degrees).
        """
        stick = in_range("stick", stick, -1.01, 1.01, "1", "Axes of a gamepad reach from -1 to 1.")
        slack = max(abs(stick) - DEAD_ZONE, 0.0) / (1.0 - DEAD_ZONE)
        self._stick = math.copysign(min(slack, 1.0), stick)
        self._trigger = in_range("trigger", trigger, 0.0, 1.0, "1", "Put an axis of -1 to 1 to 0 to 1.")

    def read(self) -> Stylus:
        """A millisecond further."""
        # The square leaves room for slow cuts near the middle.
        speed = FASTEST * self._stick * abs(self._stick)
        self._position = _within_travel(self._position + speed * TICK)
        return Stylus(self._position, UPRIGHT - self._trigger * (UPRIGHT - INCLINED))

    def push(self, force: float) -> None:
        """A gamepad pushes nothing along the cut: the force is seen."""

    def close(self) -> None:
        """Nothing to let go."""


class Motion(NamedTuple):
    """Place of the hand [m] and angle of the blade [rad] that a script asks for."""

    position: float
    angle: float


class ScriptedDevice:
    """A hand that follows a script, for tests and demonstrations: every read is a millisecond later.

    Parameters
    ----------
    script : callable
        From the time since the cut began [s] to a :class:`Motion`.
    """

    coupling = None

    def __init__(self, script: Callable[[float], Motion]) -> None:
        self._script = script
        self._reads = 0
        self.pushed = 0.0

    def open(self) -> None:
        """Begin anew."""
        self._reads = 0

    def read(self) -> Stylus:
        """What the script says of this millisecond."""
        position, angle = self._script(self._reads * TICK)
        self._reads += 1
        return Stylus(_within_travel(position), _within_angles(angle))

    def push(self, force: float) -> None:
        """Keep what a person would feel [N]."""
        self.pushed = force

    def close(self) -> None:
        """Nothing to let go."""


def simple_hand(
    target: float, *, speed: float = 0.0127, lead: float = 0.022, lean: float = math.radians(60.0)
) -> ScriptedDevice:
    """A hand as one would first try: forward at one speed, upright again near the end, back until nothing pulls.

    Parameters
    ----------
    target : float
        Where the tip is to stand, from the clamp [m].
    speed : float
        Forward [m/s].
    lead : float
        By which the hand goes beyond the target: blade and tip hang behind it by what the force pulls [m].
    lean : float
        Angle of the blade under way [rad].
    """
    in_range("target", target, 0.005, TRAVEL, "m", "Lengths are in metres: 80 mm is 0.08.")
    in_range("speed", speed, 1e-4, FASTEST, "m/s", "Speeds are in m/s: 1.27 cm/s is 0.0127.")
    farthest = min(target + lead, TRAVEL)
    there = farthest / speed
    back = 0.050

    def script(time: float) -> Motion:
        if time < there:
            position = speed * time
            return Motion(position, lean if 0.005 < position < farthest - 0.015 else UPRIGHT)
        return Motion(max(farthest - speed * (time - there), farthest - back), UPRIGHT)

    return ScriptedDevice(script)
