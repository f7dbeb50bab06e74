"""Nothing that avoids the task pays better than an honest cut, and sensible scripts do better than random actions."""

from __future__ import annotations

import functools
from typing import Any

import numpy as np
import pytest
from hacks import HACKS, KEYWORDS, Ended, Hack, ProbingEnd, cut_all, probing
from whole_cut import CRUISE, FASTEST, INCLINED, UPRIGHT, Script, cut, interval, make

from cutenv._engine.randomness import generator
from cutenv.agents.policy import (
    ConstantFeed,
    FastThenSlow,
    ForceFeedback,
    InclineBetween,
    NoAction,
    Policy,
    ProbeAndCreep,
    RandomAction,
    StopAndUnload,
)
from cutenv.sim.tissue import Specimen
from cutenv.sim.tissue.specimen import SPACING

FEW, SEEDS = range(3), range(24)
CLASSES = ("uniform", "liver")
ENDINGS = {"stop and unload": StopAndUnload, "probe and creep": ProbingEnd}


def returns(policy: Policy | Hack, seeds: range = SEEDS, **keywords: float) -> np.ndarray:
    """Return the returns of a policy in even tissue and in liver, shape (2, seeds)."""
    return np.array([cut_all(policy, seeds, specimen_class=name, **keywords).returns for name in CLASSES])


def constant_feed() -> ConstantFeed:
    return ConstantFeed(speed=CRUISE, angle=INCLINED)


@functools.cache
def honest(ending: str, seeds: range = SEEDS, **keywords: float) -> np.ndarray:
    """Returns of the honest cut that ends so: the best constant feed, or the script that probes."""
    return returns(constant_feed() if ending == "stop and unload" else ProbeAndCreep(), seeds, **keywords)


def check_that_it_does_not_pay(hack: Hack, ending: str, weights=None, **keywords) -> None:
    """The hack returns no more than an honest cut of the same specimens.

    Where a crack that runs comes to rest is chance, and after a plain stop that chance is in the return: a gain counts
    if it is more than chance, and with an end that probes also if it is more than a hundredth.
    """
    weights = weights or {}
    gained = returns(hack.end_as(ENDINGS[ending]), **weights, **keywords) - honest(ending, **weights)
    assert interval(gained)[0] < 0.0, f"the hack returns {gained.mean():.3f} more than an honest cut"
    if ending != "stop and unload":
        assert gained.mean() < 0.01, f"the hack returns {gained.mean():.3f} more than an honest cut"


def cases(stops: bool) -> list[Any]:
    return [
        pytest.param(hack, KEYWORDS.get(name, {}), id=f"{family}: {name}")
        for family, hacks in HACKS.items()
        for name, hack in hacks.items()
        if hack.stops == stops
    ]


@pytest.mark.parametrize(("hack", "keywords"), cases(stops=False))
def test_no_hack_that_avoids_the_task_beats_either_honest_cut(hack, keywords):
    gained = returns(hack, FEW, **keywords).mean()
    honestly = [honest(ending, FEW).mean() for ending in ENDINGS]
    assert gained < min(honestly)
    assert gained < max(honestly) - 0.1


@pytest.mark.parametrize("ending", ENDINGS)
@pytest.mark.parametrize(("hack", "keywords"), cases(stops=True))
def test_no_hack_on_the_way_beats_an_honest_cut_that_ends_as_it_does(hack, keywords, ending):
    check_that_it_does_not_pay(hack, ending, **keywords)


NO_ERROR = {"weight_accuracy": 0.0, "weight_success": 0.0}
WRONG_WEIGHTS = {
    ("hovering", "at the clamp"): {**NO_ERROR, "weight_time": 0.0, "weight_jump": 30.0},
    ("shallow or hardly cutting", "half of it and out"): {**NO_ERROR, "weight_time": 0.0, "weight_jump": 30.0},
    ("ending early", "by force near the target"): {**NO_ERROR, "weight_wedge": 0.0, "weight_backward": 30.0},
    ("leaving the tissue loaded", "creeping back"): {**NO_ERROR, "weight_backward": 10.0},
    ("force dither", "5 % about R B"): {"weight_jump": 3.0, "weight_uncontrolled": 3.0, "weight_backward": 0.0},
    ("pumping speed", "every decision"): {"weight_haste": 3.0, "weight_time": 0.0},
    ("leaving the measured speed range", "in and out"): {"weight_haste": 3.0, "weight_time": 0.0},
    ("haste by turns", "at high force"): {"weight_haste": 5.0, "weight_time": 0.0},
}


@pytest.mark.parametrize("case", WRONG_WEIGHTS, ids=": ".join)
def test_with_other_weights_it_would_pay_and_be_noticed(case):
    family, name = case
    with pytest.raises(AssertionError, match="more than an honest cut"):
        check_that_it_does_not_pay(HACKS[family][name], "stop and unload", WRONG_WEIGHTS[case])


@pytest.mark.parametrize("ending", ENDINGS)
def test_the_honest_cut_is_worth_doing(ending):
    assert honest(ending).mean() > 0.5


@pytest.mark.parametrize("number", [1, 2])
def test_a_blind_unload_probe_costs_less_than_a_tenth(number):
    cost = honest("probe and creep") - returns(probing(number).end_as(ProbingEnd))
    assert 0.0 < cost.mean() < 0.1 * number


@pytest.mark.parametrize("probes", [2, 3])
def test_one_or_two_unload_probes_that_tell_where_to_go_on_are_worth_while(probes):
    """The last of them only tells that the tip has arrived."""
    probed, plain = (cut_all(policy, range(50)) for policy in (ProbeAndCreep(probes=probes), constant_feed()))
    more_success = probed.success.astype(float) - plain.success
    assert np.mean(probed.returns - plain.returns) > 0.0
    assert np.mean(more_success) > 0.0
    assert probes == 2 or interval(more_success)[0] > 0.0  # one probe that leads on tells less


@pytest.mark.parametrize("speed", [FASTEST, CRUISE])
def test_what_happens_between_decisions_is_not_hidden_from_the_reward(speed):
    """The same motion, decided 10 and 100 times a second."""
    totals = []
    for control_hz in (10, 100):
        policy = Script(
            lambda count, seen, hz=control_hz: (speed if count * 10 // hz % 4 < 2 else -0.2 * speed, UPRIGHT)
        )
        totals.append(cut(make(control_hz=control_hz, specimen_class="liver", deadline_s=8.0), policy, 2).totals)
    assert totals[0] == pytest.approx(totals[1], abs=1e-9)


@pytest.mark.parametrize("speed", [0.0005, 0.0009])
def test_time_is_paid_for_even_where_the_tissue_is_no_softer(speed):
    """Below the measured range the modulus stays that of 1 mm/s, so that slowness buys nothing but time."""
    slow, measured = (
        cut(make(specimen_class="uniform", deadline_s=150.0, target_length=0.06), ConstantFeed(speed=v))
        for v in (speed, 0.001)
    )
    assert slow.total < measured.total
    assert slow.totals["uncontrolled"] == pytest.approx(measured.totals["uncontrolled"], abs=0.03)


def test_no_hack_ends_in_a_success_before_the_target():
    for family in ("shallow or hardly cutting", "ending early", "leaving the tissue loaded"):
        for name, hack in HACKS[family].items():
            ended = cut_all(hack, [0], specimen_class="uniform", **KEYWORDS.get(name, {}))
            assert ended.tip_error[0] <= 0.003 or not ended.success[0]


CUTS_OF = {"random": range(12), "nothing": range(2)}  # nothing happens to the blade that does nothing
SCRIPTS = {
    "fast and inclined": ConstantFeed(speed=FASTEST, angle=INCLINED),
    "fast and upright": ConstantFeed(speed=FASTEST),
    "half as fast": ConstantFeed(speed=CRUISE, angle=UPRIGHT),
    "half as fast and inclined": ConstantFeed(speed=CRUISE, angle=INCLINED),
    "fast, then slow": FastThenSlow(),
    "90-45-90": InclineBetween(),
    "force feedback": ForceFeedback(),
    "probe and creep": ProbeAndCreep(),
}
IDLERS = {"random": RandomAction(), "nothing": NoAction()}
BOTH_CLASSES = ("mixed", "liver")


@functools.cache
def cuts(name: str, specimen_class: str) -> Ended:
    return cut_all((SCRIPTS | IDLERS)[name], CUTS_OF.get(name, range(14)), specimen_class=specimen_class)


def returns_of(name: str, specimen_class: str) -> np.ndarray:
    return cuts(name, specimen_class).returns


@pytest.mark.parametrize("specimen_class", BOTH_CLASSES)
def test_a_script_beats_random_and_nothing_by_intervals_that_do_not_overlap(specimen_class):
    best_idler = max(interval(returns_of(idler, specimen_class))[1] for idler in IDLERS)
    for script in SCRIPTS:
        assert interval(returns_of(script, specimen_class))[0] > best_idler, script


def test_scripts_mostly_finish_and_idlers_never_succeed():
    for script in SCRIPTS:
        ended = cuts(script, "mixed")
        assert np.mean(ended.ends == "finished") >= 0.8, script
        assert np.mean(ended.success) >= 0.3, script
    assert not any(cuts(name, "mixed").success.any() for name in IDLERS)


@pytest.mark.parametrize("specimen_class", BOTH_CLASSES)
def test_every_finished_cut_scores_above_doing_nothing(specimen_class):
    nothing = returns_of("nothing", specimen_class).max()
    for script in SCRIPTS:
        ended = cuts(script, specimen_class)
        assert ended.returns[ended.ends == "finished"].min() > nothing, script


def test_no_return_exceeds_one():
    assert max(returns_of(name, "mixed").max() for name in SCRIPTS | IDLERS) <= 1.0


DRAWN = range(40)
SLOW = [(0.0038, INCLINED), (0.0038, UPRIGHT), (0.0089, UPRIGHT)]


@functools.cache
def toughest(specimen_class: str, count: int = 4) -> list[Specimen]:
    """Specimens of forty drawn with the greatest resistance along the cut; still tougher ones score less."""
    if specimen_class == "uniform":
        return [Specimen.draw(generator(0), specimen_class="uniform")]
    drawn = [Specimen.draw(generator(seed), specimen_class=specimen_class) for seed in DRAWN]
    cut_through = slice(0, round(0.080 / SPACING))
    return sorted(drawn, key=lambda specimen: -specimen.fracture_force()[cut_through].mean())[:count]


def returns_of_slow_finished_cuts(specimens: list[Specimen], **weights: float) -> list[float]:
    env = make(control_hz=10, **weights)
    records = [
        cut(env, ConstantFeed(speed=speed, angle=angle), specimen=specimen, target_length=length)
        for speed, angle in SLOW
        for length in (0.060, 0.080, 0.100)
        for specimen in specimens
    ]
    return [record.total for record in records if record.end == "finished"]


@pytest.mark.parametrize("specimen_class", ["uniform", "liver"])
def test_a_slow_finished_cut_of_the_toughest_tissue_scores_above_doing_nothing(specimen_class):
    finished = returns_of_slow_finished_cuts(toughest(specimen_class))
    assert len(finished) >= 3
    assert min(finished) > returns_of("nothing", "mixed").max()


def test_random_actions_do_not_beat_themselves_so_the_check_can_fail():
    some = returns_of("random", "liver")
    assert interval(some[:6])[0] < interval(some[6:])[1]


def test_with_much_larger_weights_of_force_and_lag_it_does_not_so_the_check_can_fail():
    larger = {"weight_force": 0.25, "weight_lag": 0.25}
    nothing = cut(make(**larger), NoAction()).total
    assert min(returns_of_slow_finished_cuts(toughest("liver"), **larger)) < nothing
