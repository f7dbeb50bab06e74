"""Tracks: registered ids with a frozen protocol, which cut as GentleCut-v1 does with the same settings."""

from __future__ import annotations

import gymnasium
import numpy as np
import pytest
from whole_cut import ENVIRONMENT

from cutenv.envs.tracks import PROTOCOL, GentleCutRawEnv, SafeCutEnv
from cutenv.task.privileged import PRIVILEGED_FEATURES

TRACKS = [("cutenv/SafeCut-v1", {}), ("cutenv/GentleCutRaw-v1", {}), ("cutenv/GentleCutRaw-v1", {"hidden_state": True})]
HIDDEN = len(PRIVILEGED_FEATURES)


def actions(decisions: int, count: int) -> np.ndarray:
    """Return commands that mostly cut on, so that cuts end and others begin."""
    return np.random.default_rng(5).uniform((-0.2, -1.0), (1.2, 1.0), (decisions, count, 2)).astype(np.float32)


@pytest.mark.parametrize(("track", "keywords"), TRACKS)
def test_it_cuts_as_the_task_does_with_the_settings_of_the_protocol(track, keywords):
    env, plain = gymnasium.make(track, **keywords), gymnasium.make(ENVIRONMENT, **PROTOCOL)
    seen, expected = env.reset(seed=4)[0], plain.reset(seed=4)[0]
    ended = False
    for action in actions(300, 1)[:, 0]:
        assert np.array_equal(seen[:12], expected)
        assert not ended
        seen, reward, ended, _, info = env.step(action)
        expected, *rest = plain.step(action)
        assert [reward, ended, False, info] == rest
        if ended:
            break
    assert ended


def test_the_fully_observed_twin_shows_the_way_from_the_tip_to_the_target():
    env = gymnasium.make("cutenv/GentleCutRaw-v1", hidden_state=True)
    env.reset(seed=0)
    for action in actions(20, 1)[:, 0]:
        seen, _, _, _, info = env.step(action)
        truth = info["truth"]
        assert seen[-HIDDEN] == pytest.approx(100.0 * (truth["target_length_m"] - truth["tip_m"]), abs=1e-5)


@pytest.mark.parametrize(("track", "taken"), [("SafeCut", "render_mode"), ("GentleCutRaw", "hidden_state")])
def test_settings_that_the_protocol_fixes_are_refused_with_the_way_out(track, taken):
    said = rf"{track}Env.__init__\(\) got an unexpected keyword argument 'control_hz'.*{taken}.*frozen.*GentleCut-v1"
    with pytest.raises(TypeError, match=said):
        gymnasium.make(f"cutenv/{track}-v1", control_hz=50)
    with pytest.raises(TypeError, match=said):
        gymnasium.make_vec(f"cutenv/{track}-v1", num_envs=2, control_hz=50)


def test_hidden_state_is_true_or_false():
    with pytest.raises(ValueError, match="hidden_state must be one of False, True, got 'yes'"):
        gymnasium.make("cutenv/GentleCutRaw-v1", hidden_state="yes")


def test_the_constant_budget_is_that_of_the_class():
    assert gymnasium.make("cutenv/SafeCut-v1").unwrapped.cost_budget_mm == SafeCutEnv.cost_budget_mm > 0.0
    assert GentleCutRawEnv(hidden_state=True).observation_space.shape == (12 + HIDDEN,)
