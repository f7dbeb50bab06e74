"""Emulated machine with GRBL 1.1, from its public protocol: one axis under jogs, behind a pseudo-terminal.

It is not GRBL's own code: planner and parser are as small as the driver needs them.
"""

from __future__ import annotations

import math
import re
import threading
import time
from collections import deque

from cutenv.rig.devices.serial.grbl_lines import JOG_CANCEL, MARK, SOFT_RESET, STATUS
from cutenv.rig.emulator.serial.line import EmulatedLine

_BLOCKS = 15  # jogs that the planner holds
_TICK = 0.001  # [s]
_JOG = re.compile(r"\$J=G91G21X(-?\d+\.\d+)F(\d+\.\d+)")
_BANNER = b"Grbl 1.1h ['$' for help]\r\n"


class EmulatedGrbl:
    """Machine whose X axis jogs; run it in a thread of its own.

    Parameters
    ----------
    rate, acceleration : float
        Settings $110 [mm/min] and $120 [mm/s2].

    Attributes
    ----------
    line : EmulatedLine
        Serial line; ``line.port`` is the port to open.
    position, speed : float
        Machine position [mm], and speed [mm/s].
    deaf_to_cancel, blocked : bool
        Faults: jog cancel is not obeyed; the carriage stands though the motor gets pulses.
    state : str
        State as in its reports.
    cancels, runs_out : int
        Jog cancels that came, and times at which it came to the end of its jogs by itself.
    jogs_read : int
        Jogs that it has taken.
    stopped : threading.Event
        Set it to end :meth:`run`.
    """

    def __init__(self, *, rate: float = 360.0, acceleration: float = 100.0) -> None:
        self.line = EmulatedLine()
        self.settings = {10: 1.0, 13: 0.0, 20: 0.0, 21: 1.0, 100: 400.0, 110: rate, 120: acceleration}
        self.position = self.speed = 0.0
        self.deaf_to_cancel = self.blocked = False
        self._slipped = 0.0  # [mm] of pulses that a blocked carriage did not follow
        self.cancels = self.runs_out = 0
        self.stopped = threading.Event()
        self.jogs_read = 0
        self._way = 1.0
        self._blocks: deque[list[float]] = deque()  # way left [mm], feed [mm/s]
        self.state, self._cancelling = "Idle", False
        self._shift = 0.0  # G92 [mm]
        self._text = ""

    def run(self) -> None:
        """Advance by a millisecond every millisecond."""
        due = time.monotonic()
        while not self.stopped.is_set():
            due += _TICK
            self.step(due)
            if (left := due - time.monotonic()) > 0.0:
                time.sleep(left)

    def step(self, due: float) -> None:
        """Advance by one millisecond, that of time ``due`` [s]."""
        out = b"".join(self._realtime(byte) for byte in self.line.heard())
        while "\n" in self._text and len(self._blocks) < _BLOCKS:
            text, _, self._text = self._text.partition("\n")
            out += self._obey(text.strip())
        self._move()
        self.line.say(out, due)

    @property
    def carriage(self) -> float:
        """Position of the carriage [mm]: that of the machine, but for what a blocked one did not follow."""
        return self.position - self._slipped

    def set_zero(self) -> None:
        """Give the present position the coordinate of the clamp, as ``cutenv rig zero`` does."""
        self._shift = self.position - MARK

    def feed_hold(self) -> None:
        """Slow down and forget its jogs, as when somebody presses its button for feed hold while it jogs."""
        self._cancelling = bool(self._blocks)

    def alarm(self, number: int) -> None:
        """Stop at once, as at a limit switch (1) or a reset in motion (3): the position is lost."""
        self._blocks.clear()
        self.speed, self.state, self._cancelling = 0.0, "Alarm", False
        self.line.say(b"ALARM:%d\r\n" % number, time.monotonic())

    def reset(self) -> None:
        """Restart, as by a soft reset: what was under way is gone, and so is the shift of the coordinates."""
        moved = self.speed != 0.0
        self._blocks.clear()
        self._text, self.speed, self._shift, self._cancelling = "", 0.0, 0.0, False
        self.state = "Alarm" if moved else "Idle"
        self.line.say((b"ALARM:3\r\n" if moved else b"") + b"\r\n" + _BANNER, time.monotonic())

    def _realtime(self, byte: int) -> bytes:
        one = bytes([byte])
        if one == STATUS:
            feed = 60.0 * abs(self.speed)
            return b"<%s|MPos:%.3f,0.000,0.000|FS:%d,0>\r\n" % (self.state.encode(), self.position, round(feed))
        if one == JOG_CANCEL:
            self._cancelling = bool(self._blocks) and not self.deaf_to_cancel
            self.cancels += 1
        elif one == SOFT_RESET:
            self.reset()
        elif byte < 0x80:
            self._text += chr(byte)
        return b""

    def _obey(self, text: str) -> bytes:
        if (jog := _JOG.fullmatch(text)) is not None:
            if self.state not in ("Idle", "Jog"):
                return b"error:9\r\n"
            if self._cancelling:
                return b"ok\r\n"  # flushed
            way, feed = float(jog[1]), float(jog[2]) / 60.0
            self._blocks.append([abs(way), min(feed, self.settings[110] / 60.0)])
            self._way, self.state = math.copysign(1.0, way), "Jog"
            self.jogs_read += 1
            return b"ok\r\n"
        if text == "$I":
            return b"[VER:1.1h.20190825:]\r\n[OPT:V,15,128]\r\nok\r\n"
        if text == "$$":
            return b"".join(b"$%d=%.3f\r\n" % pair for pair in self.settings.items()) + b"ok\r\n"
        if text == "$#":
            return b"[G54:0.000,0.000,0.000]\r\n[G92:%.3f,0.000,0.000]\r\nok\r\n" % self._shift
        if text.startswith("G92X"):
            self._shift = self.position - float(text[4:])
            return b"ok\r\n"
        if text == "$X":
            self.state = "Idle"
            return b"[MSG:Caution: Unlocked]\r\nok\r\n"
        return b"ok\r\n" if not text else b"error:1\r\n"

    def _move(self) -> None:
        if not self._blocks:
            return
        left, feed = sum(block[0] for block in self._blocks), self._blocks[0][1]
        acceleration = self.settings[120]
        wanted = 0.0 if self._cancelling else min(feed, math.sqrt(2.0 * acceleration * left))
        change = min(max(wanted - abs(self.speed), -acceleration * _TICK), acceleration * _TICK)
        speed = max(abs(self.speed) + change, 0.0)
        way = moved = min(speed * _TICK, left)
        self.position += self._way * way
        self.speed = self._way * speed
        while self._blocks and way >= self._blocks[0][0] - 1e-9:
            way -= self._blocks.popleft()[0]
        if self._blocks:
            self._blocks[0][0] -= max(way, 0.0)
        if self.blocked:
            self._slipped += self._way * moved
        if not self._blocks or (self._cancelling and speed == 0.0):
            self.runs_out += not self._cancelling
            self._blocks.clear()
            self.speed, self.state, self._cancelling = 0.0, "Idle", False

    def close(self) -> None:
        """Remove the port; may be called twice."""
        self.stopped.set()
        self.line.close()
