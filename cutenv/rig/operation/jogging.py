"""Jogging, which moves the blade while a key is held."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from enum import Enum
from typing import NamedTuple, Protocol

from cutenv._base.validation import in_range
from cutenv.rig.plant import RigPlant
from cutenv.rig.safety.stop_causes import WATCH
from cutenv.sim.cutting.dtypes import TICK

SPEED = 0.002  # default speed of the blade [m/s]
TOP_SPEED = 0.010  # greatest speed that may be chosen [m/s]
JOG_TURN_RATE = math.radians(5.0)  # rate of turn of the blade [rad/s]
# time after its last repeat for which a key counts as held [s]. A terminal does not report the release of a key. It
# repeats a held key, after a first pause of 0.2 to 0.7 s, every 25 to 100 ms; when the repeats stay away, the key was
# released. So a key that is tapped moves the blade for this long, one that is held moves it once, pauses, and moves on
# with the first repeat
HELD = 0.150
PERIOD = 20  # period of the commands [ms]
# time from a key's last repeat to the command to rest, at most [s]: 0.4 mm at 2 mm/s, and the axis's own ramp. A line
# that delivers keys late, such as a remote shell's, adds its delay: jog beside the rig
STOPS_WITHIN = HELD + 2 * PERIOD * TICK
_LEAD = math.radians(0.5)  # [rad] lead of the commanded angle over the blade's
_SHOWN_EVERY = 5  # periods


class JogKey(Enum):
    """Key that a person can press."""

    FORWARD = "right"
    BACK = "left"
    UPRIGHT = "up"
    SLANT = "down"
    RAISE = "u"
    LOWER = "d"
    TO_LEFT = "l"
    TO_RIGHT = "r"
    QUIT = "q"
    OTHER = "any other"


_ARROWS = {b"A": JogKey.UPRIGHT, b"B": JogKey.SLANT, b"C": JogKey.FORWARD, b"D": JogKey.BACK}


_LETTERS = {
    b"q": JogKey.QUIT, b"u": JogKey.RAISE, b"d": JogKey.LOWER, b"l": JogKey.TO_LEFT, b"r": JogKey.TO_RIGHT
}  # fmt: skip


_WAYS = {
    JogKey.FORWARD: ("along", 1.0), JogKey.BACK: ("along", -1.0), JogKey.UPRIGHT: ("turn", 1.0),
    JogKey.SLANT: ("turn", -1.0), JogKey.RAISE: ("up", 1.0), JogKey.LOWER: ("up", -1.0),
    JogKey.TO_LEFT: ("left", 1.0), JogKey.TO_RIGHT: ("left", -1.0),
}  # fmt: skip


class JogSpeeds(NamedTuple):
    """Speeds along the cut, upwards and to the left [m/s], and rate of turn [rad/s]."""

    along: float = 0.0
    turn: float = 0.0
    up: float = 0.0
    left: float = 0.0


class KeyDecoder:
    """Decoder from a terminal's bytes to keys; an arrow is three."""

    def __init__(self) -> None:
        self._begun = b""

    def feed(self, data: bytes) -> list[JogKey]:
        """Take bytes, and return the keys that are complete."""
        keys = []
        for byte in (data[k : k + 1] for k in range(len(data))):
            if self._begun and self._begun != b"\x1b":  # ESC [ or ESC O
                keys.append(_ARROWS.get(byte, JogKey.OTHER))
                self._begun = b""
            elif self._begun == b"\x1b" and byte in (b"[", b"O"):
                self._begun += byte
            elif byte == b"\x1b":
                self._begun = byte
            else:
                keys.append(_LETTERS.get(byte.lower(), JogKey.OTHER))
                self._begun = b""
        return keys


class Jog:
    """Controller of the blade by keys, independent of terminal and rig.

    Pressing any key other than the held one ends the motion at once. ``speed``: speed while a key is held [m/s], up to
    :data:`TOP_SPEED`; ``turns``, ``lifts``, ``sideways``: True if the rig has that axis. Raise ValueError if the speed
    is out of range.
    """

    def __init__(
        self, speed: float = SPEED, *, turns: bool = False, lifts: bool = False, sideways: bool = False
    ) -> None:
        self.speed = in_range("speed", speed, 1e-4, TOP_SPEED, "m/s", "Jogging is slow: 2 mm/s is 0.002.")
        self._axes = {"along"} | {name for name, has in (("turn", turns), ("up", lifts), ("left", sideways)) if has}
        self._held: JogKey | None = None
        self._until = -math.inf
        self.quit = False  # True once the person has asked to quit

    def press(self, keys: Iterable[JogKey], time: float) -> None:
        """Take keys read at ``time`` [s]; the last one decides."""
        for key in keys:
            self.quit |= key is JogKey.QUIT
            self._held = None if self.quit or key is JogKey.OTHER else key
            self._until = time + HELD

    def command(self, time: float) -> JogSpeeds:
        """Return the speeds at ``time`` [s]."""
        if time >= self._until:
            self._held = None
        axis, way = _WAYS.get(self._held or JogKey.OTHER, ("", 0.0))
        if axis not in self._axes:
            return JogSpeeds()
        return JogSpeeds(**{axis: way * (JOG_TURN_RATE if axis == "turn" else self.speed)})


class Keyboard(Protocol):
    """Source of keys."""

    def read(self) -> list[JogKey]:
        """Return the keys pressed since the last call, without waiting."""
        ...


def jog(plant: RigPlant, keyboard: Keyboard, controls: Jog, show: Callable[[str], None]) -> None:
    """Move a released blade by keys until they ask to quit.

    The blade then rests, and the rig is locked. ``plant`` is prepared and released, the keyboard read every
    :data:`PERIOD`, and ``show`` called with a status line several times a second. Raise RigStopped if the supervisor
    stops the blade.
    """
    limits, clock = plant.settings.limits, plant.clock
    angle = plant.angle
    count = 0
    plant.begin()
    while not controls.quit:
        controls.press(keyboard.read(), clock.now())
        speeds = controls.command(clock.now())
        if speeds.turn:
            now = plant.angle
            wanted = min(max(angle + speeds.turn * PERIOD * TICK, now - _LEAD), now + _LEAD)
            angle = min(max(wanted, limits.angle_low), limits.angle_high)
        ahead = math.copysign(0.5 * math.pi, speeds.left) if speeds.left else 0.0
        plant.heading.begin(ahead)  # the axes lead it where it points
        plant.advance(abs(speeds.left) or speeds.along, angle, PERIOD, -speeds.up)
        if count % _SHOWN_EVERY == 0:
            show(status(plant))
        count += 1
    plant.halt()
    clock.sleep_until(clock.now() + WATCH)
    show(status(plant))


def status(plant: RigPlant) -> str:
    """Return position, angle, force and state in one line."""
    supervisor, settings = plant.supervisor, plant.settings
    force, blade = supervisor.newest_force, supervisor.blade
    along = "no force"
    if force is not None:
        along = f"{settings.sensor.sign * force.force['xyz'.index(settings.sensor.cut_axis)]:+7.2f} N"
    if blade is None:
        return f"blade unknown  {along}  {supervisor.phase}"
    lifted = supervisor.axis("height")
    across = "" if lifted is None else f"height {1e3 * lifted.position:+7.2f} mm  "
    aside = supervisor.axis("side")
    across += "" if aside is None else f"left {1e3 * aside.position:+7.2f} mm  "
    return (
        f"{1e3 * blade.position:8.2f} mm  {1e3 * blade.speed:+7.2f} mm/s  {across}{math.degrees(plant.angle):5.1f} deg"
        f"  {along}"
        f"  {supervisor.phase}, {blade.state.value}"
    )
