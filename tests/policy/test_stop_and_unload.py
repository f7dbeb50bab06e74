"""The end that all scripts share: it stops at the target, unloads the tissue, and finishes the cut."""

from __future__ import annotations

import numpy as np
import pytest
from observed import observed
from whole_cut import CRUISE, FASTEST, INCLINED, UPRIGHT, cut, make

from cutenv.policy import BASELINES, CONSTANT_FEEDS, GRID_SPEEDS, NULL_POLICIES, ORACLE, ConstantFeed, StopAndUnload
from cutenv.policy.unloading import coasting
from cutenv.task.observation import in_units, to_action

QUIET = {"force_noise": 0.0, "force_resolution": 0.0, "depth_noise": 0.0}
TOO_SLOW = [
    name for name, (speed, _) in CONSTANT_FEEDS.items() if speed == min(GRID_SPEEDS)
]  # 30 mm in the time there is
ENDING = [name for name in BASELINES if name not in (ORACLE, *NULL_POLICIES, *TOO_SLOW)]


def coasted(speed: float) -> float:
    """How far a blade at a steady speed really went on."""
    env = make(specimen_class="uniform")
    env.reset(seed=0)
    for _ in range(50):
        told = in_units(env.step(to_action(speed, UPRIGHT))[0])
    for _ in range(40):
        stands = in_units(env.step(to_action(0.0, UPRIGHT))[0])
    assert stands["speed"] == pytest.approx(0.0, abs=1e-5)
    return float(stands["position"] - told["position"])


SPEEDS = (0.0038, 0.0089, CRUISE, 0.0216, FASTEST)


def test_coasting_grows_with_speed_as_a_blade_really_does_and_is_never_less():
    for speed in SPEEDS:
        assert coasted(speed) - 0.1e-3 < coasting(speed) < coasted(speed) + 0.07 * speed


@pytest.mark.xfail(
    strict=True,
    reason="60 ms of reaction are 50 ms too many: the drive's lag falls within the braking; 1.4 mm at 2.54 cm/s",
)
def test_coasting_is_how_far_a_blade_goes_on_once_it_is_told_to_stop():
    for speed in SPEEDS:
        assert coasting(speed) == pytest.approx(coasted(speed), abs=0.3e-3)


def test_a_blade_that_stands_or_draws_back_does_not_coast():
    assert coasting(0.0) == coasting(-0.02) == 0.0


@pytest.mark.parametrize("margin", [-0.002, 0.0, 0.004])
@pytest.mark.parametrize("speed", [0.0, CRUISE])
def test_the_blade_is_stopped_a_margin_and_its_coasting_before_the_target(margin, speed):
    def stops(before: float) -> bool:
        seen = observed(position=0.08 - before, distance=before, speed=speed)  # unloaded: the tip is at the blade
        return StopAndUnload(margin=margin)(seen) is not None

    due = margin + coasting(speed)
    assert not stops(due + 1e-4)
    assert stops(due - 1e-4)


def test_a_larger_margin_moves_the_stop_of_a_whole_cut_back():
    def furthest(margin: float) -> float:
        policy = ConstantFeed(speed=CRUISE, angle=INCLINED, unloading=StopAndUnload(margin=margin))
        return float(
            cut(make(specimen_class="uniform", **QUIET), policy, target_length=0.08).readings["position"].max()
        )

    stops = np.array([furthest(margin) for margin in (0.0, 0.004, 0.008, 0.012)])
    assert (np.diff(stops) < 0.0).all()
    assert stops[0] - stops[-1] == pytest.approx(0.012, abs=0.003)


def test_once_begun_it_draws_back_upright_until_zero_force_and_rests():
    unloading = StopAndUnload(retreat_speed=0.004)
    assert unloading(observed(position=0.05, distance=0.03, force=1.0)) is None
    draw_back, rest = to_action(-0.004, UPRIGHT), to_action(0.0, UPRIGHT)
    np.testing.assert_array_equal(unloading(observed(position=0.09, distance=-0.01, force=3.0)), draw_back)
    for force, expected in ((0.1, draw_back), (-0.1, rest), (0.2, rest)):
        # The target is ahead again as far as the force tells, but a cut is ended once.
        np.testing.assert_array_equal(unloading(observed(position=0.07, distance=0.01, force=force)), expected)


def test_reset_forgets_that_a_cut_was_ended():
    unloading = StopAndUnload()
    assert unloading(observed(position=0.09, distance=-0.01)) is not None
    unloading.reset()
    assert unloading(observed(position=0.01, distance=0.07)) is None
    assert unloading.tip == pytest.approx(0.01, abs=1e-6)
    assert unloading.left == pytest.approx(0.07, abs=1e-6)


@pytest.mark.parametrize("name", ENDING)
def test_every_script_finishes_in_even_tissue_and_leaves_it_unloaded(name):
    env, policy = make(specimen_class="uniform"), BASELINES[name]()
    for length in (0.06, 0.09):
        record = cut(env, policy, target_length=length)
        assert record.end == "finished"
        assert -0.02 < record.totals["stored"] <= 0.0
        assert abs(record.readings["true_force"][-1]) < 0.2 + env.unwrapped.specimen.friction_per_depth * 0.02
        assert record.readings["angle"][-1] == pytest.approx(UPRIGHT, abs=1e-3)


def test_a_script_that_only_stopped_would_leave_it_loaded():
    class OnlyStop(StopAndUnload):
        def endings(self, seen):
            return super().endings(seen)[0], np.tile(to_action(0.0, UPRIGHT), (len(seen), 1))

    record = cut(make(specimen_class="uniform"), ConstantFeed(speed=CRUISE, unloading=OnlyStop()), target_length=0.08)
    assert record.end == "deadline"
    assert record.totals["stored"] < -0.02
