"""A map of a cut, of its depth or its path, is that of the task, and has points of its own."""

from __future__ import annotations

import check_score
import pytest

from cutenv.envs.depth_cut import DepthCutEnv
from cutenv.envs.path_cut import PathCutEnv
from cutenv.policy.depth_scripts import HoldDepth
from cutenv.policy.path_scripts import PATH_SCRIPTS
from cutenv.scoring import score
from cutenv.scoring.points import MAP_POINTS
from cutenv.task_quantities import DEPTH_COSTS, PATH_COSTS
from cutenv.tissue.lines import half_ellipse

METRICS = {
    "mean_depth_error": ("mean_error_mm", 1e-3, {"rel": 1e-12}),
    "too_deep_area": ("too_deep_mm2", 1e-6, {"rel": 1e-9, "abs": 1e-15}),
    "uncut_area": ("uncut_mm2", 1e-6, {"rel": 1e-12}),
    "layer_area": ("layer_mm2", 1e-6, {"abs": 1e-15}),
    "layer_depth": ("layer_mm", 1e-3, {"abs": 1e-12}),
    "largest_line_distance": ("largest_distance_mm", 1e-3, {"rel": 1e-6}),
    "line_area": ("area_mm2", 1e-6, {"rel": 1e-3}),  # the line is drawn again
}
COSTS = {"depth": (DEPTH_COSTS, 1e-9), "path": (PATH_COSTS, 1e-3)}


@pytest.fixture(scope="module", params=["depth", "path"])
def made(request: pytest.FixtureRequest):
    """A cut that holds one depth where a step is wanted, or cuts a corner: task, record, and cutting of the task."""
    if request.param == "depth":
        env = DepthCutEnv(wanted="step", target_length=0.06)
        _, trace = check_score.depth_cut(env, HoldDepth(), seed=4)
    else:
        env = PathCutEnv(line=half_ellipse(0.11, 0.015), target_length=0.07)
        _, trace = check_score.path_cut(env, PATH_SCRIPTS["blade on the line"](), seed=4)
    return request.param, trace, env.cutting


def test_its_metrics_are_those_of_the_task(made):
    task, trace, cutting = made
    card, errors = score(trace), cutting.errors
    compared = [name for name in METRICS if name in card.metrics]
    assert len(compared) == {"depth": 5, "path": 2}[task]
    for name in compared:
        error, unit, tolerance = METRICS[name]
        assert card[name] == pytest.approx(unit * errors[error], **tolerance)
    if task == "depth":
        assert errors["uncut_mm2"] > 10.0  # it can be seen
        assert card["peak_vertical_force"] == trace.vertical_force.max() > 0.1
    else:
        assert errors["largest_distance_mm"] > 0.5  # it can be seen
        mean = 1e-3 * errors["mean_distance_mm"] * cutting.tip / cutting.target_length
        assert card["mean_line_distance"] == pytest.approx(mean, rel=1e-6)
        assert card["peak_lateral_force"] == abs(trace.lateral_force).max() > 0.1


def test_its_cost_is_what_the_reward_has_charged(made):
    task, trace, cutting = made
    costs, tolerance = COSTS[task]
    charged = -sum(cutting.reward_totals[cost.name] for cost in costs)
    found = getattr(score(trace), f"{task}_map")
    assert found.cost(cutting.target_length) == pytest.approx(charged, rel=tolerance)


def test_it_has_points_and_the_other_parts_share_the_rest(made):
    task, trace, _ = made
    card = score(trace)
    assert card.points[-1].part == task
    assert card.points[-1].most == MAP_POINTS
    assert 0.0 <= card.points[-1].points < MAP_POINTS
    assert sum(each.most for each in card.points) == pytest.approx(100.0)
    assert card.overall_score == pytest.approx(sum(each.points for each in card.points))
    assert "off the" in card.points[-1].reason
