"""Metrics against closed forms, and what each promises not to depend on."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scored_cuts import CHANGES, CUTS, TARGET, TISSUES, changed, cut, ends_under_force

from cutenv._engine.randomness import generator
from cutenv.records.scoring import INVARIANCES, METRICS, ScoredCut, Truth, Unavailable, score
from cutenv.records.scoring.cut_metrics import log_jerk, spectral_arc_length
from cutenv.sim.plant import Leg, SimulatedPlant, run, to_trace
from cutenv.sim.tissue import Specimen, measured_liver
from cutenv.sim.trace import Trace

RATE = 1000.0
DEPTH = 0.01
NOISE = np.random.default_rng(5).normal(0.0, 0.001, 100_000)  # a force without any would be a sensor that hangs


def led(force: Any, speed: Any, *, seconds: float, angle: float = math.pi / 2, stays: bool = False) -> Trace:
    """A blade led at ``speed``(t) [m/s], feeling ``force``(t) [N], with half a second of rest before and after.

    The force ends with the motion, or stays as it is.
    """
    t = np.arange(round((seconds + 1.0) * RATE)) / RATE
    inside = (t >= 0.5) & (t < 0.5 + seconds)
    v = np.where(inside, np.broadcast_to(speed(t - 0.5), t.shape), 0.0)
    F = np.where(inside, np.broadcast_to(force(t - 0.5), t.shape), 0.0)
    F = np.where(stays & (t >= 0.5 + seconds), F[inside][-1], F) + NOISE[: len(t)]
    x = np.cumsum(v) / RATE
    return Trace(time=t, force=F, position=x, angle=np.full_like(t, angle), depth=np.full_like(t, DEPTH))


def constant(value: float) -> Any:
    return lambda t: value


def value(name: str, trace: Trace, **keywords: Any) -> float:
    return METRICS[name].function(ScoredCut(trace=trace, **keywords))


STEADY = led(constant(2.0), constant(0.01), seconds=6.0)
RAMP = led(lambda t: 0.5 * t, constant(0.01), seconds=6.0)
WAVE = led(lambda t: 2.0 + np.sin(2.0 * np.pi * t), constant(0.01), seconds=6.0)


@pytest.mark.parametrize(
    ("name", "trace", "expected", "tolerance"),
    [
        ("peak_force", RAMP, 3.0, 0.01),
        ("peak_force_per_depth", RAMP, 3.0 / DEPTH, 0.01),
        ("mean_force_per_depth", STEADY, 2.0 / DEPTH, 0.01),
        ("mean_force_per_depth", RAMP, 1.5 / DEPTH, 0.01),
        ("rms_force_per_depth", RAMP, 3.0 / math.sqrt(3.0) / DEPTH, 0.01),
        ("force_time_integral", RAMP, 9.0, 0.01),
        ("force_variation", RAMP, 1.0 / math.sqrt(3.0), 0.03),
        ("force_variation", WAVE, math.sqrt(0.5) / 2.0, 0.05),
        ("crest_factor", RAMP, math.sqrt(3.0), 0.03),
        ("duration", STEADY, 6.0, 0.02),
    ],
)
def test_closed_forms_of_force(name: str, trace: Trace, expected: float, tolerance: float) -> None:
    assert value(name, trace) == pytest.approx(expected, rel=tolerance)


def filtered(order: int, hertz: float) -> float:
    """RMS of a derivative of a unit sine that passed a second-order Butterworth filter of 5 Hz to and fro."""
    return (2.0 * math.pi * hertz) ** order / math.sqrt(2.0) / (1.0 + (hertz / 5.0) ** 4)


@pytest.mark.parametrize(("name", "order"), [("force_rate", 1), ("force_jerk", 2)])
@pytest.mark.parametrize("hertz", [1.0, 3.0])
def test_rates_of_a_sine_are_those_of_the_stated_bandwidth(name: str, order: int, hertz: float) -> None:
    trace = led(lambda t: 2.0 + np.sin(2.0 * np.pi * hertz * t), constant(0.01), seconds=12.0)
    # Within the cut alone: where the force sets in and ends, it steps.
    middle = changed(trace.select((trace.time > 1.5) & (trace.time < 11.5)), metadata={"end": "cut out"})
    assert value(name, middle) == pytest.approx(filtered(order, hertz), rel=0.03)


def test_a_ramp_changes_at_its_slope() -> None:
    middle = changed(RAMP.select((RAMP.time > 1.5) & (RAMP.time < 5.5)), metadata={"end": "cut out"})
    assert value("force_rate", middle) == pytest.approx(0.5, rel=0.02)


def saw_tooth(drops: int, size: float) -> Trace:
    """Ramps of a second from 3 N - size to 3 N, falling at once; the last one stays up."""
    return led(
        lambda t: np.where(t < drops + 1, 3.0 - size + size * (t % 1.0), 3.0),
        constant(0.01),
        seconds=drops + 2,
        stays=True,
    )


@pytest.mark.parametrize("drops", [1, 4])
@pytest.mark.parametrize("size", [0.8, 2.0])
def test_a_saw_tooth_has_as_many_drops_of_that_size(drops: int, size: float) -> None:
    trace = saw_tooth(drops, size)
    assert value("force_drops", trace) == drops
    # The filter rounds either end of a fall.
    assert value("mean_force_drop", trace) == pytest.approx(size, rel=0.2)


def test_a_steady_force_does_not_drop() -> None:
    ramp = led(lambda t: 0.5 * t, constant(0.01), seconds=6.0, stays=True)
    assert value("force_drops", ramp) == 0.0
    assert value("mean_force_drop", ramp) == 0.0


def test_a_pause_is_idle_time_and_no_reversal() -> None:
    trace = led(constant(2.0), lambda t: np.where((t > 2.0) & (t < 3.5), 0.0, 0.01), seconds=6.0)
    assert value("idle_time", trace) == pytest.approx(1.5, abs=0.06)
    assert value("reversals", trace) == 0.0
    assert value("duration", trace) == pytest.approx(6.0, abs=0.06)


def test_turning_back_and_forth_is_two_reversals() -> None:
    trace = led(constant(2.0), lambda t: np.where((t > 2.0) & (t < 3.0), -0.01, 0.01), seconds=6.0)
    assert value("reversals", trace) == 2.0


@pytest.mark.parametrize(
    ("angle_deg", "expected"), [(90.0, 0.0), (60.0, 1.0 / math.sqrt(3.0)), (45.0, 1.0), (135.0, 1.0)]
)
def test_a_leaning_blade_leaves_a_wedge(angle_deg: float, expected: float) -> None:
    trace = led(constant(2.0), constant(0.01), seconds=2.0, angle=math.radians(angle_deg))
    assert value("wedge", trace) == pytest.approx(expected, abs=1e-12)


def test_a_blade_that_lies_flat_leaves_no_wedge_that_could_be_told() -> None:
    with pytest.raises(Unavailable, match="lies flat, at 0 degrees"):
        value("wedge", led(constant(2.0), constant(0.01), seconds=2.0, angle=0.0))


def known(tip_end: float, jumps: tuple[float, ...]) -> tuple[Trace, Truth]:
    """A cut of 6 cm by the blade, and a tip 5 mm behind but for runs of given lengths at the end of every second."""
    runs = np.zeros(len(STEADY))
    for k, run_length in enumerate(jumps):
        runs[1500 + 1000 * k] = run_length
    a = np.maximum(STEADY.position - 0.005 - sum(jumps), 0.0) + np.cumsum(runs)  # type: ignore[operator]
    a += tip_end - a[-1]
    return STEADY, Truth(tip=np.maximum(a, 0.0), jump=runs, resistance=200.0)


def test_truth_is_used_where_it_is_present() -> None:
    trace, truth = known(0.058, (0.004, 0.002))
    card = score(trace, target_length=0.055, truth=truth)
    assert card.tip_source == "truth"
    assert card["tip_error"] == pytest.approx(0.003)
    assert card["overshoot"] == pytest.approx(0.003)
    assert card["largest_jump"] == 0.004
    assert card["uncontrolled_share"] == pytest.approx(0.006 / 0.058)
    # 2 N over 6 cm, for 5.8 cm of 1 cm depth at 200 J/m2.
    assert card["work_over_fracture"] == pytest.approx(0.12 / (200.0 * 0.058 * 0.01), rel=0.01)
    assert score(trace, target_length=0.055).tip_source == "estimated"


def test_lag_is_that_of_the_true_tip() -> None:
    truth = Truth(tip=STEADY.position - 0.004, jump=np.zeros(len(STEADY)), resistance=200.0)  # type: ignore[operator]
    assert value("mean_lag", STEADY, truth=truth) == pytest.approx(0.004)
    assert value("overshoot", STEADY, truth=truth, target_length=0.08) == 0.0


def bell(t: np.ndarray) -> np.ndarray:
    return np.exp(-5.0 * t**2)


def test_published_values_of_smoothness() -> None:
    speed = bell(np.arange(-1.0, 1.0, 0.01))
    assert spectral_arc_length(speed, 100.0) == pytest.approx(-1.41403, abs=5e-6)
    assert log_jerk(speed, 100.0) == pytest.approx(-5.81636, abs=5e-6)


@pytest.mark.parametrize("submovements", [1, 2, 5])
@pytest.mark.parametrize("rate", [50.0, 100.0, 250.0])
def test_smoothness_is_that_of_monalysa(submovements: int, rate: float) -> None:
    from monalysa.quality import smoothness

    t = np.arange(-1.0, 1.0 + submovements, 1.0 / rate)
    speed = sum(bell(t - k) for k in range(submovements)) + 0.02 * np.sin(17.0 * t) ** 2
    assert spectral_arc_length(speed, rate) == pytest.approx(smoothness.sparc(speed, rate)[0], rel=1e-9)
    assert log_jerk(speed, rate) == pytest.approx(smoothness.log_dimensionless_jerk(speed, rate), rel=1e-9)


def minimum_jerk(t: np.ndarray) -> np.ndarray:
    s = t / 6.0
    return 0.06 / 6.0 * 30.0 * s**2 * (1.0 - s) ** 2


@pytest.mark.parametrize("name", ["sparc", "log_dimensionless_jerk"])
def test_a_perfect_constant_feed_scores_badly_on_smoothness_and_it_does_not_count(name: str) -> None:
    graceful = led(constant(2.0), minimum_jerk, seconds=6.0)
    assert value(name, STEADY) < value(name, graceful) - 0.3
    assert METRICS[name].direction == "none"


@functools.cache
def estimates(back: bool) -> tuple[float, float, float]:
    """Median and 95th percentile of the error of the estimated tip error, and the median one on the way there [mm].

    Over 60 cuts of drawn livers.
    """
    errors, on_the_way = [], []
    for n in range(60):
        specimen = Specimen.draw(generator(77, n), specimen_class="liver", tissue=measured_liver())
        angle, speed = math.radians((90.0, 45.0, 70.0)[n % 3]), (0.0038, 0.0089, 0.0165, 0.0254)[n % 4]
        plant = SimulatedPlant(specimen, seed=9, episode=n, angle=angle)
        ways = [Leg(position=0.08, speed=speed, angle=angle, dwell=0.2)]
        ways += [Leg(position=0.0, speed=0.0254, angle=angle, dwell=0.2)] * back
        readings = run(plant, ways)
        trace = to_trace(plant, readings)
        truth = Truth(tip=readings["tip"].copy(), jump=readings["jump"].copy(), resistance=200.0)
        estimated = ScoredCut(trace=trace, target_length=TARGET)
        told = METRICS["tip_error"].function(estimated)
        errors.append(abs(told - value("tip_error", trace, target_length=TARGET, truth=truth)))
        there = slice(int(np.argmax(readings["position"])))
        on_the_way.append(np.mean(np.abs(estimated.tip - truth.tip)[there]))
    return 1e3 * float(np.median(errors)), 1e3 * float(np.percentile(errors, 95)), 1e3 * float(np.median(on_the_way))


@pytest.mark.parametrize(("back", "median_mm", "worst_mm"), [(True, 0.3, 0.5), (False, 1.2, 4.0)])
def test_the_tip_is_estimated_as_well_as_the_card_says(back: bool, median_mm: float, worst_mm: float) -> None:
    median, worst, _ = estimates(back)
    assert median <= median_mm
    assert worst <= worst_mm


def test_a_return_stroke_tells_the_tip_better_also_before_it() -> None:
    assert estimates(True)[0] < estimates(False)[0]
    assert estimates(True)[1] < 0.2 * estimates(False)[1]
    assert estimates(True)[2] < 0.75 * estimates(False)[2]


def test_a_metric_says_what_it_is() -> None:
    for metric in METRICS.values():
        assert all((metric.meaning, metric.formula, metric.source, metric.validity, metric.unit)), metric.name
        assert metric.meaning.endswith(".")
        assert metric.direction == "lower" or not metric.name.endswith("_error")


def test_a_metric_does_without_the_fields_that_it_does_not_need() -> None:
    """`needs` is the truth: what is not in it can be taken away, and what is in it cannot."""
    trace = STEADY
    bare: dict[str, Any] = {"position": None, "depth": None, "angle": None}
    for metric in METRICS.values():
        kept = {name: getattr(trace, name) for name in bare if name in metric.needs}
        unit = "N" if "newtons" in metric.needs else "1"
        length = 0.055 if "target_length" in metric.needs else None
        lean = Trace(time=trace.time, force=trace.force, force_unit=unit, **kept)
        assert math.isfinite(value(metric.name, lean, target_length=length)), metric.name
        for name in kept:
            with pytest.raises(Unavailable, match=f"{name} was not recorded"):
                value(metric.name, changed(lean, **{name: None}), target_length=length)


def test_a_card_refuses_what_it_does_not_know() -> None:
    card = score(Trace(time=STEADY.time, force=STEADY.force, force_unit="1"))
    with pytest.raises(ValueError, match="tip_error is unavailable: the force is normalised"):
        card["tip_error"]


TOLERANCES = {"resampling": 0.05, "rest_after": 0.02, "force_offset": 1e-6, "time_shift": 1e-6}
ROUNDING = 1e-9
PROMISES = [(name, invariance) for name, metric in METRICS.items() for invariance in metric.invariances]
# For every invariance something that depends on what it excludes.
DEPENDENT: dict[str, Callable[[ScoredCut], float]] = {
    "time_shift": lambda of: float(of.time[-1]),
    "force_scale": METRICS["peak_force"].function,
    "force_offset": METRICS["force_variation"].function,
    "resampling": lambda of: float(len(of.trace)),
    "rest_after": lambda of: of.trace.duration,
    "units": METRICS["mean_force_drop"].function,
}


def applies(invariance: str, kind: str) -> bool:
    """Rest is in unloaded tissue, and there are readings to be left out."""
    if invariance == "rest_after":
        return not ends_under_force(kind)
    return invariance != "resampling" or cut(kind).sample_rate > 200.0


@functools.cache
def before_and_after(kind: str, invariance: str) -> tuple[ScoredCut, ScoredCut]:
    """A cut and what was made of it, for every metric: what several need of it is worked out once."""
    tissue = TISSUES.get(invariance, measured_liver())
    before, after = cut(kind), CHANGES[invariance](cut(kind))
    return ScoredCut(trace=before, target_length=TARGET), ScoredCut(trace=after, target_length=TARGET, tissue=tissue)


def check_invariance(function: Callable[[ScoredCut], float], invariance: str) -> None:
    """What ``function`` finds in any of the cuts stays as it is, or stays unavailable."""
    tested = 0
    for kind in filter(lambda kind: applies(invariance, kind), CUTS):
        before, after = before_and_after(kind, invariance)
        try:
            value = function(before)
        except Unavailable:
            continue
        changed = function(after)
        tolerance = TOLERANCES.get(invariance, ROUNDING) * abs(value) + 1e-12
        assert abs(changed - value) <= tolerance, f"{kind}: {value:g} became {changed:g}"
        tested += 1
    assert tested >= 2


@pytest.mark.parametrize(("name", "invariance"), PROMISES)
def test_a_metric_keeps_what_it_promises(name: str, invariance: str) -> None:
    check_invariance(METRICS[name].function, invariance)


@pytest.mark.parametrize("invariance", INVARIANCES)
def test_a_broken_promise_is_noticed(invariance: str) -> None:
    with pytest.raises(AssertionError, match="became"):
        check_invariance(DEPENDENT[invariance], invariance)


@pytest.mark.parametrize("invariance", INVARIANCES)
def test_every_invariance_is_promised_by_a_metric(invariance: str) -> None:
    assert any(promised == invariance for _, promised in PROMISES)
