"""Metrics of a cut.

Force, motion, outcome, and the map of a cut.

Each is a pure function of one cut, with unit, direction, formula, source and validity.

Steadiness of the force leads; the peak is only a safety limit.  Smoothness of the motion is reported and never
rewarded: a perfect constant feed scores badly on it.  Outcome is distance from the target, unstable growth, work.

Those of the map are depth beside a wanted depth and the layer below, or distance to a drawn line, and forces. A record
with the height of the blade has those of the depth, and one with a measured depth beside a wanted one. A record with
the places of the blade has those of the path, beside a line.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from cutenv._base.arrays import Array
from cutenv._base.validation import one_of
from cutenv.records.measurement.strokes import STANDSTILL_SPEED, strokes, turning_points
from cutenv.records.scoring.scored_cut import ScoredCut
from cutenv.records.scoring.validity import BANDWIDTH, RATE, Unavailable, even_instants
from cutenv.sim import quantities
from cutenv.sim.quantities import DECELERATION, TIP_TOLERANCE, force_per_depth
from cutenv.sim.tissue.grid import SPACING

Direction = Literal["lower", "higher", "none"]
Invariance = Literal["time_shift", "force_scale", "force_offset", "resampling", "rest_after", "units"]

INVARIANCES: dict[Invariance, str] = {
    "time_shift": "the clock may start anywhere",
    "force_scale": "the force may be normalised by any number",
    "force_offset": "a sensor's zero does not matter",
    "resampling": "the rate of readings does not matter, from 200 Hz on, within 5 %",
    "rest_after": "a second of rest in the unloaded tissue after the cut adds nothing, within 2 %",
    "units": "doubling a cut's force and depth and the slab's thickness together changes nothing",
}
"""Invariances that a metric may promise; each has one test for all metrics that do."""
EVERY: tuple[Invariance, ...] = tuple(INVARIANCES)  # of them


@dataclass(frozen=True, kw_only=True)
class Metric:
    """One metric of a cut.

    Attributes
    ----------
    name : str
        Name of the metric; ``*_error`` is best at zero.
    unit : str
        "1" for a pure number; "F" stands for the force unit of the record.
    direction : {"lower", "higher", "none"}
        Direction that is better; "none": reported and never rewarded.
    meaning, formula, source, validity : str
        Description, formula, source, and range of validity.
    needs : tuple of str
        Required fields of the trace beside time and force, and "newtons", "target_length", "tip".
    invariances : tuple of str
        Names in :data:`INVARIANCES`.
    """

    name: str
    unit: str
    direction: Direction
    meaning: str
    formula: str
    source: str
    validity: str
    function: Callable[[ScoredCut], float]
    needs: tuple[str, ...] = ()
    invariances: tuple[Invariance, ...] = ()

    def __post_init__(self) -> None:
        one_of("direction", self.direction, get_args(Direction))
        for each in self.invariances:
            one_of("invariance", each, INVARIANCES)


METRICS: dict[str, Metric] = {}
"""Metrics of every record by name, in the order of the score card."""
MAP_METRICS: dict[str, dict[str, Metric]] = {"depth": {}, "path": {}}
"""Metrics that a record of a task adds, which has a map of the cut, by the task; in the order of the score card."""
FORCE_WEIGHTS: Mapping[str, float] = {
    "force_rate": 0.30,
    "force_jerk": 0.20,
    "force_drops": 0.20,  # tissue that tears lets go of the blade
    "mean_force_drop": 0.15,
    "force_variation": 0.15,
}
"""Weights of the leading metrics' percentiles for a record without tip or target; they sum to 1.

They are a choice that follows research on force-based assessment: steadiness of the force leads, the peak force is only
a safety limit, and smoothness of the motion is reported but not scored.
"""


def metric(
    unit: str, direction: Direction, *, among: dict[str, Metric] = METRICS, **about: Any
) -> Callable[[Callable[[ScoredCut], float]], Callable[[ScoredCut], float]]:
    """Register a function of a cut in :data:`METRICS` by its name.

    Its docstring's first line is the meaning.

    ``among`` is one of :data:`MAP_METRICS` for a metric of a map; ``about`` are the other fields of a :class:`Metric`.
    """

    def enter(function: Callable[[ScoredCut], float]) -> Callable[[ScoredCut], float]:
        name, meaning = function.__name__, (function.__doc__ or "").strip().partition("\n")[0]
        among[name] = Metric(name=name, unit=unit, direction=direction, meaning=meaning, function=function, **about)
        return function

    return enter


def metric_named(name: str) -> Metric:
    """Return a metric of any record by its name."""
    return all_metrics()[name]


def all_metrics() -> dict[str, Metric]:
    """Return metrics of records and tasks by name, in card order."""
    return {name: each for metrics in (METRICS, *MAP_METRICS.values()) for name, each in metrics.items()}


_ALL = "any record; where position is known, while the blade advances"
_PER_DEPTH = ("depth", "newtons")
HASTE_RATE = 200.0
"""Rate at which the blade's speed is taken for :func:`haste` [Hz]."""
_BLURRED = 0.047  # [s] between readings at which a hand's lurch has half of the haste that 1 kHz shows
_LURCHES = 0.03  # [m/s] from which on a blade lurches: no feed is so fast
DROP_SHARE = 0.1
"""Smallest fall of the force that counts as a drop, as a fraction of its range."""


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
    return float(cut.force[cut.advancing].max())


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
    """Return falls of force between extremes while the blade advances."""
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


_PADDING = 0.1  # rest added at either end, as a fraction of the movement: smoothness is defined from rest to rest
_PAD_LEVEL = 4  # zero padding for the spectrum: 2^4 times the movement's length
_CUT_OFF, _THRESHOLD = 10.0, 0.05  # [Hz]; fraction of the largest amplitude
_MOTION = ("position",)


@metric(
    "s", "lower", formula="from the first motion to the last, or from the first force", source="cost of the task",
    validity="without position: while the force is above a tenth of its range", invariances=EVERY,
)  # fmt: skip
def duration(cut: ScoredCut) -> float:
    """Duration of the cut."""
    if cut.trace.position is None:
        under = cut.time[cut.advancing]
        return float(under[-1] - under[0])
    first, last, _ = moving_between(cut)
    return float(cut.time[last] - cut.time[first])


@metric(
    "s", "lower", formula="time below 0.5 mm/s between the first motion and the last", source="motion analysis",
    validity="speed from position over 50 ms", needs=_MOTION, invariances=EVERY,
)  # fmt: skip
def idle_time(cut: ScoredCut) -> float:
    """Time for which the blade stood still before it went on."""
    first, last, moving = moving_between(cut)
    return float(cut.weights[first : last + 1] @ ~moving[first : last + 1])


@metric(
    "1", "lower", formula="strokes that go the other way than the one before", source="motion analysis",
    validity="strokes of 0.2 mm and more", needs=_MOTION, invariances=EVERY,
)  # fmt: skip
def reversals(cut: ScoredCut) -> float:
    """Reversals of the blade's motion."""
    _ = cut.position  # raises if it was not recorded
    found = strokes(cut.trace)
    return float(sum(a.forward != b.forward for a, b in itertools.pairwise(found)))


@metric(
    "1", "none", formula="minus the arc length of the speed's normalised spectrum, to 10 Hz", validity="rest to rest",
    source="Balasubramanian et al. 2015, doi 10.1186/s12984-015-0090-9", needs=_MOTION, invariances=EVERY,
)  # fmt: skip
def sparc(cut: ScoredCut) -> float:
    """Smoothness of the motion, by the spectral arc length (SPARC)."""
    return spectral_arc_length(_rest_to_rest(cut), RATE)


@metric(
    "1", "none", formula="-ln(T^3 / v_peak^2 integral of (d2v/dt2)^2 dt)", validity="rest to rest",
    source="Balasubramanian et al. 2015, doi 10.1186/s12984-015-0090-9", needs=_MOTION, invariances=EVERY,
)  # fmt: skip
def log_dimensionless_jerk(cut: ScoredCut) -> float:
    """Smoothness of the motion, by its jerk (LDLJ)."""
    return log_jerk(_rest_to_rest(cut), RATE)


def spectral_arc_length(speed: Array, rate: float) -> float:
    """Compute a speed profile's SPARC at ``rate`` [Hz]; 0 is smoothest."""
    n = int(2 ** (np.ceil(np.log2(len(speed))) + _PAD_LEVEL))
    frequency = np.arange(0, rate, rate / n)
    amplitude = np.abs(np.fft.fft(speed, n))
    if amplitude.max() == 0.0:
        raise Unavailable("the blade does not move")
    amplitude = amplitude / amplitude.max()
    inside = frequency <= _CUT_OFF
    frequency, amplitude = frequency[inside], amplitude[inside]
    above = np.flatnonzero(amplitude >= _THRESHOLD)
    frequency, amplitude = frequency[above[0] : above[-1] + 1], amplitude[above[0] : above[-1] + 1]
    span = float(frequency[-1] - frequency[0])
    if span == 0.0:
        raise Unavailable("too short a movement for a spectrum")
    return -float(np.sum(np.hypot(np.diff(frequency) / span, np.diff(amplitude))))


def log_jerk(speed: Array, rate: float) -> float:
    """Compute a speed profile's LDLJ at ``rate`` [Hz]; larger is smoother."""
    peak = float(np.abs(speed).max())
    if peak == 0.0 or len(speed) < 4:
        raise Unavailable("the blade does not move")
    dt = 1.0 / rate
    jerk = np.diff(speed, 2) / dt**2
    total = float(np.sum(jerk**2)) * dt
    if total == 0.0:
        raise Unavailable("the motion has no jerk at all")
    return -float(np.log((len(speed) * dt) ** 3 / peak**2 * total))


def moving_between(cut: ScoredCut) -> tuple[int, int, NDArray[np.bool_]]:
    """Return first and last moving instants, and a mask, shape (n,)."""
    moving = _moving(cut)
    first, last = np.flatnonzero(moving)[[0, -1]]
    return int(first), int(last), moving


def _moving(cut: ScoredCut) -> NDArray[np.bool_]:
    moving: NDArray[np.bool_] = np.abs(cut.blade_speed) > STANDSTILL_SPEED
    if not moving.any():
        raise Unavailable("the blade never moves")
    return moving


def _rest_to_rest(cut: ScoredCut) -> Array:
    """Return the speed from rest to rest at 100 Hz [m/s]."""
    first, last, _ = moving_between(cut)
    instants = even_instants(cut.time[first : last + 1], RATE)
    if len(instants) < 30:
        raise Unavailable("shorter than 0.3 s")
    speed = np.interp(instants, cut.time, cut.blade_speed)
    rest = np.zeros(max(3, round(_PADDING * len(speed))))
    return np.concatenate((rest, speed, rest))


_FLAT = 0.1  # sine of the angle below which no blade cuts
_TIP = ("position", "depth", "newtons", "tip")
_VALID_TIP = "tip as known: truth; after a return stroke, to 0.3 mm; or estimated, to 1 or 2 mm, one in ten beyond 5 mm"


@metric(
    "m", "lower", formula="|a_end - L|", source="terminal cost of the task", validity=_VALID_TIP,
    needs=(*_TIP, "target_length"), invariances=("time_shift", "rest_after", "units"),
)  # fmt: skip
def tip_error(cut: ScoredCut) -> float:
    """Distance of the crack tip from the target at the end."""
    return quantities.tip_error(float(cut.tip[cut.end]), cut.length)


@metric(
    "m", "lower", formula="max(a - L, 0)", source="cost of the task", validity=_VALID_TIP,
    needs=(*_TIP, "target_length"), invariances=("time_shift", "rest_after", "units"),
)  # fmt: skip
def overshoot(cut: ScoredCut) -> float:
    """Largest distance of the crack tip beyond the target."""
    return float(quantities.overshoot(float(cut.tip[: cut.end + 1].max()), cut.length))


@metric(
    "1", "lower", formula="cot(theta_end)", source="terminal cost of the task", validity="45 to 90 degrees",
    needs=("angle",), invariances=EVERY,
)  # fmt: skip
def wedge(cut: ScoredCut) -> float:
    """Width of the wedge that an inclined blade leaves uncut at the end, over its depth."""
    angle = float(cut.angle[cut.end])
    if math.sin(angle) < _FLAT:
        raise Unavailable(f"the blade lies flat, at {math.degrees(angle):.0f} degrees")
    return abs(float(quantities.wedge(angle, 1.0)))


@metric(
    "1", "lower", formula="sum of jumps / advance of the tip", source="law of cutting, unstable growth",
    validity=_VALID_TIP, needs=_TIP, invariances=("time_shift", "rest_after", "units"),
)  # fmt: skip
def uncontrolled_share(cut: ScoredCut) -> float:
    """Fraction of the cut that the crack ran by itself (unstable growth)."""
    advance = float(cut.tip[-1] - min(cut.tip[0], 0.0))
    if advance < 1e-3:
        raise Unavailable("the tip advances less than 1 mm")
    return min(float(cut.jumps.sum()) / advance, 1.0)


@metric(
    "m", "lower", formula="max of jumps", source="law of cutting, unstable growth", validity=_VALID_TIP, needs=_TIP,
    invariances=("time_shift", "rest_after", "units"),
)  # fmt: skip
def largest_jump(cut: ScoredCut) -> float:
    """Longest unstable run of the crack."""
    return float(cut.jumps.max())


@metric(
    "1", "lower", formula="integral of v^2 abs(dx) / (2 x 0.1 m/s2 x 3 mm x L)", source="cost of the task",
    validity="speed over 5 ms, or from one reading to the next", needs=("position", "target_length"), invariances=EVERY,
)  # fmt: skip
def haste(cut: ScoredCut) -> float:
    """Mean way that the blade would need to stop, over 3 mm: how far it goes on when the tissue gives way.

    Fewer than 200 readings a second blur a lurch of some 30 ms: its speed is then raised by what they usually hide.
    """
    moved = np.abs(np.diff(np.interp(even_instants(cut.time, HASTE_RATE), cut.time, cut.position)))
    cubes = moved**3
    if cut.trace.sample_rate < HASTE_RATE:
        cubes[moved * HASTE_RATE > _LURCHES] *= 1.0 + (1.0 / (cut.trace.sample_rate * _BLURRED)) ** 2
    return float(cubes.sum()) * HASTE_RATE**2 / (2.0 * DECELERATION * TIP_TOLERANCE * cut.length)


@metric(
    "m", "lower", formula="mean of x - a while the blade advances", source="law of cutting", validity=_VALID_TIP,
    needs=_TIP, invariances=("time_shift", "rest_after", "units"),
)  # fmt: skip
def mean_lag(cut: ScoredCut) -> float:
    """Mean distance of the tip behind the blade: tissue that is dragged along."""
    return cut.mean(quantities.lag(cut.position, cut.tip))


@metric(
    "1", "lower", formula="integral of F dx / (R integral of B da)", source="thesis, 6.1-6.4", validity=_VALID_TIP,
    needs=_TIP, invariances=("time_shift", "resampling", "rest_after", "units"),
)  # fmt: skip
def work_over_fracture(cut: ScoredCut) -> float:
    """Work of the blade over the fracture energy of the cut area; R is the truth, or else pig liver's mean."""
    F, x = cut.newtons, cut.position
    work = float(0.5 * (F[1:] + F[:-1]) @ np.diff(x))
    area = cut.profile.area(min(float(cut.tip[0]), 0.0), float(cut.tip[-1]))
    if area < 1e-6:
        raise Unavailable("less than 1 mm2 was cut")
    R = cut.tissue.fracture_resistance if cut.truth is None else cut.truth.resistance
    return work / (R * area)


_FLOOR: dict[str, Any] = {
    "among": MAP_METRICS["depth"],
    "validity": "floor as known: truth; with height, that of mean tissue under this blade; else the recorded depth",
    "needs": ("position", "depth", "newtons", "tip"),
    "invariances": ("time_shift",),
}
_PATH: dict[str, Any] = {
    "among": MAP_METRICS["path"],
    "validity": "cut as known: truth; else that of mean tissue behind this blade",
    "needs": ("position", "tip"),
    "invariances": ("time_shift",),
}
_FORCE: dict[str, Any] = {"source": "limit of a rig", "validity": "any record with it", "invariances": ("time_shift",)}
_DEPTH_TASK, _PATH_TASK = "cost of the task along a wanted depth", "cost of the task along a drawn line"


@metric("m", "lower", formula="integral of abs(D - D_wanted) da / L", source=_DEPTH_TASK, **_FLOOR)
def mean_depth_error(cut: ScoredCut) -> float:
    """Mean distance of the floor of the cut from the wanted depth, over the target length."""
    return cut.depth_map.mean_error(cut.length)


@metric("m", "lower", formula="root of the mean over the cut of (D - D_wanted)^2", source="ours", **_FLOOR)
def rms_depth_error(cut: ScoredCut) -> float:
    """Root mean square distance of the floor of the cut from the wanted depth."""
    return float(np.sqrt(np.mean(cut.depth_map.error**2)))


@metric("m", "lower", formula="max of abs(D - D_wanted)", source="ours", **_FLOOR)
def largest_depth_error(cut: ScoredCut) -> float:
    """Largest distance of the floor of the cut from the wanted depth."""
    return float(np.abs(cut.depth_map.error).max())


@metric("m2", "lower", formula="integral of max(D - D_wanted, 0) da", source=_DEPTH_TASK, **_FLOOR)
def too_deep_area(cut: ScoredCut) -> float:
    """Area cut below the wanted depth."""
    return cut.depth_map.deep


@metric("m2", "lower", formula="integral of max(D_wanted - D, 0) da", source=_DEPTH_TASK, **_FLOOR)
def uncut_area(cut: ScoredCut) -> float:
    """Area left uncut above the wanted depth, behind the tip."""
    return cut.depth_map.uncut


@metric("m2", "lower", formula="integral of max(D - D_layer, 0) da", source=_DEPTH_TASK, **_FLOOR)
def layer_area(cut: ScoredCut) -> float:
    """Area opened in the layer below."""
    return SPACING * float(cut.depth_map.opened.sum())


@metric("m", "lower", formula="max of D - D_layer, or 0", source=_DEPTH_TASK, **_FLOOR)
def layer_depth(cut: ScoredCut) -> float:
    """Largest depth into the layer below."""
    return float(cut.depth_map.opened.max())


@metric("F", "lower", formula="max V, upwards on the blade", among=MAP_METRICS["depth"], **_FORCE)
def peak_vertical_force(cut: ScoredCut) -> float:
    """Largest force with which the blade pressed down on the tissue."""
    return max(float(_usable(cut, cut.trace.vertical_force, "vertical").max()), 0.0)


@metric("m", "lower", formula="integral of abs(d) da / L", source=_PATH_TASK, **_PATH)
def mean_line_distance(cut: ScoredCut) -> float:
    """Mean distance between cut and line, over the target length."""
    return cut.path_map.mean_distance(cut.length)


@metric("m", "lower", formula="max of abs(d)", source=_PATH_TASK, **_PATH)
def largest_line_distance(cut: ScoredCut) -> float:
    """Largest distance between cut and line."""
    return cut.path_map.farthest


@metric("m2", "lower", formula="integral of abs(d) (1 - curvature d / 2) da", source=_PATH_TASK, **_PATH)
def line_area(cut: ScoredCut) -> float:
    """Area between cut and line."""
    return cut.path_map.area


@metric("F", "lower", formula="max abs(lateral force)", among=MAP_METRICS["path"], **_FORCE)
def peak_lateral_force(cut: ScoredCut) -> float:
    """Largest force across the blade, to either side."""
    return float(abs(_usable(cut, cut.trace.lateral_force, "lateral")).max())


def _usable(cut: ScoredCut, force: Array | None, name: str) -> Array:
    if cut.spoiled:
        raise Unavailable(cut.spoiled)
    if force is None:
        raise Unavailable(f"{name} force was not recorded")
    return force
