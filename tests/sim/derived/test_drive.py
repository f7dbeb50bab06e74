"""What moves the blade: the rig's lag, limits and stiffness; the hand's compliance, lurch and friction."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from led_cut import INCLINED, UPRIGHT, PulledBlade, homogeneous

from cutenv.sim.cutting.drive import Hand, PDRig, Rig, advance_command, advance_in_air, lag_gain
from cutenv.sim.cutting.dtypes import STATE, TICK, LawParameters, law_records, new_state
from cutenv.sim.cutting.friction import deflected, grip
from cutenv.sim.cutting.sensor import SensorParameters
from cutenv.sim.plant import SimulatedPlant
from cutenv.sim.tissue.specimen import Specimen

SPEED = 0.01  # [m/s]
Drive = Rig | PDRig | Hand


def drive_blade(
    specimen: Specimen, commands: list[tuple[float, float, int]], drive: Drive | None = None
) -> tuple[Any, Any, list[float]]:
    """Readings, states after every tick, and residuals of the energy account under (speed, angle, ticks)."""
    plant = SimulatedPlant(specimen, drive=drive, sensor=SensorParameters(force_noise=0.0))
    readings, states, residuals = [], [], []
    for speed, angle, ticks in commands:
        for _ in range(ticks):
            readings.append(plant.advance(speed, angle, 1).copy())
            states.append(plant.states.copy())
            residuals.append(plant.energy()["residual"])
    return np.concatenate(readings), np.concatenate(states), residuals


def commanded(target: float, ticks: int, rig: Rig, *, dt: float = TICK, travel: float = 0.15) -> Any:
    """Speed of the rig's carriage after every tick [m/s]."""
    state, drive = new_state(1, UPRIGHT)[0], rig.records(travel)[0]
    speeds, share = np.empty(ticks), lag_gain(drive, dt)
    for i in range(ticks):
        advance_command(state, drive, share, target, dt)
        speeds[i] = state.hand_speed
    return speeds


def check_first_order(speeds: Any, lag: float) -> None:
    time = TICK * np.arange(1, len(speeds) + 1)
    assert speeds == pytest.approx(SPEED * (1.0 - np.exp(-time / lag)), rel=1e-9)


def test_the_rig_follows_a_command_with_the_motor_lag():
    check_first_order(commanded(SPEED, 300, Rig(acceleration=10.0)), 0.040)
    with pytest.raises(AssertionError):
        check_first_order(commanded(SPEED, 300, Rig(acceleration=10.0, motor_lag=0.045)), 0.040)


@given(st.floats(-0.0254, 0.0254), st.floats(0.05, 0.5), st.floats(0.01, 0.08))
@settings(max_examples=20)
def test_the_rig_never_exceeds_its_acceleration_and_reaches_the_commanded_speed(target, acceleration, lag):
    speeds = commanded(abs(target), 2000, Rig(acceleration=acceleration, motor_lag=lag), travel=1.0)
    assert np.abs(np.diff(speeds, prepend=0.0)).max() <= acceleration * TICK * (1.0 + 1e-9)
    assert np.all(np.diff(speeds) >= 0.0)
    assert speeds[-1] == pytest.approx(abs(target), rel=1e-6, abs=1e-12)


def test_under_the_acceleration_limit_the_speed_rises_linearly():
    speeds = commanded(0.0254, 200, Rig())
    limited = speeds < 0.0254 - 0.1 * 0.040 - 1e-4
    assert limited.sum() > 100
    assert np.diff(speeds[limited]) == pytest.approx(0.1 * TICK)


def test_the_response_does_not_depend_on_the_time_step():
    coarse, fine = (commanded(0.0254, round(0.5 / dt), Rig(), dt=dt) for dt in (1e-3, 1e-4))
    assert coarse == pytest.approx(fine[9::10], abs=2e-4 * 0.0254 + 0.1 * 1e-3 * 0.05)


def test_the_blade_turns_at_the_rotation_rate():
    readings, _, _ = drive_blade(homogeneous(), [(0.0, INCLINED, 250)])
    assert readings["angle"] == pytest.approx(UPRIGHT - UPRIGHT * readings["time"])
    readings, _, _ = drive_blade(homogeneous(), [(0.0, INCLINED, 700)])
    assert readings["angle"][-1] == INCLINED


@pytest.mark.parametrize("drive", [Rig(), PDRig(), Hand()])
def test_the_blade_stays_between_the_end_stops_and_comes_to_rest_there(drive):
    plant = SimulatedPlant(homogeneous(), drive=drive)
    back = plant.advance(-0.0254, UPRIGHT, 500).copy()
    assert np.all(back["position"] == 0.0)
    out = plant.advance(0.0254, UPRIGHT, 8000).copy()
    assert out["position"].max() <= 0.1495
    assert out["position"][-1] == pytest.approx(0.1495, abs={Rig: 0.0, PDRig: 1e-5, Hand: 0.02}[type(drive)])
    assert out["speed"][-1] == pytest.approx(0.0, abs=1e-6)
    home = plant.advance(-0.0254, UPRIGHT, 8000)
    assert home["position"].min() >= 0.0
    assert home["position"][-1] == pytest.approx(0.0, abs=1e-3)


def check_position_does_not_yield(drive: Drive) -> None:
    commands = [(SPEED, UPRIGHT, 2000), (-SPEED, UPRIGHT, 500)]
    soft, _, _ = drive_blade(homogeneous(modulus=1e3, fracture_resistance=5.0), commands, drive)
    stiff, _, _ = drive_blade(homogeneous(modulus=1e5), commands, drive)
    assert np.array_equal(soft["position"], stiff["position"])


def test_the_rig_holds_position_whatever_the_tissue():
    check_position_does_not_yield(Rig())
    with pytest.raises(AssertionError):
        check_position_does_not_yield(Hand())


def test_a_sudden_drop_of_force_makes_the_hand_lurch():
    """Within 50 ms after a run the blade is at least twice as fast as commanded."""
    readings, _, _ = drive_blade(homogeneous(), [(SPEED, UPRIGHT, 8000)], Hand())
    runs = np.flatnonzero(readings["jump"] > 1e-3)
    assert len(runs) >= 5
    assert all(readings["speed"][i : i + 50].max() > 2.0 * SPEED for i in runs)


def coasting(mass: float, friction: float, presliding: float) -> Any:
    """Places [m] of a free blade, the hand's grip as weak as it may be, that friction of so many newtons stops."""
    pulled = PulledBlade(Hand(mass=mass, coupling_stiffness=10.0, coupling_damping=0.0), 0.15)
    law = law_records([homogeneous(friction_share=0.2)], LawParameters(presliding_length=presliding))[0]
    law.friction_per_depth, depth = friction / 0.02, 0.02
    state = pulled.state
    state.blade = state.hand = 0.05
    state.speed = 0.02
    places = []
    for _ in range(1000):
        dx = pulled.step(0.0, grip(law, depth, state.bristle))
        state.bristle = deflected(law, state.bristle, dx)
        places.append(float(state.blade))
    return np.array(places)


@pytest.mark.parametrize("presliding", [1e-6, 50e-6, 1e-3])
@pytest.mark.parametrize("mass", [0.01, 0.15])
def test_friction_stops_a_free_blade_however_stiff_its_bristles_and_how_light_the_hand(mass, presliding):
    """After m v^2 / 2 f, and within the presliding length; the bristles swing it back by no more than that."""
    places = coasting(mass, 4.0, presliding)
    way = 0.5 * mass * 0.02**2 / 4.0 + 0.02 * TICK
    assert 0.05 <= places.max() <= 0.05 + way + presliding
    assert places.max() - places[-1] <= presliding
    assert np.ptp(places[-200:]) < 1e-3 * presliding


@pytest.mark.parametrize("hand", [Hand(), Hand(mass=0.05, coupling_stiffness=1500.0, coupling_damping=2.0)])
@pytest.mark.parametrize("share", [0.0, 0.2])
def test_energy_closes_for_the_hand_at_every_instant_and_equals_the_recorded_work(hand, share):
    commands = [(0.02, UPRIGHT, 2000), (-0.02, INCLINED, 1000), (0.0254, math.radians(60), 1000)]
    readings, states, residuals = drive_blade(homogeneous(friction_share=share), commands, hand)
    assert np.abs(residuals).max() <= 1e-12
    assert np.diff(states["loss"]).min() >= 0.0
    turned = np.maximum(np.diff(-1.0 / np.tan(readings["angle"])), 0.0).sum() * 0.5 * 0.02**2 * (1.0 - share) * 211.0
    x, F = np.append(0.0, readings["position"]), np.append(0.0, readings["true_force"])
    recorded = 0.5 * (F[1:] + F[:-1]) @ np.diff(x)
    assert states["work"][-1] == pytest.approx(recorded + turned, rel=0.01)


def check_hands_own_balance(hand: Hand, states: Any, work_on_tissue: float) -> None:
    """What flows through the grip is kinetic energy of the blade and work on the tissue."""
    grip = (
        hand.coupling_stiffness * (states["hand"][1:] - states["blade"][:-1])
        + hand.coupling_damping * (states["hand_speed"] - states["speed"])[1:]
    )
    through_grip = float(grip @ np.diff(states["blade"]))
    kinetic = 0.5 * hand.mass * states["speed"][-1] ** 2
    assert through_grip == pytest.approx(work_on_tissue + kinetic, rel=0.02)


def test_what_the_hand_gives_is_what_the_tissue_takes():
    hand = Hand()
    _, states, _ = drive_blade(homogeneous(), [(SPEED, UPRIGHT, 6000)], hand)
    states = np.concatenate((np.zeros(1, STATE), states)).view(np.recarray)
    check_hands_own_balance(hand, states, float(states["work"][-1]))
    with pytest.raises(AssertionError):
        check_hands_own_balance(hand, states, 1.1 * float(states["work"][-1]))


def check_later_by(ticks: int, rig: Rig) -> None:
    """With dead time the blade does the same, so many milliseconds later, whatever is commanded."""
    commands = [(SPEED, UPRIGHT, 300), (-SPEED, UPRIGHT, 200), (0.0, UPRIGHT, 200), (0.02, UPRIGHT, 100)]
    prompt, _, _ = drive_blade(homogeneous(), commands, Rig())
    late, _, _ = drive_blade(homogeneous(), commands, rig)
    assert np.all(late["position"][:ticks] == 0.0)
    assert np.array_equal(late["position"][ticks:], prompt["position"][: len(prompt) - ticks])


def test_dead_time_delays_the_motion_and_changes_nothing_else():
    check_later_by(7, Rig(dead_time=0.007))
    with pytest.raises(AssertionError):
        check_later_by(7, Rig(dead_time=0.006))


def test_the_blade_turns_back_once_the_play_is_used_up():
    play = 0.4e-3
    commands = [(SPEED, UPRIGHT, 3000), (-SPEED, UPRIGHT, 1000), (SPEED, UPRIGHT, 1000)]
    readings, states, residuals = drive_blade(homogeneous(), commands, Rig(backlash=play))
    gap = states["blade"] - states["hand"]
    assert gap.min() >= -1e-12
    assert gap.max() == pytest.approx(play, abs=1e-12)
    assert np.all(np.diff(states["blade"])[(gap[1:] > 1e-9) & (gap[1:] < play - 1e-9)] == 0.0)  # it waits in the play
    assert np.array_equal(readings["position"], states["hand"])  # the encoder does not see it
    assert np.abs(residuals).max() <= 1e-12


def test_without_play_encoder_and_blade_agree():
    readings, states, _ = drive_blade(homogeneous(), [(SPEED, UPRIGHT, 500), (-SPEED, UPRIGHT, 300)])
    assert readings["position"] == pytest.approx(states["blade"], abs=1e-15)
    assert readings["position"] == pytest.approx(states["hand"], abs=1e-12)


def check_yields_by_force_over_gain(drive: PDRig) -> None:
    """At rest in loaded tissue the blade stands back from the wanted position by the force over the gain."""
    commands = [(SPEED, UPRIGHT, 1500), (0.0, UPRIGHT, 3000)]
    readings, states, _ = drive_blade(homogeneous(friction_share=0.0), commands, drive)
    behind = float(states["hand"][-1] - states["blade"][-1])
    assert readings["true_force"][-1] > 1.0
    assert behind == pytest.approx(readings["true_force"][-1] / 75e3, rel=1e-3)


def test_under_pd_control_the_blade_yields_by_force_over_proportional_gain():
    check_yields_by_force_over_gain(PDRig(proportional_gain=75e3, derivative_gain=8e3))
    with pytest.raises(AssertionError):
        check_yields_by_force_over_gain(PDRig(proportional_gain=150e3, derivative_gain=8e3))


def test_pd_control_closes_the_energy_account():
    _, _, residuals = drive_blade(homogeneous(), [(SPEED, UPRIGHT, 4000), (-SPEED, INCLINED, 1000)], PDRig())
    assert np.abs(residuals).max() < 1e-9


def test_pd_control_in_air_is_the_second_order_system_of_its_gains():
    """Under a ramp of the wanted position the speed is the closed form of (Kd s + Kp)/(m s2 + (Kd + b) s + Kp)."""
    from scipy.signal import lsim

    drive = PDRig(proportional_gain=75e3, derivative_gain=3e3, drag=500.0, acceleration=10.0)
    records, state = drive.records(1.0)[0], new_state(1, UPRIGHT)[0]
    wanted, speeds = np.empty(1000), np.empty(1000)
    for i in range(1000):
        advance_in_air(state, records, lag_gain(records, TICK), SPEED, TICK)
        wanted[i], speeds[i] = state.hand_speed, state.speed
    system = ([3e3, 75e3], [190.0, 3.5e3, 75e3])
    _, told, _ = lsim(system, wanted, TICK * np.arange(1, 1001))
    assert np.abs(speeds - told).max() < 0.02 * SPEED
    assert speeds.max() > 1.1 * SPEED  # it overshoots: the check sees the dynamics


def test_gains_too_stiff_for_the_update_are_refused():
    with pytest.raises(ValueError, match="proportional_gain = 5e\\+07 N/m on moved_mass = 190 kg swings too fast"):
        PDRig(proportional_gain=5e7)
