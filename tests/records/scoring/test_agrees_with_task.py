"""Score and task agree: names and code of terms, the map of a cut, and the order of cuts."""

from __future__ import annotations

import functools

import gymnasium
import numpy as np
import pytest
from map_cuts import map_cut

import cutenv  # noqa: F401  registers the environment
from cutenv._engine.jit import njit
from cutenv.agents.policy import BASELINES
from cutenv.records.scoring import ScoreCard, Truth, score
from cutenv.records.scoring.points import MAP_POINTS
from cutenv.records.scoring.technique import FORCE_LIMIT_PER_DEPTH
from cutenv.sim import quantities
from cutenv.sim.plant import to_trace
from cutenv.sim.quantities import DEPTH_COSTS, PATH_COSTS
from cutenv.sim.trace import Trace
from cutenv.task.reward import Limits, RewardWeights
from scripts.validation.scoring import check_score

SPECIMENS = 24
HANDS = ("steady hand", "upright hand", "late hand")
PLAYERS = ("return stroke", "fast then slow", "force feedback", "ppo-free", check_score.FEED, "random", *HANDS)


@pytest.fixture(scope="module")
def rows():
    return check_score.measure(PLAYERS, SPECIMENS, "mixed")


def test_every_success_has_more_than_any_failure_on_the_same_specimen(rows):
    found = check_score.agreement(rows)
    assert found.success_pairs > 100
    assert found.success_wrong == 0


def test_where_returns_differ_the_score_agrees(rows):
    found = check_score.agreement(rows)
    assert found.pairs > 100
    assert found.agreeing >= 0.95
    assert found.rank_correlation > 0.8


def test_the_score_agrees_for_cuts_by_hands_alone(rows):
    hands = check_score.agreement([row for row in rows if row["policy"] in HANDS])
    assert hands.pairs > 30
    assert hands.success_wrong == 0
    assert 0.85 < hands.agreeing <= hands.possible


def test_a_score_turned_round_would_be_noticed(rows):
    turned = [row | {"score": 100.0 - row["score"]} for row in rows]
    found = check_score.agreement(turned)
    assert found.success_wrong == found.success_pairs
    assert found.agreeing < 0.1


def test_script_feed_and_giving_up_stand_in_this_order(rows):
    means = check_score.mean_scores(rows)
    in_order = [means[name] for name in check_score.ORDER if name in means]
    assert len(in_order) == 3
    assert in_order == sorted(in_order, reverse=True)


def test_the_report_tells_the_agreement(rows):
    table = check_score.report(rows)
    assert f"{SPECIMENS} held-out specimens" in table
    assert f"| 0 of {check_score.agreement(rows).success_pairs} |" in table


@functools.cache
def charged_and_scored(seed: int) -> tuple[dict[str, float], ScoreCard, float]:
    """Terms of the reward of a slicing cut that ends leaning, its score with the truth, and its target [m]."""
    env = gymnasium.make("cutenv/GentleCut-v1")
    policy = BASELINES["constant 1.65 cm/s 45 deg"]()
    observation, _ = env.reset(seed=seed)
    policy.reset(np.random.default_rng(seed))
    cutting, parts, ended = env.unwrapped.cutting, [], False  # type: ignore[attr-defined]
    while not ended:
        observation, _, ended, _, info = env.step(policy(observation))
        parts.append(cutting.readings.copy())
    readings = np.concatenate(parts)
    truth = Truth(tip=readings["tip"].copy(), jump=readings["jump"].copy(), resistance=200.0)
    trace = to_trace(env.unwrapped.plant, readings, end=info["end"])  # type: ignore[attr-defined]
    target = float(info["truth"]["target_length_m"])
    return dict(cutting.reward_totals), score(trace, target_length=target, truth=truth), target


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_what_is_charged_is_what_is_scored(seed: int) -> None:
    charged, card, target = charged_and_scored(seed)
    weights = RewardWeights()
    assert charged["accuracy"] == pytest.approx(weights.accuracy * max(1.0 - card["tip_error"] / 0.009, 0.0), abs=1e-12)
    assert charged["wedge"] == pytest.approx(-weights.wedge * card["wedge"], rel=1e-12)
    cut_length = card["uncontrolled_share"] * _advance(card, target)
    assert charged["uncontrolled"] == pytest.approx(-weights.uncontrolled * cut_length / target, rel=1e-9)


def _advance(card: ScoreCard, target: float) -> float:
    """How far the tip came [m], from how far it was from the target at last."""
    return target + (card["tip_error"] if card["overshoot"] > 0.0 else -card["tip_error"])


def test_a_cut_near_the_clamp_is_scored_with_the_depth_that_the_reward_divides_by() -> None:
    time = np.arange(2000) / 1e3
    depth = np.linspace(0.2e-3, 3e-3, 2000)  # thinner than the floor at first
    force = 0.3 * np.sin(np.pi * time / 2.0) ** 0.25  # greatest over the depth where that is thinner than the floor
    trace = Trace(time=time, force=force, position=0.01 * time, depth=depth)
    card = score(trace, target_length=0.02)
    floored = np.maximum(depth, quantities.SHALLOWEST)
    assert quantities.SHALLOWEST == 0.001
    assert card["peak_force_per_depth"] == pytest.approx((force / floored).max(), rel=1e-12)
    assert card["peak_force_per_depth"] < 0.75 * (force / np.maximum(depth, 0.5 * quantities.SHALLOWEST)).max()


def test_limits_are_stated_once() -> None:
    assert Limits().force_limit_per_depth == FORCE_LIMIT_PER_DEPTH == quantities.FORCE_LIMIT_PER_DEPTH


@njit
def _in_a_kernel(tip: float, target: float, blade: float, angle: float) -> tuple[float, ...]:
    return (
        quantities.tip_error(tip, target),
        quantities.closeness(tip, target),
        quantities.overshoot(tip, target),
        quantities.lag(blade, tip),
        quantities.force_per_depth(tip, blade),
        quantities.wedge(angle, 0.02),
    )


@pytest.mark.parametrize("tip", [0.05, 0.06, 0.0713])
def test_a_term_is_the_same_in_a_kernel_and_for_arrays(tip: float) -> None:
    target, blade, angle = 0.06, 0.065, 0.9
    for_arrays = (
        quantities.tip_error(np.array([tip]), target),
        quantities.closeness(np.array([tip]), target),
        quantities.overshoot(np.array([tip]), target),
        quantities.lag(np.array([blade]), np.array([tip])),
        quantities.force_per_depth(np.array([tip]), np.array([blade])),
    )
    terms_of_all = [float(value[0]) for value in for_arrays]
    assert _in_a_kernel(tip, target, blade, angle) == (*terms_of_all, quantities.wedge(angle, 0.02))


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


@pytest.fixture(params=["depth", "path"])
def made(request: pytest.FixtureRequest):
    """Task, record, and cutting of the task."""
    return request.param, *map_cut(request.param)[1:]


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
