"""Connection to a machine with GRBL: its port, the thread that reads it, questions and their answers."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable

from cutenv.rig.devices.clock import Clock
from cutenv.rig.devices.owner import Owner
from cutenv.rig.devices.serial.ports import open_port, write_line
from cutenv.rig.errors import RigError

_log = logging.getLogger(__name__)

ANSWERED = 1.0
"""Time within which a line is answered [s]."""
_WRITE, _READ = 0.02, 0.05  # [s]
_LINE = 128  # bytes at most


class GrblConnection:
    """Serial line to a machine, open from the start.

    Parameters
    ----------
    port : str
        Serial port.
    baud : int
        Baud rate.
    clock : Clock
        Clock of the rig.
    heard : callable
        Called from the reading thread with each line that is no answer "ok" or "error", and the time [s].
    broke : callable
        Called once, from another thread, with the reason and the time [s] when the line is lost.

    Attributes
    ----------
    lost : str or None
        Reason why the line is lost.
    changed : threading.Condition
        Notified after every line.

    Raises
    ------
    RigError
        If the port is missing or taken.
    """

    def __init__(
        self,
        port: str,
        baud: int,
        clock: Clock,
        *,
        heard: Callable[[bytes, float], None],
        broke: Callable[[str, float], None],
    ) -> None:
        self._name, self._clock, self._heard, self._broke = port, clock, heard, broke
        self.lost: str | None = None
        self.changed = threading.Condition()
        self._sending = threading.Lock()
        self._answers: list[str] = []
        self._closed = 0  # answers "ok" and errors since the last question
        self._ending = threading.Event()
        self._owner = Owner()
        self._port = open_port(port, baud, read_limit=_READ)
        self._reader = threading.Thread(target=self._read, name="cutenv GRBL", daemon=True)
        self._reader.start()

    def write(self, data: bytes) -> None:
        """Send bytes at once.

        Raises
        ------
        RigError
            If the port does not take them.
        """
        self._owner.check()
        if self.lost is not None:
            raise RigError(f"the machine at {self._name} is lost: {self.lost}.")
        with self._sending:
            try:
                write_line(self._port, data, _WRITE)
            except Exception as error:  # pyserial and the system raise many kinds
                raise self._break(f"nothing can be sent any more: {error}") from error

    def ask(self, line: str) -> list[str]:
        """Send a line, and return what comes before its "ok".

        Raises
        ------
        RigError
            If the answer is an error, or none comes in time.
        """
        with self.changed:
            self._answers, self._closed = [], 0
        self.write(line.encode("ascii") + b"\n")
        self._clock.wait_for(lambda: self._closed > 0 or self.lost is not None, ANSWERED, self.changed)
        answers = list(self._answers)
        if not self._closed or any(answer.startswith("error:") for answer in answers):
            raise RigError(self.lost or f"to {line!r} the machine says {answers or None}.")
        return answers

    def close(self) -> None:
        """Leave the port; may be called from the reading thread."""
        self._ending.set()
        if self._reader is not threading.current_thread():
            self._reader.join(timeout=1.0)
        try:
            self._port.close()
        except Exception:  # the device is gone
            _log.warning("the port %s was not closed in order", self._name, exc_info=True)

    def _read(self) -> None:
        rest = b""
        while not self._ending.is_set():
            try:
                read = self._port.read(max(self._port.in_waiting, 1))
            except Exception as error:  # pyserial and the system raise many kinds
                if not self._ending.is_set():
                    self._break(f"nothing can be read any more: {error}")
                return
            *lines, rest = (rest + read).split(b"\n")
            rest = rest[-_LINE:]
            for line in lines:
                self._take(line.strip(), self._clock.now())

    def _take(self, line: bytes, now: float) -> None:
        closes = line == b"ok" or line.startswith(b"error:")
        with self.changed:
            if line and line != b"ok" and not line.startswith(b"<"):
                self._answers.append(line.decode("ascii", "replace"))
            self._closed += closes
        if not closes:
            self._heard(line, now)
        with self.changed:
            self.changed.notify_all()

    def _break(self, why: str) -> RigError:
        with self.changed:
            first, self.lost = self.lost is None, self.lost or why
            self.changed.notify_all()
        if first:
            # From a separate thread: the sender may hold the very lock that is needed to stop the blade.
            threading.Thread(target=self._broke, args=(why, self._clock.now()), daemon=True).start()
        return RigError(f"the machine at {self._name} is lost: {why}.")
