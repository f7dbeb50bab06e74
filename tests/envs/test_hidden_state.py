"""An agent sees only what a rig can know, and a reward from estimates needs nothing else."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
from whole_cut import FASTEST, UPRIGHT, cut, legs, make

from cutenv.agents.policy import ConstantFeed
from cutenv.sim.trace import Reading
from cutenv.task.episode import Episode, Goal
from cutenv.task.observation import in_units

HIDDEN = ("true_force", "elastic_force", "tip", "jump")
GENTLE = ConstantFeed(speed=0.0127)


class Blindfold:
    """A plant whose readings hold only what a rig measures: the simulator's hidden fields are overwritten."""

    def __init__(self, plant: Any, value: float) -> None:
        self._plant, self._value = plant, value
        self.depth = plant.depth

    def __getattr__(self, name: str) -> Any:
        return getattr(self._plant, name)

    def advance(self, speed: float, angle: float, ticks: int) -> np.ndarray:
        readings = self._plant.advance(speed, angle, ticks).copy()
        for field in HIDDEN:
            readings[field] = self._value
        return readings


def as_on_a_rig(env: Any, value: float) -> Episode:
    """The same cut assessed by what a rig measures alone."""
    tissue = env.specimen.tissue
    goal = Goal(
        tissue=tissue,
        friction_per_depth=tissue.friction_share * tissue.fracture_resistance,
        target_length=env.cutting.target_length,
        deadline=env.deadline,
        ticks=env.ticks,
        weights=env.constants.weights,
        limits=env.constants.limits,
    )
    cutting = Episode(Blindfold(env.plant, value), goal)
    cutting.rest(env.start_angle)
    return cutting


def played(value: float | None, commands: np.ndarray, **keywords: Any) -> tuple[list[Any], list[Any]]:
    """Observations, and rewards with their terms and ends; hidden fields overwritten by ``value`` if not None."""
    env = make(**keywords)
    observations = [env.reset(seed=7)[0]]
    if value is not None:
        env.unwrapped.cutting = as_on_a_rig(env.unwrapped, value)
    rewards = []
    for command in commands:
        observation, reward, ended, _, info = env.step(command)
        observations.append(observation)
        rewards.append((reward, info["reward_terms"], info["cost"], info.get("end"), info.get("is_success")))
        if ended:
            break
    return observations, rewards


def recorded_commands(**keywords: Any) -> np.ndarray:
    """The actions of a whole gentle cut, from cutting to unloading."""
    observations = [make(**keywords).reset(seed=7)[0], *cut(make(**keywords), GENTLE, 7).observations]
    GENTLE.reset(np.random.default_rng(7))
    return np.array([GENTLE(observation) for observation in observations])


@pytest.mark.parametrize("value", [np.nan, -1e6, 1.0])
def test_observations_and_rewards_from_estimates_use_no_hidden_field(value):
    commands = recorded_commands(reward_from="estimate")
    seen, rewards = played(None, commands, reward_from="estimate")
    blind, blind_rewards = played(value, commands, reward_from="estimate")
    assert rewards[-1][3] == "finished"
    np.testing.assert_array_equal(seen, blind)
    same = rewards == blind_rewards  # pytest would look for the differences of two long lists for minutes
    assert same


def test_observations_are_the_same_whatever_the_reward_is_assessed_from():
    commands = recorded_commands(reward_from="truth")[:400]
    one, _ = played(None, commands, reward_from="truth")
    other, _ = played(None, commands, reward_from="estimate")
    np.testing.assert_array_equal(one, other)


def test_two_tissues_of_equal_force_and_depth_cannot_be_told_apart_while_nothing_is_felt():
    env = make(force_noise=0.0, depth_noise=0.0)
    env.reset(seed=0)
    soft = env.unwrapped.specimen
    hard = dataclasses.replace(soft, modulus=3.0 * soft.modulus, fracture_resistance=2.0 * soft.fracture_resistance)
    resting = np.tile(np.float32([0.0, 1.0]), (40, 1))
    seen = []
    for specimen in (soft, hard):
        observation, _ = env.reset(seed=0, options={"specimen": specimen})
        seen.append([observation, *(env.step(action)[0] for action in resting)])
    np.testing.assert_array_equal(*seen)


def test_the_observation_is_what_the_rig_felt_since_the_last_decision():
    env = make(specimen_class="liver")
    record = cut(env, GENTLE, 4)
    task = env.unwrapped.cutting
    for number, observation in enumerate(record.observations):
        block = record.readings[20 * number : 20 * number + 20]
        seen, last = in_units(observation), block[-1]
        expected = {
            "force": last["force"],
            "force_mean": block["force"].mean(),
            "force_min": block["force"].min(),
            "force_max": block["force"].max(),
            "position": last["position"],
            "speed": last["speed"],
            "angle": last["angle"],
            "depth": np.interp(last["position"], np.arange(301) * 0.0005, env.unwrapped.plant.depth),
            "distance": task.target_length - last["position"],
        }
        for name, value in expected.items():
            assert seen[name] == pytest.approx(value, abs=2e-6 * max(abs(value), 1.0)), name
        if number < len(record.observations) - 1:  # time stops at the end, within a decision
            assert seen["time_left"] == pytest.approx(task.deadline - last["time"], abs=1e-5)


def test_the_last_action_is_seen_as_it_was_carried_out():
    for keywords, carried in (({}, [1.0, -0.25]), ({"angle_mode": "fixed", "fixed_angle_deg": 67.5}, [1.0, 0.0])):
        env = make(**keywords)
        env.reset(seed=0)
        observation = env.step(np.float32([1.7, -0.25]))[0]
        np.testing.assert_allclose(observation[-2:], carried, atol=1e-6)


def test_the_depth_is_the_noisy_profile_of_the_lab_and_not_the_truth():
    errors = []
    for seed in range(40):
        env = make(specimen_class="liver")
        env.reset(seed=seed)
        errors.append(env.unwrapped.plant.depth - env.unwrapped.specimen.depth)
    thick = np.array(errors)[:, 60:220]
    assert np.std(thick) == pytest.approx(0.5e-3, rel=0.15)
    assert abs(np.mean(thick)) < 0.15e-3
    steps = np.diff(thick, axis=1)
    assert np.std(steps) < 0.1 * np.std(thick), "the error is smooth: it cannot be averaged away along the cut"
    env = make(depth_noise=0.0)
    env.reset(seed=0)
    np.testing.assert_array_equal(env.unwrapped.plant.depth, env.unwrapped.specimen.depth)


def test_what_is_seen_beyond_a_reading_is_known_before_the_cut():
    names = set(in_units(np.zeros(12)))
    measured = {"force", "force_mean", "force_min", "force_max", *Reading._fields} - {"time"}
    assert names - measured == {"distance", "time_left", "last_speed", "last_angle"}


def test_the_reward_from_estimates_is_near_the_truth_for_a_gentle_cut():
    commands = recorded_commands(specimen_class="uniform")
    _, truth = played(None, commands, specimen_class="uniform")
    _, estimate = played(None, commands, specimen_class="uniform", reward_from="estimate")
    sums = [{name: sum(step[1][name] for step in rewards) for name in rewards[0][1]} for rewards in (truth, estimate)]
    assert truth[-1][3] == estimate[-1][3] == "finished"
    for name, value in sums[0].items():
        assert abs(sums[1][name] - value) < (0.06 if name == "accuracy" else 0.04), name
    assert abs(sum(sums[1].values()) - sum(sums[0].values())) < 0.12


def off_in_other_livers(*parts) -> float:
    """Median distance of the estimated tip from the true one after the commands [m], in livers unlike the mean."""
    errors = []
    for seed in range(10):
        env = make(specimen_class="liver", reward_from="estimate", target_length=0.1)
        policy = legs(*parts)
        observation, info = env.reset(seed=seed)
        policy.reset(np.random.default_rng(0))
        for _ in range(round(50 * sum(duration for duration, _, _ in parts))):
            observation, _, _, _, info = env.step(policy(observation))
        errors.append(abs(env.unwrapped.cutting.tip - info["truth"]["tip_m"]))
    return float(np.median(errors))


def test_drawing_back_tells_the_estimated_tip_in_livers_unlike_the_mean():
    forward = (2.5, 0.02, UPRIGHT)
    assert off_in_other_livers(forward, (1.5, -0.01, UPRIGHT)) < 0.2e-3
    assert off_in_other_livers(forward) > 0.8e-3, "so the check can fail"


def estimated_and_true_tip(*parts) -> tuple[float, float]:
    """Where the task and where the truth have the tip after the commands, in the mean tissue, without noise."""
    quiet = {"force_noise": 0.0, "force_resolution": 0.0, "depth_noise": 0.0}
    env = make(specimen_class="uniform", reward_from="estimate", target_length=0.12, **quiet)
    policy = legs(*parts)
    observation, info = env.reset(seed=0)
    policy.reset(np.random.default_rng(0))
    for _ in range(round(50 * sum(duration for duration, _, _ in parts))):
        observation, _, _, _, info = env.step(policy(observation))
    return env.unwrapped.cutting.tip, info["truth"]["tip_m"]


CUT = (2.4, FASTEST, UPRIGHT)


@pytest.mark.parametrize("parts", [[], [(0.4, -FASTEST, UPRIGHT), (0.3, 0.0127, UPRIGHT)]])
def test_the_estimated_tip_of_a_steady_cut_is_right_and_after_a_reversal_too(parts):
    estimated, true = estimated_and_true_tip(CUT, *parts)
    assert estimated == pytest.approx(true, abs=0.5e-3)
