"""The planner that knows the truth gets exactly what it planned; the other one plans for the mean liver, and feels."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest
from observed import observed
from whole_cut import CRUISE, FASTEST, INCLINED, Cut, cut, go_on, make

from cutenv.agents.policy import SCRIPTS, ConstantFeed, PlannerNominal, PlannerWithTruth
from cutenv.agents.policy import planner as planning
from cutenv.agents.policy.planner import Search
from cutenv.sim.tissue import Specimen, measured_liver
from cutenv.task.episode import Episode
from cutenv.task.observation import in_units

ENDS_PLANNED_FOR = ("finished", "deadline")
FEEDS = {"feed": ConstantFeed(speed=CRUISE, angle=INCLINED), "fast feed": ConstantFeed(speed=FASTEST, angle=INCLINED)}


class Planned(NamedTuple):
    """What a cut was to be paid, and the cut."""

    value: float
    record: Cut


def cut_as_planned(env, seed: int, planner: PlannerWithTruth) -> Planned:
    """Let the planner look, take down the value of its plan, and cut."""
    values = []
    best = Search.best

    def noting(search, rngs, **keywords):
        found = best(search, rngs, **keywords)
        values.extend(value for _, value in found)
        return found

    observation, _ = env.reset(seed=seed)
    planner.reset(np.random.default_rng(seed))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(planning.Search, "best", noting)
        planner.set_state(env.unwrapped.cutting)
    return Planned(values[0], go_on(env, planner, observation))


def check_planned(planned: Planned) -> None:
    assert planned.record.total == pytest.approx(planned.value, abs=1e-9)
    assert planned.record.end in ENDS_PLANNED_FOR


def test_what_the_planner_with_truth_plans_is_what_happens_and_no_script_does_better():
    env = make(target_length=0.08)
    planned = [cut_as_planned(env, seed, PlannerWithTruth()) for seed in range(6)]
    for each in planned:
        check_planned(each)
    returns = np.array([each.record.total for each in planned])
    for name, policy in {**{name: script() for name, script in SCRIPTS.items()}, **FEEDS}.items():
        theirs = [cut(env, policy, seed).total for seed in range(6)]
        assert (returns - theirs).mean() > 0.05, name
        assert (returns - theirs).min() > -0.01, f"{name} on one of them"  # luck that twenty rounds do not find


@pytest.mark.parametrize(
    "keywords",
    [
        {"control_hz": 10, "specimen_class": "vascular"},
        {"drive": "hand", "specimen_class": "liver"},
        {"weight_jump": 1.0, "deadline_s": 12.0, "target_length": 0.07, "specimen_class": "vascular"},
    ],
)
def test_it_plans_for_the_environment_that_it_is_shown(keywords):
    check_planned(cut_as_planned(make(**keywords), 3, PlannerWithTruth(rounds=2)))


def test_more_rounds_never_plan_worse():
    env = make(specimen_class="vascular")
    env.reset(seed=1)
    search = Search(env.unwrapped.cutting)
    values = [search.best([np.random.default_rng(0)], rounds=rounds)[0][1] for rounds in (0, 3, 9)]
    assert values == sorted(values)
    assert values[-1] > values[0]


def test_looking_into_a_cut_changes_nothing_of_it():
    readings = []
    for looks in (False, True):
        env, feed, planner = make(), ConstantFeed(speed=CRUISE), PlannerWithTruth(rounds=1)
        observation, _ = env.reset(seed=7)
        feed.reset(np.random.default_rng(0))
        planner.reset(np.random.default_rng(0))
        if looks:
            planner.set_state(env.unwrapped.cutting)
        record = go_on(env, feed, observation)
        readings.append((record.readings, record.rewards, record.observations))
    for without, with_a_look in zip(*readings, strict=True):
        np.testing.assert_array_equal(without, with_a_look)


def test_without_a_look_at_the_cut_it_says_what_is_missing():
    planner = PlannerWithTruth(rounds=0)
    planner.reset(np.random.default_rng(0))
    with pytest.raises(RuntimeError, match=r"set_state\(env\.unwrapped\.cutting\)"):
        planner(observed())
    env = make(specimen_class="uniform")
    env.reset(seed=0)
    planner.set_state(env.unwrapped.cutting)
    planner(observed())
    planner.reset(np.random.default_rng(0))
    with pytest.raises(RuntimeError, match="set_state"):
        planner(observed())


def test_a_cut_that_is_not_simulated_cannot_be_looked_into():
    cutting = object.__new__(Episode)
    planner = PlannerWithTruth()
    planner.reset(np.random.default_rng(0))
    with pytest.raises(TypeError, match="plans need a simulated episode, got <"):
        planner.set_state(cutting)


def commands(planner: PlannerNominal, seed: int) -> np.ndarray:
    """The actions up to the stop, shape (n, 2), in a specimen and 80 mm of length."""
    record = cut(make(specimen_class="vascular"), planner, seed, target_length=0.08)
    seen = in_units(record.observations)
    stop = int(np.argmax(seen["last_speed"] <= 0.0))
    return record.observations[:stop, -2:]


def test_the_nominal_planner_commands_the_same_whatever_it_cuts_until_it_stops():
    planner = PlannerNominal()
    one, other = (commands(planner, seed) for seed in (1, 4))
    both = min(len(one), len(other))
    assert both > 150
    np.testing.assert_array_equal(one[:both], other[:both])
    assert len(one) != len(other), "where it stops, it feels"


def test_the_nominal_planner_looks_for_the_best_plan_of_the_mean_liver():
    planner, target = PlannerNominal(rounds=3), 0.08
    mean = planning._mean_cut(measured_liver(), target)
    assert mean.plant.specimen == Specimen.mean()
    search = Search(mean)
    (plain,) = search.returns([search.plain_plans(target)])
    assert search.returns([planner.plan_for(target)])[0] >= plain.max()
    assert plain.max() - plain.min() > 0.5


def test_plans_that_share_a_cut_up_to_their_stops_return_what_each_returns_alone():
    cuttings = []
    for seed in (1, 2):
        env = make(specimen_class="vascular")
        env.reset(seed=seed)
        cuttings.append(env.unwrapped.cutting)
    search = Search(*cuttings)
    plans = [search.plain_plans(cutting.target_length)[:66] for cutting in cuttings]
    alone = [own.copy() for own in plans]
    for own in alone:
        own["leader"] = 0
    np.testing.assert_array_equal(search.returns(plans), search.returns(alone))
    ahead = [own.copy() for own in plans]
    for own in ahead:
        own["leader"] = np.minimum(own["leader"], 1)  # it moves only from its own stop on: too late
    assert not np.array_equal(search.returns(ahead), search.returns(alone))
