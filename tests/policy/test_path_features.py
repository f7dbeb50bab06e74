"""Features of the path: finite, bounded, the same for one cut as for many, and right about where the crack goes."""

from __future__ import annotations

import numpy as np
import pytest

from cutenv.envs.path_cut import PathCutEnv
from cutenv.policy import Features
from cutenv.policy.crack_course import CrackCourse
from cutenv.policy.path_features import PathFeatures
from cutenv.policy.path_scripts import SteerByForce
from cutenv.task.observation import CLIP, COMPONENTS
from cutenv.task.path import PATH_CUT

N, ALL = len(COMPONENTS), len(PATH_CUT.all_components)
CRACK, ASIDE = 0, 1  # numbers of features of the path after what is observed


def observations(seed: int, decisions: int = 60, **keywords) -> tuple[np.ndarray, np.ndarray]:
    """Observations of a script's cut, shape (decisions + 1, 28), and the true distance of its tip to the line [m]."""
    env, policy = PathCutEnv(control_hz=20, **keywords), SteerByForce()
    seen, aside, ended = [env.reset(seed=seed)[0]], [0.0], False
    policy.reset(np.random.default_rng(0))
    while len(seen) <= decisions and not ended:
        observation, _, ended, _, info = env.step(policy(seen[-1]))
        seen.append(observation)
        aside.append(info["truth"]["aside_m"])
    return np.array(seen), np.array(aside)


def all_features(seen: np.ndarray, **keywords) -> np.ndarray:
    extract = PathFeatures(**{"history": 0, **keywords})
    return np.array([extract(observation) for observation in seen])


def test_first_come_those_of_gentle_cutting_then_what_the_path_adds():
    seen, _ = observations(0)
    extract = Features(history=3)
    expected = np.array([extract(observation) for observation in seen[:, :N]])
    found = all_features(seen, history=3)
    np.testing.assert_array_equal(found[:, : expected.shape[1]], expected)
    np.testing.assert_array_equal(found[:, expected.shape[1] :][:, : ALL - N], seen[:, N:])
    assert found.shape[1] == PathFeatures(history=3).size
    assert np.abs(found).max() <= CLIP


def test_many_cuts_at_once_have_the_features_of_each_alone_bit_for_bit():
    cuts = [observations(seed)[0] for seed in range(3)]
    length = min(map(len, cuts))
    alone = [all_features(seen[:length], history=2) for seen in cuts]
    many = PathFeatures(3, history=2)
    for moment in range(length):
        together = many(np.array([seen[moment] for seen in cuts]))
        np.testing.assert_array_equal(together, np.array([found[moment] for found in alone]))
    many.forget(np.array([1]))
    np.testing.assert_array_equal(many(cuts[1][:1], np.array([1]))[0], alone[1][0])


def test_the_reckoned_course_of_the_tip_is_near_the_true_one():
    """On lines of all kinds it tells more than that the tip is on the line."""
    reckoned, true = [], []
    for seed in range(20):
        seen, aside = observations(seed, decisions=90, specimen_class="uniform")
        first = Features(history=0).size + ALL - N
        reckoned.append(0.002 * all_features(seen)[-1, first + ASIDE])
        true.append(aside[-1])
    assert np.corrcoef(reckoned, true)[0, 1] > 0.5


def test_a_crack_that_is_pulled_to_the_left_goes_there():
    course, one = CrackCourse(1), np.ones(1)
    for k in range(1, 11):
        course.follow(0.001 * k * one, (0.0 * one, 0.0 * one), 0.001 * k * one, (2.0 * one, 0.2 * one))
    assert course.courses["crack"][0] == pytest.approx(0.1)
    assert 0.0008 < course.courses["aside"][0] <= 0.0009


def test_without_force_the_lateral_force_counts_as_zero():
    seen, _ = observations(1)
    numb = seen.copy()
    numb[:, [0, 1, 2, 3, N, N + 1, N + 2]] = 0.0
    np.testing.assert_array_equal(all_features(seen, force=False), all_features(numb))


@pytest.mark.parametrize(("shape", "value"), [((27,), 0.0), ((2, 28), 0.0), ((28,), np.nan)])
def test_bad_observations_are_refused(shape, value):
    with pytest.raises(ValueError, match="observation"):
        PathFeatures()(np.full(shape, value))
