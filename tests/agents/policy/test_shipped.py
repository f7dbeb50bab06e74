"""Policies by name: those that come with the package cut as their card says; baselines are complete, and blind."""

from __future__ import annotations

import inspect
import math
import pickle

import gymnasium
import numpy as np
import pytest
from whole_cut import make

from cutenv.agents.policy import (
    BASELINES,
    CONSTANT_FEEDS,
    NULL_POLICIES,
    ORACLE,
    SCRIPTS,
    PrivilegedPolicy,
    TipEstimate,
    feed_name,
)
from cutenv.task.observation import commanded_speed, in_units

pytest.importorskip("safetensors", reason="trained policies are an extra: pip install 'cutenv[view]'")

import cutenv  # noqa: F401
from cutenv._base import resources
from cutenv.agents.policy import SHIPPED, Network, TrainedPolicy, named_policy, save_policy, shipped
from cutenv.agents.policy.features import feature_count


@pytest.mark.parametrize("name", SHIPPED)
def test_a_shipped_policy_is_small_and_was_trained_on_seeds_of_training_alone(name):
    card = shipped(name).card
    others = {"ppo-path": "cutenv/PathCut-v1", "ppo-excision": "cutenv/Excision-v1"}
    assert card.environment == others.get(name, "cutenv/GentleCut-v1")
    assert set(card.layers[1:-1]) == {64}
    assert max(card.training["seeds"]["training"]) < 1_000_000
    assert resources.path(f"policies/{name}/policy.safetensors").stat().st_size < 200_000


@pytest.mark.parametrize("name", SHIPPED)
def test_a_shipped_policy_finishes_a_cut_within_the_tolerance(name):
    policy, ends = shipped(name), []
    env = gymnasium.make(policy.card.environment, specimen_class="uniform", **policy.environment_arguments)
    for seed in range(3_000_000, 3_000_003):  # of excisions, it misses every third
        observation, _ = env.reset(seed=seed)
        policy.reset(np.random.default_rng(0))
        ended = False
        while not ended:
            observation, _, ended, _, info = env.step(policy(observation))
        ends.append(info["end"])
        if info["is_success"]:
            return
    raise AssertionError(ends)


def test_ppo_free_is_shipped_and_turns_the_blade():
    assert "ppo-free" in SHIPPED
    assert shipped("ppo-free").environment_arguments == {"control_hz": 10, "angle_mode": "free"}
    upright = {"control_hz": 10, "angle_mode": "fixed", "fixed_angle_deg": 90.0}
    assert shipped("ppo-fixed").environment_arguments == upright
    assert len(shipped("ppo-fixed").card.training["commit"]) == 40


def test_a_policy_is_taken_by_name_or_by_folder(tmp_path):
    network = Network(((np.zeros((2, feature_count(0)), np.float32), np.zeros(2, np.float32)),))
    save_policy(
        tmp_path / "mine",
        network,
        environment="cutenv/GentleCut-v1",
        environment_arguments={},
        features={"history": 0},
        training={},
    )
    assert named_policy(tmp_path / "mine").card == TrainedPolicy.load(tmp_path / "mine").card
    assert named_policy("ppo-free").card == shipped("ppo-free").card


def test_a_misspelt_name_is_answered_with_the_nearest_three_at_most():
    with pytest.raises(ValueError, match="Did you mean 'ppo-free'"):
        shipped("ppo-fre")
    with pytest.raises(
        ValueError, match=r"neither shipped nor .*Did you mean 'ppo-free' or.*--list.*card\.json"
    ) as said:
        named_policy("ppo-fre")
    assert sum(name in str(said.value) for name in SHIPPED) <= 3


def test_the_names_are_the_grid_the_scripts_the_bound_and_the_idle():
    assert list(BASELINES) == [*CONSTANT_FEEDS, *SCRIPTS, ORACLE, *NULL_POLICIES]
    assert len(CONSTANT_FEEDS) == 7 * 4
    planned = {"fast then slow", "90-45-90", "force feedback", "planner (nominal)"}
    assert set(SCRIPTS) == planned | {"probe and creep", "return stroke"}
    assert set(NULL_POLICIES) == {"random", "nothing"}


def first_command(name: str, policy) -> tuple[float, float]:
    """Speed [cm/s] and angle [deg] of the first command in some specimen."""
    observation, _ = make().reset(seed=0)
    policy.reset(np.random.default_rng(0))
    known = in_units(np.r_[observation[:10], policy(observation)])
    return 100.0 * float(commanded_speed(known["last_speed"])), 67.5 + 22.5 * float(known["last_angle"])


@pytest.mark.parametrize("name", CONSTANT_FEEDS)
def test_a_constant_feed_is_what_its_name_says(name):
    speed, angle = CONSTANT_FEEDS[name]
    assert name == feed_name(speed, angle) == f"constant {speed:.2f} cm/s {angle} deg"
    assert first_command(name, BASELINES[name]()) == pytest.approx((speed, angle), abs=1e-5)


def test_only_the_bound_is_shown_the_hidden_state():
    sees = [name for name, policy in BASELINES.items() if isinstance(policy(), PrivilegedPolicy)]
    assert sees == [ORACLE]
    assert [name for name, policy in BASELINES.items() if hasattr(policy(), "set_state")] == [ORACLE]


def test_all_others_are_given_an_observation_and_nothing_else():
    for name, policy in BASELINES.items():
        assert list(inspect.signature(policy().reset).parameters) == ["rng"], name
        assert list(inspect.signature(type(policy()).__call__).parameters) == ["self", "observation"], name
    assert list(inspect.signature(TipEstimate.__call__).parameters) == ["self", "observation"]


@pytest.mark.parametrize("name", [name for name in BASELINES if name != ORACLE])
def test_a_baseline_that_was_pickled_acts_as_before(name):
    policy = BASELINES[name]()
    copy = pickle.loads(pickle.dumps(policy))
    env = make(specimen_class="uniform")
    seen = [env.reset(seed=0)[0], *(env.step(np.float32([0.5, 1.0]))[0] for _ in range(20))]
    for each in (policy, copy):
        each.reset(np.random.default_rng(3))
    for observation in seen:
        action = policy(observation)
        np.testing.assert_array_equal(action, copy(observation))
        assert action.shape == (2,)
        assert action.dtype == np.float32
        assert np.abs(action).max() <= 1.0


def test_the_bound_can_be_pickled_too():
    planner = pickle.loads(pickle.dumps(BASELINES[ORACLE]()))
    env = make(specimen_class="uniform")
    observation, _ = env.reset(seed=0)
    planner.reset(np.random.default_rng(0))
    planner.set_state(env.unwrapped.cutting)
    assert math.isfinite(float(np.sum(planner(observation))))
