"""``spec.max_episode_steps`` is the number of decisions after which the deadline ends a cut, and cuts none short."""

from __future__ import annotations

import gymnasium
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec

import cutenv

ENVIRONMENT = "cutenv/GentleCut-v1"
assert ENVIRONMENT in gymnasium.registry, cutenv.__name__


def steps_of_idle_cut(env: gymnasium.Env) -> tuple[int, bool, bool, str]:
    """Decisions of a cut in which nothing is done, whether it was ended or truncated, and what ended it."""
    env.reset(seed=0)
    idle, steps, ended, truncated = np.zeros(env.action_space.shape, np.float32), 0, False, False
    while not (ended or truncated):
        _, _, ended, truncated, info = env.step(idle)
        steps += 1
    return steps, ended, truncated, info.get("end", "")


@pytest.mark.parametrize(
    "options", [{}, {"control_hz": 200}, {"control_hz": 8, "deadline_s": 1.3}, {"deadline_s": 45.0}]
)
def test_a_cut_ends_by_its_deadline_at_that_decision_and_not_before(options):
    env = gymnasium.make(ENVIRONMENT, **options)
    assert steps_of_idle_cut(env) == (env.spec.max_episode_steps, True, False, "deadline")


@pytest.mark.parametrize("options", [{"deadline_s": 2.0}, {"control_hz": 100, "deadline_s": 2.0}])
def test_an_environment_made_from_its_spec_ends_at_the_same_decision(options):
    env = gymnasium.make(ENVIRONMENT, **options)
    again = gymnasium.make(EnvSpec.from_json(env.spec.to_json()))
    assert again.spec == env.spec
    steps, ended, _, end = steps_of_idle_cut(again)  # Gymnasium's TimeLimit sets truncated too, at the same decision
    assert (steps, ended, end) == (env.spec.max_episode_steps, True, "deadline")


def test_a_shorter_limit_that_is_asked_for_truncates():
    env = gymnasium.make(ENVIRONMENT, max_episode_steps=20)
    assert env.spec.max_episode_steps == 20
    assert steps_of_idle_cut(env) == (20, False, True, "")


def test_a_batch_tells_it_is_made_again_from_its_spec_and_refuses_to_be_cut_short():
    batch = gymnasium.make_vec(ENVIRONMENT, num_envs=3, control_hz=20)
    assert batch.spec.max_episode_steps == 600
    assert gymnasium.make_vec(batch.spec).spec.max_episode_steps == 600
    with pytest.raises(ValueError, match=r"max_episode_steps = 100: .* after 1500 decisions\. Give deadline_s"):
        gymnasium.make_vec(ENVIRONMENT, num_envs=2, max_episode_steps=100)
