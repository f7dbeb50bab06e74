"""A record gains nothing by its logger, nor by being forged: at most three points, or no score, with a reason."""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Callable

import numpy as np
import pytest
from scipy.ndimage import uniform_filter1d
from scored_cuts import rated
from simulated_hands import DRIVEN, SKILLS, SimulatedHand

from cutenv.learning.evaluation import FinishedCut, batched_rollout, contestant
from cutenv.plant.protocol import recorded_trace
from cutenv.scoring import ReferenceSet, ScoreCard, score
from cutenv.scoring.points import CHARGED
from cutenv.scoring.truth import TIP_AT_END
from cutenv.task.weights import RewardWeights
from cutenv.trace import Trace

GAIN = 3.0
"""Points that a changed record may have more than the same cut as it was."""
SEEDS = (0, 1, 3, 5)


@functools.cache
def cuts() -> tuple[FinishedCut, ...]:
    """Cuts of livers by steady people, and by a script that moves the blade itself."""
    hand, one = SimulatedHand(SKILLS["steady hand"]), contestant("return stroke")
    people = batched_rollout(hand, SEEDS, {**DRIVEN, "specimen_class": "liver"}, readings=True)
    script = batched_rollout(one.policy, SEEDS, {**one.arguments, "specimen_class": "liver"}, readings=True)
    return (*people, *script)


def record(cut: FinishedCut) -> Trace:
    noted = {TIP_AT_END: float(cut.readings["tip"][-1]), "end": cut.end}
    return recorded_trace(cut.readings, cut.measured_depth, **noted)


def forged(trace: Trace, **fields: object) -> Trace:
    return dataclasses.replace(trace, speed=None, **fields)  # type: ignore[arg-type]


def card(cut: FinishedCut, trace: Trace) -> ScoreCard:
    return score(trace, target_length=float(cut.truth["target_length_m"]))


def noise(trace: Trace, size: float) -> np.ndarray:
    return np.random.default_rng(0).normal(0.0, size, len(trace))


def smooth(seconds: float) -> Callable[[Trace], Trace]:
    return lambda trace: forged(trace, force=uniform_filter1d(trace.force, round(seconds * trace.sample_rate)))


def scaled(factor: float) -> Callable[[Trace], Trace]:
    return lambda trace: forged(trace, force=np.minimum(factor * trace.force, 500.0))


def in_the_air(offset: float, drift: float) -> Callable[[Trace], Trace]:
    return lambda trace: forged(trace, force=offset + drift * trace.time / trace.time[-1] + noise(trace, 0.005))


def spiked(trace: Trace) -> Trace:
    force = trace.force.copy()
    force[len(force) // 2] = 55.0
    return forged(trace, force=force)


def claimed(trace: Trace) -> Trace:
    short = trace.select(slice(0, int(np.argmax(trace.position > 0.02))))  # type: ignore[operator]
    return forged(short, metadata=dict(trace.metadata) | {TIP_AT_END: 0.08, "end": "finished"})


CHEATS: dict[str, Callable[[Trace], Trace]] = {
    "100 Hz": lambda trace: rated(trace, 100.0),
    "50 Hz": lambda trace: rated(trace, 50.0),
    "30 Hz": lambda trace: rated(trace, 30.0),
    "smoothed over 0.3 s": smooth(0.3),
    "smoothed over 1.5 s": smooth(1.5),
    "tenth": scaled(0.1),
    "third": scaled(0.3),
    "half": scaled(0.5),
    "sixtyfold": scaled(60.0),
    "a spike": spiked,
    "air": in_the_air(0.0, 0.0),
    "air and an offset": in_the_air(0.85, 0.0),
    "air and a drift": in_the_air(0.0, 0.5),
    "a tip that is claimed": claimed,
    "at its limit": lambda trace: forged(trace, force=np.minimum(trace.force, 2.0 + noise(trace, 0.01))),
    "steady": lambda trace: forged(trace, force=np.where(trace.force > 0.5, 2.0, trace.force) + noise(trace, 0.01)),
    "a noise of 0.1 N": lambda trace: forged(trace, force=trace.force + noise(trace, 0.1)),
    "twice the depth": lambda trace: forged(trace, depth=2.0 * trace.depth),  # type: ignore[operator]
    "half the depth": lambda trace: forged(trace, depth=0.5 * trace.depth),  # type: ignore[operator]
    "half the time": lambda trace: forged(trace, time=0.5 * trace.time),
    "in a second": lambda trace: forged(trace, time=trace.time / trace.time[-1]),
    "upright": lambda trace: forged(trace, angle=np.full(len(trace), 0.5 * math.pi)),
    "turned round": lambda trace: forged(trace, force=-trace.force),
}
"""Changes to a record, by name."""


@pytest.mark.parametrize("name", CHEATS)
def test_a_changed_record_gains_nothing(name: str) -> None:
    for cut in cuts():
        before = card(cut, record(cut)).overall_score or 0.0
        after = card(cut, CHEATS[name](record(cut)))
        assert (after.overall_score or 0.0) <= before + GAIN, (name, before, after.headline())
        assert (after.overall_score is None) == bool(after.no_score)


def test_a_score_that_the_cheats_could_raise_is_there() -> None:
    scores = [card(cut, record(cut)).overall_score for cut in cuts()]
    assert sum(each is not None and each > 50.0 for each in scores) >= 4


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("air", "no cut: the force rises by"),
        ("air and an offset", "no cut: the force rises by"),
        ("air and a drift", "times the work that cutting this tissue takes"),
        ("a tip that is claimed", "ahead of where the blade has been"),
        ("sixtyfold", "times the work that cutting this tissue takes"),
        ("tenth", "times the work that cutting this tissue takes"),
        ("smoothed over 1.5 s", "a filter has taken out what is scored"),
        ("steady", "the force stays at its largest for"),
    ],
)
def test_what_is_no_record_of_a_cut_says_why(name: str, says: str) -> None:
    for cut in cuts():
        if cut.end == "finished":
            found = card(cut, CHEATS[name](record(cut)))
            assert says in found.no_score
            assert not found.points


def test_too_few_readings_are_not_scored() -> None:
    cut = cuts()[0]
    assert "20 readings a second are too few" in card(cut, rated(record(cut), 20.0)).no_score


def test_a_spike_is_left_out_and_told() -> None:
    cut = cuts()[-1]
    found = card(cut, spiked(record(cut)))
    assert found.overall_score == pytest.approx(card(cut, record(cut)).overall_score, abs=0.5)
    assert any("one reading left out, 55 N" in note for note in found.notes)


def test_the_charges_are_the_tasks() -> None:
    weights = RewardWeights()
    assert {name: getattr(weights, name) for name in CHARGED} == CHARGED


def pushed(seed: int) -> Trace:
    """A force over time of no law: loads that fall away, with noise."""
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, 8.0, 1.0 / 30.0)
    force = 2.0 * np.minimum(time, 1.0) + 0.5 * ((1.3 + 0.2 * seed) * time % 1.0) + rng.normal(0.0, 0.03, len(time))
    return Trace(time=time, force=force)


FROZEN = (69.46666666666667, 68.16666666666666, 65.11944444444444, 63.3)
"""Scores of the first version; they never move."""


def test_the_score_of_a_force_alone_is_frozen() -> None:
    reference = ReferenceSet.shipped("force-alone")
    scores = [score(pushed(seed), reference=reference).overall_score for seed in range(4)]
    assert scores == list(FROZEN)
