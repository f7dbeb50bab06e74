"""Machine with GRBL 1.1 as it is: its lines, its connection, and the options and periods of an axis on it."""

from __future__ import annotations

import logging
import re
import threading
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Literal, NamedTuple

from cutenv._base.validation import check_parameters, in_range, one_of
from cutenv.rig.config.axes import Axis
from cutenv.rig.config.setting import setting
from cutenv.rig.config.settings import RigSettings
from cutenv.rig.devices.host import Clock
from cutenv.rig.devices.serial.ports import open_port, write_line
from cutenv.rig.errors import RigError

JOG_CANCEL, SOFT_RESET, STATUS, HOLD = b"\x85", b"\x18", b"?", b"!"
"""Commands of one byte, which GRBL obeys at once, whatever it is doing."""
MARK = 5000.0
"""Coordinate at the clamp [mm] that ``cutenv rig zero`` gives the machine, in its memory only: proof of it."""
GRBL_AXES = ("X", "Y", "Z")
"""Letters of the axes."""


class GrblStatus(NamedTuple):
    """Status report.

    Attributes
    ----------
    state : str
        "Idle", "Jog", "Run", "Hold", "Alarm", "Door", "Check", "Home" or "Sleep".
    position : tuple of float
        Machine position of each axis [mm].
    feed : float
        Present feed [mm/min].
    pins : str
        Letters of inputs that are triggered.
    """

    state: str
    position: tuple[float, ...]
    feed: float
    pins: str


_STATUS = re.compile(rb"<([A-Za-z]+)(?::\d+)?\|MPos:(-?\d+\.\d+(?:,-?\d+\.\d+)*)((?:\|[^|<>]*)*)>")
_FEED = re.compile(rb"\|FS?:(\d+(?:\.\d+)?)")
_PINS = re.compile(rb"\|Pn:([A-Z]+)")


def grbl_status(line: bytes) -> GrblStatus | None:
    """Return what a status report says; None if the line is none, or is damaged."""
    match = _STATUS.fullmatch(line.strip())
    if match is None:
        return None
    feed, pins = _FEED.search(match[3]), _PINS.search(match[3])
    position = tuple(float(number) for number in match[2].split(b","))
    if len(position) < len(GRBL_AXES) or feed is None:
        return None
    return GrblStatus(match[1].decode(), position, float(feed[1]), pins[1].decode() if pins else "")


def jog_line(letter: str, way: float, feed: float) -> bytes:
    """Return the command that jogs an axis by ``way`` [mm] at ``feed`` [mm/min], relative to where it will be."""
    return f"$J=G91G21{letter}{way:.4f}F{feed:.2f}\n".encode("ascii")


def grbl_setting(line: str) -> tuple[int, float] | None:
    """Return number and value of a setting such as ``$120=100.000``; None if the line is none."""
    match = re.fullmatch(r"\$(\d+)=(-?\d+(?:\.\d+)?)", line)
    return None if match is None else (int(match[1]), float(match[2]))


def offsets_of(line: str, name: str) -> tuple[float, ...] | None:
    """Return the offsets that a line such as ``[G92:0.000,0.000,0.000]`` tells; None if it is another."""
    match = re.fullmatch(rf"\[{name}:(-?[\d.]+(?:,-?[\d.]+)*)\]", line)
    return None if match is None else tuple(float(number) for number in match[1].split(","))


def grbl_zero(lines: Iterable[str], number: int) -> float | None:
    """Return the machine position [mm] of the clamp, which the answer to ``$#`` tells; None if nobody has set it.

    ``number`` is the place of the axis among the machine's own.
    """
    found = {name: offsets[number] for line in lines for name in ("G54", "G92") if (offsets := offsets_of(line, name))}
    if abs(found.get("G92", 0.0)) <= 0.5 * MARK:
        return None
    return found.get("G54", 0.0) + found["G92"] + MARK


REPORT_PERIOD = 0.100
"""Period at which status reports are asked for [s]: GRBL is not made for much more."""
PIECE = 0.025
"""Time of one jog [s]."""
SENT_AHEAD = 0.150
"""Time of the motion that is sent ahead [s]: after a silence of the computer the blade goes on for so long."""


_SAME = 0.02  # [1] relative difference allowed between the machine's settings and the file
_MINUTE = 6e4  # mm/min of a m/s


@dataclass(frozen=True, kw_only=True)
class GrblOptions:
    """Options of an axis on a machine with GRBL."""

    port: str = setting(
        "", "1", "Serial port of the machine; a name below /dev/serial/by-id stays the same.",
        example='"/dev/serial/by-id/usb-..."',
    )  # fmt: skip
    baud: int = setting(115_200, "1", "Baud rate of GRBL.")
    letter: Literal["X", "Y", "Z"] = setting("X", "1", "Axis of the machine that moves the blade.")

    def __post_init__(self) -> None:
        check_parameters(self)
        one_of("letter", self.letter, GRBL_AXES)
        in_range("baud", self.baud, 9600, 4_000_000, "baud", "GRBL's own is 115200.")


def check_grbl(rig: RigSettings, role: str) -> None:
    """Raise ValueError for an axis that GRBL cannot drive."""
    axis: Axis = getattr(rig, role)
    if role != "blade":
        raise ValueError(f'{role}.driver = "grbl": it moves the blade alone. Set the angle by hand.')
    if axis.options is None:
        raise ValueError('blade.driver = "grbl" needs [blade.options] with port.')
    if axis.quick_stop != axis.acceleration:
        raise ValueError(
            f"blade.quick_stop_m_s2 = {axis.quick_stop:g} and blade.acceleration_m_s2 = {axis.acceleration:g}: GRBL "
            "has one deceleration for both ($120, $121, $122). Write the same."
        )
    if rig.bus.sync != REPORT_PERIOD:
        raise ValueError(f"bus.sync_ms = {1e3 * rig.bus.sync:g}: GRBL tells its position every 100 ms. Write 100.")


def lines_to_send(told: Mapping[int, float], axis: Axis, number: int) -> list[str]:
    """Return the lines that set a machine as the file says; empty if it is.

    ``told`` are its settings by number, and ``number`` is the place of the axis among its own.
    """
    wanted = {110 + number: _MINUTE * axis.speed, 120 + number: 1e3 * axis.acceleration}
    wrong = [
        f"${key}={value:.3f}" for key, value in wanted.items() if not abs(told.get(key, 0.0) / value - 1.0) <= _SAME
    ]
    if not int(told.get(10, 1)) & 1:  # reports of the machine position
        wrong.append("$10=1")
    if told.get(13, 0.0):  # in inches
        wrong.append("$13=0")
    return wrong


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
