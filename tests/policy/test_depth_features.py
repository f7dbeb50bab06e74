"""Features of the depth: finite, bounded, the same for one cut as for many, and right about where the blade must go."""

from __future__ import annotations

import numpy as np
import pytest

from cutenv.envs.depth_cut import DepthCutEnv
from cutenv.policy import Features
from cutenv.policy.depth_features import DepthFeatures
from cutenv.policy.depth_scripts import FollowDepth
from cutenv.task.depth import DEPTH_CUT
from cutenv.task.observation import CLIP, COMPONENTS

N, ALL = len(COMPONENTS), len(DEPTH_CUT.all_components)
LOWER = 10  # number of the first feature of the depth, after what is observed
NAMES = [one.name for one in DEPTH_CUT.all_components]
BLADE_DEPTH, WANTED, DEPTH = (NAMES.index(name) for name in ("blade_depth", "wanted", "depth"))


def observations(seed: int, decisions: int = 60, **keywords) -> np.ndarray:
    """Observations of a script's cut, shape (decisions + 1, 22)."""
    env, policy = DepthCutEnv(specimen_class="mixed", control_hz=10, **keywords), FollowDepth()
    seen, ended = [env.reset(seed=seed)[0]], False
    policy.reset(np.random.default_rng(0))
    while len(seen) <= decisions and not ended:
        observation, _, ended, _, _ = env.step(policy(seen[-1]))
        seen.append(observation)
    return np.array(seen)


def of_depth(found: np.ndarray) -> np.ndarray:
    """The features that depth adds."""
    return found[..., Features(history=0).size :]


def all_features(seen: np.ndarray, **keywords) -> np.ndarray:
    extract = DepthFeatures(**{"history": 0, **keywords})
    return np.array([extract(observation) for observation in seen])


def test_first_come_those_of_gentle_cutting_at_the_depth_that_is_cut():
    seen = observations(0)
    assert not np.array_equal(seen[:, DEPTH], seen[:, BLADE_DEPTH])
    along = seen[:, :N].copy()
    along[:, DEPTH] = seen[:, BLADE_DEPTH]
    extract = Features(history=3)
    expected = np.array([extract(observation) for observation in along])
    found = all_features(seen, history=3)
    np.testing.assert_array_equal(found[:, : expected.shape[1]], expected)
    np.testing.assert_array_equal(found[:, expected.shape[1] :][:, : ALL - N], seen[:, N:])
    assert found.shape[1] == DepthFeatures(history=3).size


def test_many_cuts_at_once_have_the_features_of_each_alone_bit_for_bit():
    cuts = [observations(seed) for seed in range(3)]
    length = min(map(len, cuts))
    alone = [all_features(seen[:length], history=2) for seen in cuts]
    many, some = DepthFeatures(3, history=2), DepthFeatures(3, history=2)
    for moment in range(length):
        seen = np.array([own[moment] for own in cuts])
        np.testing.assert_array_equal(many(seen), [found[moment] for found in alone])
        np.testing.assert_array_equal(some(seen[[2, 0]], np.array([2, 0])), [alone[2][moment], alone[0][moment]])


def test_a_cut_that_is_forgotten_leaves_nothing():
    first, second = observations(0), observations(1)
    extract = DepthFeatures(history=0)
    for observation in first:
        extract(observation)
    without = extract(second[0])
    extract.reset()
    np.testing.assert_array_equal([extract(observation) for observation in second], all_features(second))
    assert not np.array_equal(without, all_features(second)[0])


def test_they_are_finite_and_bounded():
    rng = np.random.default_rng(0)
    found = all_features(rng.uniform(-CLIP, CLIP, (200, ALL)).astype(np.float32))
    assert np.isfinite(found).all()
    assert np.abs(found).max() <= CLIP


def test_at_rest_the_blade_must_go_to_the_wanted_depth():
    (seen,) = observations(4, decisions=0)
    lower = 0.02 * (seen[WANTED] - seen[BLADE_DEPTH]) / 0.002
    found = of_depth(all_features(seen[None])[0])[LOWER:]
    assert found[[0, 2, 4, 6, 8]] == pytest.approx(lower, abs=1e-4)  # no point but the first is passed
    assert found[10] == pytest.approx(lower, abs=1e-4)


def test_behind_a_step_the_wanted_depth_at_the_tip_is_remembered():
    """Until the tip has reached the step, the blade must not go down, though more is wanted where it stands."""
    seen = observations(2, decisions=0)[0]
    shown = np.tile(seen, (40, 1))
    shown[:, NAMES.index("position")] = np.linspace(0.0, 0.4, 40)  # 40 mm
    shown[:, NAMES.index("force") : NAMES.index("force") + 4] = 0.6  # the tip lags behind the blade
    shown[:, [BLADE_DEPTH, DEPTH]] = 0.5
    shown[:, WANTED] = 0.5
    shown[-1, WANTED] = 0.7  # 4 mm deeper
    found = of_depth(all_features(shown))[-1, LOWER:]
    assert found[0] == pytest.approx(0.0, abs=1e-4)
    assert found[10] == pytest.approx(2.0, abs=1e-4)


def test_force_can_be_hidden():
    seen = observations(1)
    blind = seen.copy()
    blind[:, [NAMES.index(name) for name in NAMES if name.startswith(("force", "vertical"))]] = 0.0
    np.testing.assert_array_equal(all_features(seen, force=False), all_features(blind))
    assert not np.array_equal(all_features(seen), all_features(blind))


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (lambda: DepthFeatures(2)(np.zeros((2, N))), r"shape \(2, 12\); give \(2, 22\)"),
        (lambda: DepthFeatures()(np.full(ALL, np.nan)), "must be finite"),
        (lambda: DepthFeatures(history=-1), "history"),
    ],
)
def test_what_cannot_be_is_refused(wrong, message):
    with pytest.raises(ValueError, match=message):
        wrong()
