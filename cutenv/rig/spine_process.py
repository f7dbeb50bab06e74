"""Process of a rig's spine, and the memory that it shares.

It takes commands and calls from the policy's program, and stops the blade without it. Its main thread waits for the
program. The loop's thread judges the rig every 2 ms, and looks whether the program lives, asks for a stop, or a signal
has come; a driver that holds up the main thread holds up none of that.

The shared memory is rings of numbered records, without a lock: nobody waits for anybody. Whoever writes takes the next
number and overwrites the oldest record; whoever reads looks for the number that comes next. Each record carries its
number and a checksum of both, so that one that is half written, or half overwritten, is not there yet: it is never
taken for a record, in whatever order a processor writes.
"""

from __future__ import annotations

import ctypes
import gc
import itertools
import json
import logging
import mmap
import os
import pickle
import select
import signal
import socket
import struct
import sys
import tempfile
import threading
import time
import zlib
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import asdict
from logging.handlers import QueueHandler, QueueListener
from multiprocessing.connection import Connection
from queue import SimpleQueue
from typing import Any

from cutenv.rig.devices.loop import SWITCH, Attempt, SystemClock, prefer
from cutenv.rig.devices.protocols import DriveState, ForceSample, MotionSample
from cutenv.rig.errors import RigError
from cutenv.rig.safety.oversight import SIGNALS
from cutenv.rig.safety.stop_causes import WATCH, Cause, StopReport
from cutenv.rig.spine import CLOSED_WITHIN, Receiver, Spine, mounted_spine

_HEAD = struct.Struct("<QII")  # number, checksum, length


def ring_size(record: int, count: int) -> int:
    """Return the length of a ring of ``count`` records of at most ``record`` bytes [bytes]."""
    return (record + _HEAD.size) * count


class Ring:
    """Ring of records in shared memory, for one process that writes and one that reads.

    Several threads may write; of those that read, only one at a time. ``memory``: memory, zero at first; ``start``:
    place of the ring in it [bytes]; ``record``: greatest length of a record [bytes]; ``count``: number of records that
    it holds.
    """

    def __init__(self, memory: mmap.mmap | bytearray, start: int, record: int, count: int) -> None:
        self._memory, self._start, self._record, self._count = memory, start, record + _HEAD.size, count
        self._numbers = itertools.count(1)  # next() is one step for all threads
        self._expected, self._far = 1, max(count // 256, 8)
        self.lost = 0  # number of records that were overwritten, or destroyed, before they were read

    def put(self, record: bytes) -> None:
        """Write a record over the oldest one; raises ValueError if it is too long."""
        if len(record) > self._record - _HEAD.size:
            raise ValueError(f"a record of {len(record)} bytes is too long: {self._record - _HEAD.size} at most.")
        number = next(self._numbers)
        at = self._start + number % self._count * self._record
        whole = _HEAD.pack(number, zlib.crc32(record, number & 0xFFFFFFFF), len(record)) + record
        self._memory[at : at + len(whole)] = whole

    def take(self) -> bytes | None:
        """Return the next record, or None while there is none.

        A reader who is a whole ring behind goes on with what has overwritten the record, one whose record was destroyed
        with the next; both count what they have missed.
        """
        while (found := self._at(self._expected)) is None:
            if self._at(self._expected + self._far) is None:
                return None
            self.lost += 1  # who has written so much later has written this one, too
            self._expected += 1
        number, record = found
        self.lost += number - self._expected
        self._expected = number + 1
        return record

    def _at(self, wanted: int) -> tuple[int, bytes] | None:
        """Return number and content of the record that stands where ``wanted`` should, if it is that or a later one."""
        at = self._start + wanted % self._count * self._record
        number, checksum, length = _HEAD.unpack_from(self._memory, at)
        if number < wanted or length > self._record - _HEAD.size:
            return None
        record = bytes(self._memory[at + _HEAD.size : at + _HEAD.size + length])
        return (number, record) if zlib.crc32(record, number & 0xFFFFFFFF) == checksum else None


_SAMPLE = struct.Struct("<BB6xQQqd6d6q")  # kind, axis, status or state, sequence, lost, time, six values, six counts
_FORCE, _MOTION, _ALIVE, _GARBLED = range(4)
_STATES = tuple(DriveState)
_NONE = (0.0,) * 6
_NO_COUNTS = (0,) * 6


class SampleWriter:
    """Receiver that writes what drivers have reported into a ring.

    ``ring``: ring, of records as long as :attr:`RECORD`; ``axes``: names of the axes, in the order in which the reader
    knows them.
    """

    RECORD = _SAMPLE.size

    def __init__(self, ring: Ring, axes: Sequence[str]) -> None:
        self._ring, self._axes = ring, {name: number for number, name in enumerate(axes)}

    def force(self, sample: ForceSample) -> None:
        """Write a reading of the force sensor."""
        values, counts = (*sample.force, *sample.torque), sample.counts
        self._ring.put(
            _SAMPLE.pack(_FORCE, 0, sample.status, sample.sequence, sample.lost, sample.time, *values, *counts)
        )

    def motion(self, axis: str, sample: MotionSample) -> None:
        """Write a sample of an axis."""
        values = (sample.position, sample.speed, sample.torque, 0.0, 0.0, 0.0)
        state = _STATES.index(sample.state)
        self._ring.put(_SAMPLE.pack(_MOTION, self._axes[axis], state, 0, 0, sample.time, *values, *_NO_COUNTS))

    def alive(self, axis: str, time: float) -> None:
        """Write a drive's heartbeat, which arrived at ``time`` [s]."""
        self._ring.put(_SAMPLE.pack(_ALIVE, self._axes[axis], 0, 0, 0, time, *_NONE, *_NO_COUNTS))

    def garbled(self, why: str, time: float) -> None:
        """Write that a packet was not a valid reading."""
        self._ring.put(_SAMPLE.pack(_GARBLED, 0, 0, 0, 0, time, *_NONE, *_NO_COUNTS))


def deliver(record: bytes, axes: Sequence[str], receiver: Receiver) -> None:
    """Give a receiver what a :class:`SampleWriter` has written."""
    kind, axis, status, sequence, lost, time, *numbers = _SAMPLE.unpack(record)
    x, y, z, a, b, c, *counts = numbers
    if kind == _FORCE:
        receiver.force(ForceSample(time, (x, y, z), tuple(counts), status, sequence, lost, (a, b, c)))
    elif kind == _MOTION:
        receiver.motion(axes[axis], MotionSample(time, x, y, z, _STATES[status]))
    elif kind == _ALIVE:
        receiver.alive(axes[axis], time)
    else:
        receiver.garbled("not a reading", time)


class Link:
    """Shared memory of one rig, without a name.

    Nothing of it is left when both processes have ended. ``file``: descriptor of the memory that the other process has
    made; by default it is made. ``samples``: what drivers have reported, from the spine: about ten seconds of it;
    ``states``: state of the rig as JSON, from the spine, whenever it has changed; ``stops``: stops that the program
    asks for, as JSON.
    """

    def __init__(self, file: int | None = None) -> None:
        shapes = ((SampleWriter.RECORD, 16384), (2048, 64), (1024, 16))
        sizes = [ring_size(*shape) for shape in shapes]
        self.file = _memory_file(sum(sizes)) if file is None else file
        memory = mmap.mmap(self.file, sum(sizes))
        starts = itertools.accumulate(sizes, initial=0)
        self.samples, self.states, self.stops = (
            Ring(memory, start, *shape) for start, shape in zip(starts, shapes, strict=False)
        )

    def close(self) -> None:
        """Close the descriptor; what was shared can still be read."""
        os.close(self.file)


def cut_to(text: str, size: int) -> str:
    """Return as much of a text as takes ``size`` bytes in JSON."""
    while len(json.dumps(text)) > size:
        text = text[: 3 * len(text) // 4]
    return text


def _memory_file(length: int) -> int:
    if hasattr(os, "memfd_create"):
        file = os.memfd_create("cutenv-rig")
    else:
        with tempfile.TemporaryFile() as unnamed:
            file = os.dup(unnamed.fileno())
    os.truncate(file, length)
    return file


# command: its mark, number, the parent of the program, time, speed or rate, angle, hold, height, side [SI]
COMMAND = struct.Struct("<c7xqq6d")
GO, TURN, DONE = b"D", b"T", b"O"  # marks of a message's first byte; a call is pickled, and begins otherwise
REPLY = struct.Struct("<c7xqd")  # reply to a command: :data:`DONE`, its number, the angle to turn to [rad]


OF_SPINE = ("power", "switch_off", "set_zero", "drive_limits", "about", "tare")
"""Methods of :class:`~cutenv.rig.spine.Spine` that the program may call."""
OF_SUPERVISOR = ("release", "lock", "lower", "reset")
"""Methods of :class:`~cutenv.rig.safety.supervisor.Supervisor` that it may call."""
SEEN = ("latched", "beyond", "pressed", "relieving", "standing")  # properties of the supervisor that it may read
# greatest time for which a command may be valid [s]; the blade goes on for so long without the program
LONGEST_HOLD = 1.0
_DETAIL = 1200  # [bytes] of a detail that are written
_LONGEST_MESSAGE = 1 << 16  # [bytes] of a command or call
_WRITTEN_WITHIN = 0.5  # [s] for what was logged last to be written
_STACK = 1 << 19  # [bytes] of a thread
_log = logging.getLogger(__name__)


def serve_spine(line: int, memory: int, program: int) -> None:
    """Run the spine of one rig until the program at the other end closes it, or ends.

    ``line``: descriptor of the connection to the program, which sends the rig's settings first; ``memory``: descriptor
    of the memory of a :class:`~cutenv.rig.spine_process.Link`; ``program``: id of the program's process.
    """
    received, log = _hear_signals(), _log_apart()
    connection, link, clock = Connection(line), Link(memory), SystemClock()
    try:
        spine = mounted_spine(connection.recv(), clock)
    except Exception as error:
        return connection.send((False, _portable(error)))
    served = _Served(spine, connection, link, program, received, log)
    allowed = _take_precedence()
    clock.every(WATCH, served.look, "rig program")
    connection.send((True, allowed))
    served.run()
    time.sleep(CLOSED_WITHIN * (len(spine.axes) + 2))  # meanwhile the loop closes the rig, and ends this process
    os._exit(1)  # a driver holds up the loop


class _Served:
    """A spine that is served; see :func:`serve_spine`."""

    def __init__(
        self, spine: Spine, line: Connection, link: Link, program: int, signals: socket.socket, log: QueueListener
    ) -> None:
        self.spine, self.supervisor = spine, spine.supervisor
        self._line, self._link, self._signals, self._log = line, link, signals, log
        self._program, self._its_parent = program, 0
        self._parents_end: int | None = None  # descriptor that can be read once the program's parent has ended
        self._number = 0  # of the last message
        self._told: tuple[Any, ...] = ()
        self._heard = 0  # stops that were asked for
        self._over = self._leaving = False  # the loop alone begins to leave

    def run(self) -> None:
        """Take commands and calls until the program has ended, or has closed the rig."""
        while True:
            try:
                message = self._line.recv_bytes(_LONGEST_MESSAGE)
                reply = self._commanded(message) if message[:1] in (GO, TURN) else self._called(message)
            except (EOFError, ConnectionError):
                break
            except Exception as error:  # nobody knows what the program wants
                self.supervisor.trip(Cause.EXCEPTION, f"no message of the program: {type(error).__name__}: {error}")
                break
            self._tell()  # first: who has the answer may ask for the state
            with suppress(OSError):  # nobody waits for it any more
                self._line.send_bytes(reply)
        self._over = True

    def _commanded(self, message: bytes) -> bytes:
        mark, number, parent, given, speed, angle, hold, height, side = COMMAND.unpack(message)
        supervisor, late = self.supervisor, self.spine.clock.now() - given
        if parent != (self._its_parent or parent):
            supervisor.trip(Cause.ORPHANED, f"the parent process {self._its_parent} has ended")
        if not self._its_parent:
            self._its_parent = parent
            with suppress(AttributeError, OSError):  # elsewhere the next command tells
                self._parents_end = os.pidfd_open(parent)
        self._in_order(number)
        try:
            if not 0.0 <= late <= hold <= LONGEST_HOLD:
                given = f"a command came {1e3 * late:.0f} ms after it was given"
                supervisor.trip(Cause.OVERRUN, f"{given}, to be valid for {1e3 * hold:.0f} ms")
            if mark == TURN:
                supervisor.turn(speed)
                return REPLY.pack(DONE, number, angle)
            return REPLY.pack(DONE, number, supervisor.drive(speed, angle, hold - late, height=height, side=side))
        except Exception as error:
            return pickle.dumps((number, False, _portable(error)))

    def _in_order(self, number: int) -> None:
        """Note the number of a message, and stop the blade if it does not come after the last one."""
        last, self._number = self._number, max(self._number, number)
        if number <= last:
            why = f"message {number} of the program comes after {last}: two programs, or a fork, command one rig"
            self.supervisor.trip(Cause.FOREIGN, why)

    def _called(self, message: bytes) -> bytes:
        number, name, arguments, named = pickle.loads(message)
        self._in_order(number)
        try:
            return pickle.dumps((number, True, self._called_by_name(name, *arguments, **named)))
        except Exception as error:
            return pickle.dumps((number, False, _portable(error)))

    def _called_by_name(self, name: str, *arguments: Any, **named: Any) -> Any:
        spine = self.spine
        if name == "open":
            spine.open(SampleWriter(self._link.samples, list(spine.settings.axes)))
            return spine.rate_error, spine.counts_steps
        if name in SEEN:
            return getattr(self.supervisor, name)
        if name not in OF_SPINE + OF_SUPERVISOR:
            raise RigError(f"a rig's spine has no call {name!r}.")
        found = getattr(spine if name in OF_SPINE else self.supervisor, name)(*arguments, **named)
        if name == "switch_off":
            gc.collect()  # without power a millisecond does not matter
        return self.supervisor.settings if name == "lower" else found

    # In the loop

    def look(self, now: float) -> None:
        """Stop the blade for a signal, for the program, or without it; tell the state of the rig if it has changed."""
        with suppress(BlockingIOError):
            for number in self._signals.recv(64):
                self.supervisor.trip(Cause.INTERRUPTED, signal.Signals(number).name)
        while (asked := self._link.stops.take()) is not None:
            wanted = json.loads(asked)
            if "close" in wanted:
                self._over = True
            else:
                self.supervisor.trip(Cause(wanted["cause"]), wanted["detail"])
            self._heard += 1
        if self._parents_end is not None and select.select([self._parents_end], [], [], 0)[0]:
            self.supervisor.trip(Cause.ORPHANED, f"the parent process {self._its_parent} has ended")
        if os.getppid() != self._program:
            self.supervisor.trip(Cause.ORPHANED, f"the program {self._program}, which commands the rig, has ended")
            self._over = True
        if self._over and not self._leaving:
            self._leaving = True
            Attempt(self._closed, "rig close")  # the loop has to go on meanwhile
        self._tell()

    def _tell(self) -> None:
        """Write the state of the rig if it has changed; the loop's next look corrects one that two have written."""
        supervisor, report = self.supervisor, self.supervisor.report
        stop = None if report is None else asdict(report) | {"detail": cut_to(report.detail, _DETAIL)}
        state = (str(supervisor.phase), supervisor.limited, self._heard, stop)
        if state != self._told:
            self._link.states.put(json.dumps(state).encode())
            self._told = state

    def _closed(self) -> None:
        """Close the rig, and end this process."""
        try:
            self.spine.close()
            self._tell()
        except Exception:
            _log.exception("the rig was not closed in order")
        finally:
            Attempt(self._log.stop, "rig log").ends(_WRITTEN_WITHIN)
            os._exit(0)  # threads of drivers may never return


def read_state(state: bytes) -> tuple[str, int, int, StopReport | None]:
    """Return phase, number of commands reduced, number of stops heard, and the report of the last stop."""
    phase, limited, heard, stop = json.loads(state)
    return phase, limited, heard, None if stop is None else StopReport(**stop | {"cause": Cause(stop["cause"])})


def _portable(error: Exception) -> Exception:
    """Return an error that the other process knows, too."""
    if type(error) in (RigError, ValueError, ModuleNotFoundError):
        return error
    return RigError(str(error) if isinstance(error, RigError) else f"{type(error).__name__}: {error}")


def _hear_signals() -> socket.socket:
    """Have signals written to a socket, which the loop reads: no driver that holds the main thread holds them up.

    The program has blocked them before it started this process.  Ctrl-Z is for the program alone.
    """
    receiving, writing = socket.socketpair()
    receiving.setblocking(False)
    writing.setblocking(False)
    for number in SIGNALS:
        signal.signal(number, lambda *_: None)
    signal.set_wakeup_fd(writing.detach(), warn_on_full_buffer=False)
    signal.signal(signal.SIGTSTP, signal.SIG_IGN)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, SIGNALS)
    return receiving


def _log_apart() -> QueueListener:
    """Have what is logged written from a thread of its own: a terminal that takes no more keeps nothing from a stop."""
    waiting = SimpleQueue[logging.LogRecord]()
    logging.getLogger().addHandler(QueueHandler(waiting))
    listener = QueueListener(waiting, logging.StreamHandler())
    listener.start()
    return listener


def _take_precedence() -> bool:
    """Collect no garbage from here on, keep the memory, and run before others; return whether that is allowed."""
    gc.collect()
    gc.freeze()
    gc.disable()
    sys.setswitchinterval(SWITCH)
    threading.stack_size(_STACK)  # all of it is in memory once it is kept: the usual 8 MiB hold up a new thread by 3 ms
    with suppress(ImportError, OSError, AttributeError, ValueError):
        import resource  # Windows, where the module has to be importable, has none

        everything, later = 1, 2
        unlimited = resource.getrlimit(resource.RLIMIT_MEMLOCK)[0] == resource.RLIM_INFINITY or os.geteuid() == 0
        ctypes.CDLL(None).mlockall(everything | (later if unlimited else 0))
    return prefer(first_in=True)
