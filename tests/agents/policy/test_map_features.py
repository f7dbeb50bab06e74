"""Features of every task: the same for one cut as for many, right about where to go; two forces tell the tip."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import pytest

from cutenv.agents.learning.evaluation import Contestant, evaluate
from cutenv.agents.policy import Features, OneReturnStroke, ProbeAndCreep
from cutenv.agents.policy.depth_policies import DepthByTwoForces, DepthFeatures, FollowDepth
from cutenv.agents.policy.path_policies import CrackCourse, PathFeatures, SteerByForce
from cutenv.envs.depth_cut import DepthCutEnv
from cutenv.envs.vector import CutBatch
from cutenv.task.depth import DEPTH_CUT
from cutenv.task.observation import CLIP, COMPONENTS
from cutenv.task.path import PATH_CUT
from cutenv.task.registry import TASKS

N = len(COMPONENTS)
LOWER, ASIDE = 10, 1  # numbers of features of depth and of path after what is observed
DEPTH_NAMES = [one.name for one in DEPTH_CUT.all_components]
BLADE_DEPTH, WANTED, DEPTH = (DEPTH_NAMES.index(name) for name in ("blade_depth", "wanted", "depth"))


class Case(NamedTuple):
    features: Any
    script: Any
    keywords: dict[str, Any]
    names: list[str]
    felt: tuple[str, ...]
    """Beginnings of the names of what is felt."""


CASES = {
    "depth": Case(
        DepthFeatures, FollowDepth, {"control_hz": 10, "specimen_class": "mixed"}, DEPTH_NAMES, ("force", "vertical")
    ),
    "path": Case(
        PathFeatures, SteerByForce, {"control_hz": 20}, [one.name for one in PATH_CUT.all_components],
        ("force", "lateral"),
    ),
}  # fmt: skip
both = pytest.mark.parametrize("task", CASES)
EVERY = CASES | {
    "gentle": Case(Features, ProbeAndCreep, {"control_hz": 20}, [one.name for one in COMPONENTS], ("force",))
}
every = pytest.mark.parametrize("task", EVERY)


def observations(task: str, seed: int, decisions: int = 60, **keywords) -> tuple[np.ndarray, list[dict]]:
    """Observations of a script's cut, shape (decisions + 1, components), and the truth after each decision."""
    case = EVERY[task]
    env, policy = TASKS[task].single(**{**case.keywords, **keywords}), case.script()
    seen, truths, ended = [env.reset(seed=seed)[0]], [], False
    policy.reset(np.random.default_rng(0))
    while len(seen) <= decisions and not ended:
        observation, _, ended, _, info = env.step(policy(seen[-1]))
        seen.append(observation)
        truths.append(info["truth"])
    return np.array(seen), truths


def all_features(task: str, seen: np.ndarray, **keywords) -> np.ndarray:
    extract = EVERY[task].features(**{"history": 0, **keywords})
    return np.array([extract(observation) for observation in seen])


def added(found: np.ndarray) -> np.ndarray:
    """The features that the task adds."""
    return found[..., Features(history=0).size :]


@both
def test_first_come_those_of_gentle_cutting_at_the_depth_that_is_cut(task):
    seen, _ = observations(task, 0)
    along = seen[:, :N].copy()
    if task == "depth":
        assert not np.array_equal(seen[:, DEPTH], seen[:, BLADE_DEPTH])
        along[:, DEPTH] = seen[:, BLADE_DEPTH]
    extract = Features(history=3)
    expected = np.array([extract(observation) for observation in along])
    found = all_features(task, seen, history=3)
    np.testing.assert_array_equal(found[:, : expected.shape[1]], expected)
    np.testing.assert_array_equal(found[:, expected.shape[1] :][:, : seen.shape[1] - N], seen[:, N:])
    assert found.shape[1] == CASES[task].features(history=3).size


@every
def test_many_cuts_at_once_have_the_features_of_each_alone_bit_for_bit(task):
    cuts = [observations(task, seed)[0] for seed in range(3)]
    length = min(map(len, cuts))
    alone = [all_features(task, seen[:length], history=2) for seen in cuts]
    many, some = (EVERY[task].features(3, history=2) for _ in range(2))
    for moment in range(length):
        seen = np.array([own[moment] for own in cuts])
        np.testing.assert_array_equal(many(seen), [found[moment] for found in alone])
        np.testing.assert_array_equal(some(seen[[2, 0]], np.array([2, 0])), [alone[2][moment], alone[0][moment]])
    many.forget(np.array([1]))
    np.testing.assert_array_equal(many(cuts[1][:1], np.array([1]))[0], alone[1][0])


@every
def test_a_cut_that_is_forgotten_leaves_nothing(task):
    first, second = (observations(task, seed)[0] for seed in range(2))
    extract = EVERY[task].features(history=0)
    for observation in first:
        extract(observation)
    without = extract(second[0])
    extract.reset()
    np.testing.assert_array_equal([extract(observation) for observation in second], all_features(task, second))
    assert not np.array_equal(without, all_features(task, second)[0])


@both
def test_they_are_finite_and_bounded(task):
    rng = np.random.default_rng(0)
    found = all_features(task, rng.uniform(-CLIP, CLIP, (200, len(CASES[task].names))).astype(np.float32))
    assert np.isfinite(found).all()
    assert np.abs(found).max() <= CLIP


@every
def test_force_can_be_hidden(task):
    seen, _ = observations(task, 1)
    blind = seen.copy()
    blind[:, [k for k, name in enumerate(EVERY[task].names) if name.startswith(EVERY[task].felt)]] = 0.0
    np.testing.assert_array_equal(all_features(task, seen, force=False), all_features(task, blind))
    assert not np.array_equal(all_features(task, seen), all_features(task, blind))


@both
def test_what_cannot_be_is_refused(task):
    features, size = CASES[task].features, len(CASES[task].names)
    for wrong, message in (
        (lambda: features(2)(np.zeros((2, N))), rf"observations? .*shape \(2, 12\); give \(2, {size}\)"),
        (lambda: features()(np.full(size, np.nan)), r"(?s)observation.* must be finite"),
        (lambda: features(history=-1), "history"),
    ):
        with pytest.raises(ValueError, match=message):
            wrong()


def test_at_rest_the_blade_must_go_to_the_wanted_depth():
    ((seen,), _) = observations("depth", 4, decisions=0)
    lower = 0.02 * (seen[WANTED] - seen[BLADE_DEPTH]) / 0.002
    found = added(all_features("depth", seen[None])[0])[LOWER:]
    assert found[[0, 2, 4, 6, 8]] == pytest.approx(lower, abs=1e-4)  # no point but the first is passed
    assert found[10] == pytest.approx(lower, abs=1e-4)


def test_behind_a_step_the_wanted_depth_at_the_tip_is_remembered():
    """Until the tip has reached the step, the blade must not go down, though more is wanted where it stands."""
    seen = observations("depth", 2, decisions=0)[0][0]
    shown = np.tile(seen, (40, 1))
    shown[:, DEPTH_NAMES.index("position")] = np.linspace(0.0, 0.4, 40)  # 40 mm
    shown[:, DEPTH_NAMES.index("force") : DEPTH_NAMES.index("force") + 4] = 0.6  # the tip lags behind the blade
    shown[:, [BLADE_DEPTH, DEPTH]] = 0.5
    shown[:, WANTED] = 0.5
    shown[-1, WANTED] = 0.7  # 4 mm deeper
    found = added(all_features("depth", shown))[-1, LOWER:]
    assert found[0] == pytest.approx(0.0, abs=1e-4)
    assert found[10] == pytest.approx(2.0, abs=1e-4)


def test_the_reckoned_course_of_the_tip_is_near_the_true_one():
    """On lines of all kinds it tells more than that the tip is on the line."""
    reckoned, true = [], []
    for seed in range(20):
        seen, truths = observations("path", seed, decisions=90, specimen_class="uniform")
        reckoned.append(0.002 * added(all_features("path", seen)[-1])[seen.shape[1] - N + ASIDE])
        true.append(truths[-1]["aside_m"])
    assert np.corrcoef(reckoned, true)[0, 1] > 0.5


def test_a_crack_that_is_pulled_to_the_left_goes_there():
    course, one = CrackCourse(1), np.ones(1)
    for k in range(1, 11):
        course.follow(0.001 * k * one, (0.0 * one, 0.0 * one), 0.001 * k * one, (2.0 * one, 0.2 * one))
    assert course.courses["crack"][0] == pytest.approx(0.1)
    assert 0.0008 < course.courses["aside"][0] <= 0.0009


CUTS = 60


@pytest.fixture(scope="module")
def seen():
    """Lags of the tip [m] while the blade advances at 15 to 40 mm; logarithms of friction; true and estimated."""
    batch = CutBatch(CUTS, DepthCutEnv(specimen_class="mixed", control_hz=25, wanted="constant"))
    every = np.arange(CUTS)
    batch.give_seeds((4000 + every).tolist(), every, np.random.default_rng(0))
    batch.begin(every)
    script, features, along = FollowDepth(), DepthFeatures(CUTS, history=0), Features(history=0).size
    script.begin([np.random.default_rng(0)] * CUTS)
    found = {name: [] for name in ("true", "two forces", "one force")}
    for _ in range(70):
        values = features(batch.observations)
        states = batch.cuts.states
        now = (states["blade"] > 0.015) & (states["blade"] < 0.040) & (states["speed"] > 0.010)
        lag = states["blade"] - states["tip"]
        found["true"] += lag[now].tolist()
        found["two forces"] += (0.01 * values[now, along + 29]).tolist()
        found["one force"] += (0.01 * values[now, 12 + 1]).tolist()
        batch.decide(script.act(batch.observations))
    friction = np.log(batch.cuts.laws["friction_per_depth"])
    return {name: np.array(values) for name, values in found.items()}, friction, values[:, along + 31]


def error(found, name):
    """Root mean square error of a lag [m], each at most 10 mm: one cut gone wrong does not decide."""
    return np.sqrt(np.mean(np.clip(found[name] - found["true"], -0.01, 0.01) ** 2))


def test_they_tell_the_lag_of_the_tip_better_than_the_mean_tissue(seen):
    found = seen[0]
    assert len(found["true"]) > 1000
    assert error(found, "two forces") < 0.85 * error(found, "one force")


def test_they_tell_the_friction(seen):
    _, friction, told = seen
    assert np.corrcoef(friction, told)[0, 1] > 0.8


def test_a_script_that_knows_the_tip_by_them_cuts_nearer_to_the_wanted_depth():
    scripts = {"two": DepthByTwoForces(OneReturnStroke()), "one": FollowDepth()}  # the same way along the cut
    rows = evaluate(
        {name: Contestant(script) for name, script in scripts.items()}, range(4000, 4000 + CUTS),
        {"task": "depth", "wanted": "constant"}, processes=1,
    )  # fmt: skip
    two, one = (
        np.array([row["mean_error_mm"] for row in rows if row["policy"] == name]) for name in ("two", "one")
    )  # fmt: skip
    assert np.median(two - one) < 0.0
    assert two.mean() < one.mean()
