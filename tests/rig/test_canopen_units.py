"""Between a drive's integers and metres: there and back, and what is refused."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cutenv.rig.config.axes import Axis
from cutenv.rig.devices.canopen.units import AxisUnits

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
    """Of an axis that can be counted, None of another."""
    try:
        return AxisUnits(axis=axis, steps=steps)
    except ValueError:
        return None


@given(AXES, st.floats(0.0, 1.0))
def test_a_position_comes_back_to_half_an_increment(axis, share):
    if (found := units(axis)) is not None:
        position = axis.low + share * (axis.high - axis.low)
        increment = abs(found.position(1))
        assert abs(found.position(found.increments(position)) - position) <= 0.5000001 * increment
        assert found.increments(found.position(12345)) == 12345


@given(AXES, st.floats(-1.0, 1.0))
def test_a_speed_comes_back_to_half_a_step(axis, share):
    if (found := units(axis)) is not None:
        speed = share * axis.speed
        assert abs(found.speed(found.velocity(speed)) - speed) <= 0.5000001 * found.speed_step
        assert found.velocity(-speed) == -found.velocity(speed)


@given(AXES, st.floats(0.01, 10.0))
def test_an_acceleration_comes_back_to_half_an_rpm_a_second(axis, acceleration):
    if (found := units(axis)) is not None and found.ramp(acceleration) > 1:
        step = found.acceleration(1)
        assert abs(found.acceleration(found.ramp(acceleration)) - acceleration) <= 0.5000001 * step


@given(AXES)
def test_motion_away_from_the_clamp_counts_in_the_direction_of_the_settings(axis):
    if (found := units(axis)) is not None:
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


@pytest.mark.parametrize("speed", [math.nan, -math.inf, 0.04, None])
def test_a_speed_beyond_the_axis_or_none_is_refused(speed):
    with pytest.raises((TypeError, ValueError), match="speed"):
        AxisUnits(axis=Axis(), steps=1000).velocity(speed)
