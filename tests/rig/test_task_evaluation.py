"""Cuts along a wanted depth or a line on a rig beside the simulator: same task, same estimates, compared alike."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
import pytest

from cutenv.agents.policy.depth_policies import FollowDepth
from cutenv.agents.policy.path_policies import SteerByForce
from cutenv.agents.sim_to_real.measures import (
    MAP_MEASURES,
    MEASURES,
    ComparedCut,
    height_rmse,
    measures_of,
    place_rmse,
    position_rmse,
)
from cutenv.agents.sim_to_real.paired_experiment import cut_once, simulator_like
from cutenv.envs import RigCutEnv, RigDepthCutEnv, RigPathCutEnv
from cutenv.envs.depth_cut import DepthCutEnv
from cutenv.envs.path_cut import PathCutEnv
from cutenv.records.scoring import MAP_METRICS

SEED, EPISODE = 5, 1
pytestmark = pytest.mark.usefixtures("quick_return")


class Task(NamedTuple):
    """A task with a third axis: on a rig and simulated, and what is recorded and compared."""

    on_rig: Callable[[], Any]
    simulated: type[Any]
    policy: Callable[[], Any]
    other: dict[str, str]  # options of another cut of the task
    wanted: str  # metadata that say which cut is wanted
    places: set[str]
    force: str
    apart: Callable[..., float]
    closeness: float  # greatest distance between the two sides [m]
    error: str  # metric of the distance from what is wanted
    measures: Mapping[str, Any]
    measured: str


TASKS = {
    "depth": Task(
        lambda: RigDepthCutEnv(rig="fake", wanted="ramp", target_length=0.06), DepthCutEnv,
        FollowDepth, {"wanted": "step"}, "wanted_depth_m", {"height", "vertical_force"}, "vertical_force", height_rmse,
        0.5e-3, "mean_depth_error", MAP_MEASURES["depth"], "height_rmse",
    ),
    "path": Task(
        lambda: RigPathCutEnv(rig="fake", line="s", target_length=0.06), PathCutEnv,
        SteerByForce, {"line": "arc"}, "line_m", {"blade_x", "blade_y", "lateral_force"}, "lateral_force", place_rmse,
        5e-3, "mean_line_distance", MAP_MEASURES["path"], "place_rmse",
    ),
}  # fmt: skip
Cuts = tuple[ComparedCut, list[ComparedCut]]


@pytest.fixture(scope="module", params=TASKS.values(), ids=TASKS)
def task(request: pytest.FixtureRequest) -> Task:
    return request.param


@pytest.fixture(scope="module")
def cuts(task: Task) -> Cuts:
    """One cut on the rig, and two draws of noise in the simulator."""
    rig = task.on_rig()
    simulator = simulator_like(rig, target_length=0.06)
    assert type(simulator) is task.simulated
    assert not simulator.task.from_truth
    drawn = [cut_once(simulator, task.policy(), seed=SEED, episode=EPISODE, noise=noise) for noise in range(2)]
    found = cut_once(rig, task.policy(), seed=SEED, episode=EPISODE)
    if task is TASKS["depth"]:
        np.testing.assert_array_equal(simulator.cutting.whole["wanted"], rig.cutting.whole["wanted"])
    rig.close()
    return found, drawn


def test_both_sides_cut_what_the_rig_wants_and_are_near(task: Task, cuts: Cuts) -> None:
    on_rig, drawn = cuts
    for cut in drawn:
        for name in (task.wanted, "target_length_m"):
            assert cut.trace.metadata[name] == on_rig.trace.metadata[name]
        np.testing.assert_allclose(cut.trace.depth[0], on_rig.trace.depth[0], atol=1e-6)
        assert task.places <= set(cut.trace.known)
        assert task.apart(on_rig.trace, cut.trace) < task.closeness
        assert position_rmse(on_rig.trace, cut.trace) < 5e-3
        assert cut.value == pytest.approx(on_rig.value, abs=0.3)
        assert cut.card[task.error] == pytest.approx(on_rig.card[task.error], abs=0.5e-3)
    assert np.abs(getattr(on_rig.trace, task.force)).max() > 0.1


def test_a_rig_without_a_third_axis_is_compared_with_two_actions() -> None:
    assert simulator_like(RigCutEnv(rig="fake"), target_length=0.06).task.action_names == ("speed", "angle")


def test_draws_of_noise_differ_in_the_forces_alone(task: Task, cuts: Cuts) -> None:
    first, second = (cut.trace for cut in cuts[1])
    assert not np.array_equal(getattr(first, task.force)[:500], getattr(second, task.force)[:500])
    assert first.metadata[task.wanted] == second.metadata[task.wanted]


def test_the_third_axis_is_compared_where_it_is_recorded_and_only_there(task: Task, cuts: Cuts) -> None:
    on_rig, drawn = cuts
    assert set(measures_of([on_rig])) == set(MEASURES) | set(task.measures)
    assert set(measures_of([])) == set(MEASURES)
    assert 0.0 < task.measures[task.measured].value(on_rig, drawn) < task.closeness
    assert task.measures[task.error].value(on_rig, drawn) == on_rig.card[task.error]


def test_what_no_rig_sees_is_not_compared() -> None:
    assert set(MAP_METRICS["depth"]) - set(MAP_MEASURES["depth"]) == {"layer_area", "layer_depth"}
    assert set(MAP_METRICS["path"]) < set(MAP_MEASURES["path"])


def test_estimates_are_not_the_truth_of_the_simulator(task: Task) -> None:
    estimated, known = (
        cut_once(
            task.simulated(**task.other, target_length=0.06, reward_from=seen),
            task.policy(),
            seed=SEED,
            episode=EPISODE,
        )
        for seen in ("estimate", "truth")
    )
    assert estimated.value != known.value
    assert estimated.value == pytest.approx(known.value, abs=0.4)


def test_the_lateral_force_comes_late() -> None:
    keywords = {"line": "arc", "force_delay": 0.04, "lateral_noise": 0.0, "lateral_resolution": 0.0}
    felt, true = [], []
    for seen, forces in (("estimate", felt), ("truth", true)):
        env = PathCutEnv(target_length=0.06, reward_from=seen, **keywords)
        env.reset(seed=SEED)
        for _ in range(60):
            env.step(np.array([0.6, 0.0, 0.3], np.float32))
            forces.extend(env.cutting.across)
    np.testing.assert_array_equal(felt[40:], true[:-40])
    assert np.abs(true).max() > 0.03
