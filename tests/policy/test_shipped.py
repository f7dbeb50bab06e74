"""The policies that come with the package load by name, fit their environment, and cut as their card says."""

from __future__ import annotations

import gymnasium
import numpy as np
import pytest

pytest.importorskip("safetensors", reason="trained policies are an extra: pip install 'cutenv[view]'")

import cutenv  # noqa: F401
from cutenv._base import resources
from cutenv.policy import SHIPPED, Network, TrainedPolicy, named_policy, save_policy, shipped
from cutenv.policy.features import feature_count


@pytest.mark.parametrize("name", SHIPPED)
def test_a_shipped_policy_is_small_and_was_trained_on_seeds_of_training_alone(name):
    card = shipped(name).card
    assert card.environment == ("cutenv/PathCut-v1" if name == "ppo-path" else "cutenv/GentleCut-v1")
    assert set(card.layers[1:-1]) == {64}
    assert max(card.training["seeds"]["training"]) < 1_000_000
    assert resources.path(f"policies/{name}/policy.safetensors").stat().st_size < 200_000


@pytest.mark.parametrize("name", SHIPPED)
def test_a_shipped_policy_finishes_a_cut_within_the_tolerance(name):
    policy = shipped(name)
    env = gymnasium.make(policy.card.environment, specimen_class="uniform", **policy.environment_arguments)
    observation, _ = env.reset(seed=3_000_000)
    policy.reset(np.random.default_rng(0))
    ended = False
    while not ended:
        observation, _, ended, _, info = env.step(policy(observation))
    assert info["is_success"], info["end"]


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


def test_a_misspelt_name_is_answered_with_the_nearest_or_with_all():
    with pytest.raises(ValueError, match="Did you mean 'ppo-free'"):
        shipped("ppo-fre")
    with pytest.raises(ValueError, match=r"'ppo-fre' is neither shipped \(ppo-f.*card\.json"):
        named_policy("ppo-fre")
