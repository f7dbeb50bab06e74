"""Axes across the cut, up and down or to the side: every fault of one stops it and the blade, in time, for good."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from datetime import date
from typing import Any, NamedTuple

import numpy as np
import pytest
from made_ready import SETTLE, height_settings, ready_rig, ready_to_descend, release
from scripted_operator import ScriptedOperator

from cutenv.emulation.fake_benches import AirPlant
from cutenv.emulation.fake_rig import FakeRig, Faults
from cutenv.rig.config.settings import SIDE, RigSettings, across, fake_settings
from cutenv.rig.contradictions import refuse_contradictions
from cutenv.rig.devices.protocols import DriveState
from cutenv.rig.errors import RigError
from cutenv.rig.operation.preflight import moving_checks, prepare, relieve, return_inside, still_checks
from cutenv.rig.operation.suitability import fits
from cutenv.rig.safety.stop_causes import Cause, RigStopped, detection_times
from cutenv.rig.toml_file import read_rig_file, to_toml
from cutenv.sim.trace import COMPONENTS_OF_FORCE

PERIOD = 20  # [ms]
UPRIGHT = math.pi / 2
BOTH = pytest.mark.parametrize("axis", ["height", "side"])


def side_settings(**axis: Any) -> RigSettings:
    return fake_settings(side=dataclasses.replace(SIDE, **axis))


def settings_of(axis: str, **values: Any) -> RigSettings:
    return height_settings(**values) if axis == "height" else side_settings(**values)


def in_air(axis: str, place: float = 0.0, settings: RigSettings | None = None) -> FakeRig:
    rig = FakeRig(lambda settings: AirPlant(settings, start=0.01), settings or settings_of(axis))
    if place:
        rig.bench._across[axis].place = place
    rig.plant.open()
    return rig


def ready(axis: str, place: float = 0.0, **values: Any) -> FakeRig:
    rig = in_air(axis, place, settings_of(axis, **values))
    release(rig)
    return rig


def move(
    rig: FakeRig, descent: float = 0.0, periods: int = 100, speed: float = 0.008, direction: float | None = None
) -> RigStopped | None:
    """Move for so many periods, downwards [m/s], or in a direction [rad]; the stop that came."""
    if direction is not None:
        rig.plant.begin()
        rig.plant.heading.begin(direction)
    try:
        for _ in range(periods):
            rig.plant.advance(speed, UPRIGHT, PERIOD, descent)
    except RigStopped as stop:
        return stop
    return None


Inject = Callable[[FakeRig, str], None]


def faulty(**values: object) -> Inject:
    return lambda rig, axis: rig.faults_of(axis).__dict__.update(values)


def fail(rig: FakeRig, axis: str) -> None:
    rig.report_emergency(0x8A81, "limit switch", axis=axis)


def fall(rig: FakeRig, axis: str) -> None:
    rig.across[axis].state = DriveState.SWITCHED_ON


def command_no_number(rig: FakeRig, axis: str) -> None:
    rig.plant.supervisor.drive(0.0, UPRIGHT, 0.02, **{axis: math.nan})


class Fault(NamedTuple):
    """A fault of an axis, the motion in which it happens, and what may find it out."""

    axis: str
    inject: Inject
    motion: dict[str, float]
    causes: set[Cause]


def when(axis: str, way: float, faults: dict[str, tuple[Inject, set[Cause]]]) -> dict[str, Fault]:
    """Faults of an axis whose blade moves downwards [m/s], or in a direction [rad]."""
    motion = {"descent" if axis == "height" else "direction": way}
    return {f"{axis}: {name}": Fault(axis, inject, motion, causes) for name, (inject, causes) in faults.items()}


COMMON: dict[str, tuple[Inject, set[Cause]]] = {
    "no samples": (faulty(silent=True), {Cause.MOTION_STALE}),
    "no heartbeat": (faulty(heartbeat_silent=True), {Cause.HEARTBEAT}),
    "a stuck encoder": (faulty(stuck=True), {Cause.STUCK, Cause.ACCELERATION}),
    "it cannot move": (faulty(blocked=True), {Cause.STUCK, Cause.ACCELERATION}),
    "a limit switch": (fail, {Cause.DRIVE}),
    "a drive that leaves operation": (fall, {Cause.DRIVE}),
    "a command that is no number": (command_no_number, {Cause.NOT_A_NUMBER}),
    "a wrong place": (faulty(shift=0.003), {Cause.SPEED, Cause.FOLLOWING}),
}
FAULTS = {
    **when("height", 0.003, COMMON | {
        "a wrong height": (faulty(shift=0.002), {Cause.SPEED, Cause.FOLLOWING}),
        "a runaway downwards": (faulty(runaway=-0.02), {Cause.SPEED, Cause.FOLLOWING}),
        "a pressed blade": (faulty(force=-10.5), {Cause.VERTICAL_FORCE}),
        "a lifted blade": (faulty(force=10.5), {Cause.VERTICAL_FORCE}),
    }),
    **when("height", -0.003, {
        "a stuck encoder while raised": (faulty(stuck=True), {Cause.NOT_RAISED, Cause.ACCELERATION}),
        "it cannot be raised": (faulty(one_way=True), {Cause.NOT_RAISED, Cause.ACCELERATION}),
    }),
    **when("height", 0.0, {"a runaway upwards": (faulty(runaway=0.006), {Cause.FOLLOWING, Cause.HEIGHT})}),
    **when("side", 0.8, COMMON | {
        "it cannot go left": (faulty(one_way=True), {Cause.STUCK, Cause.ACCELERATION}),
        "a runaway": (faulty(runaway=0.03), {Cause.SPEED, Cause.FOLLOWING}),
        "a force to the side": (faulty(force=16.0), {Cause.FORCE, Cause.FORCE_RISE}),
    }),
}  # fmt: skip
GROWS = (Cause.SPEED, Cause.FOLLOWING, Cause.ACCELERATION, Cause.HEIGHT)


@pytest.mark.parametrize("name", FAULTS)
@pytest.mark.promise("S14")
@pytest.mark.promise("S15")
def test_every_fault_stops_both_axes_in_time_and_stays_so(name):
    """At some instant, between two commands; test_every_fault_stops.py takes many."""
    axis, inject, motion, causes = FAULTS[name]
    after = np.random.default_rng(list(name.encode())).uniform(0.2, 0.35)
    start = 0.003 if motion.get("descent", 0.0) > 0 else -0.003
    rig = ready(axis, start if axis == "height" else 0.0)
    assert move(rig, **motion, periods=int(after / 0.02)) is None
    rig.clock.sleep_until(rig.clock.now() + after % 0.02)
    injected = rig.clock.now()
    inject(rig, axis)
    stop = move(rig, motion.get("descent", 0.0))
    assert stop is not None
    assert stop.report.cause in causes, str(stop.report)
    late = stop.report.detected - injected
    assert late <= (
        0.4 if stop.report.cause in GROWS else detection_times(rig.settings.limits)[stop.report.cause] + 1e-3
    )
    for drive in (rig.blade, rig.across[axis]):  # told at once, together
        assert (stop.report.commanded, "quick stop") in drive.sent
    assert rig.blade.state in (DriveState.QUICK_STOP, DriveState.FAULT)
    rig.clock.sleep_until(rig.clock.now() + 0.1)
    (place, speed), along = rig.bench.cross_motion(axis), rig.bench.motion
    assert (speed, along[1]) == (0.0, 0.0)
    for _ in range(3):
        with pytest.raises(RigStopped):
            rig.plant.advance(0.01, UPRIGHT, PERIOD, -0.01 if axis == "height" else 0.0)
        with pytest.raises(RigStopped):
            rig.plant.carry(axis, 0.01)
        rig.clock.sleep_until(rig.clock.now() + 0.1)
    assert (rig.bench.cross_motion(axis)[0], rig.bench.motion[0]) == (place, along[0])  # and nothing was raised
    with pytest.raises(RigError, match="not agreed"):
        rig.plant.supervisor.reset(agreed=False)


def test_without_a_supervisor_the_same_faults_go_on():
    """The sibling."""
    for axis, inject, motion, _ in FAULTS.values():
        rig = ready(axis)
        assert move(rig, **motion, periods=10) is None
        rig.plant.supervisor.trip = lambda *arguments, **named: None
        inject(rig, axis)
        assert move(rig, motion.get("descent", 0.0), 25) is None


def test_after_a_reset_it_can_be_raised_again_and_not_before():
    rig = ready("height", -0.003)
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
    rig = ready("height", -0.003)
    rig.plant.supervisor.drive, command = (
        lambda speed, angle, hold, height=0.0: command(speed, angle, hold, height=min(height, 2e-4)),
        rig.plant.supervisor.drive,
    )
    with pytest.raises(RigStopped, match=r"cannot be raised: the blade stands at a height of -?\d"):
        rig.plant.raise_to(0.02)


@BOTH
def test_a_drive_that_does_not_hear_the_quick_stop_is_told_again_and_then_left_to_its_watchdog(axis):
    for lost in (3, 1000):
        rig = ready(axis)
        assert move(rig, periods=20) is None
        rig.faults_of(axis).quick_stops_lost = lost
        rig.plant.supervisor.trip(Cause.OPERATOR, "a test")
        rig.clock.sleep_until(rig.clock.now() + 0.3)
        drive = rig.across[axis]
        if lost == 3:
            assert drive.state is DriveState.QUICK_STOP
            assert 4 <= len(drive.sent) <= 6
        else:
            assert "abandoned" in [what for _, what in drive.sent]
            assert f"the {axis} drive ignores the quick stop" in rig.plant.supervisor.report.detail


def test_commands_fade_out_before_both_ends_and_are_no_faster_than_allowed():
    rig = ready("height", lowest=-0.002, highest=0.004, raised=0.003)
    assert move(rig, 0.02, 60, speed=0.0) is None
    assert -0.002 <= rig.plant.height < -0.0018
    assert move(rig, -0.02, 100, speed=0.0) is None
    assert 0.0038 < rig.plant.height <= 0.004
    assert rig.plant.supervisor.limited > 0
    rig = ready("height")
    assert move(rig, 0.02, 25, speed=0.0) is None
    assert -rig.bench.cross_motion("height")[1] == pytest.approx(0.0106 / 1.04, rel=0.01)


def test_a_late_policy_stops_a_blade_that_only_descends():
    rig = ready("height")
    assert move(rig, 0.003, 10, speed=0.0) is None
    rig.clock.sleep_until(rig.clock.now() + 0.2)
    stop = move(rig, 0.003, speed=0.0)
    assert stop is not None
    assert stop.report.cause is Cause.OVERRUN


@BOTH
def test_a_locked_axis_that_moves_is_stopped(axis):
    rig = ready(axis)
    rig.plant.supervisor.lock()
    rig.across[axis].target = -0.004
    rig.clock.sleep_until(rig.clock.now() + 0.5)
    assert rig.plant.supervisor.phase == "stopped"
    assert f"locked, the {axis} axis moves: -1." in str(rig.plant.supervisor.report)


@pytest.mark.parametrize(
    ("axis", "place", "said"),
    [
        ("height", -0.0205, r"blade at a height of -20\.50 mm, outside -20 to 25 mm"),
        ("height", 0.0255, r"blade at a height of 25\.50 mm, outside -20 to 25 mm"),
        ("side", 0.0385, r"blade to the left by 38\.50 mm, outside -38 to 38 mm"),
    ],
)
def test_from_beyond_an_end_it_creeps_back_only_if_allowed(axis, place, said):
    for runaway in (0.0, math.copysign(0.001, place)):
        rig = in_air(axis, place)
        rig.plant.power()
        rig.clock.sleep_until(rig.clock.now() + SETTLE)
        rig.faults_of(axis).runaway = runaway
        if runaway:
            with pytest.raises(RigStopped, match="outward"):
                return_inside(rig.plant)
            continue
        with pytest.raises(RigError, match=said):
            rig.plant.supervisor.release()
        return_inside(rig.plant)
        low, high = settings_of(axis).cross_axes[axis].bounds
        assert low < rig.plant.place(axis) < high
        assert rig.plant.position == pytest.approx(0.01, abs=1e-9)


@pytest.mark.parametrize(
    ("axis", "near_end", "fault", "said"),
    [("height", 0.0245, "one_way", "cannot be raised"), ("side", 0.0375, "blocked", r"encoder stuck|acceleration")],
)
def test_the_self_test_moves_it_and_back_and_measures_both(axis, near_end, fault, said):
    check = moving_checks(ready(axis).plant)[0]
    assert (check.name, check.passed) == (f"{axis} encoder", True)
    assert f"moved {'up' if axis == 'height' else 'to the left'} +0.98" in check.found
    assert "-1.00 mm" in moving_checks(ready(axis, near_end).plant)[0].found  # first the way that has room
    rig = ready(axis)
    setattr(rig.faults_of(axis), fault, True)
    with pytest.raises(RigStopped, match=said):
        moving_checks(rig.plant)


@BOTH
def test_a_drive_that_was_not_homed_is_not_moved(axis):
    def homed(rig: FakeRig) -> list[Any]:
        return [check for check in still_checks(rig.plant) if check.name == f"{axis} homed"]

    rig = ready(axis)
    assert [check.passed for check in homed(rig)] == [True]
    rig.faults_of(axis).not_homed = True
    (check,) = homed(rig)
    assert not check.passed
    assert "home it with the maker's tool" in check.found
    assert homed(ready(axis, homing="trusted")) == homed(ready_rig()) == []


def pressing(rig: FakeRig, force: float, per_metre: float) -> None:
    """Let the tissue push back by a force that changes with the height [N], [N/m]."""
    start = rig.bench.cross_motion("height")[0]

    def push(now: float) -> None:
        rig.faults.height.force = force - per_metre * (rig.bench.cross_motion("height")[0] - start)

    push(0.0)
    rig.clock.every(0.001, push, "tissue")
    rig.clock.sleep_until(rig.clock.now() + 0.01)


def test_a_blade_that_presses_too_hard_is_raised_slowly_after_a_yes_alone():
    rig = ready("height", -0.005)
    pressing(rig, 12.0, 2000.0)
    assert rig.plant.supervisor.report.cause is Cause.VERTICAL_FORCE
    rig.clock.sleep_until(rig.clock.now() + 0.2)
    stood = rig.bench.cross_motion("height")[0]
    operator = ScriptedOperator([("will move", "fake"), ("the blade presses on the tissue with 12.0 N", False)])
    rig.plant.supervisor.reset(agreed=True)
    with pytest.raises(RigError, match="has not agreed that it is raised: nothing moves"):
        prepare(rig.plant, operator, today=date.today(), in_air=False)
    assert rig.bench.cross_motion("height")[0] == stood
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
    rig = ready("height", -0.005)
    pressing(rig, force, per_metre)
    rig.clock.sleep_until(rig.clock.now() + 0.2)
    rig.plant.supervisor.reset(agreed=True)
    rig.plant.power()
    rig.clock.sleep_until(rig.clock.now() + SETTLE)
    start = rig.bench.cross_motion("height")[0]
    with pytest.raises(ends) as caught:
        relieve(rig.plant)
    assert type(caught.value) is ends
    assert rig.bench.cross_motion("height")[0] - start < (0.0005 if ends is RigStopped else 0.0101)
    rig.clock.sleep_until(rig.clock.now() + 0.2)
    assert rig.bench.cross_motion("height")[1] == 0.0


def test_while_it_is_relieved_no_other_motion_is_possible():
    rig = ready("height", -0.005)
    pressing(rig, 12.0, 0.0)
    rig.plant.supervisor.reset(agreed=True)
    rig.plant.power()
    rig.clock.sleep_until(rig.clock.now() + SETTLE)
    rig.plant.supervisor.release(returning=True)
    before = (rig.bench.motion[0], rig.bench.cross_motion("height")[0])
    assert move(rig, 0.005, 10, speed=0.01) is None
    assert (rig.bench.motion[0], rig.bench.cross_motion("height")[0]) == before
    rig.faults.height.force = -10.5  # a pull is no pressing
    rig = ready("height", -0.005)
    pressing(rig, -12.0, 0.0)
    assert rig.plant.supervisor.pressed is None
    assert rig.plant.supervisor.report.cause is Cause.VERTICAL_FORCE


def test_height_vertical_force_and_six_components_come_with_the_readings():
    rig = ready_to_descend()
    readings = rig.plant.advance(0.01, UPRIGHT, 300)
    channels = rig.plant.channels
    assert len(channels) == len(readings) == 300
    assert np.all(channels["height"] == 0.0)
    assert np.array_equal(channels["force_x"], readings["force"])
    assert channels["torque_y"] == pytest.approx(-0.1 * readings["force"])
    readings = rig.plant.advance(0.0, UPRIGHT, 400, -0.004)
    channels = rig.plant.channels
    assert channels["height"][-1] == pytest.approx(rig.plant.height, abs=3e-5)
    assert 0.001 < channels["height"][-1] < 0.0016
    assert channels["vertical_force"].min() < -0.02  # the tissue rubs on a rising blade, downwards
    assert np.array_equal(channels["force_z"], channels["vertical_force"])
    assert abs(rig.bench.plant.energy()["residual"]) < 1e-12
    assert set(COMPONENTS_OF_FORCE) < set(channels.dtype.names)
    assert np.array_equal(rig.plant.vertical_force, channels["vertical_force"])
    assert rig.plant.level == rig.plant.height


def test_the_sensor_may_be_mounted_the_other_way():
    rig = ready_to_descend(force_axis="y", force_sign=-1)
    rig.plant.advance(0.01, UPRIGHT, 300)
    rig.plant.advance(0.0, UPRIGHT, 400, -0.004)
    assert rig.plant.channels["vertical_force"].min() < -0.02
    assert np.array_equal(rig.plant.channels["force_y"], -rig.plant.channels["vertical_force"])


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
    assert rig.plant.channels is None
    assert height_settings().require_height_axis(by="a test").node == 3


def test_speed_and_turn_lead_the_blade_along_an_arc():
    rig = ready("side")
    move(rig, periods=25, speed=0.015, direction=0.0)
    start = rig.plant.position
    for _ in range(100):
        rig.plant.advance(0.015, UPRIGHT, PERIOD, turn_rate=0.5)
    assert rig.plant.heading.now == pytest.approx(1.0)
    radius, end = 0.015 / 0.5, (rig.plant.position - start, rig.plant.place("side"))
    assert math.dist(end, (0.0, radius)) == pytest.approx(radius, abs=1e-4)  # its direction has no lag
    assert rig.plant.channels["blade_y"][-1] == pytest.approx(end[1], abs=5e-5)


def test_forces_are_turned_into_the_direction_of_the_blade():
    rig = ready("side")
    rig.faults.extra_force, rig.faults.side.force = 3.0, 4.0
    rig.plant.begin()
    rig.plant.heading.begin(math.atan2(4.0, 3.0))
    readings = rig.plant.advance(0.0, UPRIGHT, PERIOD)
    assert np.mean(readings["force"]) == pytest.approx(5.0, abs=0.1)
    assert np.mean(rig.plant.channels["lateral_force"]) == pytest.approx(0.0, abs=0.1)


def test_where_one_axis_is_limited_the_other_goes_as_much_slower():
    rig = ready("side", fastest=0.0052)
    move(rig, periods=30, speed=0.02, direction=0.7)
    (_, ahead, _), (_, left) = rig.bench.motion, rig.bench.cross_motion("side")
    assert left == pytest.approx(0.005, rel=0.02)
    assert left / ahead == pytest.approx(math.tan(0.7), rel=0.02)
    assert rig.plant.supervisor.limited > 0


def test_before_the_ends_of_travel_it_comes_to_rest():
    rig = ready("side", leftmost=0.01)
    assert move(rig, periods=200, speed=0.02, direction=1.2) is None
    assert 0.0095 < rig.plant.place("side") <= 0.01
    rig.faults.side.runaway = 0.004
    stop = move(rig, direction=1.2)
    assert stop is not None
    assert stop.report.cause in (Cause.SIDE, Cause.FOLLOWING)


def test_a_file_holds_it_and_contradictions_are_refused(tmp_path):
    settings = fake_settings(emulated=False, **across("height", "side"), depth_profile=((0.0, 0.01), (0.15, 0.01)))
    path = tmp_path / "rig.toml"
    path.write_text(to_toml(settings), encoding="utf-8")
    assert read_rig_file(path).side == SIDE
    for change, message in (
        ({"force_axis": "x"}, r"side.force_axis = 'x' and sensor.cut_axis"),
        ({"force_axis": "z"}, r"cannot lie upwards and to the side"),
        ({"rightmost": 0.0}, r"side.rightmost_mm = 0: a cut begins at side 0"),
        ({"low": -0.03}, r"side.low_mm = -30 and side.rightmost_mm"),
        ({"node": 3}, r"every node of a CAN bus needs a number of its own"),
    ):
        with pytest.raises(ValueError, match=message):
            refuse_contradictions(dataclasses.replace(settings, side=dataclasses.replace(SIDE, **change)))


def test_what_a_rig_can_do_depends_on_it():
    possible = {each.name: each.possible for each in fits(side_settings())}
    assert possible["RigPathCut-v1"]
    assert not possible["RigDepthCut-v1"]
    (without,) = [each for each in fits(fake_settings()) if each.name == "RigPathCut-v1"]
    assert (without.possible, without.why) == (False, "no drive moves the blade to the side")
    rig = FakeRig(AirPlant)
    rig.plant.open()
    release(rig)
    with pytest.raises(ValueError, match=r"turn_rate moves the blade to the side, and rig 'fake' has no side axis"):
        rig.plant.advance(0.01, UPRIGHT, PERIOD, turn_rate=0.5)


@BOTH
def test_nothing_changes_for_the_motion_along_the_cut(axis):
    """In air, at its place of the start, a rig with the axis moves as one without it, to the last bit."""
    found = []
    for settings in (settings_of(axis), dataclasses.replace(settings_of(axis), **{axis: None})):
        rig = in_air(axis, settings=settings)
        release(rig)
        found.append(np.concatenate([rig.plant.advance(v, 1.2, PERIOD) for v in (0.01, 0.02, -0.01, 0.0) * 5]))
    for name in ("position", "speed", "force", "time", "angle"):
        assert np.array_equal(found[0][name], found[1][name])


@pytest.mark.parametrize("axis", ["height", "side"])
@pytest.mark.promise("S15")
def test_an_axis_told_to_stand_that_creeps_is_stopped_at_its_limit(axis):
    rig = ready(axis)
    move(rig, periods=5)
    rig.faults_of(axis).runaway = -0.0019
    stop = move(rig, periods=100)
    assert stop is not None
    assert stop.report.cause is Cause.FOLLOWING
    assert abs(rig.bench.cross_motion(axis)[0]) < 1.15 * rig.settings.reaches[axis].following
