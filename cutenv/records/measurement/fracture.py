"""Fracture resistance: work per area cut (thesis, chapter 6)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from scipy.integrate import trapezoid
from scipy.optimize import brentq

from cutenv._base.arrays import Array
from cutenv._base.validation import in_range
from cutenv.records.measurement.depth import DepthProfile, depth_sd, stiffness_ratio, unit_stiffness
from cutenv.records.measurement.loading_ratio import LoadingRatio, loading_ratio_of
from cutenv.records.measurement.segments import Segment, loading_segments
from cutenv.records.measurement.strokes import STANDSTILL_SPEED, ReturnStroke, Stroke, fit_return_stroke, strokes
from cutenv.records.measurement.zero import SensorZero, zeroed
from cutenv.sim.quantities import MEASURABLE_DEPTH
from cutenv.sim.tissue.cut_model import CutModel
from cutenv.sim.tissue.description import measured_liver
from cutenv.sim.trace import Trace

_Stiffness = Callable[[float | Array, float], Array]  # [N/m], from tip [m] and friction per depth [N/m]

FRICTION_SHARE = 0.2
"""Assumed share of friction in the measured resistance [1], where nothing measures it; sweep 0 to 0.4."""

_SETTLED = 1e-9  # relative tolerance of assumed friction
_LONGEST_LAG = 0.02  # [m] of the blade ahead of the tip: in liver it is 2 to 12 mm
_PLACES = 100  # positions behind the blade at which the tip of loaded tissue is searched
_SOFTEST = 0.1  # smallest share of a ramp's slope that belongs to the tissue rather than friction
_SHORTEST_CUT = 0.2e-3  # [m]
_SLOW_SHARE = 0.1  # share of the travel that may be below the speed that counts as standing
LEAST_RUN = 0.010  # length of the cut below which a crack counts as one that hardly ran [m]; its resistance is noise
_FINAL = 0.010  # [s] of readings averaged for the force at the end of the cut


@dataclass(frozen=True, kw_only=True)
class FractureEstimate:
    """Fracture resistance of one cut.

    Attributes
    ----------
    apparent : float
        Work of the blade per depth and travel [J/m2], equations 6.1 to 6.4, as in Table 6.1. It uses the blade's
        travel as the length of the cut and counts stored energy as fracture, and is too low for short cuts.
    corrected : float
        Work per area cut, by the estimated tip, less stored energy, friction's share included [J/m2].
    cut_length : float
        Distance from the start of the cut to the estimated tip [m].
    friction_per_depth : float
        Friction on the blade per depth of cut [N/m], as used in `corrected`.
    flags : tuple of str
        Remarks on what weakens the estimate; empty if nothing does.
    return_stroke : ReturnStroke or None
        The way back that closed the loop; None without one past the tip.
    zero : SensorZero
        The sensor's zero that was subtracted from the force first.
    depth_error : float or None
        Standard error of `corrected` that the depth's standard deviation leaves, as if it were one error all along the
        cut [J/m2]; a constant error of the cameras is not in it. None if the record does not give that, see
        :func:`cutenv.records.measurement.depth.depth_sd`.
    """

    apparent: float
    corrected: float
    cut_length: float
    friction_per_depth: float
    flags: tuple[str, ...]
    return_stroke: ReturnStroke | None = None
    zero: SensorZero = field(default_factory=SensorZero)
    depth_error: float | None = None


def estimate_fracture_resistance(
    trace: Trace,
    *,
    friction_per_depth: float | None = None,
    friction_share: float = FRICTION_SHARE,
    loading_ratio: float | LoadingRatio | None = None,
) -> FractureEstimate:
    """Find a cut's fracture resistance R from the blade's work.

    The sensor's zero is subtracted. With a return stroke past the tip, the loop is closed: all elastic energy is given
    back, and the tip is where the force has become plain friction f on the way back. Then R = (W - 2 f x)/(B a) + f/B,
    or, for a varying depth, R = (W - phi * integral of B |dx|) / (integral of B from 0 to a) + phi with phi = f/B,
    after any number of earlier strokes. Without a return stroke the stored energy F_elastic^2/(2 K) and the lag
    F_elastic/K are estimated from the final force and the stiffness K = slope / r of the last loading segment, with a
    flag.

    Parameters
    ----------
    trace : Trace
        Record with position and depth, from the start of the cut; force in newtons. Without a return stroke also
        angle, unless `loading_ratio` is given.
    friction_per_depth : float, optional
        phi [N/m], 0 to 1e5; by default from the return stroke, or else by `friction_share`.
    friction_share : float
        Friction's share of R [1], 0 to 0.9; used, with a flag, only where nothing measures friction.
    loading_ratio : float or callable, optional
        r [1], 0.01 to 1, for other tissue, or a function of speed [m/s] and angle [rad]. By default that of
        pig liver at the last segment's speed and angle.

    Raises
    ------
    ValueError
        If the trace lacks position, depth or newtons, does not advance, does no work of cutting, or an argument is out
        of range.

    Notes
    -----
    Equations 6.1 to 6.4 and section 6.2 of the thesis; :func:`~cutenv.records.measurement.zeroed` subtracts the zero.

    The thesis integrated the norm of the sensor's three components (sections 3.3.2 and 5.3): its R, Table 6.1,
    contains the work that vertical and lateral force would do along the cut. A trace holds one force, properly the
    component along the cut; R of the one and of the other are different quantities. A norm has no sign, so its way
    back gives no friction.

    The error is mostly due to depth. In sampled livers cut 11 cm long R is recovered within 0.4 % (median) and 1.6 %
    (95th percentile) with exact depth, within 1.3 and 4.0 % with depth known to 0.5 mm; then within 2.8 and 7.9 %
    over 6 cm and 5.7 and 16 % over 3 cm, which are shallower. Without a return stroke friction's share is wrong by
    the assumption, and R within 0.5 and 2.1 % over 11 cm, exact depth (``scripts/validation/measurement/recovery.py
    --specimens 40``).
    """
    by = "estimate_fracture_resistance"
    trace.require_newtons(by=by)
    (position,) = trace.require("position", by=by)
    depth = DepthProfile.recorded(trace, by=by)
    trace, zero = zeroed(trace)
    in_range("friction_share", friction_share, 0.0, 0.9, "1", "It is a share: 20 % is 0.2.")
    if friction_per_depth is not None:
        in_range("friction_per_depth", friction_per_depth, 0.0, 1e5, "N/m")
    ratio = loading_ratio_of(loading_ratio, low=0.01)
    start = float(position[0])
    travel = float(position.max()) - start
    in_range("travel of the blade", travel, 1e-3, 0.5, "m", "Give a record in which the blade advances.")

    _check_speed(trace, position, travel)
    in_range(
        "area below the blade", depth.area(start, start + travel), 1e-7, 1.0, "m2", "Record the depth of cut in m."
    )

    flags = list(zero.flags)
    if float(depth.depth.min()) < MEASURABLE_DEPTH:
        flags.append("depth below 0.5 mm counts as 0.5 mm in the apparent value")
    apparent = _work_per_depth(trace, position, depth) / travel  # (6.4)
    sd = depth_sd(trace)
    relative = None if sd is None else sd * travel / depth.area(start, start + travel)
    way_back = fit_return_stroke(trace, depth)
    if way_back is not None:
        phi = way_back.friction_per_depth if friction_per_depth is None else friction_per_depth
        corrected = _closed_loop(trace, position, depth, way_back, phi)
        flags += hardly_ran(way_back.tip - start, travel)
        return FractureEstimate(
            apparent=apparent,
            corrected=corrected,
            cut_length=way_back.tip - start,
            friction_per_depth=phi,
            flags=tuple(flags),
            return_stroke=way_back,
            zero=zero,
            depth_error=None if relative is None else relative * corrected,
        )
    flags.append("no return stroke past the tip: stored energy and lag estimated")
    ramp = next((s for s in reversed(loading_segments(trace)) if s.is_steady), None)
    if ramp is None or (loading_ratio is None and ramp.angle is None):
        missing = "no steady loading segment" if ramp is None else "neither angle nor loading_ratio known"
        flags.append(f"{missing}: stiffness of mean pig liver")
        stiffness = _mean_liver_stiffness(depth, float(position.max()))
    else:
        (speed,) = ramp.require("speed", by=by)
        stiffness = _ramp_stiffness(ramp, ratio(speed, ramp.angle), position, depth)
    if friction_per_depth is None:
        flags.append(f"friction assumed to be {100 * friction_share:g} % of the resistance")
    corrected, tip, phi = _open_loop(trace, depth, stiffness, friction_per_depth, friction_share)
    flags += hardly_ran(tip - start, travel)
    return FractureEstimate(
        apparent=apparent,
        corrected=corrected,
        cut_length=tip - start,
        friction_per_depth=phi,
        flags=tuple(flags),
        zero=zero,
        depth_error=None if relative is None else relative * corrected,
    )


def hardly_ran(length: float, travel: float) -> list[str]:
    """Return a flag for cuts much shorter than the travel [m]."""
    if length >= LEAST_RUN:
        return []
    return [
        f"the crack hardly ran ({1e3 * length:.1f} mm of {1e3 * travel:.0f} mm of the blade's way): the tissue was "
        "dragged, not cut, and shows no resistance"
    ]


def _check_speed(trace: Trace, position: Array, travel: float) -> None:
    """Raise for a cut too slow to count as motion."""
    advance = sum(position[s.stop - 1] - position[s.start] for s in strokes(trace) if s.forward)
    if advance < (1.0 - _SLOW_SHARE) * travel:
        raise ValueError(
            f"the blade moves slower than {STANDSTILL_SPEED * 1e3:g} mm/s over {1.0 - advance / travel:.0%} of the "
            "cut, where it counts as standing. Cut at 1 mm/s or faster, which is the measured range."
        )


def _work_per_depth(trace: Trace, position: Array, depth: DepthProfile) -> float:
    """Return W* over new ground [J/m], the integral of F/B dU. See equation 6.2."""
    reached = np.maximum.accumulate(position)
    F_per_B = trace.force / np.maximum(depth.at(position), MEASURABLE_DEPTH)
    return float(trapezoid(F_per_B, reached))


def _work(trace: Trace, position: Array, stop: int) -> float:
    """Return the blade's work over the first ``stop`` readings [J]."""
    return float(trapezoid(trace.force[:stop], position[:stop]))


def _rubbed_area(trace: Trace, position: Array, depth: DepthProfile, stop: int) -> float:
    """Return the integral of B |dx| up to reading ``stop`` [m2]."""
    moved = strokes(trace)
    return sum(abs(depth.area(*_ends(position, stroke))) for stroke in moved if stroke.stop <= stop)


def _ends(position: Array, stroke: Stroke) -> tuple[float, float]:
    x = position[stroke.samples]
    return float(x.min()), float(x.max())


def _closed_loop(trace: Trace, position: Array, depth: DepthProfile, way_back: ReturnStroke, phi: float) -> float:
    """Return R of a closed loop, with no energy stored.

    R = (W - phi int B |dx|) / int_0^a B da + phi.
    """
    W = _work(trace, position, way_back.stop)
    rubbed = phi * _rubbed_area(trace, position, depth, way_back.stop)
    return (W - rubbed) / depth.area(float(position[0]), way_back.tip) + phi


def _ramp_stiffness(ramp: Segment, r: float, position: Array, depth: DepthProfile) -> _Stiffness:
    """Return K by tip from a ramp's slope, less friction's share."""
    x, slope = ramp.require("position", "slope", by="estimate_fracture_resistance")
    first, last = (float(position[i]) for i in (ramp.start, ramp.stop - 1))
    rise_of_depth = float(depth.at(last) - depth.at(first)) / (last - first)

    def stiffness(a: float | Array, phi: float) -> Array:
        K = max(slope - phi * rise_of_depth, _SOFTEST * slope) / r
        ramp_tip = x - (ramp.force - phi * float(depth.at(x))) / K
        return K * stiffness_ratio(ramp_tip, a, depth)

    return stiffness


def _mean_liver_stiffness(depth: DepthProfile, farthest: float) -> _Stiffness:
    """Return K by tip [N/m], for the thesis's mean liver slab."""
    model = CutModel()
    in_range("position", farthest, 0.0, model.length, "m", "In a longer specimen record a return stroke.")

    def stiffness(a: float | Array, phi: float) -> Array:
        return measured_liver().modulus * unit_stiffness(a, depth, model)

    return stiffness


def _open_loop(
    trace: Trace, depth: DepthProfile, stiffness: _Stiffness, friction_per_depth: float | None, friction_share: float
) -> tuple[float, float, float]:
    """Return R, a and phi with the tissue still loaded.

    Friction that is a share of R is between none and all of the work: a root between bounds, however K varies.
    """
    (position,) = trace.require("position", by="estimate_fracture_resistance")
    advance = [s for s in strokes(trace) if s.forward]
    stop = max(advance, key=lambda stroke: position[stroke.stop - 1]).stop
    moving = slice(int(np.searchsorted(trace.time, trace.time[stop - 1] - _FINAL)), stop)
    start, x, F = float(position[0]), float(position[moving].mean()), float(trace.force[moving].mean())
    W = _work(trace, position, stop)
    rubbed = _rubbed_area(trace, position, depth, stop)
    places = np.linspace(x, max(start + _SHORTEST_CUT, x - _LONGEST_LAG), _PLACES)

    def resistance(phi: float) -> tuple[float, float]:
        F_elastic = max(F - phi * float(depth.at(x)), 0.0)
        a = _loaded_tip(x, F_elastic, lambda tip: stiffness(tip, phi), places)
        U = 0.5 * F_elastic * (x - a)
        return (W - phi * rubbed - U) / depth.area(start, a) + phi, a

    phi = friction_per_depth
    if phi is None:
        phi = _root(lambda phi: friction_share * resistance(phi)[0] - phi, W / rubbed)
    R, a = resistance(phi)
    if R <= 0.0:
        raise ValueError(
            f"the blade's work of {W:.3g} J is no more than friction and stored energy: the fracture resistance would "
            f"be {R:.3g} J/m2. Cut farther, or record the way back."
        )
    return R, a, phi


def _loaded_tip(x: float, F: float, stiffness: Callable[[float | Array], Array], places: Array) -> float:
    """Find the tip with K (x - a) = F nearest the blade.

    If there is none, it is x - F/K with K at the blade. ``places`` [m] run back from the blade. In tissue that gets
    softer that way, the estimated K may nowhere carry the force.
    """
    missing = (x - places) * stiffness(places) - F
    if F <= 0.0:
        return x
    if not (missing >= 0.0).any():
        return max(x - F / float(stiffness(x)), float(places[-1]))
    first = int(np.argmax(missing >= 0.0))
    return float(brentq(lambda a: float((x - a) * stiffness(a) - F), places[first], places[first - 1]))


def _root(function: Callable[[float], float], high: float) -> float:
    """Return the zero of ``function`` up to ``high``, or nearest end."""
    if high <= 0.0 or function(0.0) <= 0.0:
        return 0.0
    if function(high) >= 0.0:
        return high
    return float(brentq(function, 0.0, high, xtol=_SETTLED * high))
