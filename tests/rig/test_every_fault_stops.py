"""Whatever goes wrong, at whatever instant: the blade is stopped in the stated time, and stays stopped."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from made_ready import SETTLE, ready_rig

from cutenv.emulation.fake_rig import FakeRig, Faults
from cutenv.rig.devices.protocols import DriveState, ForceSample
from cutenv.rig.errors import RigError
from cutenv.rig.safety.stop_causes import Cause, RigStopped, detection_times

PERIOD = 20  # [ms]
UPRIGHT = math.pi / 2
Inject = Callable[[FakeRig], None]


def faulty(**values: Any) -> Inject:
    def inject(rig: FakeRig) -> None:
        for name, value in values.items():
            setattr(rig.faults, name, value)

    return inject


def go_late(rig: FakeRig) -> None:
    rig.clock.sleep_until(rig.clock.now() + 0.2)  # a policy that thinks for too long


def command_nan(rig: FakeRig) -> None:
    rig.plant.supervisor.drive(math.nan, UPRIGHT, 0.02)


def tripped(cause: Cause) -> Inject:
    return lambda rig: rig.plant.supervisor.trip(cause, "as told", rig.clock.now())


def twist(rig: FakeRig) -> None:
    """Let the sensor read a torque from now on that no force beside it explains."""

    class Twisted:
        def force(self, sample: ForceSample) -> None:
            rig.plant.spine.force(sample._replace(torque=(0.0, 0.0, 3.1)))

        def garbled(self, why: str, time: float) -> None:
            """Nothing is."""

    if rig.sensor.listener is rig.plant.spine:
        rig.sensor.listener = Twisted()


FAULTS: dict[str, tuple[Inject, set[Cause]]] = {
    "over-force along the cut": (faulty(extra_force=30.0), {Cause.FORCE}),
    "over-force across the cut": (faulty(side_force=-16.0), {Cause.FORCE}),
    "a hard stop": (faulty(extra_force=4.0), {Cause.FORCE_RISE}),
    "a torque": (twist, {Cause.TORQUE}),
    "a force that is no number": (faulty(force_nan=True), {Cause.NOT_A_NUMBER}),
    "bad status of the sensor": (faulty(force_status=0x80010000), {Cause.FORCE_STATUS}),
    "frozen readings": (faulty(force_frozen=True), {Cause.FORCE_FROZEN}),
    "a frozen force along the cut": (faulty(axis_frozen=0), {Cause.FORCE_AXIS}),
    "a frozen force across the cut": (faulty(axis_frozen=1), {Cause.FORCE_AXIS}),
    "no readings": (faulty(force_silent=True), {Cause.FORCE_STALE}),
    "late readings": (faulty(force_late=0.05), {Cause.FORCE_STALE, Cause.FORCE_LATE}),
    "lost readings": (faulty(lose_every=3), {Cause.FORCE_LOST}),
    "no samples of the axis": (faulty(motion_silent=True), {Cause.MOTION_STALE}),
    "doubled samples": (faulty(motion_doubled=True), {Cause.MOTION_DOUBLED}),
    "no heartbeat": (faulty(heartbeat_silent=True), {Cause.HEARTBEAT}),
    "a stuck encoder": (faulty(stuck=True), {Cause.STUCK, Cause.FOLLOWING, Cause.ACCELERATION}),
    "a blocked blade": (faulty(blocked=True), {Cause.STUCK, Cause.FOLLOWING, Cause.ACCELERATION}),
    "a slipping blade": (faulty(slip=0.008), {Cause.FOLLOWING, Cause.STUCK}),
    "a runaway": (faulty(runaway=0.035), {Cause.SPEED, Cause.FOLLOWING}),
    "power loss": (faulty(power_lost=True), {Cause.MOTION_STALE}),
    "bus off": (lambda rig: rig.break_bus(), {Cause.BUS}),
    "a command of another master": (lambda rig: rig.intrude(0.03), {Cause.FOREIGN}),
    "an error of the drive": (lambda rig: rig.report_emergency(0x8611, "following error"), {Cause.DRIVE}),
    "a policy that is late": (go_late, {Cause.OVERRUN}),
    "a command that is no number": (command_nan, {Cause.NOT_A_NUMBER}),
    "an exception": (tripped(Cause.EXCEPTION), {Cause.EXCEPTION}),
    "an interruption": (tripped(Cause.INTERRUPTED), {Cause.INTERRUPTED}),
    "the death of the parent": (tripped(Cause.ORPHANED), {Cause.ORPHANED}),
    "the operator": (tripped(Cause.OPERATOR), {Cause.OPERATOR}),
}
UNSEEN = {"power loss", "bus off", "no samples of the axis"}  # nobody can tell when the blade stands
BY_THEMSELVES = {"bus off", "power loss", "an error of the drive"}  # the drive stops, with or without our frame


def cut_until(rig: FakeRig, moment: float, speed: float) -> None:
    """Cut back and forth in the specimen until ``moment`` [s], which may lie within a period."""
    plant = rig.plant
    while rig.clock.now() + PERIOD * 1e-3 < moment:
        plant.advance(speed if plant.position < 0.05 else -speed, UPRIGHT, PERIOD)
    plant.supervisor.drive(speed if plant.position < 0.05 else -speed, UPRIGHT, 0.02)
    rig.clock.sleep_until(moment)


def cut_on(rig: FakeRig, speed: float) -> RigStopped:
    """The stop that comes within two seconds."""
    try:
        for _ in range(100):
            rig.plant.advance(speed, UPRIGHT, PERIOD)
    except RigStopped as stop:
        return stop
    raise AssertionError("nothing stops the blade")


def check_stopped(rig: FakeRig, name: str, injected: float, stop: RigStopped) -> None:
    """Detected for the right reason and in time, told to the bus at once, at rest soon, and latched."""
    report, causes = stop.report, FAULTS[name][1]
    supervisor = rig.plant.supervisor
    assert report.cause in causes, str(report)
    allowed = detection_times(supervisor.limits)[report.cause]
    grows = (Cause.FOLLOWING, Cause.FORCE_LOST, Cause.ACCELERATION, Cause.SPEED)  # to its limit
    if report.cause not in grows and name != "a slipping blade":  # which may first have to come to a stand
        beyond = PERIOD * 1e-3 * (1.0 + supervisor.limits.overrun) if report.cause is Cause.OVERRUN else 0.0
        assert report.detected - injected <= allowed + beyond + 0.001, str(report)
    else:
        assert report.detected - injected <= 0.5, str(report)
    assert report.commanded is not None
    assert report.commanded - report.detected <= PERIOD * 1e-3
    if name not in BY_THEMSELVES:
        assert (report.commanded, "quick stop") in rig.blade.sent[-1000:]
    assert supervisor.phase == "stopped"
    with pytest.raises(RigError, match="may not move"):
        supervisor.drive(0.01, UPRIGHT, 0.02)


def check_stays(rig: FakeRig) -> None:
    """Told to go on, and left alone for half a second, the blade stands where it stands."""
    rig.clock.sleep_until(rig.clock.now() + 0.1)
    rest = rig.bench.motion[0]
    with pytest.raises(RigError, match="not agreed"):
        rig.plant.supervisor.reset(agreed=False)
    begun = rig.clock.now()
    for _ in range(5):
        with pytest.raises(RigStopped):
            rig.plant.advance(0.02, UPRIGHT, PERIOD)
        rig.clock.sleep_until(rig.clock.now() + 0.1)
    assert rig.clock.now() - begun < 0.6, "a blade whose rest no sample shows was waited for once"
    assert rig.bench.motion[0] == pytest.approx(rest, abs=1e-9)


def begin_again(rig: FakeRig) -> None:
    """The operator resets, lays a new specimen, and cuts go on."""
    rig.faults.__dict__.update(vars(Faults()))
    rig.sensor.listener = rig.plant.spine
    rig.plant.supervisor.reset(agreed=True)
    rig.mount()
    rig.plant.power()
    rig.clock.sleep_until(rig.clock.now() + SETTLE)
    rig.plant.supervisor.release()
    rig.plant.begin()


def trial(rig: FakeRig, name: str, after: float, speed: float) -> RigStopped:
    cut_until(rig, rig.clock.now() + after, speed)
    injected = rig.clock.now()
    FAULTS[name][0](rig)
    stop = cut_on(rig, speed)
    check_stopped(rig, name, injected, stop)
    return stop


@pytest.mark.parametrize(
    ("periods", "instants"), [(1, PERIOD // 2), pytest.param(3, 1000, marks=pytest.mark.slow)], ids=["one", "three"]
)
@pytest.mark.parametrize("name", FAULTS)
@pytest.mark.promise("S3")
def test_at_every_instant_it_is_found_out_and_stays_stopped(name, periods, instants):
    """One instant in each of the equal parts of control periods, in any order: of one, in every two milliseconds."""
    random = np.random.default_rng(list(name.encode()))
    rig = ready_rig()
    parts = random.permutation(instants) + random.uniform(size=instants)
    for number, part in enumerate(parts):
        after = 0.12 + 1e-3 * PERIOD * periods * part / instants
        trial(rig, name, after=after, speed=random.uniform(0.008, 0.0254))
        if number % (instants // 5) == 0:
            check_stays(rig)
        begin_again(rig)


@pytest.mark.parametrize("name", FAULTS)
@pytest.mark.promise("S4")
def test_anywhere_in_a_cut(name):
    after = np.random.default_rng(list(name.encode())).uniform(0.1, 4.0)
    rig = ready_rig(seed=int(1000 * after))
    stop = trial(rig, name, after=after, speed=0.019)
    if name not in UNSEEN:
        assert stop.report.standstill is not None
        assert stop.report.distance_to_standstill < 0.001
    rig.clock.sleep_until(rig.clock.now() + 0.1)
    assert rig.bench.motion[1] == 0.0  # it does stand, whatever the samples say
    assert stop.readings["time"][-1] > after - 0.05
    check_stays(rig)


@pytest.mark.parametrize("name", FAULTS)
def test_a_supervisor_that_looks_away_fails_the_check(rig, name):
    """The sibling: with nobody watching, the same faults go on for seconds."""
    cut_until(rig, rig.clock.now() + 0.3, 0.01)
    rig.plant.supervisor.trip = lambda *arguments, **named: None
    FAULTS[name][0](rig)
    with pytest.raises(AssertionError, match="nothing stops"):
        cut_on(rig, 0.01)


def test_every_cause_is_brought_about_by_some_fault():
    brought = set().union(*(causes for _, causes in FAULTS.values()))
    tested_below = {Cause.TRAVEL, Cause.ANGLE}
    of_height = {Cause.HEIGHT, Cause.VERTICAL_FORCE, Cause.NOT_RAISED}  # tests/rig/test_cross_axes.py
    of_side = {Cause.SIDE}  # tests/rig/test_cross_axes.py
    apart = {Cause.SPINE}  # tests/rig/test_spine.py
    assert brought | tested_below | of_height | of_side | apart == set(Cause)


@pytest.mark.promise("S10")
def test_the_ends_of_travel():
    rig = ready_rig(high=0.03)
    for _ in range(300):
        rig.plant.advance(0.0254, UPRIGHT, PERIOD)
    assert 0.029 < rig.plant.position <= 0.03  # commands fade out before the end
    assert rig.plant.supervisor.limited > 0
    rig.faults.runaway = 0.01
    assert cut_on(rig, 0.01).report.cause in (Cause.TRAVEL, Cause.FOLLOWING)


def test_the_angle_and_a_drive_that_leaves_its_state():
    rig = ready_rig(angle_low=math.radians(80.0))
    assert rig.angle is not None
    for _ in range(20):
        rig.plant.advance(0.0, math.radians(60.0), PERIOD)
    assert rig.plant.angle == pytest.approx(math.radians(80.0), abs=math.radians(0.3))  # no further than allowed
    rig.angle.command = lambda rate: setattr(rig.angle, "target", -1.0)  # a hinge of its own mind
    assert cut_on(rig, 0.0).report.cause is Cause.ANGLE
    rig = ready_rig()
    rig.blade.state = DriveState.SWITCHED_ON
    assert cut_on(rig, 0.01).report.cause is Cause.DRIVE
