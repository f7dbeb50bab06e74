"""Weights of the metrics by which a record without tip or target is scored: steadiness of the force alone."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass

from cutenv._base.parameter import check_parameters, parameter
from cutenv.scoring.metric import METRICS

_SUM = 1e-9  # tolerance of the weights' sum


def _weight(default: float, why: str) -> float:
    value: float = parameter(default, unit="1", low=0.0, high=1.0, provenance="choice", source=why)
    return value


@dataclass(frozen=True, kw_only=True)
class ForceOnlyWeights:
    """Weights of the leading metrics' percentiles for a record without tip or target; they sum to 1.

    They follow research on force-based assessment: steadiness of the force leads, the peak force is only a safety
    limit, and smoothness of the motion is reported but not scored.
    """

    force_rate: float = _weight(0.30, "steadiness leads")
    force_jerk: float = _weight(0.20, "steadiness leads")
    force_drops: float = _weight(0.20, "steadiness leads: tissue that tears lets go of the blade")
    mean_force_drop: float = _weight(0.15, "steadiness leads: tissue that tears lets go of the blade")
    force_variation: float = _weight(0.15, "steadiness leads")

    def __post_init__(self) -> None:
        _check(self)


def weights_by_metric(weights: ForceOnlyWeights) -> Mapping[str, float]:
    """Return the weights by the names of their metrics."""
    return dataclasses.asdict(weights)


def _check(weights: ForceOnlyWeights) -> None:
    check_parameters(weights)
    values = dataclasses.asdict(weights)
    assert set(values) <= set(METRICS), "a weight is named after its metric"
    if abs(sum(values.values()) - 1.0) > _SUM:
        raise ValueError(f"weights sum to {sum(values.values()):g}; they must sum to 1.")
