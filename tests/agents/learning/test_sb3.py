"""Environments that step in one call cut exactly as single ones do, of every task."""

from __future__ import annotations

import gymnasium
import numpy as np
import pytest
from stable_baselines3 import PPO
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import DummyVecEnv

from cutenv.agents.learning.seeds import ENVIRONMENT
from cutenv.agents.sb3 import FeatureVecEnv, NativeVecEnv
from cutenv.sim.tissue import Specimen
from cutenv.task.depth import DEPTH_CUT
from cutenv.task.privileged import PRIVILEGED_FEATURES, privileged_names
from cutenv.task.registry import TASKS

pytest.importorskip("stable_baselines3", reason="the learner is an extra: pip install 'cutenv[rl]'")
SEEDS = (3, 8, 21)
KEYWORDS = {"specimen_class": "mixed", "control_hz": 10, "deadline_s": 4.0}


RANGES = {"gentle": ((-0.2, -1.0), (1.2, 1.0)), "depth": ((-0.2, -1.0, -0.4), (1.2, 1.0, 0.6))}


def actions(decisions: int, task: str = "gentle") -> np.ndarray:
    """Mostly onward, and down, so that cuts end and others begin."""
    low, high = RANGES[task]
    return np.random.default_rng(5).uniform(low, high, (decisions, len(SEEDS), len(low))).astype(np.float32)


@pytest.mark.parametrize(
    ("task", "keywords"),
    [("gentle", {}), ("gentle", {"angle_mode": "fixed", "fixed_angle_deg": 60.0}), ("depth", {})],
    ids=["free", "fixed", "depth"],
)
def test_they_cut_bit_for_bit_as_single_ones_do_over_episodes_with_resets(task, keywords):
    environments = FeatureVecEnv(SEEDS, history=2, hidden_state=True, task=task, **KEYWORDS, **keywords)
    singles = [TASKS[task].single(**KEYWORDS, **keywords) for _ in SEEDS]
    features = [TASKS[task].features(history=2) for _ in SEEDS]
    hidden, ends = len(TASKS[task].privileged), []
    shown = environments.reset()[:, :-hidden]
    for n, env in enumerate(singles):
        np.testing.assert_array_equal(shown[n], features[n](env.reset(seed=SEEDS[n])[0]))
    for chosen in actions(130, task):
        shown, rewards, ended, infos = environments.step(chosen)
        for n, env in enumerate(singles):
            observation, reward, done, _, info = env.step(chosen[n])
            assert (np.float32(reward), done) == (rewards[n], ended[n])
            if done:
                assert infos[n]["end"] == info["end"]
                ends.append((n, info["end"]))
                features[n].reset()
                observation = env.reset()[0]
            np.testing.assert_array_equal(shown[n, :-hidden], features[n](observation))
    assert all([n for n, _ in ends].count(n) >= 3 for n in range(len(SEEDS)))
    assert task != "depth" or "layer" in {end for _, end in ends}


def test_they_begin_with_the_episode_that_is_asked_for_and_go_on_from_it():
    environments = NativeVecEnv(SEEDS, **KEYWORDS)
    environments.first_episode = 7
    env = gymnasium.make(ENVIRONMENT, **KEYWORDS)
    assert np.array_equal(environments.reset()[1], env.reset(seed=SEEDS[1], options={"episode": 7})[0])
    for chosen in actions(130):
        seen, _, ended, _ = environments.step(chosen)
        if ended[1]:
            assert np.array_equal(seen[1], env.reset(seed=SEEDS[1], options={"episode": 8})[0])
            return
    pytest.fail("no cut ended")


def test_the_hidden_state_is_the_tip_first_of_all():
    environments = FeatureVecEnv(SEEDS, history=0, hidden_state=True, **KEYWORDS)
    seen = environments.reset()
    for chosen in actions(15):
        seen = environments.step(chosen)[0]
    cuts = environments.native.cuts
    assert seen[:, -len(PRIVILEGED_FEATURES)] == pytest.approx(
        100.0 * (cuts.tasks["target"] - cuts.states["tip"]), abs=1e-5
    )


def test_adapted_as_it_is_it_does_what_stable_baselines_own_list_of_environments_does():
    ours = NativeVecEnv(range(5, 8), **KEYWORDS)
    theirs = DummyVecEnv([lambda: Monitor(gymnasium.make(ENVIRONMENT, **KEYWORDS))] * 3)
    theirs.seed(5)
    assert np.array_equal(ours.reset(), theirs.reset())
    ended = 0
    for chosen in actions(130):
        mine, own = ours.step(chosen), theirs.step(chosen)
        for one, other in zip(mine[:3], own[:3], strict=True):
            assert np.array_equal(one, other)
        for n in np.flatnonzero(mine[2]):
            ended += 1
            assert np.array_equal(mine[3][n]["terminal_observation"], own[3][n]["terminal_observation"])
            assert mine[3][n]["is_success"] == own[3][n]["is_success"]
            assert mine[3][n]["episode"]["l"] == own[3][n]["episode"]["l"]
            assert mine[3][n]["episode"]["r"] == pytest.approx(own[3][n]["episode"]["r"], abs=1e-5)
    assert ended >= 9


def test_ppo_with_default_settings_takes_it():
    model = PPO("MlpPolicy", NativeVecEnv(range(4), **KEYWORDS), n_steps=64, batch_size=64, seed=0)
    model.learn(512)
    assert model.ep_info_buffer


def test_what_cannot_be_set_or_called_is_refused_and_says_why():
    environments = NativeVecEnv(range(2), **KEYWORDS)
    assert environments.get_attr("ticks") == [100, 100]
    with pytest.raises(NotImplementedError, match="make new environments"):
        environments.set_attr("ticks", 5)
    with pytest.raises(NotImplementedError, match="step in one"):
        environments.env_method("render")


def theirs(count: int) -> DummyVecEnv:
    """Stable-Baselines3's own list of environments."""
    return DummyVecEnv([lambda: gymnasium.make(ENVIRONMENT, **KEYWORDS)] * count)


SPECIMEN = Specimen.homogeneous(modulus=40e3, fracture_resistance=150.0, depth=0.015)


@pytest.mark.parametrize(
    "options",
    [
        {"target_length": 0.08},
        [{"target_length": 0.08}, {}, {"episode": 4}],
        {"specimen": SPECIMEN.to_json(), "target_length": 0.07},
    ],
)
def test_options_hold_for_one_reset_as_in_stable_baselines_own_list(options):
    both = NativeVecEnv(3, **KEYWORDS), theirs(3)
    seen = []
    for environments in both:
        environments.seed(0)
        environments.set_options(options)
        seen.append(environments.reset())
    np.testing.assert_array_equal(*seen)
    plain = NativeVecEnv(3, **KEYWORDS).reset()
    assert not np.array_equal(seen[0], plain)
    np.testing.assert_array_equal(both[0].reset(), plain)


def test_options_that_cannot_be_used_are_refused():
    environments = NativeVecEnv(2, **KEYWORDS)
    with pytest.raises(ValueError, match="Did you mean 'target_length'"):
        environments.set_options({"target_lenght": 0.08})
    with pytest.raises(ValueError, match="options holds 3 entries; give one for each of 2 environments"):
        environments.set_options([{}] * 3)
    environments.set_options({"target_length": 80})
    with pytest.raises(ValueError, match=r"80 mm is 0\.08"):
        environments.reset()
    np.testing.assert_array_equal(environments.reset(), NativeVecEnv(2, **KEYWORDS).reset())


def test_a_seed_is_taken_where_the_number_of_environments_was_given():
    environments, others = NativeVecEnv(3, **KEYWORDS), theirs(3)
    assert environments.seed(6) == others.seed(6) == [6, 7, 8]
    np.testing.assert_array_equal(environments.reset(), others.reset())
    assert len(set(environments.seed())) == 3
    PPO("MlpPolicy", environments, n_steps=64, batch_size=64, seed=11)
    assert environments.specimen_seeds == [11, 12, 13]


def test_seeds_given_one_by_one_are_kept_and_told():
    environments = NativeVecEnv(SEEDS, **KEYWORDS)
    start = environments.reset()
    assert environments.seed(6) == list(SEEDS)
    np.testing.assert_array_equal(environments.reset(), start)


HIDDEN = len(privileged_names(DEPTH_CUT))
AT_TIP, _, TO_LAYER, BLADE_TO_LAYER, TOUGHNESS, MODULUS, SURFACE, SO_FAR, OPENED = range(
    len(PRIVILEGED_FEATURES), HIDDEN
)


def test_the_hidden_state_is_that_of_the_cut():
    environments = NativeVecEnv(SEEDS, hidden_state=True, task="depth", **KEYWORDS)
    seen = environments.reset()
    for chosen in actions(20, "depth"):
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
