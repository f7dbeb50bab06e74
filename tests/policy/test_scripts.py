"""Scripts do along the way what their names say, as the blade's readings show."""

from __future__ import annotations

import numpy as np
import pytest
from observed import observed
from whole_cut import FASTEST, INCLINED, UPRIGHT, Cut, cut, make

from cutenv.policy import ConstantFeed, FastThenSlow, ForceFeedback, InclineBetween, Script
from cutenv.task.observation import commanded_speed, in_units

SETTLED = 15  # decisions, after which the drive has followed a command


def cut_by(policy: Script, specimen_class: str = "liver", seed: int = 2) -> tuple[Cut, dict[str, np.ndarray]]:
    """A cut of 90 mm, and what was observed up to the stop, in SI units."""
    record = cut(make(specimen_class=specimen_class), policy, seed, target_length=0.09)
    seen = in_units(record.observations)
    ending = int(np.argmax(seen["last_speed"] <= 0.0))
    assert ending > 100
    return record, {name: values[:ending] for name, values in seen.items()}


def at(seen: dict[str, np.ndarray], name: str, where: np.ndarray) -> np.ndarray:
    """A value where a condition has held for so long that the drive has followed."""
    held = np.convolve(where, np.ones(SETTLED), "full")[: len(where)] == SETTLED
    assert held.sum() > 10
    return seen[name][held]


@pytest.mark.parametrize(("speed", "angle"), [(0.0089, UPRIGHT), (FASTEST, INCLINED)])
def test_a_constant_feed_keeps_speed_and_angle(speed, angle):
    _, seen = cut_by(ConstantFeed(speed=speed, angle=angle))
    always = np.arange(len(seen["speed"])) > 30  # the blade starts upright and at rest
    np.testing.assert_allclose(at(seen, "speed", always), speed, rtol=0.01)
    np.testing.assert_allclose(at(seen, "angle", always), angle, atol=1e-3)


def test_fast_then_slow_is_fast_far_from_the_target_and_slow_near_it():
    policy = FastThenSlow(fast=0.02, slow=0.006, approach=0.030)
    _, seen = cut_by(policy)
    np.testing.assert_allclose(
        at(seen, "speed", (seen["position"] > 0.01) & (seen["distance"] > 0.031)), 0.02, rtol=0.01
    )
    np.testing.assert_allclose(at(seen, "speed", seen["distance"] < 0.015), 0.006, rtol=0.01)
    assert len(np.unique(np.round(seen["last_speed"], 4))) == 2


def test_fast_then_slow_slows_down_where_the_estimated_tip_is_that_near():
    slower = [cut_by(FastThenSlow(fast=0.02, slow=0.006, approach=approach))[1] for approach in (0.020, 0.040)]
    places = [float(seen["position"][np.argmin(seen["last_speed"] > 0.5)]) for seen in slower]
    assert places[0] - places[1] == pytest.approx(0.020, abs=0.008)
    for place, approach in zip(places, (0.020, 0.040), strict=True):
        assert 0.0 <= place - (0.09 - approach) < 0.015, "the blade leads the tip by some millimetres"


def test_incline_between_is_upright_inclined_and_upright_again():
    record, seen = cut_by(InclineBetween(speed=0.01, start=0.015, approach=0.015), specimen_class="uniform")
    tip = record.readings["tip"][19::20][: len(seen["angle"])]
    np.testing.assert_allclose(at(seen, "angle", tip < 0.010), UPRIGHT, atol=1e-3)
    np.testing.assert_allclose(at(seen, "angle", (tip > 0.025) & (tip < 0.070)), INCLINED, atol=1e-3)
    assert seen["angle"][-1] == pytest.approx(UPRIGHT, abs=1e-3)
    assert np.count_nonzero(np.diff(seen["last_angle"])) == 2


@pytest.mark.parametrize(("first", "second"), [({"start": 0.01}, {"start": 0.03}), ({"approach": 0.03}, {})])
def test_incline_between_turns_where_it_is_told_to(first, second):
    seen = [cut_by(InclineBetween(**changes), "uniform")[1] for changes in (first, {"approach": 0.01} | second)]
    turn = 0 if "start" in first else 1
    places = [run["position"][np.flatnonzero(np.diff(run["last_angle"]))[turn]] for run in seen]
    assert places[1] - places[0] == pytest.approx(0.02, abs=0.006)


def test_force_feedback_commands_a_speed_that_rises_with_force_per_depth_between_two_limits():
    policy = ForceFeedback(unloaded=0.005, loaded=0.02, full_load=300.0, angle=INCLINED)
    policy.reset(np.random.default_rng(0))

    def commanded(force_per_depth: float, depth: float) -> float:
        seen = observed(force=force_per_depth * depth, depth=depth, distance=0.08)
        return float(commanded_speed(in_units(np.r_[np.zeros(10), policy(seen)])["last_speed"]))

    for depth in (0.006, 0.02):
        for force_per_depth, speed in ((-50.0, 0.005), (0.0, 0.005), (150.0, 0.0125), (300.0, 0.02), (600.0, 0.02)):
            assert commanded(force_per_depth, depth) == pytest.approx(speed, abs=1e-5)


def answer(seen: dict[str, np.ndarray]) -> float:
    """How much faster the blade moves at full load than at none [m/s], by the load 40 ms before, once under way."""
    load = np.clip(seen["force"] / np.maximum(seen["depth"], 1e-3) / 300.0, 0.0, 1.0)
    return float(np.polyfit(load[40:-2], seen["speed"][42:], 1)[0])


def test_force_feedback_moves_faster_through_a_whole_cut_where_it_feels_more():
    record, seen = cut_by(ForceFeedback(unloaded=0.003, loaded=0.02))
    assert answer(seen) == pytest.approx(0.017, rel=0.25)  # the drive rounds off the sudden falls of the load
    assert record.readings["speed"].max() <= 0.0201
    assert abs(answer(cut_by(ConstantFeed(speed=0.0127))[1])) < 1e-3, "a feed that feels nothing does not"
