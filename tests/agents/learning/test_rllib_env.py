"""What an environment runner of a cluster steps is the environment of the agents, with specimens of its own."""

from __future__ import annotations

import gymnasium
import numpy as np

from cutenv.agents.learning.rllib_env import RunnerEnv
from cutenv.agents.policy import Features

SHORT = {"history": 2, "control_hz": 10, "deadline_s": 1.0, "specimen_class": "liver"}


def test_features_rewards_and_ends_are_those_of_single_environments_cut_after_cut():
    runner = RunnerEnv(3, first_seed=7, **SHORT)
    single = {name: SHORT[name] for name in ("control_hz", "deadline_s", "specimen_class")}
    envs = [gymnasium.make("cutenv/GentleCut-v1", **single) for _ in range(3)]
    features = [Features(history=2) for _ in range(3)]
    rng = np.random.default_rng(0)
    seen, _ = runner.reset(seed=999)  # RLlib's seed, which is not taken
    expected = [own(env.reset(seed=7 + n)[0]) for n, (own, env) in enumerate(zip(features, envs, strict=True))]
    begins = np.zeros(3, bool)
    cuts = 0
    for _ in range(25):
        assert (seen == expected).all()
        actions = rng.uniform(-1.5, 1.5, (3, 2)).astype(np.float32)
        seen, rewards, ended, truncated, told = runner.step(actions)
        assert not truncated.any()
        for n, env in enumerate(envs):
            if begins[n]:
                features[n].reset()
                expected[n], begins[n] = features[n](env.reset()[0]), False
                assert rewards[n] == 0.0
                continue
            observation, reward, begins[n], _, info = env.step(actions[n])
            expected[n] = features[n](observation)
            assert (rewards[n], ended[n]) == (reward, begins[n])
            if begins[n]:
                cuts += 1
                assert told["is_success"][n] == info["is_success"]
    assert cuts >= 6


def test_resets_go_on_to_specimens_not_yet_cut_as_a_resumed_training_does():
    runner = RunnerEnv(2, first_seed=7, **SHORT)
    first, second, _, fourth = (runner.reset()[0] for _ in range(4))
    assert (first != second).any()
    assert (RunnerEnv(2, first_seed=7, **SHORT).reset(seed=3)[0] == first).all()
    goes_on = RunnerEnv(2, first_seed=7, first_episode=3, **SHORT)
    assert (goes_on.reset()[0] == fourth).all()
    assert (goes_on.reset()[0] == runner.reset()[0]).all()


def test_spaces_hold_what_is_seen():
    runner = RunnerEnv(4, first_seed=0, **SHORT)
    seen, _ = runner.reset()
    assert seen in runner.observation_space
    assert runner.single_observation_space.shape == (seen.shape[1],)
    assert runner.step(runner.action_space.sample())[0] in runner.observation_space


def test_runners_have_seeds_of_their_own():
    begun = []
    for number in (0, 1, 2):
        runner = RunnerEnv(5, first_seed=100, **SHORT)
        runner.share_seeds(number)
        runner.reset()
        begun += runner._native.batch.seeds.tolist()
    assert begun == list(range(100, 115))


def test_a_runner_is_made_of_what_rllib_tells_it_and_takes_one_core(monkeypatch):
    given = []
    monkeypatch.setattr("cutenv.agents.learning.rllib_env.set_cores", given.append)
    assert RunnerEnv.of_runner(SHORT | {"first_seed": 100, "num_envs": 5}).num_envs == 5
    assert given == [1]
