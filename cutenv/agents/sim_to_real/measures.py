"""Measures by which a rig's cuts are compared with the simulator's.

Each has a margin of equivalence. The control clock is measured by its periods, latencies and overruns.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from cutenv._base.arrays import Array
from cutenv._base.validation import array_in_range, in_range
from cutenv.records.scoring import MAP_METRICS, METRICS, ScoreCard, score
from cutenv.records.scoring.cut_metrics import metric_named
from cutenv.sim.trace import PLACE, Trace

FORCE_RESOLUTION = 0.05  # resolution of the force sensor, worst case in the cutting plane [N]; thesis 3.1


@dataclass(frozen=True, kw_only=True, eq=False)
class ComparedCut:
    """One cut, assessed alike on the rig and in the simulator.

    Attributes
    ----------
    value : float
        Return: the sum of rewards, on both sides from the same estimates.
    success : bool
        Success by the definition of the task.
    end : str
        Reason why the cut ended.
    card : ScoreCard
        Score card of the trace.
    """

    trace: Trace
    value: float
    success: bool
    end: str
    card: ScoreCard = field(init=False)

    @functools.cached_property
    def displaced(self) -> ScoreCard:
        """Score card with the sensor's zero off by its resolution."""
        return score(dataclasses.replace(self.trace, force=self.trace.force + FORCE_RESOLUTION))

    def __post_init__(self) -> None:
        object.__setattr__(self, "card", score(self.trace))


STEP = 1e-4  # spacing of the positions at which forces are compared [m]
_RETREAT = 1e-4  # [m] behind the furthest point: the flicker of an encoder is smaller
_MIN_COMMON_LENGTH = 0.005  # [m], shortest common length that is compared
_TIME_STEP = 0.005  # [s], interval of a rig's positions


def force_over_position(trace: Trace) -> tuple[Array, Array]:
    """Return the force by position up to the blade's first retreat.

    Parameters
    ----------
    trace : Trace
        Record with position.

    Returns
    -------
    tuple of ndarray, each of shape (n,)
        Positions [m], ``STEP`` apart, and forces in the trace's unit.

    Raises
    ------
    ValueError
        If the trace holds no position.
    """
    force, position = trace.require("force", "position", by="force_over_position")
    furthest = np.maximum.accumulate(position)
    back = np.flatnonzero(position < furthest - _RETREAT)
    stop = len(position) if len(back) == 0 else int(np.argmax(position[: back[0]])) + 1
    new = np.flatnonzero(np.diff(furthest[:stop], prepend=-np.inf) > 0.0)
    at = np.arange(np.ceil(position[new[0]] / STEP), np.floor(furthest[stop - 1] / STEP) + 1) * STEP
    return at, np.interp(at, position[new], force[new])


def force_difference(first: Trace, second: Trace, *, displaced: float = 0.0) -> Array | None:
    """Return the force difference at equal positions up to a retreat.

    It is in the traces' unit, ``STEP`` apart, the second shifted away from the clamp by ``displaced`` [m]; None if they
    have less than 5 mm in common.
    """
    (at, force), (other_at, other) = force_over_position(first), force_over_position(second)
    if not len(at) or not len(other_at):
        return None
    other_at = other_at + displaced
    low, high = max(at[0], other_at[0]), min(at[-1], other_at[-1])
    if high - low < _MIN_COMMON_LENGTH:
        return None
    common = np.arange(low, high, STEP)
    return np.interp(common, at, force) - np.interp(common, other_at, other)


def force_rmse(first: Trace, second: Trace, *, displaced: float = 0.0) -> float | None:
    """Return the root mean square of :func:`force_difference`."""
    difference = force_difference(first, second, displaced=displaced)
    return None if difference is None else rms(difference)


def force_offset(first: Trace, second: Trace) -> float | None:
    """Return :func:`force_difference`'s absolute mean, which shows zero drift."""
    difference = force_difference(first, second)
    return None if difference is None else abs(float(difference.mean()))


def position_rmse(first: Trace, second: Trace) -> float | None:
    """Return the root mean square position difference at equal times [m].

    Returns
    -------
    float or None
        Over the time that both cuts last; None if they have less than 0.1 s in common.
    """
    return _rmse_over_time(first, second, "position")


def height_rmse(first: Trace, second: Trace) -> float | None:
    """Return the root mean square height difference at equal times [m].

    It is None if one has no height, or they have less than 0.1 s in common.
    """
    if first.height is None or second.height is None:
        return None
    return _rmse_over_time(first, second, "height")


def place_rmse(first: Trace, second: Trace) -> float | None:
    """Return the blades' root mean square distance at equal times [m].

    It is None if one has no places, or they have less than 0.1 s in common.
    """
    if first.blade_x is None or second.blade_x is None:
        return None
    x, y = (_rmse_over_time(first, second, name) for name in PLACE)
    return None if x is None or y is None else math.hypot(x, y)


def _rmse_over_time(first: Trace, second: Trace, name: str) -> float | None:
    time, own = first.require("time", name, by=f"{name}_rmse")
    other_time, other = second.require("time", name, by=f"{name}_rmse")
    low, high = max(time[0], other_time[0]), min(time[-1], other_time[-1])
    if high - low < 20 * _TIME_STEP:
        return None
    common = np.arange(low, high, _TIME_STEP)
    return rms(np.interp(common, time, own) - np.interp(common, other_time, other))


def rms(values: Array) -> float:
    """Return the root mean square."""
    return float(np.sqrt(np.mean(values**2)))


RELATIVE = 0.01
"""Smallest margin relative to the simulator's mean, whatever the noise: the gain of a force sensor, a depth by
caliper and a time grid of SYNCs are not known better."""


@dataclass(frozen=True, kw_only=True)
class Measure:
    """Number of a cut compared between rig and simulator.

    Attributes
    ----------
    name, unit, meaning : str
        Name, unit ("1" for a pure number) and description.
    least_margin : float
        Smallest equivalence margin, whatever the sensor's noise; in the unit.
    share : bool
        True for a yes-or-no measure, compared by its mean.
    paired : bool
        True if it needs cuts of the same specimen on both sides.
    value : callable
        Function of a cut and the simulator's other cuts of its specimen; None where there is no value.
    harmless : callable, optional
        Function of a simulated cut: a difference that is within measurement accuracy, as an additional margin.
    """

    name: str
    unit: str
    meaning: str
    least_margin: float
    share: bool = False
    paired: bool = False
    value: Callable[[ComparedCut, Sequence[ComparedCut]], float | None]
    harmless: Callable[[ComparedCut], float | None] | None = None


# Smallest margins are a tenth of what the task tolerates; the resolution of the force sensor is added elsewhere.
_LENGTH = 0.3e-3  # [m]; the tip of a success is within 3 mm
_BY_UNIT = {
    "m": _LENGTH,
    "s": 0.1,  # of 30 s
    "m2": 8e-6,  # a tenth of a millimetre along 8 cm
}
_BY_NAME = {
    "force_drops": 0.5,  # a typical cut has about as many
    "reversals": 0.5,
    "wedge": 0.018,  # a degree of the 10 that success allows
    "uncontrolled_share": 0.02,
}
_COUNTED = 0.25  # share of cuts: a dozen specimens cannot show a smaller difference than one in four
_RETURN = 0.02  # a tenth of the typical difference between two reasonable scripts


def _metric(name: str) -> Measure:
    about = metric_named(name)

    def value(cut: ComparedCut, others: Sequence[ComparedCut]) -> float | None:
        return cut.card.metrics[name].value

    def harmless(cut: ComparedCut) -> float | None:
        """Return the metric's change if the zero is off by one resolution."""
        own, displaced = cut.card.metrics[name].value, cut.displaced.metrics[name].value
        return None if own is None or displaced is None else abs(displaced - own)

    return Measure(
        name=name,
        unit=about.unit.replace("F", "N"),
        meaning=about.meaning,
        least_margin=_BY_NAME.get(name, _BY_UNIT.get(about.unit, 0.0)),
        value=value,
        harmless=harmless,
    )


def _beside(
    compared: Callable[[ComparedCut, ComparedCut], float | None],
) -> Callable[[ComparedCut, Sequence[ComparedCut]], float | None]:
    """Average a comparison over all other simulated cuts of the specimen."""

    def value(cut: ComparedCut, others: Sequence[ComparedCut]) -> float | None:
        found = [each for other in others if (each := compared(cut, other)) is not None]
        return float(np.mean(found)) if found else None

    return value


def _compared(
    name: str, unit: str, meaning: str, margin: float, value: Callable[[ComparedCut, ComparedCut], float | None]
) -> Measure:
    return Measure(name=name, unit=unit, meaning=meaning, least_margin=margin, paired=True, value=_beside(value))


def _traces(compared: Callable[[Trace, Trace], float | None]) -> Callable[[ComparedCut, ComparedCut], float | None]:
    return lambda cut, other: compared(cut.trace, other.trace)


_OF_SPECIMEN = "from the simulator's cuts of the same specimen"
_TASK = (
    Measure(
        name="return",
        unit="1",
        meaning="Sum of the cut's rewards, from estimates that a rig can make.",
        least_margin=_RETURN,
        value=lambda cut, others: cut.value,
    ),
    Measure(
        name="success",
        unit="1",
        meaning="1 if the cut was a success: finished, near the target and upright.",
        least_margin=_COUNTED,
        share=True,
        value=lambda cut, others: float(cut.success),
    ),
)
_END = "Share of the simulator's cuts of the same specimen with the same kind of end."
_FORCE = "Difference of force at equal positions from the simulator's cuts of the specimen (up to a retreat)."
_OFFSET = "Absolute mean of that difference: it shows a drifting zero, while runs of the crack cancel out."
_PLACE = f"Difference of position at equal times {_OF_SPECIMEN}."
_BESIDE = (
    dataclasses.replace(
        _compared("end_agreement", "1", _END, _COUNTED, lambda cut, other: float(cut.end == other.end)), share=True
    ),
    dataclasses.replace(
        _compared("force_rmse", "N", _FORCE, FORCE_RESOLUTION, _traces(force_rmse)),
        # One run of the crack that comes slightly later makes a difference of newtons for a while.
        harmless=lambda cut: force_rmse(cut.trace, cut.trace, displaced=_LENGTH),
    ),
    _compared("force_offset", "N", _OFFSET, FORCE_RESOLUTION, _traces(force_offset)),
    _compared("position_rmse", "m", _PLACE, _LENGTH, _traces(position_rmse)),
)

MEASURES: Mapping[str, Measure] = {each.name: each for each in (*_TASK, *_BESIDE, *map(_metric, METRICS))}
"""Everything that is compared, by name: task, curves, and every metric of a score card."""
_HEIGHT = f"Difference of the blade's height at equal times {_OF_SPECIMEN}."
_DISTANCE = f"Distance of the blade in the plane at equal times {_OF_SPECIMEN}."
_APART = {
    "depth": _compared("height_rmse", "m", _HEIGHT, _LENGTH, _traces(height_rmse)),
    "path": _compared("place_rmse", "m", _DISTANCE, _LENGTH, _traces(place_rmse)),
}
MAP_MEASURES: Mapping[str, Mapping[str, Measure]] = {
    task: {_APART[task].name: _APART[task]}
    | {name: _metric(name) for name in metrics if not name.startswith("layer_")}  # no rig sees a layer below
    for task, metrics in MAP_METRICS.items()
}
"""Further measures of a task, by task: the blade's way, and the metrics of the map that a rig can tell."""


def measures_of(cuts: Sequence[ComparedCut]) -> Mapping[str, Measure]:
    """Return everything that is compared of these cuts, by name."""
    fields = {"depth": "height", "path": "blade_x"}
    told = [
        MAP_MEASURES[task]
        for task, field in fields.items()
        if cuts and all(getattr(cut.trace, field) is not None for cut in cuts)
    ]
    return {name: each for measures in (MEASURES, *told) for name, each in measures.items()}


QUANTILES = (0.5, 0.99, 0.999)


@dataclass(frozen=True, kw_only=True, eq=False)
class ClockKept:
    """Control periods and latencies of all cuts on a rig.

    Parameters
    ----------
    nominal : float
        Requested period [s].
    periods : array_like of shape (n,)
        Time from command to command [s].
    latencies : array_like of shape (m,)
        Time from the newest reading used by a decision to its command on the bus [s].
    overruns : int
        Number of commands more than 2 ms late.
    skipped : float
        Time lost by late commands [s].
    garbled : int
        Number of packets that were no readings.
    """

    nominal: float
    periods: Array
    latencies: Array
    overruns: int = 0
    skipped: float = 0.0
    garbled: int = 0

    def __post_init__(self) -> None:
        in_range("nominal", self.nominal, 1e-3, 1.0, "s", "Give seconds: 20 ms is 0.02.")
        for name in ("periods", "latencies"):
            object.__setattr__(self, name, array_in_range(name, getattr(self, name), -1.0, 3600.0, "s"))

    @classmethod
    def of(cls, nominal: float, parts: Sequence[tuple[ArrayLike, ArrayLike, int, float, int]]) -> ClockKept:
        """Combine cuts, each given as periods, latencies, overruns, skipped and garbled."""
        periods, latencies, overruns, skipped, garbled = zip(*parts, strict=True) if parts else ((), (), (), (), ())
        return cls(
            nominal=nominal,
            periods=np.concatenate([np.zeros(0), *map(np.asarray, periods)]),
            latencies=np.concatenate([np.zeros(0), *map(np.asarray, latencies)]),
            overruns=sum(overruns),
            skipped=float(sum(skipped)),
            garbled=sum(garbled),
        )

    @property
    def jitter(self) -> float:
        """Standard deviation of the periods about the nominal one [s]."""
        return float(np.sqrt(np.mean((self.periods - self.nominal) ** 2))) if len(self.periods) else 0.0

    def spread(self, name: str) -> dict[str, float]:
        """Return quantiles p50, p99, p99.9 and maximum [s], if any.

        ``name`` is "periods" or "latencies".
        """
        values: Array = getattr(self, name)
        if not len(values):
            return {}
        found = {f"p{100 * q:g}": float(np.quantile(values, q)) for q in QUANTILES}
        return {**found, "max": float(values.max())}

    def to_dict(self) -> dict[str, object]:
        """Return a JSON-serialisable summary, with units in the names."""
        kept = {key: getattr(self, key) for key in ("overruns", "garbled")}
        return {
            "nominal_period_s": self.nominal,
            "commands": len(self.periods),
            "jitter_sd_s": self.jitter,
            "period_s": self.spread("periods"),
            "latency_s": self.spread("latencies"),
            "skipped_s": self.skipped,
            **kept,
        }
