"""Bad and wild records get no overall score, for a clear reason; honest ones with mild noise are scored."""

from __future__ import annotations

import dataclasses
import functools
import math
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scored_cuts import TARGET, changed, check_card, cut, force_alone

from cutenv._engine.randomness import generator
from cutenv.records import load
from cutenv.records.scoring import METRICS, ReferenceSet, ScoreCard, Truth, score
from cutenv.records.scoring.cut_metrics import FORCE_WEIGHTS
from cutenv.sim.plant import Leg, SimulatedPlant, run, to_trace
from cutenv.sim.tissue import Specimen, measured_liver
from cutenv.sim.trace import Trace

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
    with pytest.raises(TypeError, match=r"trace must be a cutenv\.sim\.trace\.Trace, got list"):
        score([trace])  # type: ignore[arg-type]
    with pytest.raises(ValueError, match=f"truth has 3 instants and the trace {len(trace)}"):
        score(trace, truth=Truth(tip=np.zeros(3), jump=np.zeros(3), resistance=200.0))


WILD_TARGET = 0.06  # [m]
ACCEPTED = 0.95  # smallest share of honest records that must get an overall score
Source = Callable[[np.random.Generator, int], Any]


def _walk(rng: np.random.Generator, n: int) -> Any:
    return np.cumsum(rng.normal(0.0, 1.0, n)) / math.sqrt(n)


TIMES: dict[str, Source] = {
    "even": lambda rng, n: np.arange(n) / rng.choice([10.0, 30.0, 200.0, 1000.0]),
    "jittered": lambda rng, n: np.cumsum(rng.exponential(0.01, n)),
    "with a gap": lambda rng, n: np.arange(n) / 100.0 + (np.arange(n) > n // 2) * 10.0 ** rng.uniform(-1, 9),
    "tiny steps": lambda rng, n: np.arange(n) * 1e-9,
    "a far clock": lambda rng, n: 1.7e9 + np.arange(n) / 1000.0,
    "in milliseconds": lambda rng, n: np.arange(n) * 1.0,
    "shuffled": lambda rng, n: rng.permutation(n) / 100.0,
}
FORCES: dict[str, Source] = {
    "noise": lambda rng, n: rng.normal(0.0, 1.0, n),
    "a walk": lambda rng, n: 3.0 * _walk(rng, n),
    "constant": lambda rng, n: np.full(n, rng.choice([0.0, 1.0, -2.0])),
    "saturated": lambda rng, n: np.clip(3.0 * np.abs(np.sin(np.arange(n) / 40.0)), 0.0, 2.0),
    "reversed": lambda rng, n: -2.0 - np.abs(rng.normal(0.0, 0.3, n)),
    "a spike": lambda rng, n: 900.0 * (np.arange(n) == n // 2),
    "tiny": lambda rng, n: 1e-300 * rng.normal(0.0, 1.0, n),
    "in millinewtons": lambda rng, n: 2000.0 + 100.0 * rng.normal(0.0, 1.0, n),
    "a NaN in it": lambda rng, n: np.where(np.arange(n) == n // 2, np.nan, 1.0),
    "coarse": lambda rng, n: np.round(2.0 * np.abs(_walk(rng, n))),
}
POSITIONS: dict[str, Source] = {
    "a feed": lambda rng, n: np.linspace(0.0, rng.uniform(0.001, 0.14), n),
    "back": lambda rng, n: np.linspace(0.1, 0.0, n),
    "two cuts": lambda rng, n: np.abs(np.linspace(0.0, 0.16, n) % 0.08),
    "there and back": lambda rng, n: 0.08 * np.sin(np.pi * np.arange(n) / n),
    "still": lambda rng, n: np.full(n, 0.02),
    "jumps": lambda rng, n: rng.uniform(-0.05, 0.5, n),
    "a walk": lambda rng, n: np.clip(0.05 + 0.03 * _walk(rng, n), -0.05, 0.5),
    "in centimetres": lambda rng, n: np.linspace(0.0, 8.0, n),
}
DEPTHS: dict[str, Source] = {
    "even": lambda rng, n: np.full(n, 0.015),
    "nothing": lambda rng, n: np.zeros(n),
    "random": lambda rng, n: rng.uniform(0.0, 0.1, n),
}
ANGLES: dict[str, Source] = {
    "upright": lambda rng, n: np.full(n, math.pi / 2),
    "flat": lambda rng, n: np.full(n, rng.choice([0.0, math.pi])),
    "random": lambda rng, n: rng.uniform(0.0, math.pi, n),
    "in degrees": lambda rng, n: np.full(n, 90.0),
}
REFUSED = {"in milliseconds", "shuffled", "in millinewtons", "a NaN in it", "in centimetres", "in degrees", "jumps"}
"""Flaws that a trace mostly refuses; rarer here than among people, so that enough records reach the scorer."""


def _drawn(rng: np.random.Generator, sources: dict[str, Source], n: int, missing: float) -> Any:
    if rng.random() < missing:
        return None
    odds = np.array([0.15 if name in REFUSED else 1.0 for name in sources])
    return sources[str(rng.choice(list(sources), p=odds / odds.sum()))](rng, n)


def wild(rng: np.random.Generator) -> Trace:
    """A random record; raises ValueError where a trace refuses it."""
    n = int(rng.choice([0, 1, 2, 3, 10, 49, 60, 400, 2000], p=[0.02, 0.02, *7 * [0.96 / 7]]))
    position = _drawn(rng, POSITIONS, n, 0.3)
    return Trace(
        time=_drawn(rng, TIMES, n, 0.0),
        force=_drawn(rng, FORCES, n, 0.0),
        position=position,
        speed=rng.normal(0.0, 0.01, n) if rng.random() < 0.05 else None,
        depth=_drawn(rng, DEPTHS, n, 0.3),
        angle=_drawn(rng, ANGLES, n, 0.3),
        force_unit=str(rng.choice(["N", "N", "1"])),
    )


def wild_target(rng: np.random.Generator) -> float | None:
    """A target length as people give it, sometimes in centimetres, sometimes None [m]."""
    return rng.choice([None, None, 0.04, 0.06, 0.06, 0.08, 0.15, 0.15, 6.0, -1.0])


@functools.cache
def cut_livers(cuts: int = 24, seed: int = 1) -> list[Trace]:
    """Cut sampled livers at many speeds and angles, half of them there and back, recorded as by a rig."""
    traces = []
    for n in range(cuts):
        rng = generator(seed, n)
        specimen = Specimen.draw(rng, specimen_class="liver", tissue=measured_liver())
        angle = math.radians(rng.uniform(45.0, 90.0))
        plant = SimulatedPlant(specimen, seed=seed, episode=n, angle=angle)
        ways = [Leg(position=WILD_TARGET + 0.005, speed=rng.uniform(0.004, 0.0254), angle=angle, dwell=0.2)]
        ways += [Leg(position=0.0, speed=0.02, angle=angle, dwell=0.2)] * (n % 2)
        traces.append(to_trace(plant, run(plant, ways)))
    return traces


def honest(rng: np.random.Generator, cuts: list[Trace]) -> Trace:
    """One of ``cuts`` as another lab might have recorded it: more noise, another rate, fewer columns."""
    trace = cuts[int(rng.integers(len(cuts)))]
    trace = trace.select(slice(int(rng.integers(3)), None, int(rng.choice([1, 2, 5, 10, 20]))))
    n = len(trace)
    if rng.random() < 0.3:  # lost readings
        trace = trace.select(rng.random(n) > 0.01)
        n = len(trace)
    force = trace.force + rng.normal(rng.uniform(-0.03, 0.03), rng.uniform(0.0, 0.04), n)
    resolution = rng.choice([0.01, 0.05])
    force = np.round(force / resolution) * resolution
    if rng.random() < 0.25:
        return Trace(time=trace.time, force=force / rng.uniform(1.0, 10.0), force_unit="1")
    assert trace.position is not None
    encoder = rng.choice([1e-6, 1e-5, 5e-5])
    position = np.round(trace.position / encoder) * encoder + rng.normal(0.0, 5e-6, n)
    kept = {name: None for name in ("depth", "angle") if rng.random() < 0.1}
    return dataclasses.replace(trace, force=force, position=position, speed=None, **kept)  # type: ignore[arg-type]


@functools.cache
def reference_in(unit: str) -> ReferenceSet:
    """Reference set of the unmodified cuts, with the force alone for the unit "1"."""
    cuts = cut_livers()
    alone = [Trace(time=cut.time, force=cut.force, force_unit="1") for cut in cuts]
    cards = [score(trace, target_length=WILD_TARGET) for trace in (cuts if unit == "N" else alone)]
    rows = [("rig", {name: scored.value for name, scored in card.metrics.items()}) for card in cards]
    return ReferenceSet.of(rows, name="virtual livers", about="as recorded", force_unit=unit)


def check_wild(seed: int) -> None:
    """A wild record is refused with a reason, or gets a valid card."""
    rng = np.random.default_rng(seed)
    what = ""
    try:
        trace, target = wild(rng), wild_target(rng)
        what = "target_length"
        card = score(trace, target_length=target)
    except (TypeError, ValueError) as error:
        reason = str(error)
    else:
        check_card(card)
        return
    assert what in reason
    assert len(reason) >= 20


@pytest.fixture(autouse=True)
def no_warnings() -> Any:
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # NumPy's warnings are quiet NaNs
        yield


@settings(max_examples=300, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(seed=st.integers(0, 2**32 - 1))
def test_wild_records_never_crash_the_scorer(seed: int) -> None:
    check_wild(seed)


@pytest.mark.slow
def test_ten_thousand_wild_records_never_crash_the_scorer() -> None:
    for seed in range(10_000):
        check_wild(seed)


values = st.floats(-1e3, 1e3, allow_subnormal=False)


@settings(max_examples=150, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    force=st.lists(values, min_size=2, max_size=80),
    step=st.floats(1e-6, 0.5),
    place=st.lists(st.floats(-0.05, 0.5), min_size=80, max_size=80),
    depth=st.none() | st.floats(0.0, 0.1),
    angle=st.none() | st.floats(0.0, math.pi),
    unit=st.sampled_from(["N", "1"]),
)
def test_no_small_record_crashes_the_scorer(
    force: list[float], step: float, place: list[float], depth: float | None, angle: float | None, unit: str
) -> None:
    n = len(force)
    trace = Trace(
        time=step * np.arange(n),
        force=force,  # type: ignore[arg-type]
        position=place[:n],  # type: ignore[arg-type]
        depth=None if depth is None else np.full(n, depth),
        angle=None if angle is None else np.full(n, angle),
        force_unit=unit,
    )
    check_card(score(trace, target_length=0.06))


@pytest.mark.parametrize("count", [200, pytest.param(1000, marks=pytest.mark.slow)])
def test_honest_records_with_mild_noise_are_scored(count: int) -> None:
    accepted = 0
    for seed in range(count):
        trace = honest(np.random.default_rng(seed), cut_livers())
        card = score(trace, target_length=WILD_TARGET, reference=reference_in(trace.force_unit))
        check_card(card)
        accepted += card.overall_score is not None
    assert accepted >= ACCEPTED * count
