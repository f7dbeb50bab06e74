"""Driver "grbl" of an axis.

A machine with GRBL 1.1 as it is, moved by jogs that are sent a little ahead.

What GRBL cannot promise: it has no watch for a silent computer, and moves to the end of the jogs that it has; a quick
stop is its plain deceleration; its lines have no check sum; it reports ten times a second; it has no encoder. Here that
is bounded: no more than ``SENT_AHEAD`` of motion is ever under way.
"""

from __future__ import annotations

import logging
import math
import re
import threading
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Literal, NamedTuple

from cutenv._base.validation import check_parameters, in_range, one_of
from cutenv.rig.config.settings import Axis, RigSettings, setting
from cutenv.rig.devices.driver_bases import AxisDriver
from cutenv.rig.devices.driver_registry import Mounting, rig_driver
from cutenv.rig.devices.loop import Clock, Repeating
from cutenv.rig.devices.protocols import DriveState, MotionSample
from cutenv.rig.devices.serial.board_drivers import on_pseudo_terminal
from cutenv.rig.devices.serial.ports import open_port, write_line
from cutenv.rig.errors import RigError

JOG_CANCEL, SOFT_RESET, STATUS, HOLD = b"\x85", b"\x18", b"?", b"!"
"""Commands of one byte, which GRBL obeys at once, whatever it is doing."""
# coordinate at the clamp [mm] that ``cutenv rig zero`` gives the machine, in its memory only: proof of it
MARK = 5000.0
GRBL_AXES = ("X", "Y", "Z")  # letters of the axes


class GrblStatus(NamedTuple):
    """Status report."""

    state: str  # "Idle", "Jog", "Run", "Hold", "Alarm", "Door", "Check", "Home" or "Sleep"
    position: tuple[float, ...]  # machine position of each axis [mm]
    feed: float  # present feed [mm/min]
    pins: str  # letters of inputs that are triggered


_STATUS = re.compile(rb"<([A-Za-z]+)(?::\d+)?\|MPos:(-?\d+\.\d+(?:,-?\d+\.\d+)*)((?:\|[^|<>]*)*)>")
_FEED = re.compile(rb"\|FS?:(\d+(?:\.\d+)?)")
_PINS = re.compile(rb"\|Pn:([A-Z]+)")


def grbl_status(line: bytes) -> GrblStatus | None:
    """Return a status report's content, None for other or damaged lines."""
    match = _STATUS.fullmatch(line.strip())
    if match is None:
        return None
    feed, pins = _FEED.search(match[3]), _PINS.search(match[3])
    position = tuple(float(number) for number in match[2].split(b","))
    if len(position) < len(GRBL_AXES) or feed is None:
        return None
    return GrblStatus(match[1].decode(), position, float(feed[1]), pins[1].decode() if pins else "")


def jog_line(letter: str, way: float, feed: float) -> bytes:
    """Return the command of a relative jog, ``way`` [mm] at ``feed`` [mm/min]."""
    return f"$J=G91G21{letter}{way:.4f}F{feed:.2f}\n".encode("ascii")


def grbl_setting(line: str) -> tuple[int, float] | None:
    """Return number and value of ``$120=100.000``, or None."""
    match = re.fullmatch(r"\$(\d+)=(-?\d+(?:\.\d+)?)", line)
    return None if match is None else (int(match[1]), float(match[2]))


def offsets_of(line: str, name: str) -> tuple[float, ...] | None:
    """Return the offsets of a line like ``[G92:0.000,0.000,0.000]``, or None."""
    match = re.fullmatch(rf"\[{name}:(-?[\d.]+(?:,-?[\d.]+)*)\]", line)
    return None if match is None else tuple(float(number) for number in match[1].split(","))


def grbl_zero(lines: Iterable[str], number: int) -> float | None:
    """Return the clamp's machine position [mm] from ``$#``, None if unset.

    ``number`` is the place of the axis among the machine's own.
    """
    found = {name: offsets[number] for line in lines for name in ("G54", "G92") if (offsets := offsets_of(line, name))}
    if abs(found.get("G92", 0.0)) <= 0.5 * MARK:
        return None
    return found.get("G54", 0.0) + found["G92"] + MARK


REPORT_PERIOD = 0.100  # period at which status reports are asked for [s]: GRBL is not made for much more
PIECE = 0.025  # time of one jog [s]
# time of the motion that is sent ahead [s]: after a silence of the computer the blade goes on for so long
SENT_AHEAD = 0.150


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


def lines_to_send(settings: Mapping[int, float], axis: Axis, number: int) -> list[str]:
    """Return the lines that set a machine as the file says.

    Empty if it is.

    ``settings`` are its settings by number, and ``number`` is the place of the axis among its own.
    """
    wanted = {110 + number: _MINUTE * axis.speed, 120 + number: 1e3 * axis.acceleration}
    wrong = [
        f"${key}={value:.3f}" for key, value in wanted.items() if not abs(settings.get(key, 0.0) / value - 1.0) <= _SAME
    ]
    if not int(settings.get(10, 1)) & 1:  # reports of the machine position
        wrong.append("$10=1")
    if settings.get(13, 0.0):  # in inches
        wrong.append("$13=0")
    return wrong


_log = logging.getLogger(__name__)

ANSWERED = 1.0  # time within which a line is answered [s]
_WRITE, _READ = 0.02, 0.05  # [s]
_LINE = 128  # bytes at most


class GrblConnection:
    """Serial line to a machine, open from the start.

    ``heard``: called from the reading thread with each line that is no answer "ok" or "error", and the time [s];
    ``broke``: called once, from another thread, with the reason and the time [s] when the line is lost. Raise RigError
    if the port is missing or taken.
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
        self.lost: str | None = None  # reason why the line is lost
        self.changed = threading.Condition()  # notified after every line
        self._sending = threading.Lock()
        self._answers: list[str] = []
        self._closed = 0  # answers "ok" and errors since the last question
        self._ending = threading.Event()
        self._port = open_port(port, baud, read_limit=_READ)
        self._reader = threading.Thread(target=self._read, name="cutenv GRBL", daemon=True)
        self._reader.start()

    def write(self, data: bytes) -> None:
        """Send bytes at once; raise RigError if the port does not take them."""
        if self.lost is not None:
            raise RigError(f"the machine at {self._name} is lost: {self.lost}.")
        with self._sending:
            try:
                write_line(self._port, data, _WRITE)
            except Exception as error:  # pyserial and the system raise many kinds
                raise self._break(f"nothing can be sent any more: {error}") from error

    def ask(self, line: str) -> list[str]:
        """Send a line, and return what comes before its "ok".

        Raise RigError if the answer is an error, or none comes in time.
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


_STOPPING = 0.020  # [s] between reports while it stops
_BOOT, _STATE = 4.0, 1.5  # [s]
_DEAF = 0.1  # [s] beyond its ramp, after which a machine that does not slow down is reset
_ASKED = 3  # times that the settings are asked for
_OURS = ("Idle", "Jog")  # states of a machine that does nothing but our jogs
_AT_REST = ("Alarm", "Sleep")  # in which it moves nothing, and knows no zero that a reset could lose


@rig_driver(options=GrblOptions, check=check_grbl, emulated=on_pseudo_terminal, patience=SENT_AHEAD + PIECE)
class GrblAxis(AxisDriver):
    """Axis of a GRBL 1.1 machine: jogs, jog cancel, soft reset, reports.

    Its position counts from where a person has set zero since the machine has power: ``cutenv rig zero``. The motor's
    power is the machine's own affair: "without power" means here that no jogs are sent. It has no watch of its own: one
    that has to stop by itself and does not slow down soon is reset, which stops it without a ramp and loses its zero.
    """

    device, silence, report_limit = "machine", "no more jogs are sent", 1.0

    def __init__(self, mounting: Mounting) -> None:
        super().__init__(mounting.role, mounting.settings, mounting.clock)
        self._options: GrblOptions = mounting.options
        self._number = GRBL_AXES.index(self._options.letter)
        self._machine: GrblConnection | None = None
        self._jogs = JogFeed(self._options.letter, self._number, self._write_quietly, lambda: self.latch.closed)
        self._turns: list[Repeating] = []
        self._reset()

    def _reset(self) -> None:
        self._status: GrblStatus | None = None
        self._heard = 0.0
        self._told: dict[int, float] = {}
        self._zero: float | None = None  # [mm] machine position of the clamp; None: nobody has set it
        self._state = DriveState.DISABLED
        self._jogs.begin()
        self._asked_at = -math.inf  # [s] of the last question for a report
        self._fastest = 0.0  # [mm/min] feed at the stop
        self._reset_at = math.inf  # [s] when a machine that is deaf is reset
        self._passed_on, self._passed_state = -math.inf, self._state

    # Life cycle

    def _connect(self) -> None:
        self._reset()
        self._machine = GrblConnection(
            self._options.port, self._options.baud, self._clock, heard=self._handle, broke=self.lost
        )
        self._identify()
        self._compare()
        self._turns = [
            self._clock.every(_STOPPING, self._ask_status, "cutenv GRBL status"),
            self._clock.every(PIECE, self._feed, "cutenv GRBL jogs"),
        ]
        self._fresh()

    def _identify(self) -> None:
        ends = self._clock.now() + _BOOT
        while True:
            try:
                lines = self._ask("$I")
                break
            except RigError:
                if self._lost or self._clock.now() > ends:
                    raise RigError(
                        f"no GRBL answers at {self._options.port} and {self._options.baud} baud. Is the machine "
                        "powered, is the baud rate right, is it GRBL 1.1?"
                    ) from None
        version = next((line for line in lines if line.startswith("[VER:1.1")), None)
        if version is None:
            raise RigError(f"the machine at {self._options.port} is not GRBL 1.1; it says {lines}.")

    def _compare(self) -> None:
        for _ in range(_ASKED):  # a late "ok" to an earlier line ends the answer before it has begun
            self._told = dict(pair for line in self._ask("$$") if (pair := grbl_setting(line)) is not None)
            if 110 + self._number in self._told:
                break
        wrong = lines_to_send(self._told, self._settings, self._number)
        if wrong:
            raise RigError(
                f"{self.name}: the machine is not set as the rig's file says. Send it {', '.join(wrong)} (speed in "
                "mm/min, acceleration in mm/s2, reports of the machine position in mm), or correct the file."
            )
        self._read_offsets()

    def _read_offsets(self) -> None:
        self._zero = grbl_zero(self._ask("$#"), self._number)

    def _rest(self) -> None:
        if self._lost is None:
            self._write(JOG_CANCEL)
            self._rested()

    def _disconnect(self) -> None:
        while self._turns:
            self._turns.pop().stop()
        machine, self._machine = self._machine, None
        if machine is not None:
            machine.close()

    def limits(self) -> dict[str, float]:
        """Return the machine's speed and acceleration, and the file's travel (GRBL has none)."""
        speed, acceleration = self._told[110 + self._number] / _MINUTE, 1e-3 * self._told[120 + self._number]
        return {
            "low": self._settings.low, "high": self._settings.high, "speed": speed, "acceleration": acceleration,
            "quick_stop": acceleration,
        }  # fmt: skip

    def about(self) -> dict[str, float | str]:
        """Return what the machine reports of itself."""
        return {
            "port": self._options.port,
            "steps_per_mm": self._told.get(100 + self._number, math.nan),
            "zero_set": "yes"
            if self._zero is not None
            else "no: put the blade at the clamp, and give 'cutenv rig zero'",
            "state": "?" if self._status is None else self._status.state,
            "soft_limits": "on" if self._told.get(20) else "off",
            "hard_limits": "on" if self._told.get(21) else "off: switch them on ($21=1)",
        }

    def set_zero(self) -> None:
        """Take the present position, at the clamp, as zero.

        It is kept in the machine's memory until that restarts. Raise RigError if the machine does not take it.
        """
        self._ask(f"G92{self._options.letter}{MARK:g}")
        self._read_offsets()
        if self._zero is None:
            raise RigError(f"{self.name}: the machine has not taken the zero.")

    # Commands

    def _switch_on(self) -> None:
        if self.latch.closed or self._state not in (DriveState.DISABLED, DriveState.ENABLED):
            raise RigError(f"{self.name}: {self._condition()}; clear it first.")
        if self._zero is None:
            raise RigError(
                f"{self.name}: the machine does not know where the blade stands. Put the blade at the clamp by hand, "
                "and give 'cutenv rig zero'."
            )
        self._jogs.begin()
        self._state = DriveState.ENABLED

    def _send_speed(self, target: float) -> None:
        self._energise(partial(self._jogs.aim, 1e3 * target * self._settings.direction))  # the next jogs are made of it

    def _send_stop(self, *, for_good: bool = False) -> None:
        self._jogs.end()
        with self._changed:
            self._fastest = 0.0 if self._status is None else self._status.feed
        self._write(JOG_CANCEL)  # repeated until it is seen to obey: a jog that it has not read yet is cancelled too

    def _fall_silent(self) -> None:
        self._jogs.end()
        self._reset_at = self._clock.now() + self._settings.speed / self._settings.acceleration + _DEAF

    def disable(self) -> None:
        """Send no more jogs; raise RigError if the axis does not come to rest."""
        self._jogs.aim(0.0)
        self._rested()
        if self._state is DriveState.ENABLED:
            self._state = DriveState.DISABLED

    def clear(self) -> None:
        """Leave stop or alarm for rest, within the latch's reset; raise RigError if the cause is still there."""
        self._jogs.aim(0.0)
        self._write(JOG_CANCEL)
        self._rested()
        if self._status is not None and self._status.state == "Alarm":
            self._ask("$X")
        self._read_offsets()
        self._jogs.begin()
        self._reset_at = math.inf
        self._state = DriveState.DISABLED
        self._fresh()
        if self._state is DriveState.FAULT:
            raise RigError(f"{self.name}: the machine stays in {self._status}. Is a limit switch or a door open?")

    def _feed(self, now: float) -> None:
        status = self._status
        if self._state is DriveState.ENABLED and not self.latch.closed and not self._lost and status is not None:
            self._jogs.turn(now, status, self._heard)

    def _ask_status(self, now: float) -> None:
        if now > self._reset_at:
            self._reset_at = math.inf
            if self._status is None or (self._status.state != "Idle" and self._status.feed >= 0.9 * self._fastest):
                self._zero = None
                self._write_quietly(SOFT_RESET)
        stopping = self._jogs.cancelled and self._status is not None and self._status.state != "Idle"
        if self._lost:
            return
        if stopping or now - self._asked_at >= REPORT_PERIOD - 0.5 * _STOPPING:
            self._asked_at = now
            self._write_quietly(STATUS)

    # Lines

    def _write(self, data: bytes) -> None:
        if (machine := self._machine) is None:
            raise RigError(f"{self.name}: not open.")
        try:
            machine.write(data)
        except RigError as error:
            raise RigError(f"{self.name}: {error}") from error

    def _write_quietly(self, data: bytes) -> None:
        try:
            self._write(data)
        except RigError as error:  # the break itself informs the listener
            _log.warning("%s", error)

    def _ask(self, line: str) -> list[str]:
        if (machine := self._machine) is None:
            raise RigError(f"{self.name}: not open.")
        try:
            return machine.ask(line)
        except RigError as error:
            raise RigError(f"{self.name}: {error}") from error

    def _handle(self, line: bytes, now: float) -> None:
        if line.startswith(b"<"):
            if (status := grbl_status(line)) is not None:
                self._reported(status, now)
            return
        text, listener = line.decode("ascii", "replace"), self._listener
        if listener is None:
            return
        if text.startswith("ALARM:"):
            self._state = DriveState.FAULT
            listener.emergency(self.name, 0xFF00, f"GRBL's {text}", now)
        elif text.startswith("Grbl ") and self._turns:
            self._state, self._zero = DriveState.FAULT, None
            listener.emergency(self.name, 0x6180, "it was restarted, and no longer knows where the blade stands", now)

    def _reported(self, status: GrblStatus, now: float) -> None:
        with self._changed:
            self._status, self._heard = status, now
            self._reports += 1
            if foreign := status.state not in _OURS:
                self._state = DriveState.FAULT
            obeys = status.state == "Idle" or status.feed < 0.9 * self._fastest
            if self.latch.closed and self._state is DriveState.ENABLED and obeys:
                self._state = DriveState.QUICK_STOP
            self._changed.notify_all()
        if foreign and status.state not in _AT_REST:
            self._hold(status.state, now)
        speed = status.feed / _MINUTE
        if self._jogs.backward:
            speed = -speed
        position = 1e-3 * (status.position[self._number] - (self._zero or 0.0))
        direction = self._settings.direction
        # A stop is watched more closely, and told at once; samples between are not for the listener, who counts them.
        due = now - self._passed_on >= REPORT_PERIOD - 0.5 * _STOPPING
        if self._listener is not None and (due or self._state is not self._passed_state):
            self._passed_on, self._passed_state = now, self._state
            sample = MotionSample(now, direction * position, direction * speed, 0.0, self._state)
            self._listener.motion(self.name, sample)
            self._listener.alive(self.name, now)

    def _hold(self, state: str, now: float) -> None:
        """Hold and reset a machine in foreign motion, which no jog cancel stops."""
        self._zero = None
        self._write_quietly(HOLD + SOFT_RESET)
        if self._listener is not None:
            self._listener.foreign(self.name, f'the machine is in "{state}", not in a jog', now)

    def lost(self, why: str, time: float) -> None:
        """Take the news that the line is lost."""
        self._state = DriveState.FAULT
        super().lost(why, time)

    def _condition(self) -> str:
        return f'the machine is in "{self._state.value}"'

    def _rested(self) -> None:
        begun = self._clock.now()
        self._await(
            lambda: self._status is not None and self._heard > begun and self._status.feed == 0.0,
            "come to rest",
            _STATE,
        )


class JogFeed:
    """Feed of jogs along one axis.

    ``letter``: axis of the machine; ``number``: its place in a status report; ``write``: sends bytes; ``stopped``:
    returns True once nothing may move any more. ``cancelled``: True from a cancel until the machine is seen to stand.
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
        """Set the target speed [mm/s] of the next jogs."""
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
        """Send the jogs that are due at ``now`` [s].

        Cancel those under way where the target is 0 or the other way.

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
