"""Sensible scripts do better than random actions and than none, by intervals that do not overlap."""

from __future__ import annotations

import functools

import numpy as np
import pytest
from whole_cut import CRUISE, FASTEST, INCLINED, UPRIGHT, Cut, cut, interval, make

from cutenv._engine.randomness import generator
from cutenv.policy import (
    ConstantFeed,
    FastThenSlow,
    ForceFeedback,
    InclineBetween,
    NoAction,
    ProbeAndCreep,
    RandomAction,
)
from cutenv.tissue import Specimen
from cutenv.tissue.specimen import SPACING

SEEDS = {"random": range(12), "nothing": range(2)}  # nothing happens to the blade that does nothing
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
CLASSES = ("mixed", "liver")


@functools.cache
def cuts(name: str, specimen_class: str) -> list[Cut]:
    env = make(specimen_class=specimen_class)
    return [cut(env, (SCRIPTS | IDLERS)[name], seed) for seed in SEEDS.get(name, range(14))]


def returns(name: str, specimen_class: str) -> np.ndarray:
    return np.array([record.total for record in cuts(name, specimen_class)])


@pytest.mark.parametrize("specimen_class", CLASSES)
def test_a_script_beats_random_and_nothing_by_intervals_that_do_not_overlap(specimen_class):
    best_idler = max(interval(returns(idler, specimen_class))[1] for idler in IDLERS)
    for script in SCRIPTS:
        assert interval(returns(script, specimen_class))[0] > best_idler, script


def test_random_actions_do_not_beat_themselves_so_the_check_can_fail():
    some = returns("random", "liver")
    assert interval(some[:6])[0] < interval(some[6:])[1]


def test_scripts_mostly_finish_and_idlers_never_succeed():
    for script in SCRIPTS:
        records = cuts(script, "mixed")
        assert sum(record.end == "finished" for record in records) >= 0.8 * len(records), script
        assert sum(record.infos[-1]["is_success"] for record in records) >= 0.3 * len(records), script
    assert not any(record.infos[-1]["is_success"] for name in IDLERS for record in cuts(name, "mixed"))


@pytest.mark.parametrize("specimen_class", CLASSES)
def test_every_finished_cut_scores_above_doing_nothing(specimen_class):
    nothing = returns("nothing", specimen_class).max()
    for script in SCRIPTS:
        finished = [record.total for record in cuts(script, specimen_class) if record.end == "finished"]
        assert min(finished) > nothing, script


def test_no_return_exceeds_one():
    assert max(returns(name, "mixed").max() for name in SCRIPTS | IDLERS) <= 1.0


DRAWN = range(40)
SLOW = [(0.0038, INCLINED), (0.0038, UPRIGHT), (0.0089, UPRIGHT)]


@functools.cache
def toughest(specimen_class: str, count: int = 4) -> list[Specimen]:
    """Of forty drawn, those with the greatest resistance where the cut goes; still tougher ones score less."""
    if specimen_class == "uniform":
        return [Specimen.draw(generator(0), specimen_class="uniform")]
    drawn = [Specimen.draw(generator(seed), specimen_class=specimen_class) for seed in DRAWN]
    cut_through = slice(0, round(0.080 / SPACING))
    return sorted(drawn, key=lambda specimen: -specimen.fracture_force()[cut_through].mean())[:count]


def returns_of_slow_finished_cuts(specimens: list[Specimen], **weights: float) -> list[float]:
    env = make(**weights)
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
    assert min(finished) > returns("nothing", "mixed").max()


def test_with_much_larger_weights_of_force_and_lag_it_does_not_so_the_check_can_fail():
    larger = {"weight_force": 0.25, "weight_lag": 0.25}
    nothing = cut(make(**larger), NoAction()).total
    assert min(returns_of_slow_finished_cuts(toughest("liver"), **larger)) < nothing
