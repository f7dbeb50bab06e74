"""What a metric promises not to depend on, for every metric that promises it, on virtual cuts."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from scored_cuts import CHANGES, CUTS, TARGET, TISSUES, cut, ends_under_force

from cutenv.scoring import INVARIANCES, METRICS, ScoredCut, Unavailable
from cutenv.tissue import measured_liver

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


def check_invariance(function: Callable[[ScoredCut], float], invariance: str) -> None:
    """What ``function`` finds in any of the cuts stays as it is, or stays unavailable."""
    tested = 0
    tissue = TISSUES.get(invariance, measured_liver())
    for kind in filter(lambda kind: applies(invariance, kind), CUTS):
        before, after = cut(kind), CHANGES[invariance](cut(kind))
        try:
            value = function(ScoredCut(trace=before, target_length=TARGET))
        except Unavailable:
            continue
        changed = function(ScoredCut(trace=after, target_length=TARGET, tissue=tissue))
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
