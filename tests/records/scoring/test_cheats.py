"""A record gains nothing by its logger, nor by being forged: at most three points, or no score, or it is doubted."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d, uniform_filter1d
from scipy.signal import lfilter
from scored_cuts import rated

from cutenv.agents.learning.evaluation import batched_rollout
from cutenv.records.scoring import ReferenceSet, ScoreCard, score
from cutenv.records.scoring.doubts import DOUBT
from cutenv.records.scoring.points import CHARGED
from cutenv.records.scoring.truth import TIP_AT_END
from cutenv.sim.plant.protocol import recorded_trace
from cutenv.sim.trace import Trace
from cutenv.task.reward import RewardWeights
from scripts.validation.scoring.check_score import (
    CHANGES,
    RATES,
    doubts_report,
    forged,
    player,
    with_fast_clock,
    with_smooth_position,
)
from scripts.validation.scoring.simulated_hands import SKILLS

GAIN = 3.0
"""Points that a changed record may have more than the same cut as it was."""
PLAYERS = (("steady hand", (0, 1, 3)), ("hurried hand", (3, 5, 7)), ("return stroke", (0, 1)))
"""Who cuts which livers."""


@functools.cache
def records() -> tuple[Trace, ...]:
    """Records of cuts of livers: by people, who are named in them, and by a script that moves the blade itself."""
    found = []
    for name, seeds in PLAYERS:
        person = {"operator": "p07"} if name in SKILLS else {}
        policy, arguments = player(name)
        for cut in batched_rollout(policy, seeds, {**arguments, "specimen_class": "liver"}, readings=True):
            noted = {TIP_AT_END: float(cut.readings["tip"][-1]), "target_length_m": cut.truth["target_length_m"]}
            found.append(recorded_trace(cut.readings, cut.measured_depth, end=cut.end, **noted, **person))
    return tuple(found)


@functools.cache
def honest_cards() -> tuple[ScoreCard, ...]:
    return tuple(score(each) for each in records())


def renoted(trace: Trace, **notes: object) -> Trace:
    """The record with other notes; None takes one out."""
    return trace.with_metadata({k: v for k, v in {**trace.metadata, **notes}.items() if v is not None})


def doubts(card: ScoreCard) -> list[str]:
    return [note for note in card.notes if note.startswith(DOUBT)]


def noise(trace: Trace, size: float, over: int = 1) -> np.ndarray:
    """Noise of a standard deviation [N], whose readings are alike over so many."""
    found = uniform_filter1d(np.random.default_rng(0).normal(0.0, 1.0, len(trace)), over)
    return np.asarray(size * found / found.std())


def noisy(size: float, over: int = 1) -> Callable[[Trace], Trace]:
    return lambda trace: forged(trace, force=trace.force + noise(trace, size, over))


def moved(change: Callable[[np.ndarray], np.ndarray]) -> Callable[[Trace], Trace]:
    """A record with another position, which is read every millisecond."""
    return lambda trace: forged(trace, position=change(trace.position))  # type: ignore[arg-type]


def behind(position: np.ndarray) -> np.ndarray:
    """A position that follows by 0.1 s."""
    return np.asarray(lfilter([0.01], [1.0, -0.99], position - position[0]) + position[0])


def never_fast(position: np.ndarray) -> np.ndarray:
    """A position that follows at 3 cm/s at most."""
    found = position.copy()
    for i in range(1, len(found)):
        found[i] = found[i - 1] + np.clip(position[i] - found[i - 1], -3e-5, 3e-5)
    return np.asarray(found)


def fast_where_the_blade_is(trace: Trace) -> Trace:
    """A clock that goes on the faster, the faster the blade moves beyond 2 cm/s."""
    steps = np.diff(trace.time) * np.maximum(1.0, np.abs(trace.blade_speed[1:]) / 0.02)
    return forged(trace, time=np.append(0.0, np.cumsum(steps)))


def offset(size: float) -> Callable[[Trace], Trace]:
    return lambda trace: forged(trace, force=trace.force + size)


def left_off(trace: Trace) -> Trace:
    """The record up to the target, noted as finished there."""
    target = trace.metadata["target_length_m"]
    first = int(np.argmax(trace.position >= min(target, float(trace.position.max()))))  # type: ignore[operator, union-attr]
    return renoted(trace.select(slice(0, first + 1)), **{TIP_AT_END: target - 0.002, "end": "finished"})


def at_the_target(trace: Trace) -> Trace:
    """The record, with a tip noted at the target, or as near as the blade came."""
    nearest = min(trace.metadata["target_length_m"], float(trace.position.max()) + 0.003)  # type: ignore[union-attr]
    return renoted(trace, **{TIP_AT_END: nearest, "end": "finished"})


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
    return renoted(short, **{TIP_AT_END: 0.08, "end": "finished"})


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
    "a noise of 0.1 N": noisy(0.1),
    "a noise of 0.2 N": noisy(0.2),
    "a noise of 0.4 N": noisy(0.4),
    "a slow noise of 0.2 N": noisy(0.2, over=20),
    "less by 0.3 N": offset(-0.3),
    "more by 0.3 N": offset(0.3),
    "noted as finished before its end": left_off,
    "a tip noted at the target": at_the_target,
    "twice the depth": lambda trace: forged(trace, depth=2.0 * trace.depth),  # type: ignore[operator]
    "half the depth": lambda trace: forged(trace, depth=0.5 * trace.depth),  # type: ignore[operator]
    "half the time": lambda trace: forged(trace, time=0.5 * trace.time),
    "in a second": lambda trace: forged(trace, time=trace.time / trace.time[-1]),
    "upright": lambda trace: forged(trace, angle=np.full(len(trace), 0.5 * math.pi)),
    "turned round": lambda trace: forged(trace, force=-trace.force),
}
"""Changes to a record, by name."""
MOTIONS: dict[str, Callable[[Trace], Trace]] = {
    "position smoothed over 50 ms": CHANGES["position smoothed over 50 ms"],
    "position smoothed over 0.1 s": with_smooth_position(100),
    "position smoothed over 0.3 s": with_smooth_position(300),
    "position smoothed over 1 s": with_smooth_position(1000),
    "position smoothed by a bell": moved(lambda position: gaussian_filter1d(position, 100)),
    "position behind": moved(behind),
    "position never fast": moved(never_fast),
    "clock faster by a factor of 1.5": CHANGES["clock faster by a factor of 1.5"],
    "clock faster by a factor of 2": CHANGES["clock faster by a factor of 2"],
    "clock faster by a factor of 3": with_fast_clock(3.0),
    "a clock that is fast where the blade is": fast_where_the_blade_is,
}
"""Changes to the motion of a person's record."""


@functools.cache
def changed_card(name: str, number: int) -> ScoreCard:
    """Card of a record after a change."""
    return score({**CHEATS, **MOTIONS}[name](records()[number]))


@pytest.mark.parametrize("name", [*CHEATS, *MOTIONS])
def test_a_changed_record_gains_nothing(name: str) -> None:
    """Or it is doubted beside the score, which the honest one is not."""
    for number, honest in enumerate(honest_cards()):
        if name in MOTIONS and "operator" not in records()[number].metadata:
            continue
        after = changed_card(name, number)
        before = honest.overall_score or 0.0
        doubted = bool(doubts(after)) and not doubts(honest)
        assert (after.overall_score or 0.0) <= before + GAIN or doubted, (name, before, after.headline())
        assert (after.overall_score is None) == bool(after.no_score)


@pytest.mark.parametrize("name", ["position smoothed over 0.3 s", "position smoothed over 1 s", "position never fast"])
def test_a_smoothed_record_that_names_nobody_is_scored_as_a_drives_and_says_so(name: str) -> None:
    for trace, honest in zip(records(), honest_cards(), strict=True):
        after = score(renoted(MOTIONS[name](trace), operator=None))
        told = any(note.startswith("nobody is named, so the blade is taken to be on a drive") for note in after.notes)
        gains = (after.overall_score or 0.0) > (honest.overall_score or 0.0) + GAIN
        assert told or doubts(after) or not gains, (name, honest.headline(), after.headline())
        assert not any(note.startswith("nobody") for note in honest.notes) or "operator" not in trace.metadata


def test_a_tip_that_is_noted_ahead_of_the_blade_has_no_score() -> None:
    for trace in records():
        farthest = float(trace.position.max())  # type: ignore[union-attr]
        for ahead in (0.002, 0.004):
            assert (
                "ahead of where the blade has been" in score(renoted(trace, **{TIP_AT_END: farthest + ahead})).no_score
            )


def test_a_score_that_the_cheats_could_raise_is_there() -> None:
    scores = [card.overall_score for card in honest_cards()]
    assert sum(each is not None and each > 50.0 for each in scores) >= 4
    assert not any(doubts(card) for card in honest_cards())


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("air", "no cut: the force rises by"),
        ("air and an offset", "no cut: the force rises by"),
        ("air and a drift", "times the work that cutting this tissue takes"),
        ("a tip that is claimed", "ahead of where the blade has been"),
        ("sixtyfold", "which hides how the tissue runs"),
        ("tenth", "times the work that cutting this tissue takes"),
        ("smoothed over 1.5 s", "a filter has taken out what is scored"),
        ("steady", "the force stays at its largest for"),
        ("a noise of 0.2 N", "a noise of 0.2"),
        ("a slow noise of 0.2 N", "which hides how the tissue runs"),
    ],
)
def test_what_is_no_record_of_a_cut_says_why(name: str, says: str) -> None:
    for number, trace in enumerate(records()):
        if trace.metadata["end"] == "finished":
            found = changed_card(name, number)
            assert says in found.no_score
            assert not found.points


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (MOTIONS["position smoothed over 50 ms"], "of a lurch comes before the fall of the force"),
        (MOTIONS["clock faster by a factor of 1.5"], "times as slowly as a hand does"),
        (MOTIONS["position smoothed over 1 s"], "the blade hardly lurches at "),
        (offset(0.8), "N at the start, before anything is touched"),
        (CHEATS["noted as finished before its end"], "ends before the blade rests or is drawn back"),
    ],
)
def test_what_may_be_forged_is_doubted(change: Callable[[Trace], Trace], says: str) -> None:
    trace = records()[0]
    assert any(says in note for note in doubts(score(change(trace))))
    assert not any(says in note for note in doubts(score(trace)))


def test_too_few_readings_are_not_scored() -> None:
    assert "20 readings a second are too few" in score(rated(records()[0], 20.0)).no_score


def test_a_spike_is_left_out_and_told() -> None:
    found = score(spiked(records()[-1]))
    assert found.overall_score == pytest.approx(honest_cards()[-1].overall_score, abs=0.5)
    assert any("one reading left out, 55 N" in note for note in found.notes)


def test_the_charges_are_the_tasks() -> None:
    weights = RewardWeights()
    assert {name: getattr(weights, name) for name in CHARGED} == CHARGED


def test_doubts_and_gains_are_counted() -> None:
    """A record without a score, honest or changed, is in no count of doubts, and gains nothing."""
    base = {"class": "liver", "policy": "hurried hand", "refused": 0.0, "lasts": 0.02, "quickness": 1.7, "early": 0.1}
    rows = []
    for seed, before in ((0, 20.0), (1, 30.0), (2, np.nan)):
        for record in (*RATES, *CHANGES):
            quick = {"score": before + 5.0 + seed, "doubted": 1.0 - seed} if record in CHANGES else {}
            rows.append(base | {"seed": seed, "record": record, "score": before, "doubted": 0.0} | quick)
    said = doubts_report(rows)
    assert "| by simulated people: doubted | 0 of 2 | 0 of 2 | 0 of 2 | 0 of 2 |" in said
    assert "| as it is | 20 to 20 ms | 1.70 to 1.70 | 10 % | 0 of 2 |  |  |" in said
    assert "| clock faster by a factor of 2 | 20 to 20 ms | 1.70 to 1.70 | 10 % | 1 of 2 | 6.0 | 6.0 |" in said


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
