"""The emulated motor moves the blade as the simulated drive does, with mechanics that the simulated one lacks."""

from __future__ import annotations

import numpy as np
import pytest

from cutenv.cutting.drive import PDRig, Rig, advance_in_air, lag_gain
from cutenv.cutting.dtypes import TICK, new_state
from cutenv.rig.emulator.assembly import BLADE, HINGE
from cutenv.rig.emulator.motor import (
    MODE_RAMP,
    MODE_VELOCITY,
    Mechanics,
    force_per_ampere,
    hinge,
    motor_record,
    turn_motor,
)

SPEEDS = [0.01, 0.0254, -0.01]


def emulated(mechanics=None, *, axis=BLADE, position=0.05):
    motors = motor_record(axis, mechanics or Mechanics(), position=position, margin=0.003)
    motors["mode"] = MODE_VELOCITY
    motors["acceleration"] = motors["deceleration"] = axis.acceleration
    motors["ramp"], motors["fastest"] = axis.quick_stop, axis.speed
    motors["strongest"] = axis.current_limit * force_per_ampere(axis, mechanics or Mechanics())
    return motors


def led(motors, targets, load=0.0, field="carriage"):
    """What ``field`` was after each millisecond under ``targets``."""
    found = np.empty(len(targets))
    for i, target in enumerate(targets):
        motors["target"] = target
        turn_motor(motors, load)
        found[i] = motors[field][0]
    return found


def simulated(targets, position=0.05, drive=None):
    drive, state = (drive or Rig()).records(travel=0.149)[0], new_state(1, np.pi / 2)[0]
    state.hand = state.blade = position
    positions = np.empty(len(targets))
    for i, target in enumerate(targets):
        advance_in_air(state, drive, lag_gain(drive, TICK), target, TICK)
        positions[i] = state.blade
    return positions


def step_and_stop(speed):
    return np.concatenate([np.full(1500, speed), np.zeros(1000)])


@pytest.mark.parametrize("load", [0.0, -15.0])
@pytest.mark.parametrize("speed", SPEEDS)
def test_a_step_and_a_stop_follow_the_simulated_drive_within_a_tenth_of_a_millimetre(speed, load):
    targets = step_and_stop(speed)
    assert led(emulated(), targets, load) == pytest.approx(simulated(targets), abs=0.1e-3)


def pd_mechanics(drive, **changes):
    return Mechanics(proportional_gain=drive.proportional_gain, derivative_gain=drive.derivative_gain, **changes)


@pytest.mark.parametrize("load", [0.0, -15.0])
@pytest.mark.parametrize("drive", [PDRig(), PDRig(proportional_gain=2e5, derivative_gain=5e3)])
@pytest.mark.parametrize("speed", SPEEDS)
def test_pd_control_follows_the_simulated_drive_within_what_friction_and_load_shift(speed, drive, load):
    targets = step_and_stop(speed)
    moved = led(emulated(pd_mechanics(drive)), targets, load)
    shift = (22.0 + abs(load)) / drive.proportional_gain  # friction of motor and guides
    assert np.abs(moved - simulated(targets, drive=drive)).max() < 0.05e-3 + 1.2 * shift


def test_under_pd_control_a_load_shifts_the_blade_by_its_force_over_the_gain():
    drive, still = PDRig(proportional_gain=1e5, derivative_gain=8e3), np.zeros(3000)
    mechanics = pd_mechanics(drive, friction=0.0, carriage_friction=0.0, backlash=0.0)
    moved = led(emulated(mechanics), still, -15.0, field="position")
    assert moved[-1] - 0.05 == pytest.approx(-15.0 / 1e5, rel=0.01)
    held = led(emulated(Mechanics(friction=0.0, carriage_friction=0.0, backlash=0.0)), still, -15.0, field="position")
    assert held[-1] - 0.05 == pytest.approx(0.0, abs=2e-6)  # the velocity loop's integral brings it back


def test_a_derivative_gain_alone_is_refused():
    with pytest.raises(ValueError, match="derivative_gain = 5 is of PD control, and proportional_gain is 0"):
        Mechanics(derivative_gain=5.0)


def test_another_lag_would_be_noticed():
    targets = step_and_stop(0.0254)
    off = np.abs(led(emulated(Mechanics(lag=0.060)), targets) - simulated(targets))
    assert off.max() > 0.1e-3


def test_dead_time_delays_the_motion():
    targets = step_and_stop(0.0254)
    late = led(emulated(Mechanics(dead_time=0.010)), targets)
    assert late[10:] == pytest.approx(led(emulated(), targets)[:-10], abs=1e-12)


def test_backlash_is_play_between_motor_and_carriage():
    motors = emulated(Mechanics(backlash=0.5e-3))
    led(motors, np.full(500, 0.01))
    motor, carriage = float(motors["position"][0]), float(motors["carriage"][0])
    assert motor - carriage == pytest.approx(0.25e-3, abs=0.01e-3)
    led(motors, np.full(500, -0.01))
    motor, carriage = float(motors["position"][0]), float(motors["carriage"][0])
    assert motor - carriage == pytest.approx(-0.25e-3, abs=0.01e-3)


def test_a_motor_without_power_coasts_against_friction_and_stays():
    motors = emulated()
    led(motors, np.full(800, 0.0254))
    motors["mode"] = 0
    speeds = led(motors, np.zeros(500), field="speed")
    assert np.all(np.diff(speeds) <= 0.0)
    assert speeds[-1] == 0.0
    assert led(motors, np.zeros(200), load=-10.0, field="position")[-1] == float(motors["position"][0])


def test_the_ramp_of_a_stop_knows_no_lag():
    motors = emulated()
    led(motors, np.full(800, 0.0254))
    motors["mode"] = MODE_RAMP
    demands = led(motors, np.zeros(40), field="demand")
    assert demands[9] == pytest.approx(0.0254 - 0.010, abs=2e-5)
    assert demands[-1] == 0.0


def test_the_current_limit_is_a_limit_of_force():
    motors = emulated()
    motors["strongest"] = 10.0  # less than friction
    forces = led(motors, np.full(300, 0.0254), field="force")
    assert forces.max() == 10.0
    assert float(motors["position"][0]) == 0.05


def test_a_load_beyond_the_motors_force_pushes_the_blade_back():
    motors = emulated()
    motors["strongest"] = 100.0
    positions = led(motors, np.zeros(500), load=-400.0)
    assert positions[-1] < 0.045


def test_a_blocked_motor_stands_while_its_demand_goes_on():
    motors = emulated()
    motors["blocked"] = 1
    led(motors, np.full(500, 0.01))
    assert float(motors["position"][0]) == 0.05
    assert float(motors["demand_position"][0]) > 0.053


def test_a_slipping_carriage_stands_while_the_motor_turns():
    motors = emulated()
    motors["slip"] = 1.0
    led(motors, np.full(500, 0.01))
    assert float(motors["carriage"][0]) == pytest.approx(0.05, abs=0.05e-3)
    assert float(motors["position"][0]) > 0.053


def test_the_mechanical_end_stops_motor_and_carriage():
    motors = emulated(position=0.148)
    led(motors, np.full(800, 0.0254))
    assert float(motors["carriage"][0]) == BLADE.high + 0.003


def test_the_hinge_turns_as_fast_as_it_is_told():
    motors = emulated(hinge(), axis=HINGE, position=1.0)
    speeds = led(motors, np.full(400, 1.0), field="carriage_speed")
    assert speeds[-1] == pytest.approx(1.0, rel=1e-3)
    assert speeds.max() < 1.01


def test_a_spring_too_stiff_for_its_steps_is_refused():
    with pytest.raises(ValueError, match="more mass"):
        Mechanics(stiffness=1e8)
