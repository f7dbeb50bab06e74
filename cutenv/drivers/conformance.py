"""Conformance of drivers to their protocols.

An axis moves by millimetres as told, refuses and stops; a sensor reads in order and in time. Of each: what its protocol
promises, what is allowed, what was measured, and what is missed.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from cutenv.rig.config.settings import Axis, RigSettings
from cutenv.rig.devices.loop import Clock, SystemClock
from cutenv.rig.devices.protocols import DriveState, ForceDriver, ForceSample, MotionDriver, MotionSample
from cutenv.rig.devices.reading_stream import SEQUENCES
from cutenv.rig.errors import RigError
from cutenv.rig.operation.preflight import ZERO_FORCE
from cutenv.rig.spine import tare_readings

CALL_TIME = 0.005  # time that a call may take that has not to wait for an answer [s]: a command, a quick stop
CLOSE_TIME = 3.0  # time that closing may take [s]
THREADS_END = 1.0  # time after closing within which a driver's threads have to end [s]


class TriedPromise(NamedTuple):
    """One promise of a driver's protocol, and what became of it."""

    promise: str
    allowed: str  # what is allowed, and what was found; with units
    measured: str
    kept: bool  # True if it was kept


HEADER = ("promised", "allowed", "measured", "kept")  # columns of the table


def conformance_rows(findings: list[TriedPromise]) -> list[tuple[str, ...]]:
    """Return the table of findings, without the header."""
    return [(each.promise, each.allowed, each.measured, "yes" if each.kept else "NO") for each in findings]


class Listening:
    """Listener that keeps all reports of either kind of driver."""

    def __init__(self) -> None:
        self.motions: list[MotionSample] = []  # samples
        self.forces: list[ForceSample] = []
        self.beats: list[float] = []  # times of heartbeats [s]
        self.troubles: list[str] = []  # errors, foreign commands, breaks and packets that were no readings

    def motion(self, axis: str, sample: MotionSample) -> None:
        """Keep a sample of an axis."""
        self.motions.append(sample)

    def alive(self, axis: str, time: float) -> None:
        """Keep a heartbeat."""
        self.beats.append(time)

    def emergency(self, axis: str, code: int, meaning: str, time: float) -> None:
        """Keep an error of the drive."""
        self.troubles.append(f"error 0x{code:04X}, {meaning}")

    def foreign(self, axis: str, what: str, time: float) -> None:
        """Keep a foreign command."""
        self.troubles.append(f"foreign command: {what}")

    def broken(self, axis: str, why: str, time: float) -> None:
        """Keep the break of the line."""
        self.troubles.append(f"broken: {why}")

    def force(self, sample: ForceSample) -> None:
        """Keep a reading."""
        self.forces.append(sample)

    def garbled(self, why: str, time: float) -> None:
        """Keep a packet that was no reading."""
        self.troubles.append(f"no reading: {why}")


def refused(action: Callable[[], Any]) -> str | None:
    """Return the message of an action's refusal, or None."""
    try:
        action()
    except (RigError, TypeError, ValueError) as error:
        return str(error)
    return None


def must_refuse(promise: str, action: Callable[[], Any]) -> TriedPromise:
    """Return whether an action is refused, with a message, as promised."""
    said = refused(action)
    return TriedPromise(promise, "an error", "no error" if said is None else _short(said), said is not None)


def timed(action: Callable[[], Any]) -> float:
    """Return an action's duration on the machine's clock [s]."""
    begun = time.monotonic()
    action()
    return time.monotonic() - begun


def time_within(promise: str, seconds: float, allowed: float) -> TriedPromise:
    """Return the finding of a time against what is allowed [s]."""
    return TriedPromise(promise, f"{1e3 * allowed:.3g} ms", f"{1e3 * seconds:.3g} ms", seconds <= allowed)


def closed(driver: Any, listening: Listening, clock: Clock, before: set[threading.Thread]) -> list[TriedPromise]:
    """Close a driver twice; check silence and ended threads."""
    findings = [time_within("close returns", timed(driver.close), CLOSE_TIME)]
    said = refused(driver.close)
    findings.append(TriedPromise("close may be called twice", "no error", said or "no error", said is None))
    clock.sleep_until(clock.now() + 0.05)  # what was under way
    seen = len(listening.motions) + len(listening.forces)
    clock.sleep_until(clock.now() + 0.3)
    late = len(listening.motions) + len(listening.forces) - seen
    findings.append(TriedPromise("after close nothing is reported", "0 reports", f"{late} reports", late == 0))
    ends = time.monotonic() + THREADS_END
    while (left := _left(before)) and time.monotonic() < ends:
        time.sleep(0.02)
    told = ", ".join(sorted(thread.name for thread in left)) or "none is left"
    findings.append(TriedPromise("after close its threads end", "none is left", told, not left))
    return findings


def reopened(driver: Any, clock: Clock) -> TriedPromise:
    """Open a driver again, and see that it reports."""
    listening = Listening()
    said = refused(lambda: driver.open(listening))
    clock.sleep_until(clock.now() + 0.3 + 3.0 / getattr(driver, "rate", math.inf))
    count = len(listening.motions) + len(listening.forces)
    driver.close()
    return TriedPromise("it can be opened again", "reports", _short(said or f"{count} reports"), count > 0)


def _left(before: set[threading.Thread]) -> set[threading.Thread]:
    return {thread for thread in threading.enumerate() if thread not in before}


def _short(text: str) -> str:
    return text if len(text) <= 60 else f"{text[:57]}..."


TRIAL_TRAVEL = 0.010  # way that the axis needs free, from where it stands towards the middle of its travel [m or rad]
LIMIT_NAMES = ("low", "high", "speed", "acceleration", "quick_stop")  # limits that a drive tells
_SPEED = 0.004  # [m/s or rad/s]
_LISTEN = 1.0  # [s]
_STANDS = 2e-5  # [m or rad] by which an axis at rest may flicker
_RESTS = 1e-4  # [m/s or rad/s]
_BEGINS = 0.30  # [s] from a command to motion
_OWN_WATCH = 0.5  # [s] within which a drive stops that hears nothing from its computer
_SAME = 0.02  # relative difference allowed between a drive's limit and the file: whole steps
_HAMMERED = 200  # commands of a thread beside a quick stop


class _Trial:
    """Axis under trial, with what it has reported."""

    def __init__(self, driver: MotionDriver, rig: RigSettings, clock: Clock) -> None:
        self.driver, self.rig, self.clock = driver, rig, clock
        self.axis: Axis = rig.axes[driver.name]
        self.listening = Listening()
        self.findings: list[TriedPromise] = []
        self.way = 1.0
        self.unit = "mrad" if driver.name == "angle" else "mm"
        self.speed = min(_SPEED, 0.6 * self.axis.speed, 0.6 * rig.limits.speed)

    @property
    def newest(self) -> MotionSample:
        return self.listening.motions[-1]

    def wait(self, seconds: float) -> list[MotionSample]:
        """Wait; return the samples meanwhile."""
        seen = len(self.listening.motions)
        self.clock.sleep_until(self.clock.now() + seconds)
        return self.listening.motions[seen:]

    def settled(self) -> list[MotionSample]:
        """Wait for samples that show the last call; return them."""
        return self.wait(max(0.1, 3.0 * self.rig.bus.sync)) or [self.newest]

    def settled_state(self) -> DriveState:
        """Wait for a sample after the last call; return its state."""
        return self.settled()[-1].state

    def found(self, promise: str, allowed: str, measured: str, kept: bool) -> None:
        self.findings.append(TriedPromise(promise, allowed, measured, bool(kept)))

    def speeds(self, promise: str, wanted: float, got: float) -> None:
        """Compare a speed with the wanted one, within a tenth."""
        unit, tolerance = f"{self.unit}/s", 0.1 * abs(wanted)
        self.found(
            promise,
            f"{1e3 * wanted:+.2f} {unit} within 10%",
            f"{1e3 * got:+.2f} {unit}",
            abs(got - wanted) <= tolerance,
        )

    def stays(self, promise: str, seconds: float) -> None:
        """Check that the axis stands for so long."""
        start = self.newest.position
        moved = max((abs(each.position - start) for each in self.wait(seconds)), default=math.inf)
        self.found(promise, f"{1e3 * _STANDS:g} {self.unit}", f"{1e3 * moved:.3f} {self.unit}", moved <= _STANDS)

    def until_rest(self, limit: float) -> float:
        """Return the time until a sample at rest [s], infinite without."""
        begun = self.clock.now()
        seen = len(self.listening.motions)
        while self.clock.now() - begun < limit:
            self.clock.sleep_until(self.clock.now() + 0.005)
            for each in self.listening.motions[seen:]:
                if abs(each.speed) < _RESTS:
                    return max(each.time - begun, 0.0)
        return math.inf

    def clear(self) -> None:
        with self.driver.latch.resetting():
            self.driver.clear()

    def run_up(self) -> None:
        """Switch on; move half a second toward the side with room."""
        middle = 0.5 * (self.axis.low + self.axis.high)
        self.way = 1.0 if self.newest.position < middle else -1.0
        self.driver.enable()
        self.driver.command(self.way * self.speed)
        self.wait(0.5)


def conform_motion(driver: MotionDriver, rig: RigSettings, clock: Clock) -> list[TriedPromise]:
    """Test a motion driver; the axis moves to and fro by some millimetres.

    ``driver`` is not open, with a latch of its own; the limits of ``rig`` are what is allowed. Raise RigError if it
    cannot be opened, switched on or cleared.
    """
    before, trial = set(threading.enumerate()), _Trial(driver, rig, clock)
    driver.open(trial.listening)
    try:
        _opened(trial)
        _switched_on(trial)
        _moves(trial)
        _stops(trial)
        if isinstance(clock, SystemClock):
            _races(trial)
        troubles = trial.listening.troubles
        trial.found("no error was reported", "none", "; ".join(troubles) or "none", not troubles)
        _watches(trial)
    finally:
        ends = closed(driver, trial.listening, clock, before)
    return [*trial.findings, *ends, reopened(driver, clock)]


def _opened(trial: _Trial) -> None:
    driver, limits, sync = trial.driver, trial.rig.limits, trial.rig.bus.sync
    samples = trial.wait(_LISTEN)
    if len(samples) < 3:
        raise RigError(f"{driver.name}: {len(samples)} samples in {_LISTEN:g} s: nothing else can be tried.")
    times = np.array([each.time for each in samples])
    period, gap = float(np.median(np.diff(times))), float(np.diff(times).max())
    beat = float(np.diff(trial.listening.beats).max()) if len(trial.listening.beats) > 1 else math.inf
    moved = max(abs(each.position - samples[0].position) for each in samples)
    trial.found(
        "open moves nothing", f"{1e3 * _STANDS:g} {trial.unit}", f"{1e3 * moved:.3f} {trial.unit}", moved <= _STANDS
    )
    states = {each.state for each in samples}
    trial.found(
        "open gives no power", "no power", ", ".join(each.value for each in states), DriveState.ENABLED not in states
    )
    trial.found(
        "samples come every bus.sync",
        f"{1e3 * sync:g} ms within 20%",
        f"{1e3 * period:.2f} ms",
        abs(period / sync - 1.0) <= 0.2,
    )
    trial.findings.append(time_within("no gap of samples stops the blade", gap, limits.stale_motion))
    trial.findings.append(time_within("no gap of heartbeats stops the blade", beat, limits.heartbeat))
    trial.findings.append(must_refuse("a second open is refused", lambda: driver.open(Listening())))
    trial.findings.append(must_refuse("a command without power is refused", lambda: driver.command(trial.speed)))
    told = driver.limits()
    wrong = [name for name in LIMIT_NAMES if not _same_limit(trial.axis, name, told.get(name, math.inf))]
    found = f"not: {', '.join(wrong) or 'none'}"
    trial.found("limits are read back from the drive", "as in the file", found, not wrong)
    about = driver.about()
    trial.found("about tells of the drive", "names and values", f"{len(about)} values", bool(about))


def _switched_on(trial: _Trial) -> None:
    driver = trial.driver
    took = timed(driver.enable)
    state = trial.settled_state()
    trial.found(
        "enable ends with power on",
        "enabled, within 3000 ms",
        f"{state.value}, {1e3 * took:.0f} ms",
        state is DriveState.ENABLED and took <= 3.0,
    )
    trial.stays("enable moves nothing", 0.3)
    driver.disable()
    state = trial.settled_state()
    trial.found("disable takes the power away", "no power", state.value, state is not DriveState.ENABLED)


def _moves(trial: _Trial) -> None:
    driver, clock, axis, speed = trial.driver, trial.clock, trial.axis, trial.speed
    middle = 0.5 * (axis.low + axis.high)
    trial.way = 1.0 if trial.newest.position < middle else -1.0
    driver.enable()
    start, begun = trial.newest.position, clock.now()
    trial.findings.append(
        time_within("a command does not wait", timed(lambda: driver.command(trial.way * speed)), CALL_TIME)
    )
    samples = trial.wait(1.0)
    began = next((each.time - begun for each in samples if abs(each.position - start) > _STANDS), math.inf)
    trial.findings.append(time_within("motion begins", began, _BEGINS))
    late = [each for each in samples if each.time > begun + 0.6]
    mean = float(np.mean([each.speed for each in late])) if late else 0.0
    trial.speeds("speed and direction match the command", trial.way * speed, mean)
    if len(late) > 1:
        by_position = (late[-1].position - late[0].position) / max(late[-1].time - late[0].time, 1e-9)
        trial.speeds("speed from position matches the command", trial.way * speed, by_position)
    bad = [driver_refuses(driver, value) for value in (math.nan, math.inf, 10.0 * axis.speed)]
    trial.found("a speed that is none, or too high, is refused", "3 errors", f"{bad.count(True)} errors", all(bad))
    after = trial.settled()[-1].speed
    trial.speeds("a refused speed changes nothing", trial.way * speed, after)
    driver.command(-trial.way * speed)
    trial.wait(1.5)
    driver.command(0.0)
    rested = trial.until_rest(1.0)
    trial.findings.append(time_within("a command of 0 brings it to rest", rested, speed / axis.acceleration + 0.3))
    driver.disable()


def _same_limit(axis: Axis, name: str, told: float) -> bool:
    wanted = float(getattr(axis, name))
    span = axis.high - axis.low if name in ("low", "high") else abs(wanted)
    return abs(told - wanted) <= _SAME * span


def driver_refuses(driver: MotionDriver, speed: float) -> bool:
    """Return whether a driver refuses a speed with an error."""
    return refused(lambda: driver.command(speed)) is not None


def _stops(trial: _Trial) -> None:
    driver, axis, sync = trial.driver, trial.axis, trial.rig.bus.sync
    trial.run_up()
    start = trial.newest.position
    trial.findings.append(time_within("a quick stop does not wait", timed(driver.quick_stop), CALL_TIME))
    allowed = trial.speed / axis.quick_stop + 3 * sync + 0.05
    trial.findings.append(time_within("a quick stop brings it to rest", trial.until_rest(1.0), allowed))
    way, most = abs(trial.newest.position - start), trial.speed * (allowed + sync)
    trial.found(
        "a quick stop takes a short way", f"{1e3 * most:.2f} {trial.unit}", f"{1e3 * way:.2f} {trial.unit}", way <= most
    )
    trial.found(
        "a quick stop closes the latch", "closed", "closed" if driver.latch.closed else "open", driver.latch.closed
    )
    trial.findings.append(must_refuse("a stopped axis takes no command", lambda: driver.command(trial.speed)))
    trial.findings.append(must_refuse("a stopped axis is not switched on", driver.enable))
    trial.stays("a stopped axis stays", 0.5)
    trial.clear()
    state = trial.settled_state()
    trial.found("clear leaves it without power", "no power", state.value, state is not DriveState.ENABLED)


def _races(trial: _Trial) -> None:
    """Send commands while another thread stops: the stop must win."""
    driver = trial.driver
    trial.run_up()
    sent = threading.Event()

    def hammer() -> None:
        for _ in range(_HAMMERED):
            with suppress(RigError):
                driver.command(trial.way * trial.speed)
            time.sleep(0.0005)
        sent.set()

    thread = threading.Thread(target=hammer, name="hammering")
    thread.start()
    trial.wait(0.02)
    driver.quick_stop()
    thread.join()
    trial.until_rest(1.0)
    trial.stays("commands beside a quick stop start nothing", 0.5)
    trial.clear()


def _watches(trial: _Trial) -> None:
    driver = trial.driver
    trial.run_up()
    driver.withhold_heartbeat("its own watch is tried")
    allowed = _OWN_WATCH + trial.speed / trial.axis.quick_stop
    trial.findings.append(time_within("a drive that hears nothing stops by itself", trial.until_rest(2.0), allowed))
    trial.stays("the drive stays at rest after its own stop", 0.5)
    trial.clear()


_HEAR = 2.0  # [s]


def conform_force(driver: ForceDriver, rig: RigSettings, clock: Clock) -> list[TriedPromise]:
    """Try a force driver against its protocol, for some seconds.

    ``driver`` is not open; the limits of ``rig`` are what is allowed. Raise RigError if it cannot be opened.
    """
    before, listening = set(threading.enumerate()), Listening()
    driver.open(listening)
    try:
        findings = _readings(driver, listening, rig, clock)
        findings.append(must_refuse("a second open is refused", lambda: driver.open(Listening())))
        findings += _tares(driver, listening, clock)
    finally:
        findings_of_end = closed(driver, listening, clock, before)
    return [*findings, *findings_of_end, reopened(driver, clock)]


def _readings(driver: ForceDriver, listening: Listening, rig: RigSettings, clock: Clock) -> list[TriedPromise]:
    start = clock.now()
    clock.sleep_until(start + _HEAR)
    now = clock.now()
    readings = [each for each in listening.forces if each.time >= start]
    if len(readings) < 2:
        return [TriedPromise("readings arrive", "2 or more", f"{len(readings)} in {_HEAR:g} s", False)]
    times = np.array([each.time for each in readings])
    lost = sum(each.lost for each in readings[1:])
    sent = (len(readings) - 1 + lost) / (times[-1] - times[0])
    tolerance = max(0.02, driver.rate_error)
    gap, share = float(np.diff(times).max()), lost / (lost + len(readings))
    in_order = all(
        (later.sequence - earlier.sequence - 1 - later.lost) % SEQUENCES == 0 for earlier, later in pairwise(readings)
    )
    deaf = [
        axis
        for number, axis in enumerate("xyz")
        if axis in driver.axes and len({each.counts[number] for each in readings}) == 1
    ]
    idle = [
        axis
        for number, axis in enumerate("xyz")
        if axis not in driver.axes and any(each.force[number] for each in readings)
    ]
    finite = all(math.isfinite(value) for each in readings for value in (*each.force, *each.torque))
    statuses = {each.status for each in readings}
    limits = rig.limits
    return [
        TriedPromise(
            "readings come at its rate",
            f"{driver.rate:g} Hz within {tolerance:.0%}",
            f"{sent:.1f} Hz",
            abs(sent / driver.rate - 1.0) <= tolerance,
        ),
        TriedPromise(
            "no gap stops the blade",
            f"{1e3 * limits.stale_force:g} ms",
            f"{1e3 * gap:.1f} ms",
            gap <= limits.stale_force,
        ),
        TriedPromise("few readings are lost", f"{limits.lost_force:.0%}", f"{share:.1%}", share <= limits.lost_force),
        TriedPromise(
            "numbers count readings and losses",
            "each follows the last",
            "they do" if in_order else "they do not",
            in_order,
        ),
        TriedPromise(
            "times are the clock's, and never go back",
            "0 to now",
            f"least step {1e3 * float(np.diff(times).min()):.2f} ms, newest {1e3 * (now - times[-1]):.1f} ms old",
            bool((np.diff(times) >= 0.0).all() and times[-1] <= now),
        ),
        TriedPromise("counts of each axis flicker", driver.axes, f"still: {', '.join(deaf) or 'none'}", not deaf),
        TriedPromise("other axes read 0", "0 N", f"not 0: {', '.join(idle) or 'none'}", not idle),
        TriedPromise("forces are numbers", "finite", "finite" if finite else "not finite", finite),
        TriedPromise("status at rest is healthy", "0", ", ".join(map(str, sorted(statuses))), statuses == {0}),
        TriedPromise(
            "limits leave room for its rate",
            "4 readings before it counts as silent",
            f"{limits.stale_force * driver.rate:.1f} readings",
            limits.stale_force * driver.rate >= 4.0 - 1e-9,
        ),
    ]


def _tares(driver: ForceDriver, listening: Listening, clock: Clock) -> list[TriedPromise]:
    samples = tare_readings(driver.rate)
    first = driver.tare(samples)
    start = clock.now()
    clock.sleep_until(start + 0.5 + 5.0 / driver.rate)
    readings = [each.force for each in listening.forces if each.time > start]
    left = float(np.abs(np.mean(readings, axis=0)).max()) if readings else math.inf
    second = driver.tare(samples)
    moved = max(abs(a - b) for a, b in zip(first, second, strict=True))
    return [
        TriedPromise("after a tare it reads 0", f"{ZERO_FORCE:g} N", f"{left:.4f} N", left <= ZERO_FORCE),
        TriedPromise("tares tell the whole zero", f"{ZERO_FORCE:g} N apart", f"{moved:.4f} N", moved <= ZERO_FORCE),
    ]
