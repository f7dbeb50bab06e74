"""Metrics of the force: size, duration and steadiness. Steadiness leads; the peak is only a safety limit."""

from __future__ import annotations

import itertools

import numpy as np

from cutenv._base.arrays import Array
from cutenv.measurement.strokes import turning_points
from cutenv.scoring.even_samples import BANDWIDTH, RATE
from cutenv.scoring.metric import metric
from cutenv.scoring.scored_cut import ScoredCut
from cutenv.scoring.unavailable import Unavailable
from cutenv.task_quantities import force_per_depth

_ALL = "any record; where position is known, while the blade advances"
_PER_DEPTH = ("depth", "newtons")
DROP_SHARE = 0.1
"""Smallest fall of the force that counts as a drop, as a fraction of its range."""


def _advancing(cut: ScoredCut) -> Array:
    return cut.force[cut.advancing]


@metric(
    "N/m", "lower", formula="max F/B", source="limit of the task", validity=_ALL, needs=_PER_DEPTH,
    invariances=("time_shift", "resampling", "rest_after", "units"),
)  # fmt: skip
def peak_force_per_depth(cut: ScoredCut) -> float:
    """Largest force per depth of cut: a safety limit, not a skill."""
    return float(force_per_depth(cut.newtons, cut.depth)[cut.advancing].max())


@metric(
    "N/m", "lower", formula="mean over time of F/B", source="thesis, section 5.4", validity=_ALL, needs=_PER_DEPTH,
    invariances=("time_shift", "resampling", "rest_after", "units"),
)  # fmt: skip
def mean_force_per_depth(cut: ScoredCut) -> float:
    """Mean force per depth of cut."""
    return cut.mean(force_per_depth(cut.newtons, cut.depth))


@metric(
    "N/m", "lower", formula="root of the mean over time of (F/B)^2", source="force-based assessment", validity=_ALL,
    needs=_PER_DEPTH, invariances=("time_shift", "resampling", "rest_after", "units"),
)  # fmt: skip
def rms_force_per_depth(cut: ScoredCut) -> float:
    """Root mean square of the force per depth of cut."""
    return float(np.sqrt(cut.mean(force_per_depth(cut.newtons, cut.depth) ** 2)))


@metric(
    "F", "lower", formula="max F", source="limit of the task", validity=_ALL,
    invariances=("time_shift", "resampling", "rest_after"),
)  # fmt: skip
def peak_force(cut: ScoredCut) -> float:
    """Largest force: a safety limit, not a skill."""
    return float(_advancing(cut).max())


@metric(
    "F s", "lower", formula="integral of F dt", source="force-based assessment", validity=_ALL,
    invariances=("time_shift", "resampling", "rest_after"),
)  # fmt: skip
def force_time_integral(cut: ScoredCut) -> float:
    """Integral of the force over time."""
    here = cut.advancing
    return float(cut.weights[here] @ np.maximum(cut.force[here], 0.0))


@metric(
    "1", "lower", formula="SD / mean over time of F below 5 Hz", source="force-based assessment",
    validity="mean force well above the sensor's zero",
    invariances=("time_shift", "force_scale", "resampling", "rest_after", "units"),
)  # fmt: skip
def force_variation(cut: ScoredCut) -> float:
    """Coefficient of variation of the force."""
    F = cut.smooth_force[cut.even_advancing]
    return float(F.std()) / _positive_mean(F)


@metric(
    "1", "lower", formula="falls of F, means of 10 ms, of 10 % of its range or more", source="thesis, section 3.3.2",
    validity="noise below 5 % of the peak",
    invariances=("time_shift", "force_scale", "force_offset", "rest_after", "units"),
)  # fmt: skip
def force_drops(cut: ScoredCut) -> float:
    """Occurrences of a force drop: at each, a piece of tissue tore or let go of the blade."""
    return float(len(_drops(cut)))


@metric(
    "F", "lower", formula="mean of these falls, 0 without any", source="thesis, section 3.3.2",
    validity="noise below 5 % of the peak", invariances=("time_shift", "force_offset", "rest_after"),
)  # fmt: skip
def mean_force_drop(cut: ScoredCut) -> float:
    """Mean size of the force drops."""
    drops = _drops(cut)
    return float(np.mean(drops)) if drops else 0.0


@metric(
    "F/s", "lower", formula=f"RMS of dF/dt below {BANDWIDTH:g} Hz", source="force-based assessment",
    validity="20 readings a second or more", invariances=("time_shift", "force_offset", "resampling", "rest_after"),
)  # fmt: skip
def force_rate(cut: ScoredCut) -> float:
    """Root mean square rate of the force."""
    return _rms(np.gradient(cut.smooth_force, 1.0 / RATE)[cut.even_advancing])


@metric(
    "F/s2", "lower", formula=f"RMS of d2F/dt2 below {BANDWIDTH:g} Hz", source="force-based assessment",
    validity="20 readings a second or more", invariances=("time_shift", "force_offset", "resampling", "rest_after"),
)  # fmt: skip
def force_jerk(cut: ScoredCut) -> float:
    """Root mean square second derivative of the force (jerk)."""
    rate = np.gradient(cut.smooth_force, 1.0 / RATE)
    return _rms(np.gradient(rate, 1.0 / RATE)[cut.even_advancing])


@metric(
    "1", "none", formula="max F / RMS F, below 5 Hz", source="signal analysis", validity=_ALL,
    invariances=("time_shift", "force_scale", "resampling", "rest_after", "units"),
)  # fmt: skip
def crest_factor(cut: ScoredCut) -> float:
    """Ratio of the peak force to its root mean square."""
    F = cut.smooth_force[cut.even_advancing]
    rms = _rms(F)
    if rms <= 0.0:
        raise Unavailable("the force is zero throughout")
    return float(F.max()) / rms


def _drops(cut: ScoredCut) -> list[float]:
    """Return the falls of the force from each maximum to the next minimum, while the blade advances."""
    F = cut.even_force[cut.even_advancing]
    swing = DROP_SHARE * float(np.ptp(F))
    if swing <= 0.0:
        return []
    ramps = turning_points(F, swing)
    falls = [float(F[top] - F[valley]) for (_, top), (valley, _) in itertools.pairwise(ramps)]
    if ramps:
        last = float(F[ramps[-1][1]] - F[ramps[-1][1] :].min())
        falls += [last] if last >= swing else []
    return falls


def _positive_mean(F: Array) -> float:
    mean = float(F.mean())
    if mean <= 0.0:
        raise Unavailable("the mean force is not positive: reversed sign, or no contact")
    return mean


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))
