"""Environments of DepthCut-v1 for Stable-Baselines3, which step in one call, cut exactly as single ones do."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("stable_baselines3", reason="the learner is an extra: pip install 'cutenv[rl]'")

from cutenv.envs.depth_cut import DepthCutEnv
from cutenv.policy.depth_features import DepthFeatures
from cutenv.sb3 import FeatureVecEnv, NativeVecEnv
from cutenv.task.depth import DEPTH_CUT
from cutenv.task.privileged import PRIVILEGED_FEATURES, privileged_names

SEEDS = (3, 8)
KEYWORDS = {"specimen_class": "mixed", "control_hz": 10, "deadline_s": 4.0}
HIDDEN = len(privileged_names(DEPTH_CUT))
AT_TIP, _, TO_LAYER, BLADE_TO_LAYER, TOUGHNESS, MODULUS, SURFACE, SO_FAR, OPENED = range(
    len(PRIVILEGED_FEATURES), HIDDEN
)


def actions(decisions: int) -> np.ndarray:
    """Mostly onward and down, so that cuts end and others begin."""
    low, high = (-0.2, -1.0, -0.4), (1.2, 1.0, 0.6)
    return np.random.default_rng(5).uniform(low, high, (decisions, len(SEEDS), 3)).astype(np.float32)


def test_they_cut_bit_for_bit_as_single_ones_do_and_name_the_ends():
    environments = FeatureVecEnv(SEEDS, history=1, hidden_state=True, task="depth", **KEYWORDS)
    singles = [DepthCutEnv(**KEYWORDS) for _ in SEEDS]
    features = [DepthFeatures(history=1) for _ in SEEDS]
    shown = environments.reset()[:, :-HIDDEN]
    for n, env in enumerate(singles):
        np.testing.assert_array_equal(shown[n], features[n](env.reset(seed=SEEDS[n])[0]))
    ends = set()
    for chosen in actions(130):
        shown, rewards, ended, infos = environments.step(chosen)
        for n, env in enumerate(singles):
            observation, reward, done, _, info = env.step(chosen[n])
            assert (np.float32(reward), done) == (rewards[n], ended[n])
            if done:
                assert infos[n]["end"] == info["end"]
                ends.add(infos[n]["end"])
                features[n].reset()
                observation = env.reset()[0]
            np.testing.assert_array_equal(shown[n, :-HIDDEN], features[n](observation))
    assert "layer" in ends


def test_the_hidden_state_is_that_of_the_cut():
    environments = NativeVecEnv(SEEDS, hidden_state=True, task="depth", **KEYWORDS)
    seen = environments.reset()
    for chosen in actions(20):
        seen = environments.step(chosen)[0]
    hidden, batch = seen[:, -HIDDEN:], environments.native.batch
    descents, depths, rows = batch.cuts.motions, batch.cuts.wholes, np.arange(len(SEEDS))
    cell = np.round(batch.cuts.states["tip"] / 0.5e-3).astype(int)
    surface = descents["surface"][rows, cell]
    floor = surface - np.maximum(descents["level"], descents["floor"][rows, cell])
    near = {"abs": 2e-2}  # the tissue responds every 10 ms
    assert hidden[:, AT_TIP] == pytest.approx((floor - depths["wanted"][rows, cell]) / 2e-3, **near)
    assert hidden[:, TO_LAYER] == pytest.approx((descents["boundary"] - floor) / 2e-3, **near)
    assert hidden[:, BLADE_TO_LAYER] == pytest.approx(
        (descents["boundary"] - surface + descents["level"]) / 2e-3, abs=1e-4
    )
    assert np.exp(hidden[:, TOUGHNESS]) == pytest.approx(descents["deep_toughness"], rel=1e-5)
    assert np.exp(hidden[:, MODULUS]) == pytest.approx(descents["deep_modulus"], rel=1e-5)
    measured = batch.cuts.nominals["depth"][rows, cell]
    assert hidden[:, SURFACE] == pytest.approx(1e3 * (measured - surface), abs=1e-5)
    errors = batch.further_scores()
    assert 1.5 * hidden[:, SO_FAR] == pytest.approx(errors["mean_error_mm"], abs=1e-4)
    assert np.maximum(hidden[:, OPENED], 0.0) == pytest.approx(errors["layer_mm"], abs=1e-4)
    assert (np.abs(hidden[:, SURFACE]) > 1e-3).any(), "the surface was measured with an error"


def test_an_unknown_task_is_refused():
    with pytest.raises(ValueError, match="task"):
        NativeVecEnv(2, task="deep")
