"""cutenv/FreeCut-v1: PathCut in a slab whose finite elements are solved again as the cut opens."""

from __future__ import annotations

import copy
import pickle
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import cutenv
from cutenv.agents.policy.path_policies import PATH_SCRIPTS
from cutenv.envs.free_cut import FreeCutEnv
from cutenv.envs.path_cut import PathCutEnv, to_path_action


def cut(env: PathCutEnv, seed: int = 0) -> tuple[list[Any], dict[str, Any]]:
    """Let the best script cut; return what each step returned, and the last info."""
    policy = PATH_SCRIPTS["steer by force"]()
    policy.reset(np.random.default_rng(0))
    observation, info = env.reset(seed=seed)
    steps, ended = [], False
    while not ended:
        observation, reward, ended, _, info = env.step(policy(observation))
        steps.append((observation.tobytes(), reward, env.cutting.readings["true_force"].copy(), info["truth"]["tip_m"]))
    return steps, info


def test_gymnasiums_checker_finds_nothing_and_the_id_is_registered() -> None:
    assert cutenv.__version__
    env = gymnasium.make("cutenv/FreeCut-v1", line="arc").unwrapped
    assert isinstance(env, FreeCutEnv)
    check_env(env, skip_render_check=True)
    with pytest.raises(ValueError, match="line"):
        FreeCutEnv(line="zigzag")


def test_the_same_seed_cuts_the_same_and_the_account_holds() -> None:
    (once, info), (again, _) = (cut(FreeCutEnv(line="s", target_length=0.06), seed=3) for _ in range(2))
    assert [step[:2] for step in once] == [step[:2] for step in again]
    assert abs(info["energy"]["residual"]) < 1e-12
    assert info["path"]["mean_distance_mm"] > 0.0


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))], ids=["copy", "pickle"])
def test_a_copy_in_the_middle_of_a_cut_goes_on_as_the_cut_does(copied: Any) -> None:
    env = FreeCutEnv(line="arc", target_length=0.06)
    env.reset(seed=2)
    for _ in range(100):
        env.step(to_path_action(0.012, 1.57, 0.1))
    other = copied(env)
    for _ in range(60):
        (seen, reward, *_), (again, same, *_) = (each.step(to_path_action(0.012, 1.57, 0.2)) for each in (env, other))
        assert (seen.tobytes(), reward) == (again.tobytes(), same)
    assert env.cutting.growing.model.tip == pytest.approx(other.cutting.growing.model.tip, abs=0.0)


def test_under_the_same_actions_it_cuts_nearly_as_the_table_does() -> None:
    envs = [kind(line="excision", target_length=0.08) for kind in (PathCutEnv, FreeCutEnv)]
    for env in envs:
        env.reset(seed=1)
    forces: list[list[Any]] = [[], []]
    for _ in range(200):  # a slow turn to the right, off the line
        for env, felt in zip(envs, forces, strict=True):
            env.step(to_path_action(0.01, 1.57, -0.12))
            felt.append(env.cutting.readings["true_force"][-1])
    path, free = np.array(forces)
    assert float(np.median(abs(free - path) / path)) < 0.04
    assert abs(envs[1].cutting.tip - envs[0].cutting.tip) < 0.0005
    steering, growing = envs[1].cutting.motion[0], envs[1].cutting.growing
    assert not steering["off_line"].any()  # which the table has, and the elements need not
    assert float(np.hypot(*(growing.model.tip - np.array(envs[1].cutting.tip_place)))) < 0.011  # less than two elements
    moved = envs[1].cutting.displaced(0.001)
    assert len(moved) >= 480
    assert all(np.isfinite(each).all() for each in moved)


def test_a_cut_may_be_made_to_before_its_target() -> None:
    env = FreeCutEnv(line="excision", target_length=0.08, start_before_target=0.02)
    _, info = env.reset(seed=0)
    assert info["truth"]["tip_m"] == pytest.approx(0.06)
    assert float(np.hypot(*(env.cutting.growing.model.tip - np.array(env.cutting.tip_place)))) < 0.011


def test_no_motion_gains_work() -> None:
    env, rng = FreeCutEnv(line="random", line_limit=0.03, deadline_s=6.0), np.random.default_rng(0)
    for seed in range(3):
        env.reset(seed=seed)
        ended, info = False, {}
        while not ended:
            action = rng.uniform(-1.0, 1.0, 3).astype(np.float32)
            _, _, ended, _, info = env.step(action)
            energy = info["energy"]
            assert abs(energy["residual"]) < 1e-12
            assert min(energy["work"] - energy["friction"] - energy["stored"], energy["loss"]) > -1e-12
            assert min(energy["fracture"], energy["stored"]) >= -1e-15
