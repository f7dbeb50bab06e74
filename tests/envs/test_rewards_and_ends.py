"""Rewards, costs and ends: as the task words them, at every rate of decision, whoever cuts."""

from __future__ import annotations

import copy
import math

import gymnasium
import numpy as np
import pytest
from hacks import HACKS
from reference_assessment import WEIGHTS, check_assessment
from whole_cut import FASTEST, INCLINED, UPRIGHT, Cut, Script, cut, go_on, legs, make, steady

from cutenv.agents.learning.evaluation import batched_rollout
from cutenv.agents.policy import BASELINES, ConstantFeed, FastThenSlow, NoAction, RandomAction
from cutenv.sim.tissue import Specimen
from cutenv.sim.tissue.specimen import CLASSES, N_POINTS, SPACING
from cutenv.task.reward import GAINS


def wandering(control_hz: int = 50) -> Script:
    """Random commands, a new one every 0.1 s whatever the rate of decision: cuts, reverses, turns."""
    values = np.random.default_rng(8).uniform((-0.6, INCLINED), (1.0, UPRIGHT), size=(400, 2)) * (FASTEST, 1.0)
    return Script(lambda count, seen: tuple(values[count * 10 // control_hz]))


def back_from(beyond: float) -> Script:
    """Go to that far beyond the target [m], or before it; then draw back without rest."""
    turned = []

    def command(count: int, seen: dict[str, float]) -> tuple[float, float]:
        if count == 0:
            turned.clear()
        if -seen["distance"] > beyond:
            turned.append(count)
        return (-0.01 if turned else 0.0127), UPRIGHT

    return Script(command)


ENDINGS = {
    "finished": ({}, ConstantFeed(speed=0.0127)),
    "force_limit": ({"force_limit_per_depth": 160.0}, steady(0.01)),
    "overshoot": ({}, steady(FASTEST, math.radians(70.0))),
    "deadline": ({"deadline_s": 3.0}, steady(0.004, INCLINED)),
}
POLICIES = {
    **{
        f"{end} at {hz} Hz": ({"control_hz": hz, **keys}, policy)
        for end, (keys, policy) in ENDINGS.items()
        for hz in (50, 8)
    },
    "wandering": ({"force_limit_per_depth": 1e5}, wandering()),
    "random": ({"drive": "hand", "deadline_s": 10.0}, RandomAction()),
    "by hand": ({"drive": "hand"}, FastThenSlow()),
    "nothing": ({"deadline_s": 2.0}, NoAction()),
    "drawn back": ({}, back_from(0.006)),
    "at an angle": ({"angle_mode": "fixed", "fixed_angle_deg": 50.0}, ConstantFeed(speed=0.02)),
}


@pytest.mark.parametrize("name", POLICIES)
@pytest.mark.parametrize("specimen_class", CLASSES[:3])
def test_every_term_every_end_and_every_success_is_as_the_task_words_it(name, specimen_class):
    keywords, policy = POLICIES[name]
    limit = keywords.get("force_limit_per_depth", 1000.0)
    for seed in range(2):
        env = make(specimen_class=specimen_class, **keywords)
        check_assessment(env, cut(env, policy, seed), force_limit=limit)


@pytest.fixture(scope="module")
def success() -> tuple[gymnasium.Env, Cut]:
    """A cut that succeeds, and its environment."""
    env = make(specimen_class="liver")
    records = (cut(env, ConstantFeed(speed=0.0127), seed) for seed in range(20))
    record = next(record for record in records if record.infos[-1]["is_success"])
    check_assessment(env, record)
    return env, record


@pytest.fixture(scope="module")
def every_cost() -> tuple[gymnasium.Env, Cut]:
    """A cut that is charged for everything, and its environment."""
    env = make(specimen_class="liver", force_limit_per_depth=1e5)
    # Fast and reversing for the force, the lag and the backward travel, and ending while loaded and inclined.
    parts = legs((4.0, FASTEST, UPRIGHT), (0.5, -FASTEST, UPRIGHT), (9.0, 0.003, INCLINED))
    costs = [name for name in WEIGHTS if name not in GAINS]
    record = next(c for seed in range(80) if all((c := cut(env, parts, seed)).totals[n] < -1e-3 for n in costs))
    check_assessment(env, record)
    return env, record


@pytest.mark.parametrize("name", WEIGHTS)
def test_a_term_charged_at_another_rate_would_be_noticed(name, every_cost, success):
    env, record = success if name in GAINS else every_cost
    with pytest.raises(AssertionError, match=name):
        check_assessment(env, record, weights=WEIGHTS | {name: 1.01 * WEIGHTS[name]})


@pytest.mark.parametrize("reward_from", ["truth", "estimate"])
@pytest.mark.parametrize("drive", ["rig", "hand"])
def test_the_terms_add_up_to_the_reward_and_no_cost_is_a_gain(reward_from, drive):
    env = make(reward_from=reward_from, drive=drive, force_limit_per_depth=1e5)
    for seed in range(3):
        record = cut(env, wandering(), seed)
        for reward, terms in zip(record.rewards, record.terms, strict=True):
            assert sum(terms.values()) == pytest.approx(reward, abs=1e-12)
            assert terms["success"] >= 0.0
            assert terms["progress"] >= 0.0 or reward_from == "estimate"  # which a return stroke may correct
            assert all(value <= 0.0 for name, value in terms.items() if name not in GAINS)
        assert record.total <= 1.0
        assert env.unwrapped.cutting.reward_totals == pytest.approx(record.totals)


def totals_at(rates, policy_at, seeds=range(3), **keywords):
    """Summed terms by rate of decision, for the same commands on the same specimens."""
    return [
        [list(cut(make(control_hz=rate, **keywords), policy_at(rate), seed).totals.values()) for seed in seeds]
        for rate in rates
    ]


def test_the_same_motion_is_charged_the_same_however_often_one_decides():
    coarse, usual, fine = totals_at((10, 50, 100), wandering, force_limit_per_depth=1e5)
    np.testing.assert_allclose(usual, coarse, atol=1e-9)
    np.testing.assert_allclose(usual, fine, atol=1e-9)


def test_estimated_runs_are_charged_the_same_however_often_one_decides():
    def feed(rate: int) -> Script:
        return legs((3.0, FASTEST, UPRIGHT), (3.0, -0.01, UPRIGHT), control_hz=rate)

    keywords = {"specimen_class": "liver", "target_length": 0.1, "reward_from": "estimate"}
    coarse, usual, fine = (np.sum(totals, axis=0) for totals in totals_at((5, 50, 100), feed, range(5), **keywords))
    np.testing.assert_allclose(usual, fine, rtol=0.1)
    np.testing.assert_allclose(coarse, fine, rtol=0.1)

    def seen(rate: int) -> float:
        record = cut(make(control_hz=rate, specimen_class="uniform"), ConstantFeed(speed=0.0127))
        return float(record.readings["jump"][:: 1000 // rate].sum())

    with pytest.raises(AssertionError):
        np.testing.assert_allclose(seen(10), seen(1000), rtol=0.1)


@pytest.mark.parametrize("end", ENDINGS)
def test_each_end_is_reached_reported_once_and_terminates(end):
    keywords, policy = ENDINGS[end]
    record = cut(make(specimen_class="uniform", **keywords), policy)
    assert record.end == end
    assert isinstance(record.infos[-1]["is_success"], bool)
    assert all("end" not in info and "is_success" not in info for info in record.infos[:-1])
    assert not record.infos[-1]["is_success"] or end == "finished"


def test_a_success_gains_its_weight_and_any_other_end_nothing():
    for keywords, policy in ENDINGS.values():
        for seed in range(3):
            record = cut(make(specimen_class="uniform", weight_success=0.7, **keywords), policy, seed)
            assert record.totals["success"] == (0.7 if record.infos[-1]["is_success"] else 0.0)
    gained = [cut(make(specimen_class="uniform"), ConstantFeed(speed=0.0127), n).totals["success"] for n in range(5)]
    assert {0.0, 0.2} == set(gained), "successes and misses"


@pytest.mark.parametrize("beyond", [-0.008, 0.002, 0.006])
def test_drawing_back_unloaded_finishes_a_cut_near_the_target(beyond):
    for seed in range(2):
        env = make(control_hz=1000)
        record = cut(env, back_from(beyond), seed)
        assert record.end == "finished"
        readings, specimen = record.readings, env.unwrapped.specimen
        depth = np.interp(readings["position"], np.arange(N_POINTS) * SPACING, specimen.depth)
        last = np.flatnonzero(readings["force"] >= specimen.friction_per_depth * depth + 0.1)[-1]
        way = readings["position"][last] - readings["position"][-2:]
        assert way[0] < 0.020 <= way[1]
        assert np.abs(readings["speed"][last + 1 :]).min() > 0.5e-3, "it has never rested"


def test_drawing_back_far_from_the_target_does_not():
    record = cut(make(deadline_s=12.0), back_from(-0.03))
    assert record.readings["position"].max() - record.readings["position"][-1] > 0.03
    assert record.end == "deadline"


@pytest.mark.parametrize(("policy", "end"), [(ConstantFeed(speed=0.0127), "finished"), (NoAction(), "deadline")])
def test_an_end_that_fails_charges_nothing_at_once_but_wedge_and_stored_energy(policy, end):
    """Else a learner that discounts would gain by putting it off."""
    records = (cut(make(), policy, seed) for seed in range(30))
    record = next(record for record in records if record.end == end and not record.infos[-1]["is_success"])
    last = record.terms[-1]
    assert last["time"] >= -0.1 * 0.02 / 30.0 - 1e-12, "of one step"
    assert record.rewards[-1] >= last["time"] + last["wedge"] + last["stored"] - 1e-9


STOPS = {
    "unload": legs((2.0, -FASTEST, UPRIGHT), control_hz=100),
    "unload slowly": legs((9.0, -0.005, UPRIGHT), control_hz=100),
    "unload inclined": legs((2.0, -FASTEST, INCLINED), control_hz=100),
    "draw right back": legs((6.0, -FASTEST, UPRIGHT), control_hz=100),
}
TOUGH = {"modulus": 48.4e3, "fracture_resistance": 1200.0, "depth": 0.02}  # meets the force limit before it breaks
BREACHES = {
    "force_limit": (steady(0.005), {"specimen": Specimen.homogeneous(**TOUGH)}),
    "force_limit at an angle": (steady(FASTEST, INCLINED), {"specimen": Specimen.homogeneous(**TOUGH)}),
    "overshoot": (steady(FASTEST), {"target_length": 0.06}),
    "overshoot at an angle": (steady(0.003, INCLINED), {"target_length": 0.06}),
}


def returns_of_stopping_and_of_the_breach(breach: str, seed: int) -> tuple[list[float], float]:
    """From one state, half a second before an end for safety: the returns of the stops, and of going on into it."""
    policy, options = BREACHES[breach]
    env = make(control_hz=100, specimen_class="liver")
    steps = len(cut(env, policy, seed, **options).rewards) - 50
    observation, _ = env.reset(seed=seed, options=options)
    policy.reset(np.random.default_rng(seed))
    for _ in range(steps):
        observation = env.step(policy(observation))[0]
    stopped = []
    for stop in STOPS.values():
        stop.reset(np.random.default_rng(seed))
        stopped.append(go_on(copy.deepcopy(env), stop, observation))
    into = go_on(env, policy, observation)
    assert into.end == breach.split()[0]
    return [record.total for record in stopped if record.end in ("finished", "deadline")], into.total


@pytest.mark.parametrize("breach", BREACHES)
@pytest.mark.parametrize("seed", range(2))
def test_an_end_for_safety_costs_more_than_any_stop_from_the_same_state(breach, seed):
    stopping, breaching = returns_of_stopping_and_of_the_breach(breach, seed)
    assert stopping, "at least one stop must succeed"
    assert breaching < min(stopping) - 0.3


QUIET = {"specimen_class": "uniform", "force_noise": 0.0, "force_resolution": 0.0}
BLIND = [  # those that do not look into the hidden state, which a rollout does not show
    ("crossing the line with small force", "at full speed"),
    ("ending early", "by a low limit of force"),
    ("leaving the tissue loaded", "creeping on"),
    ("pumping speed", "every second, fast"),
    ("jitter", "large"),
]
CUTTERS = {"/".join(names): HACKS[names[0]][names[1]] for names in BLIND} | {
    name: BASELINES[name]() for name in ("probe and creep", "return stroke", "force feedback", "random")
}


def by_trace(readings: np.ndarray, target: float) -> dict[str, float]:
    """Return what the cost of a cut consists of, by its trace [mm]."""
    return {
        "overshoot_mm": 1e3 * max(readings["tip"][-1] - target, 0.0),
        "long_runs_mm": 1e3 * np.maximum(readings["jump"] - 0.004, 0.0).sum(),
    }


def summed(record: Cut) -> dict[str, float]:
    """Return the sums of the parts of the cost, of which each step's is checked to consist."""
    for info in record.infos:
        assert info["cost"] == sum(info["cost_terms"].values())
        assert min(info["cost_terms"].values()) >= 0.0
    return {name: sum(info["cost_terms"][name] for info in record.infos) for name in record.infos[0]["cost_terms"]}


@pytest.mark.parametrize("control_hz", [10, 50])
@pytest.mark.parametrize("name", CUTTERS)
def test_it_adds_up_to_the_overshoot_and_the_long_parts_of_the_runs_in_the_trace(name, control_hz):
    arguments = {"specimen_class": "mixed", "deadline_s": 15.0, "control_hz": control_hz}
    for found in batched_rollout(CUTTERS[name], range(12), arguments, readings=True):
        expected = by_trace(found.readings, found.truth["target_length_m"])
        assert found.cost_totals == pytest.approx(expected, abs=1e-9)
        row = found.scores()
        assert row["cost_mm"] == pytest.approx(row["overshoot_mm"] + row["long_runs_mm"], abs=1e-12)


def test_both_parts_occur_and_force_is_no_cost():
    assert summed(cut(make(specimen_class="vascular"), steady(0.01), seed=1))["long_runs_mm"] > 1.0
    assert summed(cut(make(**QUIET), steady(0.01)))["overshoot_mm"] > 5.0
    strong = cut(make(force_limit_per_depth=160.0, **QUIET), steady(0.01))
    assert strong.end == "force_limit"
    assert summed(strong) == {"overshoot_mm": 0.0, "long_runs_mm": 0.0}


def test_it_is_zero_at_the_start_and_by_the_estimate_where_the_reward_is():
    env = make(specimen_class="liver", reward_from="estimate")
    _, info = env.reset(seed=1)
    assert info["cost"] == 0.0
    assert info["cost_terms"] == {"overshoot_mm": 0.0, "long_runs_mm": 0.0}
    record, cutting = cut(env, steady(FASTEST, INCLINED), seed=1), env.unwrapped.cutting
    found = summed(record)["overshoot_mm"]
    assert found == pytest.approx(1e3 * max(cutting.tip - cutting.target_length, 0.0))
    assert found != pytest.approx(by_trace(record.readings, cutting.target_length)["overshoot_mm"], abs=1e-3)
