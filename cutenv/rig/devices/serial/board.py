"""Board on a serial port that axis and sensor share; lines ``TEXT*CRC``."""

from __future__ import annotations

import binascii
import logging
import threading
from collections.abc import Callable
from enum import IntEnum, IntFlag
from typing import Any, NamedTuple, Protocol

from cutenv.rig.devices.loop import READ_EVERY, Clock, Repeating
from cutenv.rig.devices.serial.ports import open_port, write_line
from cutenv.rig.errors import RigError

LINE_LENGTH = 72  # bytes of a line at most, with its CRC
BOARD_PROTOCOL = 1  # version of the protocol, which the board reports
_START = 0xFFFF  # CRC-16/CCITT-FALSE


class BoardState(IntEnum):
    """State of the stepper, as the board reports it."""

    OFF = 0
    ENABLED = 1
    STOPPED = 2
    FAULT = 3


class BoardFlag(IntFlag):
    """Flags of the board: its pins now, and what has stopped it."""

    ZEROED = 1
    AT_LOW = 2
    AT_HIGH = 4
    STOP_OPEN = 8
    SILENT = 16
    SOFT_END = 32
    UNSET = 64


class LineError(ValueError):
    """Error for a line that is damaged or unknown. The message names the fault."""


class MotionReport(NamedTuple):
    """Report of the motion.

    Number, state, flags, position [steps], rate [steps/s], lines that it did not take.
    """

    sequence: int
    state: BoardState
    flags: BoardFlag
    steps: int
    rate: int
    bad: int


class ForceReport(NamedTuple):
    """Reading of the load cell.

    Number, status (0: healthy, 1: at the end of the range), counts.
    """

    sequence: int
    status: int
    counts: int


class BoardIdentity(NamedTuple):
    """Identity of a board: protocol version, converter, rate [Hz]."""

    protocol: int
    converter: str
    rate: int


class StepperSetup(NamedTuple):
    """Set-up of the stepper.

    Acceleration, that of a quick stop [steps/s2], top rate [steps/s], ends [steps].
    """

    acceleration: int
    quick_stop: int
    fastest: int
    low: int
    high: int


Report = MotionReport | ForceReport | BoardIdentity | StepperSetup


def board_line(text: str) -> bytes:
    """Return a text as a line with its CRC."""
    raw = text.encode("ascii")
    return b"%s*%s\n" % (raw, _crc(raw))


def board_report(line: bytes) -> Report:
    """Return what a line from the board says.

    ``line`` is without its end. Raise LineError if it is damaged, or nothing that a board of this protocol sends.
    """
    text, star, crc = line.strip().rpartition(b"*")
    if not star or len(line) > LINE_LENGTH:
        raise LineError(f"no line of the board: {_shown(line)}. Is the baud rate that of the sketch?")
    if crc != _crc(text):
        raise LineError(f"a damaged line: {_shown(line)}")
    kind, *fields = text.decode("ascii", "replace").split(" ")
    try:
        if kind == "A":
            name, version, converter, hertz = fields
            if name != "cutenv-board":
                raise ValueError
            return BoardIdentity(int(version), converter, int(hertz))
        numbers = [int(field) for field in fields]
        if kind == "F":
            return ForceReport(*numbers)
        if kind == "P":
            return StepperSetup(*numbers)
        if kind == "M":
            sequence, state, flags, steps, rate, bad = numbers
            return MotionReport(sequence, BoardState(state), BoardFlag(flags), steps, rate, bad)
    except (TypeError, ValueError):
        pass
    raise LineError(f"an unknown line: {_shown(line)}. Has the board the sketch of this version?")


def _crc(text: bytes) -> bytes:
    return b"%04X" % binascii.crc_hqx(text, _START)


def _shown(line: bytes) -> str:
    return repr(line[:40])[1:]


_log = logging.getLogger(__name__)

# time without a line from this computer after which a powered stepper stops by itself [s]; that of the sketch
BOARD_PATIENCE = 0.100
BEAT = 0.025  # period of this computer's sign of life [s]: three may be late
_ANSWER, _ASKED_AGAIN_AFTER = 0.6, 0.15  # [s] for an answer; [s] after which it is asked again
_BOOT = 5.0  # [s] for a board that restarts when its port is opened
_WRITE = 0.02  # [s] for the port to take a line
_READ = 0.1  # [s] for a read, which waits for nothing
_AT_ONCE = 4096  # [bytes] that are read at a time, at most: others have to be judged as well


class BoardMember(Protocol):
    """Axis or force sensor on the board."""

    def allows_heartbeat(self, now: float) -> bool:
        """Return whether it may have a sign of life at ``now`` [s]; True for a sensor."""
        ...

    def received(self, report: Report, time: float) -> None:
        """Take a report that arrived at ``time`` [s], in the loop."""
        ...

    def garbled(self, why: str, time: float) -> None:
        """Take the news of a line that was damaged."""
        ...

    def lost(self, why: str, time: float) -> None:
        """Take the report of a board lost since ``time`` [s]."""
        ...


class SerialBoard:
    """Board with the sketch of ``assets/firmware``.

    Opened by the first member that joins, closed by the last to leave. ``port`` is such as
    ``/dev/serial/by-id/usb-...``; ``clock`` paces the sign of life, and dates what arrives.
    """

    def __init__(self, port: str, baud: int, clock: Clock) -> None:
        self.port, self._baud, self._clock = port, baud, clock
        self.broken: str | None = None  # reason why nothing gets through; None while all is well
        self.identity: BoardIdentity | None = None  # identity of the board, once it has answered
        self.damaged = 0  # number of lines from the board that were damaged
        self.last_damaged = ""
        self._members: list[BoardMember] = []
        self._joining, self._sending = threading.Lock(), threading.Lock()
        self._changed = threading.Condition()
        self._line: Any = None
        self._rest = b""  # of a line that has not ended
        self._repeating: list[Repeating] = []
        self._answers: dict[type[Any], Report] = {}

    def join(self, member: BoardMember) -> BoardIdentity:
        """Add a member.

        The first opens the port and asks who answers. Returns the board's identity. Raise RigError if the port is
        missing, is used by another program, or no board of this protocol answers.
        """
        with self._joining:
            self._members.append(member)
            if len(self._members) == 1:
                try:
                    self._open()
                except BaseException:
                    self._members.clear()
                    raise
            if self.broken is not None or self.identity is None:
                self._members.remove(member)
                raise RigError(f"the board at {self.port} is lost: {self.broken}. Close the rig, and open it again.")
            return self.identity

    def leave(self, member: BoardMember) -> None:
        """Remove a member; the last closes the port. Never raises, may be repeated."""
        with self._joining:
            if member in self._members:
                self._members.remove(member)
                if not self._members:
                    self._close()

    def send(self, text: str) -> None:
        """Put a line on the port, from any thread, without waiting.

        Raise RigError if the port does not take it, which breaks the line, or it is not open.
        """
        line = self._line
        if line is None:
            raise RigError(f"the board at {self.port} is not open.")
        if not self._sending.acquire(timeout=_WRITE):
            raise self._break("the port takes no more lines")
        try:
            write_line(line, board_line(text), _WRITE)
        except Exception as error:  # pyserial and the system raise many kinds
            raise self._break(f"a line could not be sent: {error}") from error
        finally:
            self._sending.release()

    def ask(self, text: str, kind: type[Any], limit: float = _ANSWER) -> Any:
        """Send a line and return the answer of that kind; raise RigError if none comes in time."""
        with self._changed:
            self._answers.pop(kind, None)
        ends = self._clock.now() + limit
        while self.broken is None and self._clock.now() < ends:
            self.send(text)  # again and again: a board leaves an answer out that does not fit into its buffer
            self._clock.wait_for(
                lambda: kind in self._answers or self.broken is not None, _ASKED_AGAIN_AFTER, self._changed
            )
            if kind in self._answers:
                return self._answers[kind]
        why = self.broken or f"no answer to {text!r} within {limit:g} s: is it powered, is its cable in?"
        raise RigError(f"the board at {self.port}: {why}")

    def _open(self) -> None:
        self._line = open_port(self.port, self._baud, read_limit=_READ)
        self.broken, self.identity, self.damaged = None, None, 0
        self._rest = b""
        self._repeating = [self._clock.every(READ_EVERY, lambda now: self._read(), "cutenv board")]
        try:
            self.identity = self._identified()
        except BaseException:
            self._close()
            raise
        self._repeating.append(self._clock.every(BEAT, lambda now: self._live(), "cutenv board life"))

    def _identified(self) -> BoardIdentity:
        """Ask the board's identity repeatedly, as it may be starting."""
        ends = self._clock.now() + _BOOT
        while True:
            try:
                identity: BoardIdentity = self.ask("I", BoardIdentity)
                break
            except RigError:
                if self.broken is not None or self._clock.now() > ends:
                    heard = f" What came was {self.last_damaged}" if self.damaged else " Nothing came."
                    raise RigError(
                        f"no cutenv board answers at {self.port} and {self._baud} baud.{heard} Is it powered, has it "
                        "the sketch of assets/firmware, and is the baud rate the same in both?"
                    ) from None
        if identity.protocol != BOARD_PROTOCOL:
            raise RigError(
                f"the board at {self.port} speaks version {identity.protocol} of the protocol, this program "
                f"{BOARD_PROTOCOL}: load the sketch of this version."
            )
        return identity

    def _close(self) -> None:
        while self._repeating:
            self._repeating.pop().stop()
        line, self._line = self._line, None
        try:
            line.close()
        except Exception:  # the device is gone
            _log.warning("the port %s was not closed in order", self.port, exc_info=True)

    def _live(self) -> None:
        now = self._clock.now()
        if self.broken is None and all(member.allows_heartbeat(now) for member in tuple(self._members)):
            try:
                self.send("H")
            except RigError as error:  # the break itself informs the members
                _log.warning("%s", error)

    def _read(self) -> None:
        """Handle the lines that have arrived; inform the members of a break, of which they take the first report."""
        if (why := self.broken) is not None:
            self._each(lambda member: member.lost(why, self._clock.now()))
        try:
            read = self._line.read(min(self._line.in_waiting, _AT_ONCE))
        except Exception as error:  # pyserial and the system raise many kinds
            self._break(f"nothing can be read any more: {error}")
            return
        *lines, self._rest = (self._rest + read).split(b"\n")
        if len(self._rest) > LINE_LENGTH:
            lines, self._rest = [*lines, self._rest], b""
        for each in lines:
            self._handle(each)

    def _handle(self, line: bytes) -> None:
        now = self._clock.now()
        try:
            report = board_report(line)
        except LineError as error:
            self.damaged, self.last_damaged = self.damaged + 1, str(error)
            self._each(lambda member: member.garbled(self.last_damaged, now))
            return
        if not hasattr(report, "sequence"):
            with self._changed:
                self._answers[type(report)] = report
                self._changed.notify_all()
            return
        self._each(lambda member: member.received(report, now))

    def _each(self, tell: Callable[[BoardMember], None]) -> None:
        for member in tuple(self._members):
            try:
                tell(member)
            except Exception as error:  # reading has to go on, to see the blade stop
                _log.exception("a report of the board could not be handled")
                self._break(f"a report could not be handled: {error!r}")

    def _break(self, why: str) -> RigError:
        """Note that the line is broken; return the error.

        The loop informs the members: the sender may hold the very lock that one of them needs to stop the blade.
        """
        with self._changed:
            self.broken = self.broken or why
            self._changed.notify_all()
        return RigError(f"the board at {self.port} is lost: {why}.")
