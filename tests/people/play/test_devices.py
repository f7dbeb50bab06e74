"""What mouse, wheel, stick and trigger come to."""

from __future__ import annotations

import math

import pytest

from cutenv.people.play.devices import (
    NOTCH,
    STICK_DEAD_ZONE,
    GamepadDevice,
    HandMotion,
    MouseDevice,
    ScriptedDevice,
    simple_hand,
)
from cutenv.people.play.hand_model import MAX_HAND_SPEED
from cutenv.task.depth import DESCENT_SCALE

UPRIGHT, INCLINED = math.pi / 2, math.pi / 4


def test_a_cut_begins_at_the_clamp_upright_wherever_the_mouse_was() -> None:
    mouse = MouseDevice()
    mouse.move(0.05)
    mouse.turn(-3)
    mouse.open()
    assert mouse.read() == (0.0, UPRIGHT, frozenset(), 0.0, 0.0)


def test_the_wheel_leans_toward_the_person_and_stays_between_the_limits() -> None:
    mouse = MouseDevice()
    mouse.turn(-2)
    assert mouse.read().angle == pytest.approx(UPRIGHT - 2 * NOTCH)
    mouse.turn(-100)
    assert mouse.read().angle == INCLINED
    mouse.turn(100)
    assert mouse.read().angle == UPRIGHT


def after_a_second(stick: float) -> float:
    pad = GamepadDevice()
    pad.open()
    pad.hold(stick, 0.0)
    for _ in range(999):
        pad.read()
    return pad.read().position


def test_a_full_stick_is_the_fastest_speed_and_half_of_it_is_slow() -> None:
    assert after_a_second(1.0) == pytest.approx(MAX_HAND_SPEED)
    half = (0.5 - STICK_DEAD_ZONE) / (1.0 - STICK_DEAD_ZONE)
    assert after_a_second(0.5) == pytest.approx(MAX_HAND_SPEED * half**2)


@pytest.mark.parametrize("stick", [0.0, 0.1, -0.1, -1.0])
def test_slack_of_the_stick_moves_nothing_and_nothing_goes_behind_the_clamp(stick: float) -> None:
    assert after_a_second(stick) == 0.0


@pytest.mark.parametrize(("trigger", "angle_deg"), [(0.0, 90.0), (0.5, 67.5), (1.0, 45.0)])
def test_the_trigger_leans_the_blade(trigger: float, angle_deg: float) -> None:
    pad = GamepadDevice()
    pad.hold(0.0, trigger)
    assert math.degrees(pad.read().angle) == pytest.approx(angle_deg)


@pytest.mark.parametrize(("second", "speed"), [(1.0, -DESCENT_SCALE), (-1.0, DESCENT_SCALE), (0.1, 0.0)])
def test_a_second_stick_lowers_and_raises_the_blade_as_fast_as_an_agent(second: float, speed: float) -> None:
    pad = GamepadDevice()
    pad.hold(0.0, 0.0, second)
    for _ in range(499):
        pad.read()
    assert pad.read().level == pytest.approx(0.5 * speed)
    pad.open()
    pad.hold(0.0, 0.0)
    assert pad.read().level == 0.0, "a cut begins at the level where the blade stands"


def test_axes_beyond_their_reach_are_refused() -> None:
    with pytest.raises(ValueError, match="stick"):
        GamepadDevice().hold(2.0, 0.0)
    with pytest.raises(ValueError, match="second"):
        GamepadDevice().hold(0.0, 0.0, -2.0)
    with pytest.raises(ValueError, match="trigger"):
        GamepadDevice().hold(0.0, -1.0)
    with pytest.raises(ValueError, match="distance"):
        MouseDevice().move(math.nan)


def test_a_script_is_asked_once_a_millisecond_and_anew_for_every_cut() -> None:
    device = ScriptedDevice(lambda time: HandMotion(time, UPRIGHT))
    device.open()
    assert [round(device.read().position, 6) for _ in range(3)] == [0.0, 0.001, 0.002]
    device.open()
    assert device.read().position == 0.0


def test_a_simple_hand_leans_under_way_and_is_upright_where_it_turns() -> None:
    device = simple_hand(0.07, speed=0.02)
    way = [device.read() for _ in range(12_000)]
    farthest = max(way, key=lambda stylus: stylus.position)
    assert farthest.position == pytest.approx(0.092, abs=1e-4)
    assert farthest.angle == UPRIGHT
    assert min(stylus.angle for stylus in way) == pytest.approx(math.radians(60.0))
    assert way[-1].position < 0.05
