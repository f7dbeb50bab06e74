"""What a learned policy is fed: finite and bounded, the same for one cut as for many, and right about the tip."""

from __future__ import annotations

import ast
import inspect
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from observed import observed
from whole_cut import CRUISE, INCLINED, UPRIGHT, cut, make

from cutenv.agents.policy import ConstantFeed, Features, ProbeAndCreep, RandomAction, features
from cutenv.agents.policy.features import feature_count
from cutenv.agents.policy.tip_estimate import CUT_ESTIMATE, CUT_MEMORY
from cutenv.task.observation import CLIP, COMPONENTS, to_action

N = len(COMPONENTS)
PROBED, TO_TARGET, STIFFNESS = N + 5, N + 6, N + 9  # numbers of features


def observations(seed: int, policy=None, **keywords) -> np.ndarray:
    """What was seen in a whole cut, shape (decisions, 12)."""
    return cut(make(**keywords), policy or ProbeAndCreep(), seed).observations


def all_features(seen: np.ndarray, **keywords) -> np.ndarray:
    extract = Features(**{"history": 6, **keywords})
    return np.array([extract(observation) for observation in seen])


@pytest.mark.parametrize("history", [0, 1, 6, 20])
def test_there_are_as_many_as_it_says(history):
    extract = Features(history=history)
    assert extract(observed()).shape == (extract.size,) == (feature_count(history),) == (N + 21 + 5 * history,)
    assert extract(observed()).dtype == np.float32


SEEN = st.lists(
    st.lists(st.floats(-CLIP, CLIP, width=32), min_size=N, max_size=N).map(np.float32), min_size=1, max_size=12
)


@given(SEEN)
def test_they_are_finite_and_bounded_whatever_is_observed(seen):
    found = all_features(seen)
    assert np.isfinite(found).all()
    assert np.abs(found).max() <= CLIP


@pytest.mark.parametrize("policy", [RandomAction(), ProbeAndCreep(), ConstantFeed(speed=0.02, angle=INCLINED)])
def test_they_are_of_order_one_in_a_cut(policy):
    found = np.concatenate([all_features(observations(seed, policy, deadline_s=15.0)) for seed in range(3)])
    assert np.isfinite(found).all()
    assert np.abs(found).max() <= CLIP
    assert np.mean(np.abs(found) < 3.0) > 0.9


def test_they_begin_with_the_observation_itself():
    seen = observations(0)
    np.testing.assert_array_equal(all_features(seen)[:, :N], seen)


def test_history_tells_the_decisions_before_and_how_far_ago_they_were():
    seen = observations(0)
    found = all_features(seen, history=3)[:, N + 21 :].reshape(len(seen), 3, 5)
    for back in (1, 2, 3):
        np.testing.assert_array_equal(found[back:, back - 1, :3], seen[:-back, 1:4])
        np.testing.assert_array_equal(found[back:, back - 1, 4], seen[:-back, 6])
        moved = (seen[back:, 4] - seen[:-back, 4]) * 10.0  # a tenth of a metre, told in centimetres
        np.testing.assert_allclose(found[back:, back - 1, 3], moved, atol=1e-5)
    assert not found[0][:, [0, 1, 2, 4]].any(), "before the first decision there is none"


def tips_found(control_hz: int, seeds: range, **keywords: float) -> list[tuple[float, float]]:
    """The tip by the features and the true one [m], after 75 mm of cutting and 0.9 s or more of drawing back."""
    found = []
    for seed in seeds:
        env = make(control_hz=control_hz, target_length=0.08, **keywords)
        extract = Features()
        observation, info = env.reset(seed=seed)
        done = extract(observation)
        ended = False
        while info["truth"]["blade_m"] < 0.075 and not ended:
            observation, _, ended, _, info = env.step(to_action(CRUISE, INCLINED))
            done = extract(observation)
        assert not done[PROBED]
        while info["truth"]["blade_m"] > info["truth"]["tip_m"] - 0.003 and not ended:
            observation, _, ended, _, info = env.step(to_action(-0.01, UPRIGHT))
            done = extract(observation)
        if done[PROBED]:
            found.append((0.08 - 0.01 * float(done[TO_TARGET]), info["truth"]["tip_m"]))
    return found


def check_tips(found: list[tuple[float, float]], seeds: range) -> None:
    assert len(found) >= 0.9 * len(seeds)
    assert max(abs(tip - true) for tip, true in found) < 0.8e-3


@pytest.mark.parametrize("control_hz", [10, 50])
def test_drawing_back_finds_the_tip(control_hz):
    check_tips(tips_found(control_hz, range(20)), range(20))


def test_going_forward_finds_no_tip_but_estimates_one():
    seen = observations(0, ConstantFeed(speed=CRUISE, angle=INCLINED), specimen_class="uniform")
    forward = all_features(seen)[seen[:, 5] > 0.0]
    assert not forward[:, PROBED].any()
    assert not forward[:, STIFFNESS].any()


def test_the_stiffness_that_was_felt_is_told_by_its_logarithm():
    ratios = []
    for seed in range(8):
        env = make(specimen_class="liver", target_length=0.08)
        seen = cut(env, ProbeAndCreep(), seed).observations
        true = env.unwrapped.specimen.modulus[150] / env.unwrapped.specimen.tissue.intercept_90
        ratios.append((all_features(seen)[-1, STIFFNESS], np.log(true)))
    told, true = np.transpose(ratios)
    assert np.corrcoef(told, true)[0, 1] > 0.9


def test_nothing_hidden_reaches_them():
    """They are made of observations, and the module knows no plant, no law and no environment."""
    assert list(inspect.signature(Features.__call__).parameters) == ["self", "observations", "cuts"]
    tree = ast.parse(Path(features.__file__).read_text(encoding="utf-8"))
    rooms = {node.module for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) and node.module}
    hidden = ("cutenv.envs", "cutenv.sim.plant", "cutenv.sim.cutting", "cutenv.task.episode")
    assert not [room for room in rooms if room.startswith(hidden)]
    assert not {"true_force", "elastic_force", "jump"} & {*CUT_MEMORY.names, *CUT_ESTIMATE.names}
