"""The axis: from a drive's integers to metres and back, and beside a slave of others' making what it promises."""

from __future__ import annotations

import math
import threading
import time

import pytest
from hypothesis import given
from hypothesis import strategies as st
from waiting import until

from cutenv.rig.config.settings import Axis
from cutenv.rig.devices.canopen.objects import AxisUnits
from cutenv.rig.devices.protocols import DriveState
from cutenv.rig.errors import RigError

AXES = st.builds(
    Axis,
    gear=st.floats(0.5, 200.0),
    lead=st.floats(5e-4, 2 * math.pi),
    pulses=st.integers(128, 4096),
    direction=st.sampled_from([1, -1]),
    speed=st.floats(0.01, 0.5),
    high=st.floats(0.01, 0.3),
)


def units(axis: Axis, steps: int = 1000) -> AxisUnits | None:
    """Return the units of an axis, or None if its travel cannot be counted in steps."""
    try:
        return AxisUnits(axis=axis, steps=steps)
    except ValueError:
        return None


@given(AXES, st.floats(0.0, 1.0), st.floats(-1.0, 1.0), st.floats(0.01, 10.0))
def test_positions_speeds_and_accelerations_come_back_to_half_a_step_in_the_direction_of_the_settings(
    axis, share, fast, acceleration
):
    if (found := units(axis)) is None:
        return
    position, speed = axis.low + share * (axis.high - axis.low), fast * axis.speed
    half = 0.5000001
    assert abs(found.position(found.increments(position)) - position) <= half * abs(found.position(1))
    assert found.increments(found.position(12345)) == 12345
    assert abs(found.speed(found.velocity(speed)) - speed) <= half * abs(found.speed(1))
    assert found.velocity(-speed) == -found.velocity(speed)
    if found.ramp(acceleration) > 1:
        assert abs(found.acceleration(found.ramp(acceleration)) - acceleration) <= half * found.acceleration(1)
    assert math.copysign(1, found.velocity(axis.speed)) == axis.direction
    assert found.increments(axis.high) * axis.direction > 0


def test_the_thesis_screw_counts_as_by_hand():
    """2 mm lead, 4.4 : 1, 1024 pulses: 1 mm is 2.2 turns of the motor, 9011.2 increments; 1 mm/s is 132 rpm."""
    found = AxisUnits(axis=Axis(), steps=1000)
    assert found.increments(0.001) == 9011
    assert found.velocity(0.001) == 132_000
    assert AxisUnits(axis=Axis(), steps=1).velocity(0.001) == 132
    assert found.ramp(1.0) == 132_000


@pytest.mark.parametrize(
    ("axis", "steps", "told"),
    [
        (Axis(lead=2 * math.pi, gear=1.0, speed=math.pi / 2), 1, "speed = 1.5708 is only 15.0 .* too coarse"),
        (Axis(pulses=10**7), 1000, "high, as the drive counts it, = 1.3"),
        (Axis(gear=1e5, pulses=1), 1000, "speed, as the drive counts it, ="),
        (Axis(gear=1e4, pulses=1, speed=1e-3, quick_stop=1e4), 1, "quick_stop, as the drive counts it, ="),
    ],
)
def test_what_the_drive_cannot_count_is_refused_by_name(axis, steps, told):
    with pytest.raises(ValueError, match=told):
        AxisUnits(axis=axis, steps=steps)


def test_a_hinge_is_fine_in_milli_rpm():
    hinge = Axis(lead=2 * math.pi, gear=1.0, speed=math.pi / 2)
    assert AxisUnits(axis=hinge, steps=1000).velocity(math.pi / 2) == 15_000


def test_samples_come_in_si_units_as_soon_as_it_is_open(bench, opened):
    bench.drive.position = 4096 * 22  # 22 turns of the motor are 5 of the screw, 10 mm
    until(lambda: bench.ear.samples and bench.ear.samples[-1].position > 0)
    sample = bench.ear.samples[-1]
    assert sample.position == pytest.approx(0.010, rel=1e-12)
    assert sample.torque == 0.125
    assert sample.state is DriveState.DISABLED
    assert bench.axis.units.steps == 1000
    assert abs(bench.axis.units.speed(1)) == pytest.approx(1e-3 / 132_000)


def test_the_drives_heartbeat_is_told_again_and_again(bench, opened):
    until(lambda: len(bench.ear.heartbeats) >= 4)
    assert bench.drive.value(0x1017, 0) == 50
    assert bench.ear.heartbeats == sorted(bench.ear.heartbeats)


def test_a_command_turns_the_motor_and_the_speed_comes_back(bench, ready):
    bench.axis.command(0.010)
    assert bench.drive.frames()
    until(lambda: bench.ear.samples[-1].speed != 0.0)
    assert bench.ear.samples[-1].speed == pytest.approx(0.010, abs=abs(bench.axis.units.speed(1)))
    assert bench.drive.velocity == 1_320_000  # 5 turns of the screw a second, 22 of the motor, in milli-rpm


def test_an_axis_mounted_the_other_way_round_turns_its_motor_backwards(benches):
    bench = benches(Axis(direction=-1, low=0.0)).ready()
    bench.axis.command(0.010)
    until(lambda: bench.ear.samples[-1].position > 0.0)
    assert bench.ear.samples[-1].speed > 0.0
    assert bench.drive.velocity == -1_320_000
    assert bench.axis.limits()["low"] == pytest.approx(0.0)
    assert bench.axis.limits()["high"] == pytest.approx(0.149, rel=1e-6)


def test_what_the_drive_keeps_is_told_as_limits(bench, ready):
    bench.drive.node.set_data(0x6085, 0, (264_000).to_bytes(4, "little"))
    limits = bench.axis.limits()
    assert limits["quick_stop"] == pytest.approx(2.0)
    assert limits["speed"] == pytest.approx(0.0381, rel=1e-6)
    assert limits["acceleration"] == pytest.approx(0.1, rel=1e-4)


@pytest.mark.parametrize(
    ("drive", "found"),
    [
        ({"values": {(0x1018, 1): 0x9A}}, r"0x1018:01 \(vendor\) is 0x0000009A, expected 0x000000FB"),
        ({"values": {(0x1000, 0): 0x00040192}}, r"0x1000:00 \(device type\) is 0x00040192, expected 0x00020192"),
        ({"values": {(0x3003, 1): 3}}, r"gear of 3/5 .* gear = 4.4"),
        ({"values": {(0x3003, 2): 0}}, r"gear of 22/0 "),
        ({"values": {(0x3010, 1): 500}}, r"500 pulses .* pulses = 1024"),
    ],
)
def test_another_drive_than_the_settings_describe_is_refused_by_what_was_found(benches, drive, found):
    bench = benches(**drive)
    with pytest.raises(RigError, match=found):
        bench.axis.open(bench.ear)
    assert set(bench.drive.controlwords) <= {0}


def test_a_node_that_does_not_answer_is_named_with_what_to_look_at(bench):
    bench.drive.mute = True
    with pytest.raises(RigError, match=r"node 1 does not answer on virtual .* terminated"):
        bench.axis.open(bench.ear)
    bench.drive.mute = False
    bench.axis.open(bench.ear)  # once it is there


def test_a_drive_that_is_still_booting_is_waited_for(bench):
    bench.drive.mute = True

    def boot() -> None:
        bench.drive.mute = False

    booting = threading.Timer(0.7, boot)
    booting.start()
    bench.axis.open(bench.ear)
    booting.join()


def test_an_object_that_the_drive_refuses_is_named_with_the_reason(bench):
    bench.drive.refused[0x6085, 0] = 0x06090031
    with pytest.raises(RigError, match=r"0x6085:00 \(quick stop deceleration\).*Value of parameter written too high"):
        bench.axis.open(bench.ear)


def test_an_object_that_the_drive_does_not_keep_is_named(bench):
    bench.drive.kept[0x605A, 0] = 2
    with pytest.raises(RigError, match=r"keeps 2 .*0x605A:00 \(quick stop option\), where 6"):
        bench.axis.open(bench.ear)


@pytest.mark.parametrize(("code", "steps"), [(0x00B44700, 1), (0xFFB44700, 10)])
def test_a_drive_without_milli_rpm_is_told_speeds_in_what_it_counts(bench, code, steps):
    bench.drive.refused[0x60A9, 0], bench.drive.kept[0x60A9, 0] = 0x06090030, code
    bench.ready().axis.command(0.010)
    until(lambda: bench.drive.velocity != 0)
    assert bench.axis.units.steps == steps
    assert bench.drive.velocity == 1320 * steps


def test_a_drive_that_counts_in_another_unit_than_revolutions_is_refused(bench):
    bench.drive.kept[0x60A9, 0] = 0x00010300  # metres a second
    with pytest.raises(RigError, match="not a revolution a minute"):
        bench.axis.open(bench.ear)


def test_a_lost_drive_leaves_every_question_with_an_error_in_time(bench, ready):
    bench.drive.die()
    time.sleep(0.1)
    samples, beats = len(bench.ear.samples), len(bench.ear.heartbeats)
    before = time.monotonic()
    for question in (bench.axis.enable, bench.axis.disable, bench.axis.clear, bench.axis.limits):
        with pytest.raises(RigError):
            question()
    bench.axis.close()
    assert time.monotonic() - before < 15.0
    assert (samples, beats) == (len(bench.ear.samples), len(bench.ear.heartbeats))


def test_a_drive_that_does_not_power_on_is_told_by_its_state(bench, opened):
    bench.drive.never = 0x27
    with pytest.raises(RigError, match=r'does not leave "switched on" within .*safe torque off'):
        bench.axis.enable()


@pytest.mark.parametrize("speed", [math.nan, math.inf, 0.0382, -1.0, None, "fast"])
def test_a_speed_that_is_none_never_reaches_the_bus(bench, ready, speed):
    sent = len(bench.drive.controlwords)
    with pytest.raises((TypeError, ValueError), match="speed"):
        bench.axis.command(speed)
    assert len(bench.drive.controlwords) == sent


def test_it_is_not_commanded_before_it_is_enabled(bench):
    with pytest.raises(RigError, match="before it is open"):
        bench.axis.command(0.01)
    bench.axis.open(bench.ear)
    with pytest.raises(RigError, match="not enabled"):
        bench.axis.command(0.01)
    assert 0x0F not in bench.drive.controlwords


def test_opening_twice_is_refused(bench, opened):
    with pytest.raises(RigError, match="open already"):
        bench.axis.open(bench.ear)
