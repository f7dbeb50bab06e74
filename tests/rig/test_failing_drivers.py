"""Drivers of others that hang, raise or lie: none keeps the blade from its stop, nor another axis from its own."""

from __future__ import annotations

import math
import struct
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from hand_moved_rig import HandMovedRig
from made_ready import ready_rig
from waiting import until

from cutenv.emulation.fake_rig import FakeRig
from cutenv.rig import spine
from cutenv.rig.devices.loop import SystemClock, next_due
from cutenv.rig.devices.protocols import DriveState, ForceSample
from cutenv.rig.errors import RigError
from cutenv.rig.safety.stop_causes import STOP_PERIOD, WITHHOLD_HEARTBEAT_AFTER, Cause, RigStopped

UPRIGHT = math.pi / 2
OVER = ForceSample(0.0, (30.0, 0.0, 0.0), (7, 1, 2, 3, 4, 5), 0, 0, 0)


@pytest.fixture
def hung() -> Iterator[Callable[..., None]]:
    """A call that does not return before the test is over."""
    over = threading.Event()
    yield lambda *arguments, **named: over.wait(10.0) and None
    over.set()


def refuse(*arguments: Any, **named: Any) -> None:
    raise OSError("the line has no time limit")


def stopped_at(rig: FakeRig | HandMovedRig, speed: float, seconds: float) -> RigStopped:
    try:
        for _ in range(round(seconds / 0.020)):
            rig.plant.advance(speed, UPRIGHT, 20)
    except RigStopped as stop:
        return stop
    raise AssertionError("nothing stops the blade")


@pytest.mark.promise("S7")
def test_a_command_that_never_returns_keeps_no_axis_from_its_stop(rig, hung):
    rig.plant.advance(0.01, UPRIGHT, 200)
    rig.blade.command = hung

    def run() -> None:
        with pytest.raises(RigStopped):
            rig.plant.advance(0.01, UPRIGHT, 20)

    program = threading.Thread(target=run)
    program.start()
    until(lambda: rig.plant.supervisor._commanding.locked())
    rig.plant.spine.force(OVER._replace(sequence=rig._sequence + 1))
    assert rig.plant.supervisor.report.cause is Cause.FORCE
    for drive in (rig.blade, rig.angle):
        assert drive.sent[-1][1] == "quick stop"
    assert program.is_alive()  # the driver still hangs


@pytest.mark.parametrize("fails", [True, False], ids=["raises", "hangs"])
@pytest.mark.promise("S7")
def test_a_quick_stop_that_fails_spares_no_other_axis_and_ends_the_heartbeat(rig, hung, fails):
    rig.plant.advance(0.01, UPRIGHT, 200)
    asked: list[float] = []

    def fail(**named: bool) -> None:
        asked.append(rig.clock.now())
        (refuse if fails else hung)()

    rig.blade.quick_stop = fail
    rig.plant.supervisor.trip(Cause.OPERATOR, "as told")
    assert rig.angle.sent[-1][1] == "quick stop"
    assert ("no time limit" if fails else "does not return") in rig.plant.supervisor.report.detail
    rig.clock.sleep_until(rig.clock.now() + 0.2)
    assert (len(asked) > 8) is fails  # again and again; not, while one is under way
    when, what, *_ = rig.blade.sent[-1]
    assert what == "abandoned"
    late = when - rig.plant.supervisor.report.detected - WITHHOLD_HEARTBEAT_AFTER
    assert late < (
        5 * STOP_PERIOD if fails else STOP_PERIOD + 1e-9
    )  # one that hangs has had its time at the stop itself
    assert "our heartbeat ends" in rig.plant.supervisor.report.detail


def test_a_repeated_quick_stop_that_hangs_holds_up_no_other_and_ends_the_heartbeat_of_an_unseen_drive(rig, hung):
    rig.plant.advance(0.01, UPRIGHT, 200)
    rig.faults.motion_silent = True
    asked: list[float] = []

    def hang_later(**named: bool) -> None:
        asked.append(rig.clock.now())
        if len(asked) == 2:
            hung()

    rig.blade.quick_stop = hang_later
    begun = time.monotonic()
    rig.plant.supervisor.trip(Cause.OPERATOR, "as told")
    rig.clock.sleep_until(rig.clock.now() + 0.3)
    assert time.monotonic() - begun < 5.0
    assert len(asked) == 2
    assert len(rig.angle.sent) >= 0.28 / STOP_PERIOD - 3
    assert rig.blade.sent[-1][1] == "abandoned"


@pytest.mark.parametrize("fails", [True, False], ids=["raises", "hangs"])
def test_a_heartbeat_that_cannot_be_withheld_ends_no_repetition(rig, hung, fails):
    asked: list[float] = []
    rig.blade.quick_stop = lambda **named: asked.append(rig.clock.now())  # and does nothing
    rig.blade.withhold_heartbeat = refuse if fails else hung
    rig.plant.advance(0.01, UPRIGHT, 200)
    rig.plant.supervisor.trip(Cause.OPERATOR, "as told")
    rig.clock.sleep_until(rig.clock.now() + 0.3)
    assert asked[-1] > asked[0] + 0.28


@pytest.mark.promise("S6")
def test_after_a_reset_that_fails_the_heartbeat_ends_again(rig):
    """The reset has given it back, and the drive is still seen to disobey."""
    rig.plant.advance(0.01, UPRIGHT, 200)
    ended: list[float] = []
    rig.blade.quick_stop = lambda **named: None
    rig.blade.withhold_heartbeat = lambda why: ended.append(rig.clock.now())

    def stay() -> None:
        raise RigError("it does not come to rest")

    rig.blade.clear = stay
    rig.plant.supervisor.trip(Cause.OPERATOR, "as told")
    rig.clock.sleep_until(rig.clock.now() + 0.2)
    assert len(ended) == 1
    with pytest.raises(RigError, match="does not come to rest"):
        rig.plant.supervisor.reset(agreed=True)
    tried = rig.clock.now()
    rig.clock.sleep_until(tried + 0.2)
    assert len(ended) == 2
    assert ended[1] - tried < WITHHOLD_HEARTBEAT_AFTER + 2 * STOP_PERIOD


@pytest.mark.parametrize("fails", [True, False], ids=["raises", "hangs"])
def test_a_driver_that_does_not_close_keeps_no_other_open(monkeypatch, hung, fails):
    monkeypatch.setattr(spine, "CLOSED_WITHIN", 0.05)
    rig = ready_rig()
    rig.blade.close = refuse if fails else hung
    rig.plant.close()
    assert rig._listeners["angle"] is None
    assert rig.sensor.listener is None


class Lying:
    """Listener between a driver and the plant, with reports as a bad driver would make them."""

    def __init__(self, plant: Any, time: float) -> None:
        self._plant, self._time = plant, time

    def force(self, sample: ForceSample) -> None:
        self._plant.spine.force(sample._replace(time=self._time))

    def motion(self, axis: str, sample: Any) -> None:
        self._plant.spine.motion(axis, sample._replace(time=self._time))

    def alive(self, axis: str, time: float) -> None:
        self._plant.spine.alive(axis, math.nan)


@pytest.mark.parametrize("time", [1.7e9, math.nan, math.inf, -1.0])
@pytest.mark.parametrize("silent", ["force_silent", "motion_silent", "heartbeat_silent"])
@pytest.mark.promise("S7")
def test_times_of_a_driver_hide_no_silence(rig, time, silent):
    rig.sensor.listener = Lying(rig.plant, time)
    rig._listeners["blade"] = Lying(rig.plant, time)
    for _ in range(10):
        rig.plant.advance(0.01, UPRIGHT, 20)
    begun = rig.clock.now()
    setattr(rig.faults, silent, True)
    report = stopped_at(rig, 0.01, 1.0).report
    wanted = {
        "force_silent": Cause.FORCE_STALE,
        "motion_silent": Cause.MOTION_STALE,
        "heartbeat_silent": Cause.HEARTBEAT,
    }
    assert report.cause is wanted[silent]
    assert report.detected - begun < 0.16


# The heartbeat says that somebody judges, not that the process lives.


@pytest.mark.promise("S8")
def test_without_a_watchdog_the_drive_stops_by_itself():
    rig = HandMovedRig().ready()
    rig.cut(0.015, 0.5)
    rig.plant.spine.timers[0].stop()  # the watchdog
    rig.plant.spine.sensor._turns.stop()  # the sensor is silent, and nobody would notice
    before = rig.position
    rig.wait(0.5)
    assert rig.speed == 0.0
    assert rig.position - before < 0.0025
    assert rig.node.state is not DriveState.ENABLED


def test_an_action_that_raises_ends_no_other():
    clock, told, seen = SystemClock(), [], []
    clock.failed = told.append
    turns = [clock.every(0.002, refuse, "bad"), clock.every(0.002, seen.append, "good")]
    until(lambda: len(seen) > 5 and len(told) > 5)
    assert "bad failed: OSError: the line has no time limit" in told[0]
    for turn in turns:
        turn.stop()
        turn.stop()
    until(lambda: clock._thread is None)
    ended = len(seen)
    later = clock.every(1.0, seen.append, "later")
    assert len(seen) == ended
    later.stop()


@pytest.mark.parametrize("period", [0.0005, 0.002, 0.005, 0.04])
@pytest.mark.parametrize("since", [0.0, 1e-9, 0.0002, 0.00049])
def test_actions_are_due_at_multiples_of_their_period_so_that_one_waking_does_for_all(period, since):
    machine = 81_234 * 0.04  # [s] when all of them are due
    assert next_due(machine + since, period) == pytest.approx(machine + period, abs=1e-9)


# What the drive itself tells is judged in motion.


def altered(rig: HandMovedRig, number: int, change: Callable[[bytes], bytes]) -> None:
    """Change every frame with a number on its way to the rig."""
    handle = rig.network._handle
    rig.network._handle = lambda can, data: handle(can, change(data) if can == number else data)  # type: ignore[method-assign]


def status(clear: int = 0, put: int = 0, mode: int | None = None) -> Callable[[bytes], bytes]:
    def change(data: bytes) -> bytes:
        word, velocity, was = struct.unpack("<HiB", data)
        return struct.pack("<HiB", word & ~clear | put, velocity, was if mode is None else mode)

    return change


def torque(data: bytes) -> bytes:
    return struct.pack("<ih", struct.unpack("<ih", data)[0], 3000)


@pytest.mark.parametrize(
    ("number", "change", "words"),
    [
        (0x181, status(mode=1), "left profile velocity mode"),
        (0x181, status(clear=0x0200), "no longer obeys the bus"),
        (0x181, status(clear=0x0010), "no voltage"),
        (0x181, status(put=0x0800), "internal limit"),
        (0x281, torque, r"\+300 % of its rated torque"),
    ],
    ids=["mode", "remote", "voltage", "internal limit", "torque"],
)
def test_what_a_drive_tells_of_itself_is_judged_in_motion(number, change, words):
    rig = HandMovedRig().ready()
    rig.cut(0.015, 0.3)
    begun = rig.clock.now()
    altered(rig, number, change)
    with pytest.raises(RigStopped, match=words) as stop:
        rig.cut(0.015, 0.3)
    assert stop.value.report.cause is Cause.DRIVE
    assert stop.value.report.detected - begun < 0.030


@pytest.mark.parametrize(("growth", "within", "way"), [(0.1, 0.6, 0.001), (0.02, 2.5, 0.001)])
def test_a_bus_that_delivers_later_and_later_stops_the_blade_while_it_still_can(growth, within, way):
    rig = HandMovedRig().ready()
    rig.cut(0.015, 0.3)
    begun, first = rig.clock.now(), rig.network.way

    def later(now: float) -> None:
        rig.network.way = first + growth * (now - begun)

    rig.clock.every(0.001, later, "later")
    with pytest.raises(RigStopped, match="the bus is late") as stop:
        rig.cut(0.015, within + 0.5)
    report = stop.value.report
    assert report.detected - begun < within
    assert report.distance_to_standstill < way


def test_a_bus_that_is_always_late_is_no_fault():
    rig = HandMovedRig()
    rig.network.way = 0.015
    rig.ready().cut(0.015, 1.0)
    assert rig.supervisor.report is None


# Slow motion that nobody commanded adds up.


@pytest.mark.parametrize("speed", [0.0005, 0.0019, -0.0028])
@pytest.mark.promise("S11")
def test_a_blade_told_to_stand_that_creeps_is_stopped_at_its_limit(rig, speed):
    rig.plant.advance(0.01, UPRIGHT, 500)
    rig.plant.advance(0.0, UPRIGHT, 500)
    start = rig.bench.motion[0]
    rig.faults.runaway = speed
    report = stopped_at(rig, 0.0, 5.0).report
    assert report.cause is Cause.FOLLOWING
    assert abs(rig.bench.motion[0] - start) < 1.1 * rig.settings.limits.following


@pytest.mark.parametrize("speed", [0.0175, 0.0125])
@pytest.mark.promise("S11")
def test_a_blade_that_is_always_a_little_too_fast_or_slow_is_stopped(rig, speed):
    rig.plant.advance(0.015, UPRIGHT, 500)
    start, begun = rig.bench.motion[0], rig.clock.now()
    rig.faults.runaway = speed
    report = stopped_at(rig, 0.015, 5.0).report
    assert report.cause is Cause.FOLLOWING
    assert abs(rig.bench.motion[0] - start - 0.015 * (report.detected - begun)) < 0.006
