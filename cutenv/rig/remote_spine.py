"""Spine in a process of its own, as a program sees it.

What runs where::

    program                                       spine (a plain interpreter: no policy, compiler or learner)
    policy, environment, records                  drivers, which the loop reads; few have a thread of their own
    plant: when the blade goes where              supervisor: judges every report and every command
    RemoteSpine  ---- commands, calls (socket) -> main thread: passes them to supervisor and drivers
                 <--- samples, state (memory) --- loop, every 0.5 ms
                 ---- stops (memory) -----------> loop: every 2 ms; also signals, and whether the program lives

A command is 72 bytes with number, time and validity, put into a socket that wakes the spine: the system delivers it
whole and in order, or not at all. Samples and the state come back through :mod:`cutenv.rig.spine_process`: neither
process waits for the other, and there is no lock between them. Calls that take their time (power, tare, reset) are
pickled through the same socket, and none is needed while the blade cuts.

A program that is killed, paused, hangs or compiles sends no next command in time: that stops the blade, as a late
command does. If the spine is killed, the drives miss its heartbeat and stop; the program is told so at its next look.
"""

from __future__ import annotations

import itertools
import json
import math
import os
import pickle
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from functools import partialmethod
from multiprocessing.connection import Connection
from typing import Any, NoReturn

from cutenv.rig.config.settings import RigSettings, SafetyLimits
from cutenv.rig.devices.loop import Owner, SystemClock
from cutenv.rig.devices.protocols import ForceSample, MotionSample, Phase
from cutenv.rig.errors import RigError
from cutenv.rig.safety.oversight import SIGNALS
from cutenv.rig.safety.stop_causes import Cause, StopReport
from cutenv.rig.spine import CLOSED_WITHIN, Receiver
from cutenv.rig.spine_process import COMMAND, DONE, GO, LONGEST_HOLD, REPLY, TURN, Link, cut_to, deliver, read_state

_STARTS_WITHIN = 60.0  # [s]
_CALLS_WITHIN = 60.0  # [s] for power, tare, reset; each driver has its own, shorter limits
_COMMANDS_WITHIN = 0.5  # [s] for a command to be on the bus
_HEARD_WITHIN = 0.2  # [s] for the spine to hear a stop, after which the line is ended
_STOPS_WITHIN = 0.5  # [s] for a stop that is asked for to be under way
_SILENT = 0.2  # [s] without a sample, from which the program knows nothing of the blade any more
_HEARS_EVERY = 1.0  # [s] of samples that are taken in at a time, at most
_DETAIL = 800  # [bytes] of the detail of a stop that is asked for
_LOOK = 0.0005  # [s] between two looks for an answer through the memory


class RemoteSpine:
    """Spine in a process of its own, with the interface of :class:`~cutenv.rig.spine.Spine`.

    ``clock``: clock of the rig, the same in both processes; whoever waits by it has then received all samples until
    then; ``rate_error``: greatest relative error of that rate [1], once it is open; ``counts_steps``: True if the
    blade's drive counts the steps that it sends, once it is open.
    """

    def __init__(self, settings: RigSettings) -> None:
        self.settings, self.clock = settings, _HearingClock(self.hear)
        self.rate, self.rate_error, self.counts_steps = settings.sensor.rate, 0.0, False
        self.real_time = False  # True if the system lets it run before other processes, once it is open
        self.supervisor = RemoteSupervisor(self)  # safety of the rig
        self.pid = 0  # id of its process; 0 before it is opened
        self._axes = list(settings.axes)
        self._receiver: Receiver | None = None
        self._owner = Owner()
        self._process: subprocess.Popen[bytes] | None = None
        self._line: Connection
        self._link: Link
        self._calling, self._hearing = threading.Lock(), threading.RLock()  # which a signal's handler may find held
        self._numbers = itertools.count(1)
        self._asked = 0
        self._closing = False
        self._taking_in, self._heard_at = False, 0.0
        self._why_ended = ""
        self.lost: StopReport | None = None  # report of the spine's own end, if it ended before it was closed

    @property
    def gone(self) -> bool:
        """True if its process has ended before it was closed."""
        return self.lost is not None

    def open(self, receiver: Receiver) -> None:
        """Start the process, and connect to drives and sensor; nothing moves."""
        if os.name == "nt":
            raise RigError("a rig is moved from Linux or macOS: there its safety has a process of its own.")
        self._receiver, self._owner = receiver, Owner()
        self._asked = self.supervisor.heard = 0
        self._closing, self._heard_at, self._why_ended, self.lost = False, 0.0, "", None
        self._start()
        try:
            found = self.call("open")
        except BaseException:
            self.close()
            raise
        self.rate_error, self.counts_steps = found

    def _start(self) -> None:
        while (taken := os.open(os.devnull, os.O_RDWR)) <= 2:
            pass  # closed, 0 to 2 would be what the spine logs to
        os.close(taken)
        self._link = link = Link()
        ours, theirs = socket.socketpair()
        code = f"import sys; sys.path[:] = {sys.path!r}\nfrom cutenv.rig.spine_process import serve_spine\n"
        code += f"serve_spine({theirs.fileno()}, {link.file}, {os.getpid()})"
        before = signal.pthread_sigmask(signal.SIG_BLOCK, SIGNALS)  # until it can answer them
        try:
            self._process = subprocess.Popen(
                [sys.executable, "-c", code], stdin=subprocess.DEVNULL, pass_fds=(theirs.fileno(), link.file)
            )
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
        theirs.close()
        link.close()
        self.pid, self._line = self._process.pid, Connection(ours.detach())
        try:
            self._line.send(self.settings)
            if not self._line.poll(_STARTS_WITHIN):
                raise RigError(f"the rig's spine has not started after {_STARTS_WITHIN:g} s: is this machine busy?")
            made, found = self._line.recv()
        except (EOFError, OSError) as error:
            self._process.wait()
            raise RigError("the rig's spine has ended at its start; see its message above.") from error
        except BaseException:
            self._process.kill()
            raise
        if not made:
            self._process.wait()
            raise found
        self.real_time = found

    def close(self) -> None:
        """Stop any motion, close drives and sensor, and end the process; never raises for a rig that is gone."""
        process, self._closing = self._process, True
        if process is None:
            return
        if process.poll() is None:
            self._ask({"close": True})
        patience = CLOSED_WITHIN * (len(self._axes) + 2)
        deadline = time.monotonic() + patience
        while process.poll() is None:
            if time.monotonic() > deadline:  # the drives have had their quick stops, and now miss its heartbeat
                process.kill()
            time.sleep(_LOOK)
        self.hear()
        self._process = None
        self._line.close()

    # Calls and commands

    def call(self, name: str, *arguments: Any, **named: Any) -> Any:
        """Have the spine do something that is named, and return its answer."""
        self._owner.check()
        with self._calling:
            number = next(self._numbers)
            self._send(pickle.dumps((number, name, arguments, named)))
            answer = self._answer(number, _CALLS_WITHIN)
        if answer is None:
            raise RigError(f"the rig's spine does not answer {name!r} within {_CALLS_WITHIN:g} s: does a driver hang?")
        made, value = answer
        if not made:
            raise value
        return value

    def command(self, mark: bytes, *numbers: float) -> float | None:
        """Send a command; return the angle to turn to [rad], or None for a driver that does not return from it."""
        self._owner.check()
        with self._calling:
            number = next(self._numbers)
            self._send(COMMAND.pack(mark, number, os.getppid(), self.clock.now(), *numbers))
            answer = self._answer(number, _COMMANDS_WITHIN)
        if answer is None:
            return None
        made, value = answer
        if not made:
            raise value
        return float(value)

    def _send(self, message: bytes) -> None:
        if self._process is None:
            raise RigError("the rig is not open.")
        try:
            self._line.send_bytes(message)
        except OSError:
            self._end_found()

    def _answer(self, number: int, within: float) -> tuple[bool, Any] | None:
        deadline = time.monotonic() + within
        while (left := deadline - time.monotonic()) > 0.0:
            try:
                if not self._line.poll(left):
                    break
                reply = self._line.recv_bytes()
            except (EOFError, OSError):
                self._end_found()
            if reply[:1] == DONE:
                _, answered, turned = REPLY.unpack(reply)
                made, value = True, turned
            else:
                answered, made, value = pickle.loads(reply)
            if answered == number:  # others answer calls that were interrupted
                return made, value
        return None

    def _end_found(self) -> NoReturn:
        """Take note that the process has ended; raise RigError."""
        assert self._process is not None
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(1.0)
        self._note_end()
        raise RigError("the rig is closed." if self.lost is None else self.lost.detail)

    def _note_end(self) -> None:
        if self._process is None or self._closing or self.lost is not None:
            return
        if (status := self._process.poll()) is not None:
            how = f"was ended by {signal.Signals(-status).name}" if status < 0 else f"has ended with status {status}"
            how += self._why_ended
            self.lost = StopReport(
                cause=Cause.SPINE,
                detail=f"the process {self.pid}, which watches the rig, {how}; without its heartbeat the drives stop "
                "by themselves. Press the stop button, look, and begin again",
                detected=self.clock.now(),
            )

    # What comes through the memory

    def hear(self) -> None:
        """Take in what the spine has reported since the last time."""
        if self._process is None or not self._owner.here:
            return  # a fork's copy of the lock is never released
        with self._hearing:
            if self._taking_in:
                return  # this is a signal's handler, which has interrupted this very thread
            self._taking_in = True
            try:
                why = self._take_in()
            finally:
                self._taking_in = False
        if why:
            self.ask_for_stop(Cause.EXCEPTION, f"{why}: it is paused, or something wrote to its memory")

    def _take_in(self) -> str:
        """Take in what is in the memory; return why the blade has to be stopped, or ""."""
        self.supervisor.hear(self._link.states)
        samples, before, came = self._link.samples, self._link.samples.lost, False
        while (record := samples.take()) is not None:
            deliver(record, self._axes, self)
            came = True
        now, missed = self.clock.now(), samples.lost - before
        if came or not self._heard_at:
            self._heard_at = now
        self._note_end()
        if self.supervisor.last_phase is not Phase.READY or self.supervisor.heard < self._asked:
            return ""  # nothing moves, or a stop is asked for already, and is the reason
        if not missed and now - self._heard_at <= _SILENT:
            return ""
        self._heard_at = math.inf  # until the next comes
        return f"{missed} readings of the spine are lost" if missed else "nothing comes from the spine any more"

    def force(self, sample: ForceSample) -> None:
        """Take a reading of the force sensor from the memory."""
        self.supervisor.newest_force_heard = sample
        if self._receiver is not None:
            self._receiver.force(sample)

    def motion(self, axis: str, sample: MotionSample) -> None:
        """Take a sample of an axis from the memory."""
        self.supervisor.newest[axis] = sample
        if self._receiver is not None:
            self._receiver.motion(axis, sample)

    def alive(self, axis: str, time: float) -> None:
        """Take a drive's heartbeat from the memory."""
        if self._receiver is not None:
            self._receiver.alive(axis, time)

    def garbled(self, why: str, time: float) -> None:
        """Take the report of a packet that is not a valid reading from the memory."""
        if self._receiver is not None:
            self._receiver.garbled(why, time)

    def ask_for_stop(self, cause: Cause, detail: str) -> None:
        """Have the loop of the spine stop the blade, from any thread; return once its quick stops are under way."""
        process, number = self._process, self._ask({"cause": cause.value, "detail": cut_to(detail, _DETAIL)})
        asked = time.monotonic()
        while self.supervisor.heard < number and process is not None and not (self.gone or self._closing):
            if (waited := time.monotonic() - asked) > _HEARD_WITHIN:
                self._why_ended = self._why_ended or f", because it did not hear a stop ({cause.value}: {detail})"
                self._hang_up()
            if waited > _STOPS_WITHIN:  # without its heartbeat the drives stop by themselves
                process.kill()
            time.sleep(_LOOK)
            self.hear()

    def _hang_up(self) -> None:
        """End the line, for which the spine stops the blade and ends."""
        with suppress(OSError), socket.socket(fileno=os.dup(self._line.fileno())) as line:
            line.shutdown(socket.SHUT_RDWR)

    def _ask(self, wanted: dict[str, Any]) -> int:
        self._link.stops.put(json.dumps(wanted).encode())
        self._asked += 1
        return self._asked

    # Procedures, each as that of the spine with this name

    power = partialmethod(call, "power")
    switch_off = partialmethod(call, "switch_off")
    set_zero = partialmethod(call, "set_zero")
    drive_limits = partialmethod(call, "drive_limits")
    about = partialmethod(call, "about")
    tare = partialmethod(call, "tare")


class _HearingClock(SystemClock):
    """The machine's clock.

    Whoever waits by it takes in what the spine has reported.
    """

    def __init__(self, hear: Callable[[], None]) -> None:
        super().__init__()
        self._hear = hear

    def sleep_until(self, moment: float) -> float:
        """Wait until ``moment`` [s], and take in the samples until then."""
        while True:
            now = super().sleep_until(min(moment, self.now() + _HEARS_EVERY))
            self._hear()
            if now >= moment:
                return now


def _seen(name: str) -> Any:
    """Return a property that asks the spine for what its supervisor sees."""
    return property(lambda supervisor: supervisor._spine.call(name))


class RemoteSupervisor:
    """Safety of a rig whose spine has a process of its own; see :class:`cutenv.rig.safety.oversight.Oversight`.

    ``limited``: number of commands that were reduced to a limit since the last release; ``heard``: number of stops
    asked for that the spine has heard; ``last_phase``: phase that the spine has reported last.
    """

    def __init__(self, spine: RemoteSpine) -> None:
        self.settings, self.limits = spine.settings, spine.settings.limits
        self.limited = self.heard = 0
        self.newest: dict[str, MotionSample] = {}  # last sample of each axis that was received
        self.newest_force_heard: ForceSample | None = None  # last force reading that was received
        self._spine = spine
        self.last_phase, self._report = Phase.UNREADY, None

    _report: StopReport | None

    def hear(self, states: Any) -> None:
        """Take in the states that the spine has told."""
        while (state := states.take()) is not None:
            phase, self.limited, self.heard, report = read_state(state)
            if report is not None:
                if self._report is not None and self._report.detected == report.detected:
                    vars(self._report).update(vars(report))  # whoever has it sees it completed
                else:
                    self._report = report
            self.last_phase = Phase(phase)

    @property
    def phase(self) -> Phase:
        """State of the rig; stopped, if the spine has ended."""
        self._spine.hear()
        return Phase.STOPPED if self._spine.gone else self.last_phase

    @property
    def report(self) -> StopReport | None:
        """Report of the last stop; None before the first."""
        self._spine.hear()
        return self._spine.lost or self._report

    def drive(self, speed: float, angle: float, hold: float, **across: float) -> float:
        """Send a command, see :meth:`cutenv.rig.safety.supervisor.Supervisor.drive`."""
        turned = self._spine.command(GO, speed, angle, hold, across.get("height", 0.0), across.get("side", 0.0))
        if turned is None and (phase := self.phase) is not Phase.READY:
            raise RigError(f"the blade may not move: the rig is {phase} ({self.report}), and a driver does not return.")
        return angle if turned is None else turned

    def turn(self, rate: float) -> None:
        """Send a turning speed [rad/s] to the angle's axis, if the rig is released."""
        with suppress(RigError):  # who waits for the blade sees that the spine has ended
            self._spine.command(TURN, rate, 0.0, LONGEST_HOLD, 0.0, 0.0)

    def trip(self, cause: Cause, detail: str) -> None:
        """Stop the blade of a released rig, from any thread; return once the quick stops are on their way."""
        if self.phase is Phase.READY:
            self._spine.ask_for_stop(cause, detail)

    def await_quick_stops(self) -> None:
        """Wait until the quick stops of a stop under way are sent."""
        deadline = time.monotonic() + _STOPS_WITHIN
        while not self._spine.gone and (report := self.report) is not None and report.commanded is None:
            if time.monotonic() > deadline:
                return
            time.sleep(_LOOK)

    def release(self, *, returning: bool = False) -> None:
        """Allow commands, see :meth:`cutenv.rig.safety.supervisor.Supervisor.release`."""
        self._spine.hear()  # what was missed before does not count
        self._spine.call("release", returning=returning)

    def lock(self) -> None:
        """Command zero speed on every axis, and refuse motion until the next release."""
        if not self._spine.gone:
            self._spine.call("lock")

    def lower(self, limits: SafetyLimits) -> None:
        """Adopt each limit that is stricter than the present one."""
        self.settings = self._spine.call("lower", limits)
        self.limits = self.settings.limits

    def reset(self, agreed: bool) -> None:
        """Clear what is latched, if the operator has ``agreed``."""
        self._spine.call("reset", agreed=agreed)

    @property
    def newest_force(self) -> ForceSample | None:
        """Last force reading; None before the first."""
        self._spine.hear()
        return self.newest_force_heard

    @property
    def blade(self) -> MotionSample | None:
        """Last sample of the blade's axis; None before the first."""
        return self.axis("blade")

    def axis(self, name: str) -> MotionSample | None:
        """Return the last sample of an axis; None before the first."""
        self._spine.hear()
        return self.newest.get(name)

    # What the spine alone knows, each as the property of its supervisor with this name

    latched = _seen("latched")
    beyond = _seen("beyond")
    pressed = _seen("pressed")
    relieving = _seen("relieving")
    standing = _seen("standing")
