"""cutenv/PathCut-v1 and cutenv/DepthCut-v1: what both tasks with a third axis promise, and no trick of it pays."""

from __future__ import annotations

import copy
import functools
import math
import pickle

import gymnasium
import numpy as np
import pytest
from batches import both, run_both
from map_tasks import SPECIMENS, cut, returns

import cutenv  # noqa: F401
from cutenv.agents.policy.depth_policies import FollowDepth, HoldDepth
from cutenv.agents.policy.path_policies import BladeOnLine, SteerByForce
from cutenv.envs import gentle_cut, vector
from cutenv.envs.gentle_cut import GentleCutEnv
from cutenv.envs.vector import CutBatch
from cutenv.sim.tissue.lines import arc, half_ellipse
from cutenv.task.observation import COMPONENTS
from cutenv.task.registry import TASKS, task_of

HONEST = {"path": SteerByForce, "depth": FollowDepth}
every = pytest.mark.parametrize("task", HONEST)


@pytest.mark.parametrize(
    ("task", "keywords", "shared"),
    [
        ("path", {"line": "straight"}, {}),
        ("depth", {"wanted": "profile"}, {}),
        ("depth", {"wanted": "profile"}, {"drive": "hand", "control_hz": 100}),
    ],
)
def test_with_nothing_added_it_is_gentle_cut_to_the_last_bit(task, keywords, shared):
    gentle, other = GentleCutEnv(**shared), TASKS[task].single(**keywords, **shared)
    rng = np.random.default_rng(0)
    for episode in range(4):
        seen, info = gentle.reset(seed=3 if episode == 0 else None)
        shown, _ = other.reset(seed=3 if episode == 0 else None)
        ended = False
        while not ended:
            np.testing.assert_array_equal(shown[: len(COMPONENTS)], seen)
            action = np.array([rng.uniform(-0.3, 1.0), rng.uniform(-1.0, 1.0)], np.float32)
            seen, reward, ended, _, info = gentle.step(action)
            shown, same, too, _, found = other.step(np.append(action, np.float32(0.0)))
            assert (same, too) == (reward, ended)
            for group in ("truth", "energy", "cost_terms", "reward_terms"):
                assert {name: found[group][name] for name in info[group]} == info[group]
        assert (found["end"], found["is_success"]) == (info["end"], info["is_success"])
        assert set(found[task].values()) == {0.0}


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
    ended, _ = run_both(*both(id=TASKS[task].id, num_envs=3, deadline_s=6.0, **keywords), steps=320)
    assert ended >= 3


@every
def test_the_docstring_has_the_declared_tables(task):
    environment, declared = TASKS[task].single, TASKS[task].task
    doc = " ".join((environment.__doc__ or "").split())
    assert "{" not in doc
    for number, one in enumerate(declared.components, start=len(COMPONENTS)):
        assert f"{number} {one.name} {one.meaning} {one.unit} {round(one.scale, 4):g} 0" in doc
    for cost in declared.costs:
        assert f"{cost.name} {cost.weight:g} {cost.text}" in doc
    for keyword in environment.options_class.names:
        assert f"``{keyword}``" in doc or f" {keyword} " in doc, keyword


@every
def test_return_is_the_sum_of_the_terms_since_reset(task):
    env, rng, total, ended = TASKS[task].single(), np.random.default_rng(0), 0.0, False
    env.reset(seed=5)
    while not ended:
        action = np.array([0.6, 0.0, rng.uniform(-0.3, 0.3)], np.float32)
        _, reward, ended, _, info = env.step(action)
        total += reward
        assert sum(info["reward_terms"].values()) == pytest.approx(reward, abs=1e-12)
        assert abs(info["energy"]["residual"]) <= 1e-12 * max(info["energy"]["work"], 1e-3)
    assert tuple(info["reward_terms"]) == TASKS[task].task.all_terms
    assert sum(env.cutting.reward_totals.values()) == pytest.approx(total, abs=1e-9)


@every
@pytest.mark.parametrize("action", [[0.0, 0.0], [0.0, 0.0, math.nan], [[0.0, 0.0, 0.0]]])
def test_bad_actions_are_refused(task, action):
    env = TASKS[task].single()
    names = ", ".join(env.task.action_names)
    env.reset(seed=0)
    with pytest.raises(ValueError, match=names):
        env.step(np.array(action, np.float32))
    batch = CutBatch(1, env)
    batch.give_seeds([0], np.arange(1), np.random.default_rng())
    batch.begin(np.arange(1))
    with pytest.raises(ValueError, match="speed, angle"):
        batch.decide(np.array([action], np.float32))


@every
@pytest.mark.parametrize("duplicate", [lambda env: pickle.loads(pickle.dumps(env)), copy.deepcopy])
def test_a_copied_cut_goes_on_as_the_same_task(task, duplicate):
    """A copy of the declaration would have its kernels made again, and its formulas cannot be pickled."""
    env = TASKS[task].single()
    env.reset(seed=1)
    env.step(np.array([0.5, 1.0, 0.1], np.float32))
    twin = duplicate(env)
    assert twin.task is env.task
    assert twin.cutting.task is env.cutting.task
    assert twin.plant.motion is env.plant.motion
    for each in (env, twin):
        each.step(np.array([0.5, 1.0, -0.1], np.float32))
    assert twin.cutting.record.tobytes() == env.cutting.record.tobytes()


@every
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
    alone = TASKS[task].single()
    alone.reset(seed=0)
    asked_before = [*asked]
    alone.step(np.zeros(len(alone.task.action_names), np.float32))
    gymnasium.make_vec(TASKS[task].id, num_envs=1)
    assert asked_before == [("begin_one", declared)]  # nothing of a step: a planner is shown starts alone
    assert asked[1:] == [("step_one", declared), ("step_some", declared)]


def tricked(honest, trick):
    """Return an honest script with one trick, which changes the actions of each decision."""

    class Tricked(honest):
        def start(self, count):
            super().start(count)
            self._decided = 0

        def act(self, observations):
            actions = super().act(observations)
            trick(self._decided, observations, actions)
            self._decided += 1
            return actions

    return Tricked()


def hover(decided, observations, actions):
    actions[:, 2] = np.where(decided < 100, -1.0, 0.0)


def dip(decided, observations, actions):
    actions[:, 2] = 1.0 if decided % 2 == 0 else -1.0


def saw_down(decided, observations, actions):
    actions[:, 0] = 0.5 if decided % 20 < 12 else -0.5
    actions[:, 2] += 0.1


def lean(decided, observations, actions):
    actions[:, 1], actions[:, 2] = -1.0, np.minimum(actions[:, 2], 0.0)


def dip_at_the_end(decided, observations, actions):
    actions[:, 2] = np.where(actions[:, 0] > 0.0, np.minimum(actions[:, 2], 0.0), 1.0)


def across(decided, observations, actions):
    """Straight to the end of the line ahead, across its bends, once past the first half centimetre."""
    aside_far = observations[:, 24] * 0.005
    actions[:, 2] = np.clip(aside_far / 0.02, -1.0, 1.0)


def wait_in_the_bend(decided, observations, actions):
    bent = np.abs(observations[:, 17] * 25.0) > 8.0
    actions[:, 0] = np.where(bent & (decided % 50 < 46), 0.0, actions[:, 0])


def turn_on_the_spot(decided, observations, actions):
    if decided % 40 < 30:
        actions[:, 0], actions[:, 2] = 0.0, 1.0 if decided % 40 < 15 else -1.0


def leave(decided, observations, actions):
    beyond = observations[:, 4] * 0.1 > 0.03
    actions[:, 2] = np.where(beyond, 1.0, actions[:, 2])


def saw(decided, observations, actions):
    actions[:, 0] = 0.7 if decided % 20 < 12 else -0.7


def zigzag(decided, observations, actions):
    actions[:, 2] = 1.0 if decided % 12 < 6 else -1.0


TRICKS = {
    "depth": (hover, dip, saw_down, lean, dip_at_the_end),
    "path": (across, wait_in_the_bend, turn_on_the_spot, leave, saw, zigzag),
}


@functools.cache
def honest(task):
    """Returns of the script that tricks are tried on."""
    return returns(task, HONEST[task]())


@pytest.mark.parametrize(("task", "trick"), [(task, trick) for task in TRICKS for trick in TRICKS[task]])
def test_no_trick_of_the_third_axis_pays(task, trick):
    gained = returns(task, tricked(HONEST[task], trick)) - honest(task)
    assert gained.mean() + 1.96 * gained.std() / math.sqrt(len(gained)) < 0.0


@pytest.mark.parametrize(("task", "simple", "rounds"), [("depth", HoldDepth, 4), ("path", BladeOnLine, 2)])
def test_the_script_beats_the_simple_one_and_the_planner_beats_both(task, simple, rounds):
    gained = honest(task) - returns(task, simple())
    assert gained.mean() - 1.96 * gained.std() / math.sqrt(len(gained)) > 0.0
    seeds = list(SPECIMENS[task])[:6]
    assert returns(task, TASKS[task].planner(rounds=rounds), seeds).mean() > honest(task)[: len(seeds)].mean()


@pytest.mark.parametrize(("task", "name"), [(task, name) for task in HONEST for name in TASKS[task].scripts])
def test_scripts_cut_alone_as_in_a_batch(task, name):
    make = TASKS[task].scripts[name]
    alone = [cut(task, make(), seed)[1] for seed in (1, 2)]
    np.testing.assert_allclose(returns(task, make(), (1, 2), specimen_class="mixed"), alone, atol=1e-12)


@pytest.mark.parametrize(
    ("task", "keywords", "message"),
    [
        ("depth", {"wanted": "deep"}, "wanted"),
        ("depth", {"layer": 3}, "layer"),
        ("depth", {"drive": "foot"}, "drive must be one of 'rig', 'pd', 'hand', got 'foot'"),
        ("depth", {"reward_from": "guess"}, "reward_from"),
        ("depth", {"layer_limit": -1.0}, "layer_limit"),
        ("depth", {"surface_spread": 2.0}, "surface_spread"),
        ("depth", {"edge_length": 5.0}, "edge_length"),
        ("path", {"line": "circle"}, "line must be one of"),
        ("path", {"line": [(0.0, 0.0), (0.05, 0.01), (0.03, 0.02)]}, r"turns back at \(0.03, 0.02\) m"),
        ("path", {"line": [(0.0, 0.0), (0.01, 0.02), (0.03, 0.025)]}, r"turns too far at \(.* m"),
        ("path", {"line": [(0.0, 0.0), (0.05, 0.02), (0.1, 0.05)]}, r"leaves the slab at \(.* m. Stay within 30 mm"),
        (
            "path",
            {"line": [(0.0, 0.0), (0.03, 0.0), (0.04, 0.004), (0.05, 0.0), (0.06, 0.0), (0.1, 0.0)]},
            r"bends too far at \(.* m",
        ),
        (
            "path",
            {"line": arc(0.04)},
            r"leaves the slab at \(0.0\d*, 0.0\d*\) m, after 5\d mm.*target_length of at most 0.02",
        ),
        ("path", {"line": arc(0.04), "target_length": 0.03}, "a cut of 30 mm needs 30 mm more"),
        ("path", {"reward_from": "guess"}, "reward_from"),
        ("path", {"relaxing_share": 0.3}, "relaxing_share = 0.3"),
        ("path", {"line_limit": -1.0}, "line_limit"),
        ("path", {"crack_curvature": 1e9}, "crack_curvature"),
    ],
)
def test_bad_keywords_are_refused_by_name_and_place(task, keywords, message):
    with pytest.raises(ValueError, match=message):
        TASKS[task].single(**keywords)


@pytest.mark.parametrize(
    ("task", "typed", "meant"),
    [("depth", "weight_uncat", "weight_uncut"), ("path", "weight_offline", "weight_off_line")],
)
def test_an_unknown_keyword_is_told_that_of_the_task_which_is_nearest(task, typed, meant):
    with pytest.raises(TypeError, match=rf"unexpected keyword argument '{typed}'. Did you mean '{meant}'"):
        TASKS[task].single(**{typed: 1.0})


def test_unknown_tasks_are_refused():
    with pytest.raises(ValueError, match="task"):
        task_of({"task": "depht"})
