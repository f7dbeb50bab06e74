"""A rig that raises and lowers its blade: every fault of that axis stops both, in time, and it stays so."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from datetime import date

import numpy as np
import pytest
from made_ready import SETTLE, ready_rig, release
from made_to_descend import height_settings, ready_to_descend
from scripted_operator import ScriptedOperator

from cutenv.rig.config.settings import RigSettings
from cutenv.rig.devices.samples import DriveState
from cutenv.rig.errors import RigError
from cutenv.rig.fake.air_plant import AirPlant
from cutenv.rig.fake.fake_rig import FakeRig, Faults
from cutenv.rig.operation.preflight import moving_checks, prepare, relieve, return_inside, still_checks
from cutenv.rig.safety.stop_causes import Cause, RigStopped, detection_times
from cutenv.trace import COMPONENTS_OF_FORCE

PERIOD = 20  # [ms]
UPRIGHT = math.pi / 2


def in_air(height: float = 0.0, settings: RigSettings | None = None) -> FakeRig:
    rig = FakeRig(lambda settings: AirPlant(settings, start=0.01, height=height), settings or height_settings())
    rig.plant.open()
    return rig


def ready(height: float = 0.0, **axis: float) -> FakeRig:
    rig = in_air(height, height_settings(**axis))
    release(rig)
    return rig


def move(rig: FakeRig, descent_speed: float, periods: int = 100, speed: float = 0.008) -> RigStopped | None:
    """Move for so many periods; the stop that came."""
    try:
        for _ in range(periods):
            rig.plant.advance(speed, UPRIGHT, PERIOD, descent_speed)
    except RigStopped as stop:
        return stop
    return None


def faulty(**values: object) -> Callable[[FakeRig], None]:
    return lambda rig: rig.faults.height.__dict__.update(values)


def fail(rig: FakeRig) -> None:
    rig.report_emergency(0x8A81, "limit switch", axis="height")


def fall(rig: FakeRig) -> None:
    rig.across["height"].state = DriveState.SWITCHED_ON


FAULTS: dict[str, tuple[Callable[[FakeRig], None], float, set[Cause]]] = {
    "no samples": (faulty(silent=True), 0.003, {Cause.MOTION_STALE}),
    "no heartbeat": (faulty(heartbeat_silent=True), 0.003, {Cause.HEARTBEAT}),
    "a wrong height": (faulty(shift=0.002), 0.003, {Cause.SPEED, Cause.FOLLOWING}),
    "a stuck encoder": (faulty(stuck=True), 0.003, {Cause.STUCK, Cause.ACCELERATION}),
    "a stuck encoder while raised": (faulty(stuck=True), -0.003, {Cause.NOT_RAISED, Cause.ACCELERATION}),
    "it cannot be lowered": (faulty(blocked=True), 0.003, {Cause.STUCK, Cause.ACCELERATION}),
    "it cannot be raised": (faulty(one_way=True), -0.003, {Cause.NOT_RAISED, Cause.ACCELERATION}),
    "a runaway downwards": (faulty(runaway=-0.02), 0.003, {Cause.SPEED, Cause.FOLLOWING}),
    "a runaway upwards": (faulty(runaway=0.006), 0.0, {Cause.FOLLOWING, Cause.HEIGHT}),
    "a pressed blade": (faulty(force=-10.5), 0.003, {Cause.VERTICAL_FORCE}),
    "a lifted blade": (faulty(force=10.5), 0.003, {Cause.VERTICAL_FORCE}),
    "a limit switch": (fail, 0.003, {Cause.DRIVE}),
    "a drive that leaves operation": (fall, 0.003, {Cause.DRIVE}),
    "a command that is no number": (
        lambda rig: rig.plant.supervisor.drive(0.0, UPRIGHT, 0.02, height=math.nan), 0.003, {Cause.NOT_A_NUMBER},
    ),
}  # fmt: skip
GROWS = (Cause.SPEED, Cause.FOLLOWING, Cause.ACCELERATION, Cause.HEIGHT)


@pytest.mark.parametrize("name", FAULTS)
@pytest.mark.parametrize("after", [0.2, 0.337, 0.8])
def test_every_fault_stops_both_axes_in_time_and_stays_so(name, after):
    inject, descent, causes = FAULTS[name]
    rig = ready(height=0.003 if descent > 0 else -0.003)
    rig.plant.supervisor.limits = rig.settings.limits
    assert move(rig, descent, round(after / 0.02)) is None
    rig.clock.sleep_until(rig.clock.now() + after % 0.02)
    injected = rig.clock.now()
    inject(rig)
    stop = move(rig, descent)
    assert stop is not None
    assert stop.report.cause in causes, str(stop.report)
    late = stop.report.detected - injected
    assert late <= (
        0.4 if stop.report.cause in GROWS else detection_times(rig.settings.limits)[stop.report.cause] + 1e-3
    )
    for drive in (rig.blade, rig.across["height"]):  # told at once, together
        assert (stop.report.commanded, "quick stop") in drive.sent
    rig.clock.sleep_until(rig.clock.now() + 0.1)
    height, position = rig.bench.beside("height"), rig.bench.motion
    assert (height[1], position[1]) == (0.0, 0.0)
    for _ in range(5):
        with pytest.raises(RigStopped):
            rig.plant.advance(0.01, UPRIGHT, PERIOD, -0.01)
        rig.clock.sleep_until(rig.clock.now() + 0.1)
    assert (rig.bench.beside("height")[0], rig.bench.motion[0]) == (height[0], position[0])  # and nothing was raised
    with pytest.raises(RigError, match="not agreed"):
        rig.plant.supervisor.reset(agreed=False)


def test_without_a_supervisor_the_same_faults_go_on():
    """The sibling."""
    for inject, descent, _ in FAULTS.values():
        rig = ready()
        assert move(rig, descent, 10) is None
        rig.plant.supervisor.trip = lambda *arguments, **named: None
        inject(rig)
        assert move(rig, descent, 25) is None


def test_after_a_reset_it_can_be_raised_again_and_not_before():
    rig = ready(height=-0.003)
    rig.faults.height.one_way = True
    with pytest.raises(RigStopped) as stop:
        rig.plant.raise_to(0.01)
    assert stop.value.report.cause is Cause.NOT_RAISED
    assert stop.value.report.detected == pytest.approx(rig.clock.now(), abs=0.3)
    rig.faults.__dict__.update(vars(Faults()))
    with pytest.raises(RigStopped):
        rig.plant.raise_to(0.01)
    rig.plant.supervisor.reset(agreed=True)
    release(rig)
    rig.plant.raise_to(0.01)
    assert rig.plant.height == pytest.approx(0.01, abs=5e-5)


def test_a_blade_that_does_not_arrive_above_is_a_fault_too():
    """It moves, but so slowly that neither the encoder stands nor the difference grows."""
    rig = ready(height=-0.003)
    rig.plant.supervisor.drive, command = (
        lambda speed, angle, hold, height=0.0: command(speed, angle, hold, height=min(height, 2e-4)),
        rig.plant.supervisor.drive,
    )
    with pytest.raises(RigStopped, match=r"cannot be raised: the blade stands at a height of -?\d"):
        rig.plant.raise_to(0.02)


def test_a_drive_that_does_not_hear_the_quick_stop_is_told_again_and_then_left_to_its_watchdog():
    rig = ready()
    assert move(rig, 0.003, 20) is None
    rig.faults.height.quick_stops_lost = 3
    rig.plant.supervisor.trip(Cause.OPERATOR, "a test")
    rig.clock.sleep_until(rig.clock.now() + 0.3)
    assert rig.across["height"].state is DriveState.QUICK_STOP
    assert 4 <= len(rig.across["height"].sent) <= 6
    rig = ready()
    assert move(rig, 0.003, 20) is None
    rig.faults.height.quick_stops_lost = 1000
    rig.plant.supervisor.trip(Cause.OPERATOR, "a test")
    rig.clock.sleep_until(rig.clock.now() + 0.3)
    assert "abandoned" in [what for _, what in rig.across["height"].sent]
    assert "the height drive ignores the quick stop" in rig.plant.supervisor.report.detail


def test_commands_fade_out_before_both_ends_and_are_no_faster_than_allowed():
    rig = ready(lowest=-0.002, highest=0.004, raised=0.003)
    assert move(rig, 0.02, 60, speed=0.0) is None
    assert -0.002 <= rig.plant.height < -0.0018
    assert move(rig, -0.02, 100, speed=0.0) is None
    assert 0.0038 < rig.plant.height <= 0.004
    assert rig.plant.supervisor.limited > 0
    rig = ready()
    assert move(rig, 0.02, 25, speed=0.0) is None
    assert -rig.bench.beside("height")[1] == pytest.approx(0.0106 / 1.04, rel=0.01)


def test_a_late_policy_stops_a_blade_that_only_descends():
    rig = ready()
    assert move(rig, 0.003, 10, speed=0.0) is None
    rig.clock.sleep_until(rig.clock.now() + 0.2)
    stop = move(rig, 0.003, speed=0.0)
    assert stop is not None
    assert stop.report.cause is Cause.OVERRUN


def test_a_locked_axis_that_sinks_is_stopped():
    rig = ready()
    rig.plant.supervisor.lock()
    rig.across["height"].target = -0.004
    rig.clock.sleep_until(rig.clock.now() + 0.5)
    assert rig.plant.supervisor.phase == "stopped"
    assert "locked, the height axis moves: -1." in str(rig.plant.supervisor.report)


@pytest.mark.parametrize("height", [-0.0205, 0.0255])
def test_from_beyond_an_end_it_creeps_back_only_if_allowed(height):
    rig = in_air(height)
    rig.plant.power()
    rig.clock.sleep_until(rig.clock.now() + SETTLE)
    with pytest.raises(RigError, match=r"blade at a height of -?2\d.* outside -20 to 25 mm"):
        rig.plant.supervisor.release()
    return_inside(rig.plant)
    assert -0.02 < rig.plant.height < 0.025
    assert rig.plant.position == pytest.approx(0.01, abs=1e-9)
    rig = in_air(height)
    rig.plant.power()
    rig.clock.sleep_until(rig.clock.now() + SETTLE)
    rig.faults.height.runaway = math.copysign(0.001, height)
    with pytest.raises(RigStopped, match="outward"):
        return_inside(rig.plant)


def test_the_self_test_moves_it_up_and_back_and_measures_both():
    rig = ready()
    check = moving_checks(rig.plant)[0]
    assert (check.name, check.passed) == ("height encoder", True)
    assert "moved up +0.98" in check.found
    rig = ready(height=0.0245)  # near the upper end: down first
    assert "-1.00 mm" in moving_checks(rig.plant)[0].found
    rig = ready()
    rig.faults.height.one_way = True
    with pytest.raises(RigStopped, match="cannot be raised"):
        moving_checks(rig.plant)


def test_a_drive_that_was_not_homed_is_not_moved():
    rig = ready()
    assert [check.passed for check in still_checks(rig.plant) if check.name == "height homed"] == [True]
    rig.faults.height.not_homed = True
    (check,) = [check for check in still_checks(rig.plant) if check.name == "height homed"]
    assert not check.passed
    assert "home it with the maker's tool" in check.found
    rig = ready(homing="trusted")
    assert "height homed" not in [check.name for check in still_checks(rig.plant)]
    assert "height homed" not in [check.name for check in still_checks(ready_rig().plant)]


def pressing(rig: FakeRig, force: float, per_metre: float) -> None:
    """Let the tissue push back by a force that changes with the height [N], [N/m]."""
    start = rig.bench.beside("height")[0]

    def push(now: float) -> None:
        rig.faults.height.force = force - per_metre * (rig.bench.beside("height")[0] - start)

    push(0.0)
    rig.clock.every(0.001, push, "tissue")
    rig.clock.sleep_until(rig.clock.now() + 0.01)


def test_a_blade_that_presses_too_hard_is_raised_slowly_after_a_yes_alone():
    rig = ready(height=-0.005)
    pressing(rig, 12.0, 2000.0)
    assert rig.plant.supervisor.report.cause is Cause.VERTICAL_FORCE
    rig.clock.sleep_until(rig.clock.now() + 0.2)
    stood = rig.bench.beside("height")[0]
    operator = ScriptedOperator([("will move", "fake"), ("the blade presses on the tissue with 12.0 N", False)])
    rig.plant.supervisor.reset(agreed=True)
    with pytest.raises(RigError, match="has not agreed that it is raised: nothing moves"):
        prepare(rig.plant, operator, today=date.today(), in_air=False)
    assert rig.bench.beside("height")[0] == stood
    with pytest.raises(RigError, match=r"presses on the tissue with 12\.0 N, 10 N allowed: it may be raised"):
        release(rig)
    operator.unasked[:] = [("will move", "fake"), ("May it be raised at 2 mm/s until it is free?", True)]
    seen, told = [], rig.heard
    rig.heard = lambda time, axis, speed: seen.append((axis, speed))
    prepare(rig.plant, operator, today=date.today(), in_air=False)
    assert not operator.unasked
    rises = [speed for axis, speed in seen if axis == "height"]
    assert 0.0 <= min(rises[:20]) <= max(rises[:20]) <= 0.002
    assert rig.plant.supervisor.pressed is None
    assert not rig.plant.supervisor.relieving
    assert stood + 0.0015 < rig.plant.height < stood + 0.003  # to 9 N
    rig.plant.travel(rig.plant.position + 0.001, speed=0.005)
    assert told is not None


@pytest.mark.parametrize(("force", "per_metre", "ends"), [(12.0, -3000.0, RigStopped), (12.0, 0.0, RigError)])
def test_a_force_that_grows_or_stays_while_it_is_raised_ends_that(force, per_metre, ends):
    rig = ready(height=-0.005)
    pressing(rig, force, per_metre)
    rig.clock.sleep_until(rig.clock.now() + 0.2)
    rig.plant.supervisor.reset(agreed=True)
    rig.plant.power()
    rig.clock.sleep_until(rig.clock.now() + SETTLE)
    start = rig.bench.beside("height")[0]
    with pytest.raises(ends) as caught:
        relieve(rig.plant)
    assert type(caught.value) is ends
    assert rig.bench.beside("height")[0] - start < (0.0005 if ends is RigStopped else 0.0101)
    rig.clock.sleep_until(rig.clock.now() + 0.2)
    assert rig.bench.beside("height")[1] == 0.0


def test_while_it_is_relieved_no_other_motion_is_possible():
    rig = ready(height=-0.005)
    pressing(rig, 12.0, 0.0)
    rig.plant.supervisor.reset(agreed=True)
    rig.plant.power()
    rig.clock.sleep_until(rig.clock.now() + SETTLE)
    rig.plant.supervisor.release(returning=True)
    before = (rig.bench.motion[0], rig.bench.beside("height")[0])
    assert move(rig, 0.005, 10, speed=0.01) is None
    assert (rig.bench.motion[0], rig.bench.beside("height")[0]) == before
    rig.faults.height.force = -10.5  # a pull is no pressing
    rig = ready(height=-0.005)
    pressing(rig, -12.0, 0.0)
    assert rig.plant.supervisor.pressed is None
    assert rig.plant.supervisor.report.cause is Cause.VERTICAL_FORCE


def test_height_vertical_force_and_six_components_come_with_the_readings():
    rig = ready_to_descend()
    readings = rig.plant.advance(0.01, UPRIGHT, 300)
    beside = rig.plant.beside
    assert len(beside) == len(readings) == 300
    assert np.all(beside["height"] == 0.0)
    assert np.array_equal(beside["force_x"], readings["force"])
    assert beside["torque_y"] == pytest.approx(-0.1 * readings["force"])
    readings = rig.plant.advance(0.0, UPRIGHT, 400, -0.004)
    beside = rig.plant.beside
    assert beside["height"][-1] == pytest.approx(rig.plant.height, abs=3e-5)
    assert 0.001 < beside["height"][-1] < 0.0016
    assert beside["vertical_force"].min() < -0.02  # the tissue rubs on a rising blade, downwards
    assert np.array_equal(beside["force_z"], beside["vertical_force"])
    assert abs(rig.bench.plant.energy()["residual"]) < 1e-12
    assert set(COMPONENTS_OF_FORCE) < set(beside.dtype.names)
    assert np.array_equal(rig.plant.vertical_force, beside["vertical_force"])
    assert rig.plant.level == rig.plant.height


def test_the_sensor_may_be_mounted_the_other_way():
    rig = ready_to_descend(force_axis="y", force_sign=-1)
    rig.plant.advance(0.01, UPRIGHT, 300)
    rig.plant.advance(0.0, UPRIGHT, 400, -0.004)
    assert rig.plant.beside["vertical_force"].min() < -0.02
    assert np.array_equal(rig.plant.beside["force_y"], -rig.plant.beside["vertical_force"])


def test_a_rig_without_the_axis_refuses_and_names_the_cure():
    rig = ready_rig()
    with pytest.raises(ValueError, match=r"DepthCut-v1 raises and lowers the blade, and rig 'fake' has no height axis"):
        rig.settings.require_height_axis(by="DepthCut-v1")
    with pytest.raises(ValueError, match=r"described in its file under \[height\].*cutenv/RigCut-v1"):
        rig.plant.advance(0.01, UPRIGHT, PERIOD, 0.001)
    with pytest.raises(ValueError, match="raise_to"):
        rig.plant.raise_to(0.01)
    with pytest.raises(ValueError, match="vertical_force"):
        rig.plant.vertical_force  # noqa: B018  read for its error
    with pytest.raises(RigError, match="if it has one"):
        rig.plant.level  # noqa: B018
    assert rig.plant.beside is None
    assert height_settings().require_height_axis(by="a test").node == 3


def test_nothing_changes_for_the_motion_along_the_cut():
    """In air at constant height, a rig with the axis moves as one without it, to the last bit."""
    found = []
    for settings in (height_settings(), dataclasses.replace(height_settings(), height=None)):
        rig = in_air(0.0, settings)
        release(rig)
        found.append(np.concatenate([rig.plant.advance(v, UPRIGHT, PERIOD) for v in (0.01, 0.02, -0.01, 0.0) * 5]))
    for name in ("position", "speed", "force", "time", "angle"):
        assert np.array_equal(found[0][name], found[1][name])
