"""Bad records get no overall score, for a clear reason."""

from __future__ import annotations

import functools
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scored_cuts import TARGET, changed, check_card, cut, force_alone

from cutenv.recording import load
from cutenv.scoring import METRICS, ReferenceSet, ScoreCard, Truth, score
from cutenv.scoring.metric import FORCE_WEIGHTS
from cutenv.trace import Trace

GOOD = "upright, and back"
ONE_WAY = "upright, one way"
USES_FORCE = [
    name for name in METRICS if name not in {"wedge", "idle_time", "reversals", "sparc", "log_dimensionless_jerk"}
]


@functools.cache
def reference(force_unit: str = "N") -> ReferenceSet:
    """Cuts as good and as bad as the good one."""
    trace = cut(GOOD) if force_unit == "N" else force_alone(cut(GOOD))
    card = score(trace, target_length=TARGET)
    share = np.linspace(0.5, 1.5, 30)
    values = {name: scored.value * share for name, scored in card.metrics.items() if scored.value is not None}
    return ReferenceSet(name="good", about="made up", force_unit=force_unit, groups=("one",) * 30, values=values)


def scored(trace: Trace) -> ScoreCard:
    card = score(trace, target_length=TARGET, reference=reference(trace.force_unit))
    check_card(card)
    return card


def check_refused(trace: Trace, reason: str, *unavailable: str) -> None:
    """No overall score, for a reason that is shown; the metrics named have none either, for the same reason."""
    card = scored(trace)
    assert card.overall_score is None
    assert reason in card.no_score
    assert reason in card.headline()
    for name in unavailable:
        assert reason in card.metrics[name].unavailable, name


def saturated(trace: Trace, limit: float) -> Trace:
    return changed(trace, force=np.minimum(trace.force, limit))


def joined(first: Trace, second: Trace) -> Trace:
    """Two records one after the other, as if the recorder had not been stopped."""
    columns: dict[str, Any] = {
        name: np.concatenate((getattr(first, name), getattr(second, name))) for name in first.known if name != "speed"
    }
    columns["time"] = np.concatenate((first.time, second.time + (first.time[-1] - second.time[0]) + 1e-3))
    return Trace(**columns, force_unit=first.force_unit)


def test_a_good_record_is_scored() -> None:
    assert scored(cut(GOOD)).overall_score > 70.0
    assert scored(force_alone(cut(GOOD))).overall_score == pytest.approx(50.0, abs=10.0)


def test_a_truncated_record_is_not_scored_and_says_why() -> None:
    half = cut(GOOD).select(slice(4000))
    check_refused(half, "the record ends while the blade moves at 13 mm/s", "tip_error", "overshoot", "wedge")
    assert scored(half).no_score.count('end="finished"') == 1
    assert not [fault for fault in scored(half).faults if fault.kind in ("short", "overshoot", "wedge")]


def test_a_cut_that_was_stopped_for_safety_ended_there() -> None:
    stopped = changed(cut(GOOD).select(slice(4000)), metadata={"end": "force_limit"})
    card = scored(stopped)
    assert card.overall_score is not None
    assert card["tip_error"] > 0.02
    assert "short" in {fault.kind for fault in card.faults}


def test_a_force_alone_that_ends_under_load_is_remarked() -> None:
    half = force_alone(cut(GOOD)).select(slice(4000))
    assert any("ends under force" in note for note in scored(half).notes)
    assert not any("ends under force" in note for note in scored(force_alone(cut(GOOD))).notes)


def test_a_constant_force_is_not_the_steadiest() -> None:
    for trace in (cut(GOOD), force_alone(cut(GOOD))):
        check_refused(changed(trace, force=np.full(len(trace), 2.0)), "the force is 2", "force_rate", "force_variation")
    still = scored(changed(cut(GOOD), force=np.full(len(cut(GOOD)), 2.0)))
    assert still["duration"] > 0.0  # the motion was recorded all the same


def test_a_saturated_force_says_so() -> None:
    check_refused(
        saturated(cut(ONE_WAY), 2.0), "the force stays at its largest reading, 2 N", *USES_FORCE[:5], "tip_error"
    )
    check_refused(
        saturated(force_alone(cut(ONE_WAY)), 0.8), "the sensor or its amplifier is at its limit", "peak_force"
    )


def test_a_reversed_force_says_so() -> None:
    check_refused(changed(cut(ONE_WAY), force=-cut(ONE_WAY).force), "Reverse its sign", "peak_force", "tip_error")
    alone = force_alone(cut(ONE_WAY))
    check_refused(changed(alone, force=-alone.force), "Reverse its sign", "peak_force", "force_rate")


def test_two_cuts_in_one_record_say_so() -> None:
    for first, second in ((GOOD, GOOD), (ONE_WAY, GOOD)):
        both = joined(cut(first), cut(second))
        check_refused(both, "two cuts in one record. Save each in a file of its own, or number their rows", *METRICS)
        assert not scored(both).faults


def test_two_cuts_whose_rows_are_numbered_are_two_records(tmp_path: Path) -> None:
    both, path = joined(cut(ONE_WAY), cut(GOOD)), tmp_path / "both.csv"
    rows = zip(np.arange(len(both)) >= len(cut(ONE_WAY)), both.time, both.force, both.position, strict=True)
    path.write_text(
        "cut,time_s,force_N,position_m\n" + "".join(f"{n:d},{t:.17g},{F:.17g},{x:.17g}\n" for n, t, F, x in rows)
    )
    assert [len(trace) for trace in load(path)] == [len(cut(ONE_WAY)), len(cut(GOOD))]
    assert not any("two cuts" in scored(trace).no_score for trace in load(path))


@pytest.mark.parametrize("kind", [GOOD, ONE_WAY, "two cycles", "slicing, and back"])
def test_coming_back_through_the_open_crack_is_one_cut(kind: str) -> None:
    assert "two cuts" not in scored(cut(kind)).no_score


def test_a_pause_between_loads_of_a_force_alone_is_remarked() -> None:
    alone = force_alone(cut(GOOD))
    rest = Trace(time=np.arange(2500) / 1e3, force=np.resize(alone.force[-50:], 2500), force_unit="1")
    note = "if these are two cuts, score each alone"
    assert any(note in said for said in scored(joined(joined(alone, rest), alone)).notes)
    assert not any(note in said for said in scored(alone).notes)


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"position": lambda t: 100.0 * t.position}, "position = .* m is outside .* looks like centimetres"),
        ({"depth": lambda t: 100.0 * t.depth}, "depth = .* looks like centimetres"),
        ({"force": lambda t: 1000.0 * t.force}, "force = .* looks like millinewtons"),
        ({"speed": lambda t: 30.0 * t.speed}, "speed and position disagree"),
        ({"angle": lambda t: np.degrees(t.angle)}, "angle = .* looks like degrees"),
        ({"time": lambda t: 1000.0 * t.time}, "speed and position disagree|looks like milliseconds"),
        ({"force": lambda t: np.where(t.time > 3.0, np.nan, t.force)}, "force = nan"),
    ],
)
def test_mixed_units_are_refused_with_field_value_and_cure(changes: dict[str, Any], says: str) -> None:
    trace = cut(GOOD)
    with pytest.raises(ValueError, match=says):
        score(changed(trace, **{name: change(trace) for name, change in changes.items()}), target_length=TARGET)


@pytest.mark.parametrize("n", [0, 1])
def test_an_empty_record_is_refused(n: int) -> None:
    with pytest.raises(ValueError, match=f"2 instants or more, got {n}"):
        score(Trace(time=np.arange(n) / 1e3, force=np.zeros(n)))


def test_a_record_of_a_few_readings_says_that_it_is_short() -> None:
    check_refused(cut(GOOD).select(slice(3000, 3040)), "the record has 40 readings, fewer than the 50", "peak_force")


def test_a_clock_that_leaps_says_so() -> None:
    alone = force_alone(cut(GOOD))
    leaps = changed(alone, time=alone.time + np.where(np.arange(len(alone)) > 3000, 1e9, 0.0))
    check_refused(leaps, "more than an hour", *FORCE_WEIGHTS)


def test_arguments_are_refused_with_field_value_and_cure() -> None:
    trace = cut(GOOD)
    with pytest.raises(ValueError, match=r"target_length = 7\.5 m is outside .* 8 cm is 0\.08"):
        score(trace, target_length=7.5)
    with pytest.raises(TypeError, match="target_length must be one real number in m, got '8 cm'"):
        score(changed(trace, metadata={"target_length_m": "8 cm"}))
    with pytest.raises(TypeError, match=r"trace must be a cutenv\.trace\.Trace, got list"):
        score([trace])  # type: ignore[arg-type]
    with pytest.raises(ValueError, match=f"truth has 3 instants and the trace {len(trace)}"):
        score(trace, truth=Truth(tip=np.zeros(3), jump=np.zeros(3), resistance=200.0))
