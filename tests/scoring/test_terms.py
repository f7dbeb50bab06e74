"""Reward and score share names and code: of one cut both say the same."""

from __future__ import annotations

import functools

import gymnasium
import numpy as np
import pytest

import cutenv  # noqa: F401  registers the environment
from cutenv import task_quantities
from cutenv._engine.jit import njit
from cutenv.plant import to_trace
from cutenv.policy import BASELINES
from cutenv.scoring import ScoreCard, Truth, score
from cutenv.scoring.technique import FORCE_LIMIT_PER_DEPTH
from cutenv.task.weights import Limits, RewardWeights
from cutenv.trace import Trace


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
    floored = np.maximum(depth, task_quantities.SHALLOWEST)
    assert task_quantities.SHALLOWEST == 0.001
    assert card["peak_force_per_depth"] == pytest.approx((force / floored).max(), rel=1e-12)
    assert card["peak_force_per_depth"] < 0.75 * (force / np.maximum(depth, 0.5 * task_quantities.SHALLOWEST)).max()


def test_limits_are_stated_once() -> None:
    assert Limits().force_limit_per_depth == FORCE_LIMIT_PER_DEPTH == task_quantities.FORCE_LIMIT_PER_DEPTH


@njit
def _in_a_kernel(tip: float, target: float, blade: float, angle: float) -> tuple[float, ...]:
    return (
        task_quantities.tip_error(tip, target),
        task_quantities.closeness(tip, target),
        task_quantities.overshoot(tip, target),
        task_quantities.lag(blade, tip),
        task_quantities.force_per_depth(tip, blade),
        task_quantities.wedge(angle, 0.02),
    )


@pytest.mark.parametrize("tip", [0.05, 0.06, 0.0713])
def test_a_term_is_the_same_in_a_kernel_and_for_arrays(tip: float) -> None:
    target, blade, angle = 0.06, 0.065, 0.9
    for_arrays = (
        task_quantities.tip_error(np.array([tip]), target),
        task_quantities.closeness(np.array([tip]), target),
        task_quantities.overshoot(np.array([tip]), target),
        task_quantities.lag(np.array([blade]), np.array([tip])),
        task_quantities.force_per_depth(np.array([tip]), np.array([blade])),
    )
    terms_of_all = [float(value[0]) for value in for_arrays]
    assert _in_a_kernel(tip, target, blade, angle) == (*terms_of_all, task_quantities.wedge(angle, 0.02))
