"""Local effective moduli, which reproduce loading increments (sections 3.3.2, 3.4)."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from cutenv._base.arrays import Array
from cutenv._base.validation import in_range
from cutenv.records.measurement.depth import DepthProfile
from cutenv.records.measurement.fracture import FRICTION_SHARE, estimate_fracture_resistance
from cutenv.records.measurement.loading_ratio import LoadingRatio, in_measured_range, loading_ratio_of
from cutenv.records.measurement.segments import Segment, loading_segments
from cutenv.records.measurement.strokes import fit_return_stroke
from cutenv.records.measurement.zero import zeroed
from cutenv.sim.quantities import MEASURABLE_DEPTH
from cutenv.sim.tissue.cut_model import CutModel
from cutenv.sim.trace import Trace

_RESTLESS = 1.3  # multiple of the usual scatter of a record's ramps
_SMOOTH = 0.99  # R squared of a ramp without noise, whose bend is only that of the depth
_SOFTEST, _STIFFEST = 1e-3, 1e12  # [Pa], range in which a modulus is searched


@dataclass(frozen=True, kw_only=True, eq=False)
class ModulusEstimate:
    """Local effective moduli along a cut, shape (n_segments,).

    Attributes
    ----------
    position : ndarray
        Estimated tip, at which the modulus is measured [m].
    modulus : ndarray
        Local effective modulus of the recorded force [Pa], for the given model, at each segment's own speed and angle;
        divided by the loading ratio it is the slow, upright one
        (`cutenv.sim.tissue.local_effective_modulus`).
    segments : list of Segment
        The ramps from which it was found, of the force less friction.
    flags : tuple of str
        Remarks on what weakens the estimate; empty if nothing does.
    """

    position: Array
    modulus: Array
    segments: list[Segment]
    friction_per_depth: float
    flags: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.segments)

    @property
    def mean(self) -> float:
        """Mean over the segments [Pa]; raises ValueError without any."""
        return float(self._some().mean())

    @property
    def sd(self) -> float:
        """Population standard deviation over the segments [Pa]."""
        return float(self._some().std())

    @property
    def relative_error(self) -> Array:
        """Relative standard error of each segment's slope [1], by scatter."""
        return np.array([np.sqrt((1.0 / s.r_squared - 1.0) / (s.stop - s.start - 2)) for s in self.segments])

    def _some(self) -> Array:
        if not len(self):
            raise ValueError(
                "no modulus was found in this cut: it has no steady loading segment in deep enough tissue."
            )
        return self.modulus


def iterate_modulus(
    model_force_rise: Callable[[float], float],
    force_rise: float,
    *,
    initial: float = 1e4,
    tolerance: float = 0.01,
    most_steps: int = 100,
) -> float:
    """Find the modulus for a force rise by the thesis's iteration.

    A linear model needs one step; the iteration is for one whose force is not proportional to the modulus.

    Parameters
    ----------
    model_force_rise : callable
        The model's rise of force Delta F [N] under the measured displacement, as a function of the modulus
        [Pa].
    force_rise : float
        Measured Delta F [N], 1e-6 to 1e4.
    initial : float
        First modulus E_1 [Pa], 1e-3 to 1e12, "of arbitrary magnitude".
    tolerance : float
        Relative difference of forces at which the iteration stops [1], 1e-12 to 0.5.
    most_steps : int
        Number of steps after which it counts as divergent.

    Returns
    -------
    float
        Modulus [Pa].

    Raises
    ------
    ValueError
        If an argument is out of range, or the model's force is not positive.
    RuntimeError
        If it does not converge; the message gives step, modulus and residual.

    Notes
    -----
    Equations 3.1 and 3.2 of the thesis.
    """
    dF_exp = in_range("force_rise", force_rise, 1e-6, 1e4, "N", "A loading ramp rises.")
    E = in_range("initial", initial, _SOFTEST, _STIFFEST, "Pa", "A modulus is positive.")
    in_range("tolerance", tolerance, 1e-12, 0.5, "1", "The thesis's is 0.01.")
    in_range("most_steps", most_steps, 1, 1_000_000, "1", "A linear model needs 2.")
    step, residual = 0, np.inf
    while step < most_steps and _SOFTEST <= E <= _STIFFEST:
        dF_fem = in_range("the model's force rise", model_force_rise(E), 1e-300, 1e300, "N")
        residual = abs(dF_fem - dF_exp) / dF_exp
        if residual <= tolerance:  # (3.2)
            return E
        E = E * dF_exp / dF_fem  # (3.1)
        step += 1
    raise RuntimeError(
        f"the modulus did not converge: step {step}, modulus {E:g} Pa, residual {residual:g}. "
        "The model's force must rise with its modulus, and less than with its square."
    )


def estimate_local_effective_moduli(
    trace: Trace,
    model: CutModel,
    *,
    depth_normalised: bool = True,
    friction_per_depth: float | None = None,
    loading_ratio: float | LoadingRatio | None = None,
    smallest_drop: float | None = None,
    smoothing_readings: int | None = None,
) -> ModulusEstimate:
    """Find the local effective modulus of every loading segment.

    The model is linear, so one step of the thesis's iteration gives the modulus exactly: slope / (kappa B). Both
    kappa and the depth B belong to the crack tip, which follows the blade at a distance of F_elastic/K; with
    K = slope / r, where r is `loading_ratio`, it is at x - r F_elastic / slope. Left out are the first segment of
    each stroke, part of which is elastic, a last one without a drop, during which the blade slowed down, ramps that
    are not straight, because they hide a drop, or whose speed varies; and those that scatter more than 1.3 times as
    much about their line as the record's ramps usually do.

    Parameters
    ----------
    trace : Trace
        Record with position, and angle unless `loading_ratio` is given; force in newtons.
    model : CutModel
        Model to which the moduli shall belong; tips beyond its length are an error.
    depth_normalised : bool
        True: per depth of cut. False, or if the trace holds no depth (with a flag): as if the cut were everywhere as
        deep as the model is thick, 1 cm by default, which is what the thesis did in Tables 5.1 to 5.5.
    friction_per_depth : float, optional
        Friction on the blade per depth of cut [N/m], 0 to 1e5. By default from the return stroke; if there is none,
        a fifth of the fracture resistance, as :func:`~cutenv.records.measurement.estimate_fracture_resistance` assumes,
        with a flag. If friction is left in the force (0), the tip is estimated too far back and tissue of growing depth
        seems up to 14 % too stiff.
    loading_ratio : float or callable, optional
        r [1], 0 to 1, for other tissue, or a function of speed [m/s] and angle [rad]. By default that of pig liver
        at each segment's speed and angle. With 0 the blade counts as the tip, as in the thesis; the moduli are then
        several per cent too high.

    Returns
    -------
    ModulusEstimate
        Without segments if none was steady, or the tissue is shallower than 0.5 mm.

    Raises
    ------
    ValueError
        If the trace lacks what is needed, an argument is out of range, or a tip lies beyond the model.

    Notes
    -----
    Equations 3.1 and 3.2 of the thesis, and its section 3.4.

    The thesis's force is the norm of the sensor's three components (sections 3.3.2 and 5.3), so that its moduli,
    Tables 5.1 to 5.7, contain the rise of vertical and lateral force too. A trace holds one force: properly the
    component along the cut, whose moduli are no larger, or the norm (``cutenv.records.load(path, force="norm")``).

    Per depth of cut the modulus is apparent: tissue below a cut that does not go through the slab resists too, so that
    it is higher than the material's (:attr:`~cutenv.records.measurement.MeasuredCut.material_moduli`); in mean pig
    liver by a factor of 1.4 at 2 cm from the clamp and 1.2 at 9 cm (:func:`cutenv.sim.tissue.slab.effective_depth`).

    A cut's median modulus is recovered within 0.1 % (median) and 0.5 % (95th percentile) in sampled livers cut 11 cm
    long, with depth known exactly, and within 1.5 and 5.4 % with depth known to 0.5 mm; over 6 cm then within 3.5 and
    12 % (``scripts/validation/measurement/recovery.py --specimens 40``).
    """
    by = "estimate_local_effective_moduli"
    trace.require_newtons(by=by)
    trace.require("position", by=by)
    if loading_ratio is None:
        trace.require("angle", by=f"{by} without loading_ratio")
    ratio = loading_ratio_of(loading_ratio)
    trace, zero = zeroed(trace)
    flags = list(zero.flags)
    if depth_normalised and trace.depth is not None:
        depth = DepthProfile.recorded(trace, by=by)
    else:
        depth = DepthProfile.constant(model.thickness)
        flags.append(f"not normalised by depth: as if {model.thickness * 100:g} cm deep everywhere")
    if friction_per_depth is None:
        way_back = fit_return_stroke(trace, depth)
        if way_back is None:
            friction, flag = _assumed_friction(trace, depth, loading_ratio)
            flags.append(flag)
        else:
            friction = way_back.friction_per_depth
    else:
        friction = in_range("friction_per_depth", friction_per_depth, 0.0, 1e5, "N/m")

    elastic = elastic_record(trace, depth, friction)
    ramps = loading_segments(elastic, smallest_drop=smallest_drop, smoothing_readings=smoothing_readings)
    found = moduli_of(ramps, depth, model, ratio, friction_per_depth=friction)
    if loading_ratio is None and not all(in_measured_range(s.speed) for s in found.segments if s.speed):
        flags.append("speed outside the measured range: loading ratio of the nearest measured speed")
    return dataclasses.replace(found, flags=tuple(flags))


def _assumed_friction(
    trace: Trace, depth: DepthProfile, loading_ratio: float | LoadingRatio | None
) -> tuple[float, str]:
    """Return assumed friction per depth [N/m] and its flag."""
    (position,) = trace.require("position", by="_assumed_friction")
    if loading_ratio == 0.0:  # the blade counts as the tip: the resistance is found with liver's ratio
        loading_ratio = None
    try:
        found = estimate_fracture_resistance(
            dataclasses.replace(trace, depth=depth.at(position)), loading_ratio=loading_ratio
        )
    except ValueError as error:
        return 0.0, f"friction unknown and taken as zero: no return stroke, no resistance to take a share of: {error}"
    share = f"{100 * FRICTION_SHARE:g} %"
    return found.friction_per_depth, f"friction assumed to be {share} of the resistance: no return stroke past the tip"


def elastic_record(trace: Trace, depth: DepthProfile, friction_per_depth: float) -> Trace:
    """Return the record less friction on the way forward [N]."""
    (position,) = trace.require("position", by="elastic_part")
    return dataclasses.replace(trace, force=trace.force - friction_per_depth * depth.at(position))


def telling(ramps: list[Segment]) -> list[Segment]:
    """Return the ramps whose slopes are tissue properties.

    Noise is the same all along a record. A ramp that scatters more than 1.3 times as much as they usually do hides a
    drop that was too small to be detected, or bends because depth changes along it: its slope can be half or twice the
    tissue's (of 2623 ramps in sampled livers, 3 in 100; without them errors have an SD of 2.0 %, with them 5.3).
    """
    steady = [ramp for ramp in ramps if ramp.is_steady]
    # Residual standard deviation of each line, for even readings [N].
    scatter = [abs(ramp.force_rise) * math.sqrt((1.0 / ramp.r_squared - 1.0) / 12.0) for ramp in steady]
    return [
        ramp
        for ramp, own in zip(steady, scatter, strict=True)
        if own <= _RESTLESS * np.median(scatter) and (ramp.restlessness <= _RESTLESS or ramp.r_squared >= _SMOOTH)
    ]


def moduli_of(
    ramps: list[Segment], depth: DepthProfile, model: CutModel, ratio: LoadingRatio, *, friction_per_depth: float
) -> ModulusEstimate:
    """Return moduli of steady elastic ramps, less ``friction_per_depth`` [N/m]."""
    segments, tips, moduli = [], [], []
    for s in telling(ramps):
        x, slope, speed = s.require("position", "slope", "speed", by="moduli_of")
        tip = max(x - ratio(speed, s.angle) * s.force / slope, 0.0)
        B = float(depth.at(tip))
        if B >= MEASURABLE_DEPTH:
            segments.append(s)
            tips.append(tip)
            moduli.append(slope / (model.stiffness(tip) * B))
    return ModulusEstimate(
        position=np.array(tips),
        modulus=np.array(moduli),
        segments=segments,
        friction_per_depth=friction_per_depth,
        flags=(),
    )
