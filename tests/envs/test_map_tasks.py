"""cutenv/PathCut-v1 and cutenv/DepthCut-v1: what both tasks with a third axis promise, and no trick of it pays."""

from __future__ import annotations

import functools
import math

import numpy as np
import pytest
from map_tasks import SPECIMENS, cut, returns

import cutenv  # noqa: F401
from cutenv.agents.policy.depth_policies import FollowDepth, HoldDepth
from cutenv.agents.policy.path_policies import BladeOnLine, SteerByForce
from cutenv.envs.gentle_cut import GentleCutEnv
from cutenv.sim.tissue.lines import arc
from cutenv.task.observation import COMPONENTS
from cutenv.task.registry import TASKS, task_of

HONEST = {"path": SteerByForce, "depth": FollowDepth}


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
