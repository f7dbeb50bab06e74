"""A task that is declared in a file of its own has everything: single, batch, estimates, costs, an end, a component."""

from __future__ import annotations

import numpy as np
import pytest
from steady_cut import LIMIT, SURGE, SteadyCutEnv, SteadyCutVectorEnv

from cutenv.envs.gentle_cut import GentleCutEnv
from cutenv.task.declare import Task

FEED = np.array([0.5, 1.0], np.float32)


def cut(env, action=FEED, seed=3):
    """Observations, rewards and infos of a cut under one action."""
    observation, _ = env.reset(seed=seed)
    found, ended = [(observation, 0.0, {})], False
    while not ended:
        observation, reward, ended, _, info = env.step(action)
        found.append((observation, reward, info))
    return found


def test_its_cost_is_charged_as_it_grows_and_its_component_shows_it():
    own, plain = cut(SteadyCutEnv(specimen_class="liver")), cut(GentleCutEnv(specimen_class="liver"))
    largest = 0.0
    for (observation, reward, info), (other, gentle, _) in zip(own[1:-1], plain[1:-1], strict=False):
        np.testing.assert_array_equal(observation[:-1], other)
        grown = 0.01 * float(observation[-1]) - largest
        assert info["reward_terms"]["surge"] == pytest.approx(-0.3 * grown / 0.01, abs=1e-6)
        assert reward == pytest.approx(gentle + info["reward_terms"]["surge"], abs=1e-12)
        largest += grown
    assert largest > 0.001


def test_its_end_and_its_weight_hold():
    totals = [
        sum(info["reward_terms"]["surge"] for *_, info in cut(SteadyCutEnv(weight_surge=weight))[1:])
        for weight in (0.5, 2.0)
    ]
    assert totals[1] == pytest.approx(4.0 * totals[0])
    assert totals[0] < 0.0
    ends = set()
    for seed in range(12):
        last = cut(SteadyCutEnv(specimen_class="vascular"), np.array([1.0, 1.0], np.float32), seed)[-1]
        ends.add(last[2]["end"])
        if last[2]["end"] == "surge":
            assert 0.01 * last[0][-1] > LIMIT
    assert "surge" in ends
    with pytest.raises(ValueError, match="weight_surge"):
        SteadyCutEnv(weight_surg=1.0)


def test_a_batch_of_it_equals_single_ones():
    env = SteadyCutVectorEnv(2, specimen_class="vascular")
    observations, _ = env.reset(seed=[3, 4])
    singles = [SteadyCutEnv(specimen_class="vascular") for _ in range(2)]
    for single, seed, observation in zip(singles, (3, 4), observations, strict=True):
        np.testing.assert_array_equal(single.reset(seed=seed)[0], observation)
    for _ in range(60):
        observations, rewards, ended, *_ = env.step(np.tile(FEED, (2, 1)))
        assert not ended.any()
        for single, observation, reward in zip(singles, observations, rewards, strict=True):
            own, own_reward, *_ = single.step(FEED)
            np.testing.assert_array_equal(own, observation)
            assert own_reward == reward


def test_costs_without_a_group_of_the_info_are_refused():
    with pytest.raises(ValueError, match="shown_as"):
        Task(place="own:STEADY", environment="own/SteadyCut-v0", costs=SURGE)


def test_it_is_assessed_by_what_a_rig_sees_as_well():
    found = cut(SteadyCutEnv(specimen_class="uniform", reward_from="estimate"))
    assert found[-1][0][-1] > 0.0
    assert "surge" in found[-1][2]["reward_terms"]
