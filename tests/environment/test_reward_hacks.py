"""A reward hack is a bug: nothing that avoids the task pays better than an honest cut of the same specimens."""

from __future__ import annotations

import functools

import numpy as np
import pytest
from hacks import HACKS, KEYWORDS, probing
from whole_cut import FASTEST, INCLINED, UPRIGHT, Script, cut, make

from cutenv.policy import ConstantFeed

SEEDS = range(10)
CLASSES = ("uniform", "liver")
MANY = [(family, name) for family in HACKS for name in HACKS[family]]


def returns(policy, **keywords) -> np.ndarray:
    """Ten cuts of even tissue and ten of liver; one unlucky run over the target does not decide among so many."""
    totals = []
    for specimen_class in CLASSES:
        policy.env = env = make(specimen_class=specimen_class, **keywords)
        totals += [cut(env, policy, seed).total for seed in SEEDS]
    return np.array(totals)


@functools.cache
def honest(**keywords: float) -> np.ndarray:
    """The best constant feed known: fast, and inclined until the end."""
    return returns(ConstantFeed(speed=FASTEST, angle=INCLINED), **keywords)


def check_that_it_does_not_pay(hack, weights=None, **keywords) -> None:
    weights = weights or {}
    gained = returns(hack, **weights, **keywords) - honest(**weights)
    assert gained.mean() < 0.0, f"the hack returns {gained.mean():.3f} more than an honest cut"


@pytest.mark.parametrize(("family", "name"), MANY, ids=[": ".join(case) for case in MANY])
def test_no_hack_beats_an_honest_cut(family, name):
    check_that_it_does_not_pay(HACKS[family][name], **KEYWORDS.get(name, {}))


WRONG_WEIGHTS = {
    ("hardly cutting", "10 mm and out"): {"weight_tip_error": 0.0, "weight_time": 12.0},
    ("leaving the tissue loaded", "creeping back"): {"weight_backward": 10.0, "weight_tip_error": 0.0},
    ("ending early", "by force near the target"): {
        "weight_tip_error": 0.0,
        "weight_wedge": 0.0,
        "weight_backward": 30.0,
    },
}


@pytest.mark.parametrize("case", WRONG_WEIGHTS, ids=": ".join)
def test_with_other_weights_it_would_pay_and_be_noticed(case):
    family, name = case
    with pytest.raises(AssertionError, match="more than an honest cut"):
        check_that_it_does_not_pay(HACKS[family][name], WRONG_WEIGHTS[case])


def test_the_honest_cut_is_worth_doing():
    assert honest().mean() > 0.3


def test_one_or_two_unload_probes_stay_worth_while():
    for number in (1, 2):
        assert returns(probing(number)).mean() > max(honest().mean() - 0.12 * number, 0.3)


@pytest.mark.parametrize("speed", [FASTEST, 0.0127])
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
    for family in ("hardly cutting", "ending early", "leaving the tissue loaded"):
        for name, hack in HACKS[family].items():
            hack.env = env = make(specimen_class="uniform", **KEYWORDS.get(name, {}))
            record = cut(env, hack, 0)
            near = abs(record.infos[-1]["truth"]["tip_m"] - record.infos[-1]["truth"]["target_length_m"]) <= 0.003
            assert near or not record.infos[-1]["is_success"]
