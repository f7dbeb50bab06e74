"""Jogs of a machine with GRBL: made from a target speed a little ahead, and cancelled where it stops or turns."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable

from cutenv.rig.devices.serial.grbl_lines import JOG_CANCEL, STATUS, GrblStatus, jog_line
from cutenv.rig.devices.serial.grbl_options import PIECE, SENT_AHEAD


class JogFeed:
    """Feed of jogs along one axis.

    Parameters
    ----------
    letter : str
        Axis of the machine.
    number : int
        Its place in a status report.
    write : callable
        Sends bytes.
    stopped : callable
        Returns True once nothing may move any more.

    Attributes
    ----------
    cancelled : bool
        True from a cancel until the machine is seen to stand.
    """

    def __init__(self, letter: str, number: int, write: Callable[[bytes], None], stopped: Callable[[], bool]) -> None:
        self._letter, self._number, self._write, self._stopped = letter, number, write, stopped
        self._lock = threading.Lock()
        self._target = 0.0  # [mm/s]
        self._sent = self._base = 0.0  # [mm] of jogs since the axis stood, and where that was
        self._jogging = self.cancelled = False
        self._asked = 0.0  # [s] time of the cancel

    @property
    def backward(self) -> bool:
        """True if the jogs under way go back."""
        return self._sent < 0.0

    def aim(self, target: float) -> None:
        """Take a target speed [mm/s], from which the next jogs are made."""
        with self._lock:
            self._target = target

    def begin(self) -> None:
        """Begin at rest, with no jogs under way."""
        with self._lock:
            self._target, self._jogging, self.cancelled = 0.0, False, False

    def end(self) -> None:
        """Make no more jogs, from any thread, without waiting."""
        self._target, self.cancelled = 0.0, True

    def turn(self, now: float, status: GrblStatus, heard: float) -> None:
        """Send the jogs that are due at ``now`` [s]; cancel those under way where the target is 0 or the other way.

        ``status`` is the last report, which came at ``heard`` [s].
        """
        with self._lock:
            if self.cancelled:  # by ourselves: go on once it stands
                if status.state == "Idle" and heard > self._asked:
                    self.cancelled = self._jogging = False
                return
            target = self._target
            if self._jogging and (target == 0.0 or target * self._sent < 0.0):
                self.cancelled, self._asked = True, now
                self._write(JOG_CANCEL + STATUS)
                return
            if target == 0.0:
                return
            if not self._jogging:
                self._jogging, self._sent, self._base = True, 0.0, status.position[self._number]
            moved = status.position[self._number] - self._base
            moved += math.copysign(status.feed / 60.0, target) * (now - heard)
            if abs(self._sent) - abs(moved) > abs(target) * (SENT_AHEAD - PIECE):
                return
            self._sent += target * PIECE
            self._write(jog_line(self._letter, target * PIECE, 60.0 * abs(target)))
            if self._stopped():  # between the lines above: the cancel has to be the last
                self._write(JOG_CANCEL)
