"""cutenv/PathCut-v1 and cutenv/DepthCut-v1: what both tasks with a third axis promise."""

from __future__ import annotations

import copy
import math
import pickle

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import cutenv  # noqa: F401
from cutenv.envs import gentle_cut, vector
from cutenv.envs.batch import CutBatch
from cutenv.envs.depth_cut import DepthCutEnv
from cutenv.envs.path_cut import PathCutEnv
from cutenv.task.depth import DEPTH_COMPONENTS, DEPTH_CUT
from cutenv.task.observation import COMPONENTS
from cutenv.task.path import PATH_COMPONENTS, PATH_CUT
from cutenv.task_quantities import DEPTH_COSTS, PATH_COSTS
from cutenv.tissue.lines import half_ellipse

TASKS = {"path": PathCutEnv, "depth": DepthCutEnv}
DECLARED = {
    "path": (PATH_COMPONENTS, PATH_COSTS, PATH_CUT.all_terms),
    "depth": (DEPTH_COMPONENTS, DEPTH_COSTS, DEPTH_CUT.all_terms),
}
both = pytest.mark.parametrize("task", TASKS)


@pytest.mark.parametrize(
    ("task", "keywords"),
    [
        ("path", {}),
        ("path", {"line": "excision", "start_before_target": 0.03}),
        ("path", {"line": half_ellipse(), "control_hz": 40}),
        ("depth", {"wanted": "mixed"}),
        ("depth", {"wanted": "profile"}),
    ],
)
def test_a_batch_is_bit_for_bit_single_cuts(task, keywords):
    name = TASKS[task].__name__.replace("Env", "-v1")
    many = gymnasium.make_vec(f"cutenv/{name}", num_envs=3, **keywords)
    singles = [gymnasium.make(f"cutenv/{name}", **keywords) for _ in range(3)]
    shown, _ = many.reset(seed=10)
    for n, single in enumerate(singles):
        np.testing.assert_array_equal(single.reset(seed=10 + n)[0], shown[n])
    rng, waits, ends = np.random.default_rng(1), np.zeros(3, bool), 0
    while ends < 6:
        actions = rng.uniform(-1.0, 1.0, (3, 3)).astype(np.float32)
        actions[:, 0] = np.abs(actions[:, 0])
        shown, rewards, ended, _, infos = many.step(actions)
        for n, single in enumerate(singles):
            if waits[n]:
                np.testing.assert_array_equal(single.reset()[0], shown[n])
                waits[n] = False
                continue
            seen, reward, over, _, info = single.step(actions[n])
            np.testing.assert_array_equal(seen, shown[n])
            assert (reward, over) == (rewards[n], ended[n])
            for group in ("truth", "energy", "reward_terms", task):
                for name, value in info[group].items():
                    assert infos[group][name][n] == value, (group, name)
            assert sum(info["reward_terms"].values()) == pytest.approx(reward, abs=1e-12)
            assert abs(info["energy"]["residual"]) <= 1e-12 * max(info["energy"]["work"], 1e-3)
            if over:
                assert infos["end"][n] == info["end"]
                waits[n], ends = True, ends + 1


@both
def test_gymnasium_accepts_it(task):
    check_env(TASKS[task](), skip_render_check=True)


@both
def test_the_docstring_has_the_declared_tables(task):
    environment, (components, costs, _) = TASKS[task], DECLARED[task]
    doc = " ".join((environment.__doc__ or "").split())
    for number, one in enumerate(components, start=len(COMPONENTS)):
        assert f"{number} {one.name} {one.meaning} {one.unit} {round(one.scale, 4):g} 0" in doc
    for cost in costs:
        assert f"{cost.name} {cost.weight:g} {cost.text}" in doc
    for keyword in environment.options_class.names:
        assert f"``{keyword}``" in doc or f" {keyword} " in doc, keyword


@both
def test_return_is_the_sum_of_the_terms_since_reset(task):
    env, rng, total, ended = TASKS[task](), np.random.default_rng(0), 0.0, False
    env.reset(seed=5)
    while not ended:
        action = np.array([0.6, 0.0, rng.uniform(-0.3, 0.3)], np.float32)
        _, reward, ended, _, info = env.step(action)
        total += reward
    assert tuple(info["reward_terms"]) == DECLARED[task][2]
    assert sum(env.cutting.reward_totals.values()) == pytest.approx(total, abs=1e-9)


@both
@pytest.mark.parametrize("action", [[0.0, 0.0], [0.0, 0.0, math.nan], [[0.0, 0.0, 0.0]]])
def test_bad_actions_are_refused(task, action):
    env = TASKS[task]()
    names = ", ".join(env.task.action_names)
    env.reset(seed=0)
    with pytest.raises(ValueError, match=names):
        env.step(np.array(action, np.float32))
    batch = CutBatch(1, env)
    batch.give_seeds([0], np.arange(1), np.random.default_rng())
    batch.begin(np.arange(1))
    with pytest.raises(ValueError, match="speed, angle"):
        batch.decide(np.array([action], np.float32))


@both
@pytest.mark.parametrize("duplicate", [lambda env: pickle.loads(pickle.dumps(env)), copy.deepcopy])
def test_a_copied_cut_goes_on_as_the_same_task(task, duplicate):
    """A copy of the declaration would have its kernels made again, and its formulas cannot be pickled."""
    env = TASKS[task]()
    env.reset(seed=1)
    env.step(np.array([0.5, 1.0, 0.1], np.float32))
    twin = duplicate(env)
    assert twin.task is env.task
    assert twin.cutting.task is env.cutting.task
    assert twin.plant.motion is env.plant.motion
    for each in (env, twin):
        each.step(np.array([0.5, 1.0, -0.1], np.float32))
    assert twin.cutting.record.tobytes() == env.cutting.record.tobytes()


@both
def test_notice_of_compiling_looks_for_the_kernels_of_the_task(task, monkeypatch):
    """It would else be printed at every start by those who use this task alone."""
    asked: list[tuple[str, str]] = []
    declared = f"cutenv.task.{task}"
    for module in (gentle_cut, vector):
        monkeypatch.setattr(
            module,
            "warn_before_first_compile",
            lambda *kernels: asked.append((kernels[0].__name__, kernels[0].__module__)),
        )
    TASKS[task]().reset(seed=0)
    gymnasium.make_vec(f"cutenv/{TASKS[task].__name__.replace('Env', '-v1')}", num_envs=1)
    assert asked == [("step_one", declared), ("step_some", declared)]
