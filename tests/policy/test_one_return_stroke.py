"""One short return stroke tells the stiffness, and the script that makes it cuts better than those that guess."""

from __future__ import annotations

import numpy as np
import pytest
from whole_cut import CRUISE, INCLINED, cut, interval, make

from cutenv.learning.batched_rollout import batched_rollout
from cutenv.policy import ConstantFeed, OneReturnStroke, ProbeAndCreep
from cutenv.task.observation import in_units


def returns(policy, seeds: range, **keywords) -> np.ndarray:
    cuts = batched_rollout(policy, list(seeds), keywords)
    return np.array([sum(one.reward_totals.values()) for one in cuts])


@pytest.mark.parametrize("control_hz", [10, 50])
def test_it_is_better_than_the_other_scripts(control_hz):
    seeds, keywords = range(400), {"control_hz": control_hz}
    own = returns(OneReturnStroke(), seeds, **keywords)
    for other in (ProbeAndCreep(), ConstantFeed(speed=0.0165, angle=INCLINED)):
        assert interval(own - returns(other, seeds, **keywords))[0] > 0.03


def test_a_script_that_makes_no_stroke_is_worse_so_the_stroke_is_what_helps():
    seeds = range(200)
    assert (
        interval(returns(OneReturnStroke(), seeds) - returns(OneReturnStroke(approach=0.0, held=10.0), seeds))[0] > 0.0
    )


def test_it_gives_up_before_a_run_beyond_the_target():
    """Where a vessel holds the tip, the crack would run past the target; without giving up, more cuts end for that."""
    seeds = list(range(300))
    ends = {
        held: [one.end for one in batched_rollout(OneReturnStroke(held=held), seeds, {"specimen_class": "vascular"})]
        for held in (1.3, 10.0)
    }
    assert ends[1.3].count("overshoot") < 0.7 * ends[10.0].count("overshoot")


def test_it_draws_back_once_and_by_the_length_of_the_stroke():
    seen = cut(make(specimen_class="liver"), OneReturnStroke(), 3).observations
    position = np.array([in_units(one)["position"] for one in seen])
    speed = np.array([in_units(one)["speed"] for one in seen])
    back = np.flatnonzero(np.diff((speed < -0.001).astype(int)) == 1)
    assert len(back) == 2, "the return stroke, and drawing back at the end"
    turned = position[: back[0] + 1].max()
    assert 0.0015 <= turned - position[back[0] : back[1]].min() < 0.0045, "shorter where nothing is left to unload"
    assert position[: back[1]].max() > turned + 0.003, "it cuts on"


def test_a_cut_is_forgotten_before_the_next():
    env, script = make(), OneReturnStroke(speed=CRUISE)
    first = cut(env, script, 5)
    cut(env, script, 6)
    np.testing.assert_array_equal(first.observations, cut(env, script, 5).observations)
