"""Axis to the side: its faults stop it and the blade, its limits slow both alike, its file and its checks."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import numpy as np
import pytest
from made_ready import release

from cutenv.rig.config.imitated_rig import SIDE, across, fake_settings
from cutenv.rig.config.settings import RigSettings
from cutenv.rig.contradictions import refuse_contradictions
from cutenv.rig.devices.samples import DriveState
from cutenv.rig.errors import RigError
from cutenv.rig.fake.air_plant import AirPlant
from cutenv.rig.fake.fake_rig import FakeRig
from cutenv.rig.operation.preflight import moving_checks, return_inside, still_checks
from cutenv.rig.operation.suitability import fits
from cutenv.rig.safety.stop_causes import Cause, RigStopped, detection_times
from cutenv.rig.toml_file import read_rig_file
from cutenv.rig.toml_text import to_toml

UPRIGHT = math.pi / 2
PERIOD = 20


def side_settings(**axis: float) -> RigSettings:
    return fake_settings(side=dataclasses.replace(SIDE, **axis))


def in_air(place: float = 0.0, settings: RigSettings | None = None) -> FakeRig:
    rig = FakeRig(lambda settings: AirPlant(settings, start=0.02), settings or side_settings())
    if place:
        rig.bench._across["side"].place = place
    rig.plant.open()
    return rig


def ready(place: float = 0.0, **axis: float) -> FakeRig:
    rig = in_air(place, side_settings(**axis))
    release(rig)
    return rig


def move(rig: FakeRig, direction: float, periods: int = 100, speed: float = 0.008) -> RigStopped | None:
    """Move in a direction [rad] for so many periods; the stop that came."""
    rig.plant.begin()
    rig.plant.heading.begin(direction)
    try:
        for _ in range(periods):
            rig.plant.advance(speed, UPRIGHT, PERIOD)
    except RigStopped as stop:
        return stop
    return None


def faulty(**values: object) -> Callable[[FakeRig], None]:
    return lambda rig: rig.faults.side.__dict__.update(values)


FAULTS: dict[str, tuple[Callable[[FakeRig], None], set[Cause]]] = {
    "no samples": (faulty(silent=True), {Cause.MOTION_STALE}),
    "no heartbeat": (faulty(heartbeat_silent=True), {Cause.HEARTBEAT}),
    "a wrong place": (faulty(shift=0.003), {Cause.SPEED, Cause.FOLLOWING}),
    "a stuck encoder": (faulty(stuck=True), {Cause.STUCK, Cause.ACCELERATION}),
    "it cannot move": (faulty(blocked=True), {Cause.STUCK, Cause.ACCELERATION}),
    "it cannot go left": (faulty(one_way=True), {Cause.STUCK, Cause.ACCELERATION}),
    "a runaway": (faulty(runaway=0.03), {Cause.SPEED, Cause.FOLLOWING}),
    "a force to the side": (faulty(force=16.0), {Cause.FORCE, Cause.FORCE_RISE}),
    "a limit switch": (lambda rig: rig.report_emergency(0x8A81, "limit switch", axis="side"), {Cause.DRIVE}),
    "a command that is no number": (
        lambda rig: rig.plant.supervisor.drive(0.0, UPRIGHT, 0.02, side=math.nan), {Cause.NOT_A_NUMBER},
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_stops_both_axes_together_within_its_time(name):
    cause, causes = FAULTS[name]
    rig = ready()
    assert move(rig, 0.8, periods=25) is None
    before = rig.clock.now()
    cause(rig)
    stop = move(rig, 0.8)
    assert stop is not None
    assert stop.report.cause in causes
    stated = max(detection_times(rig.settings.limits)[each] for each in causes)
    grows = 0.3 if stop.report.cause in (Cause.SPEED, Cause.FOLLOWING) else 0.0  # until it crosses its limit
    assert stop.report.detected - before <= stated + grows + 0.002
    assert rig.blade.state in (DriveState.QUICK_STOP, DriveState.FAULT)
    assert rig.across["side"].state in (DriveState.QUICK_STOP, DriveState.FAULT)
    assert (rig.bench.beside("side")[1], rig.bench.motion[1]) == (0.0, 0.0)
    with pytest.raises(RigStopped):
        rig.plant.carry("side", 0.0)


def test_speed_and_turn_lead_the_blade_along_an_arc():
    rig = ready()
    move(rig, 0.0, periods=25, speed=0.015)
    start = rig.plant.position
    for _ in range(100):
        rig.plant.advance(0.015, UPRIGHT, PERIOD, turn_rate=0.5)
    assert rig.plant.heading.now == pytest.approx(1.0)
    radius, end = 0.015 / 0.5, (rig.plant.position - start, rig.plant.place("side"))
    assert math.dist(end, (0.0, radius)) == pytest.approx(radius, abs=1e-4)  # its direction has no lag
    assert rig.plant.beside["blade_y"][-1] == pytest.approx(end[1], abs=5e-5)


def test_forces_are_turned_into_the_direction_of_the_blade():
    rig = ready()
    rig.faults.extra_force, rig.faults.side.force = 3.0, 4.0
    rig.plant.begin()
    rig.plant.heading.begin(math.atan2(4.0, 3.0))
    readings = rig.plant.advance(0.0, UPRIGHT, PERIOD)
    assert np.mean(readings["force"]) == pytest.approx(5.0, abs=0.1)
    assert np.mean(rig.plant.beside["lateral_force"]) == pytest.approx(0.0, abs=0.1)


def test_where_one_axis_is_limited_the_other_goes_as_much_slower():
    rig = ready(fastest=0.0052)
    move(rig, 0.7, periods=30, speed=0.02)
    (_, ahead, _), (_, left) = rig.bench.motion, rig.bench.beside("side")
    assert left == pytest.approx(0.005, rel=0.02)
    assert left / ahead == pytest.approx(math.tan(0.7), rel=0.02)
    assert rig.plant.supervisor.limited > 0


def test_before_the_ends_of_travel_it_comes_to_rest():
    rig = ready(leftmost=0.01)
    assert move(rig, 1.2, periods=200, speed=0.02) is None
    assert 0.0095 < rig.plant.place("side") <= 0.01
    rig.faults.side.runaway = 0.004
    stop = move(rig, 1.2)
    assert stop is not None
    assert stop.report.cause in (Cause.SIDE, Cause.FOLLOWING)


def test_from_beyond_an_end_it_creeps_back_only_if_allowed():
    rig = in_air(0.0385)
    with pytest.raises(RigError, match=r"blade to the left by 38\.50 mm, outside -38 to 38 mm"):
        release(rig)
    return_inside(rig.plant)
    assert rig.plant.place("side") < 0.038


def test_the_self_test_moves_it_and_asks_the_drive_whether_it_was_homed():
    rig = ready()
    check = moving_checks(rig.plant)[0]
    assert (check.name, check.passed) == ("side encoder", True)
    rig.faults.side.not_homed = True
    (check,) = [check for check in still_checks(rig.plant) if check.name == "side homed"]
    assert not check.passed
    rig.faults.side.blocked = True
    with pytest.raises(RigStopped, match=r"encoder stuck|acceleration"):
        moving_checks(rig.plant)


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


def test_nothing_changes_for_a_rig_that_does_not_use_it():
    ways = []
    for settings in (side_settings(), dataclasses.replace(side_settings(), side=None)):
        rig = in_air(settings=settings)
        release(rig)
        rig.plant.begin()
        ways.append(np.concatenate([rig.plant.advance(0.01, 1.2, PERIOD) for _ in range(20)]))
    for name in ("force", "position", "speed", "angle"):
        assert ways[0][name].tolist() == ways[1][name].tolist()
