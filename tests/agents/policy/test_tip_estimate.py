"""Where the tip is, if the tissue is the mean one."""

from __future__ import annotations

import numpy as np
import pytest
from observed import observed
from whole_cut import CRUISE, INCLINED, UPRIGHT, make

from cutenv.agents.policy import TipEstimate
from cutenv.agents.policy.interface import in_si
from cutenv.sim.tissue import Specimen, measured_liver
from cutenv.sim.tissue.crack_tip import ASSESSED_TIP, MeanTissue, assess_tips, believe_mean
from cutenv.sim.tissue.specimen import N_POINTS, SPACING, nominal_stiffness, nominal_tissue
from cutenv.task.observation import to_action

QUIET = {"force_noise": 0.0, "force_resolution": 0.0, "depth_noise": 0.0, "force_delay": 0.0}
LIVER = measured_liver()


def errors(
    specimen: Specimen | None, commands: list[tuple[float, float, float]], *, forgetful: bool = False
) -> np.ndarray:
    """Estimated less true tip after each decision [m]; commands: (duration [s], speed [m/s], angle [rad])."""
    env, estimate = make(specimen_class="uniform", **QUIET), TipEstimate()
    observation, info = env.reset(seed=0, options={"target_length": 0.12, "specimen": specimen})
    estimate(observation)
    found = []
    for duration, speed, angle in commands:
        for _ in range(round(50 * duration)):
            observation, *_, info = env.step(to_action(speed, angle))
            if forgetful:
                estimate.reset()
            found.append(estimate(observation) - info["truth"]["tip_m"])
    return np.array(found)


CUT = (4.0, CRUISE, UPRIGHT)


@pytest.mark.parametrize("commands", [[CUT], [(4.0, CRUISE, INCLINED)], [CUT, (0.3, -0.005, UPRIGHT)]])
def test_in_the_mean_tissue_the_tip_is_where_it_is_estimated(commands):
    assert np.abs(errors(None, commands)[25:]).max() < 0.3e-3


def test_the_depth_where_the_tip_stands_is_remembered_from_when_the_blade_passed():
    rising = [(5.0, CRUISE, UPRIGHT)]
    remembered = np.abs(errors(Specimen.mean(), rising)[40:]).max()
    assert remembered < 0.3e-3
    assert np.abs(errors(Specimen.mean(), rising, forgetful=True)[40:]).max() > 2.0 * remembered


def test_the_force_of_an_elastic_tissue_is_turned_into_its_lag():
    position, lag, depth = 0.06, 0.005, 0.015
    place = round((position - lag) / SPACING)
    nominal = nominal_tissue(LIVER)[0]
    stiffness = nominal_stiffness(nominal, place, depth)
    friction = nominal.friction_per_depth * depth
    for before, felt in ((-0.001, friction), (0.001, -friction)):  # at rest, friction holds as it did in motion
        for speed in (0.0, -10.0 * before):
            estimate = TipEstimate()
            estimate(observed(position=position + before, depth=depth))
            seen = observed(position=position, speed=speed, force=stiffness * lag + felt, depth=depth)
            assert estimate(seen) == pytest.approx(position - lag, abs=1e-5)


def test_no_force_means_that_the_tip_is_at_the_blade_and_it_is_never_before_the_clamp():
    estimate = TipEstimate()
    assert estimate(observed(position=0.05, force=-1.0)) == pytest.approx(0.05, abs=1e-6)
    estimate.reset()
    assert estimate(observed(position=0.002, force=40.0)) == 0.0


def test_reset_forgets_the_depths_of_the_last_cut():
    used = TipEstimate()
    for position in (0.0, 0.03, 0.08):
        used(observed(position=position, depth=0.003))
    used.reset()
    seen = observed(position=0.06, force=3.0, depth=0.02)
    assert used(seen) == TipEstimate()(seen)


def after_a_return_stroke(seed: int, *, control_hz: int = 50, stroke: float = 0.0025, **keywords: float):
    """Estimator and environment after a cut of 60 mm, a return stroke and 5 mm more; and the true friction [N/m]."""
    env, estimate = make(control_hz=control_hz, target_length=0.09, specimen_class="liver", **keywords), TipEstimate()
    observation, info = env.reset(seed=seed)
    friction = env.unwrapped.specimen.friction_per_depth
    turn = None
    for _ in range(15 * control_hz):
        tip, blade = estimate(observation), info["truth"]["blade_m"]
        furthest = float(estimate.memory["furthest"][0])
        if turn is None and furthest > 0.060 and furthest - blade > stroke:
            turn = furthest
        if turn is not None and blade > turn + 0.005:
            return tip, estimate, info["truth"], friction
        back = turn is None and furthest > 0.060
        observation, *_, info = env.step(to_action(-0.010 if back else CRUISE, INCLINED))
    raise AssertionError("the cut never came there")


@pytest.mark.parametrize("control_hz", [10, 50])
def test_a_return_stroke_measures_stiffness_and_friction_and_finds_the_tip_from_then_on(control_hz):
    tips, stiffnesses, frictions = [], [], []
    for seed in range(12):
        tip, estimate, truth, friction = after_a_return_stroke(seed, control_hz=control_hz)
        assert estimate.memory["probed"][0] == 1
        tips.append(tip - truth["tip_m"])
        stiffnesses.append(float(estimate.memory["stiffness_ratio"][0]))
        frictions.append(float(estimate.memory["friction_per_depth"][0]) / friction)
    assert np.std(stiffnesses) > 0.15, "livers differ"
    assert np.median(np.abs(tips)) < 0.4e-3
    assert np.median(np.abs(np.array(frictions) - 1.0)) < 0.1


def test_the_run_that_is_predicted_is_that_of_the_energy_balance():
    """F l - K l^2 / 2 = R B l, with the resistance that the force has shown so far."""
    estimate = TipEstimate()
    for position in np.linspace(0.0, 0.05, 51):  # 3 N all along 2 cm of depth: 150 N/m, friction included
        estimate.estimates(in_si(observed(position=position, speed=0.01, force=3.0, force_mean=3.0, depth=0.02))[None])
    (found,) = estimate.estimates(
        in_si(observed(position=0.05, speed=0.01, force=6.0, force_mean=6.0, depth=0.02))[None]
    )
    friction = float(estimate.memory["friction_per_depth"][0]) * 0.02
    nominal = nominal_tissue(LIVER)["toughness_per_depth"][0]
    resistance = ((3.0 - friction) / 0.02 * 0.035 + nominal * 0.005) / 0.040
    assert found["elastic"] == pytest.approx(6.0 - friction, abs=1e-6)
    assert found["resistance"] == pytest.approx(resistance, rel=1e-5)
    assert found["run"] == pytest.approx(2.0 * (6.0 - friction - 0.02 * resistance) / found["stiffness"], rel=1e-5)


def test_no_tip_is_located_before_the_clamp():
    """A force that is still elastic at the clamp, as of a blade that is turned, extrapolates to a place before it."""
    forth, back = np.arange(0.0, 0.003, 1e-4), np.arange(0.003, 1e-4, -1e-4)
    position = np.concatenate([forth, back])
    speed = np.where(np.arange(len(position)) < len(forth), 0.005, -0.005)
    depth = np.full(len(position), 0.01)
    readings = np.column_stack([position, speed, depth, 400.0 * (position + 0.002) + 0.2 * np.sign(speed)])
    memories, tips = np.zeros(1, ASSESSED_TIP), np.zeros(len(position))
    believe_mean(memories, 20.0)
    assess_tips(memories, np.zeros_like(memories), MeanTissue(np.full(N_POINTS, 400.0), N_POINTS, 20.0), readings, tips)
    assert memories["probed"][0] == 1
    assert tips.min() >= 0.0
    assert memories["located"][0] == 0.0
