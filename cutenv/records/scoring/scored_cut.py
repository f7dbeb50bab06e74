"""A cut prepared for the metrics.

Record, target, crack tip, and the force at a fixed rate; all computed lazily.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from cutenv._base.arrays import Array, StructArray
from cutenv._base.validation import in_range
from cutenv.records.measurement import DepthProfile, QualityIssue, estimate_local_effective_moduli, quality_issues
from cutenv.records.measurement.depth import with_blade_depth
from cutenv.records.measurement.loading_ratio import loading_ratio
from cutenv.records.measurement.strokes import STANDSTILL_SPEED
from cutenv.records.scoring.cut_map import CutMap, DepthMap, PathMap
from cutenv.records.scoring.truth import ASIDE_AT_END, FLOOR_AT_END, Truth, checked_aside, checked_floor, noted_tip
from cutenv.records.scoring.validity import (
    Lurches,
    Unavailable,
    even_centres,
    even_instants,
    even_means,
    force_unusable,
    holds_two_cuts,
    implausible_work,
    is_truncated,
    levelled,
    lurches_of,
    never_loaded,
    noisy,
    noted_ahead,
    smoothed,
    smoothed_motion,
    under_force,
    unseen,
)
from cutenv.sim.quantities import SHALLOWEST
from cutenv.sim.tissue import CutModel, TissueDescription, measured_liver
from cutenv.sim.tissue.crack_tip import ASSESSED_TIP, ESTIMATED_EVERY, MeanTissue, assess_tips, believe_mean
from cutenv.sim.tissue.drawn_lines import expected_cut
from cutenv.sim.tissue.floor import FLOOR_EVERY, BladePath, expected_floor
from cutenv.sim.tissue.grid import N_POINTS, SPACING
from cutenv.sim.tissue.lines import CutLine
from cutenv.sim.tissue.slab import THICKNESS, effective_depth
from cutenv.sim.trace import Trace

_DROP = 0.03  # fraction of the peak force by which a fall ends a loading ramp
_FEWEST_RAMPS = 3  # loading ramps needed for the cut's own modulus


def modulus_of_ramps(trace: Trace, profile: DepthProfile, tissue: TissueDescription) -> float | None:
    """Return the material modulus [Pa] from three or more steady ramps.

    With fewer ramps it is None. The trace has the angle, and the depth at the blade.
    """
    found = estimate_local_effective_moduli(
        trace,
        tissue.cut_model(),
        friction_per_depth=tissue.nominal_friction_per_depth,
        smallest_drop=max(_DROP * float(trace.force.max()), 1e-6),
    )
    depth = profile.at(found.position)
    moduli = found.modulus * depth / effective_depth(found.position, depth, tissue.thickness)
    slow = [E / loading_ratio(float(s.speed or 0.0), s.angle) for E, s in zip(moduli, found.segments, strict=True)]
    return float(np.median(slow)) if len(slow) >= _FEWEST_RAMPS else None


_TRUSTED = 0.65  # exponent of that over the tissue's: between 0.5 and 0.8 the tip is known best at any feed


RUNS_EVERY = 0.040
"""Time between two places of the tip from which runs are told [s]: longer than between 30 readings a second."""
_SHORTEST_RUN = 1.5e-3  # [m] gained on the blade: shorter ones, up to twenty a second, a slow or smooth record hides
_FASTER = 3e-3  # [m/s], by which the estimated tip advances faster than the blade where it runs


def runs_of(tip: Array, blade: Array, seconds: float) -> Array:
    """Return an estimated tip's runs by instant [m], shape (n - 1,).

    Tip and blade [m] are evenly in time, `seconds` between two. Each run counts at its first instant. Where the tip
    goes on faster than the blade it runs, and the whole way is the run: a slow or smoothed record spreads it over
    several instants. Runs that gain less than 1.5 mm on the blade are left out.
    """
    advance = np.diff(tip)
    gained = advance - np.maximum(np.diff(blade), 0.0)
    running = gained > _FASTER * seconds
    starts = running & ~np.append(False, running[:-1])
    which = np.where(running, np.cumsum(starts), 0)
    ways, gains = (np.bincount(which, weights=each, minlength=1)[1:] for each in (advance, gained))
    runs = np.zeros_like(advance)
    runs[starts] = np.where(gains > _SHORTEST_RUN, ways, 0.0)
    return runs


@dataclass(frozen=True, kw_only=True, eq=False)
class ScoredCut:
    """One cut and its quantities for metrics, computed on first use.

    Parameters
    ----------
    target_length : float, optional
        Length aimed at, from the clamp [m].
    truth : Truth, optional
        Hidden state of a simulated cut; without it the tip is estimated.
    tissue : TissueDescription, optional
        Tissue with which the tip is estimated if there is no return stroke; default pig liver.
    layer_depth : float, optional
        Depth below the surface at which another layer begins [m], 0.0005 to 0.1.
    """

    trace: Trace
    target_length: float | None = None
    truth: Truth | None = None
    tissue: TissueDescription = field(default_factory=measured_liver)
    wanted: DepthProfile | None = None
    layer_depth: float | None = None
    line: CutLine | None = None

    def __post_init__(self) -> None:
        if self.layer_depth is not None:
            in_range("layer_depth", self.layer_depth, 0.0005, 0.1, "m", "12 mm is 0.012.")
        if self.target_length is not None:
            in_range("target_length", self.target_length, 0.005, 0.15, "m", "8 cm is 0.08.")
        if self.truth is not None and len(self.truth.tip) != len(self.trace):
            raise ValueError(f"truth has {len(self.truth.tip)} instants and the trace {len(self.trace)}.")

    @property
    def time(self) -> Array:
        """Time of each reading [s], shape (n,)."""
        return self.trace.time

    @property
    def force(self) -> Array:
        """Force in the trace's unit, shape (n,)."""
        if self.spoiled:
            raise Unavailable(self.spoiled)
        return self.trace.force

    @property
    def position(self) -> Array:
        """Position of the blade [m], shape (n,)."""
        return self._field("position")

    @property
    def blade_speed(self) -> Array:
        """Speed of the blade, from its position [m/s], shape (n,)."""
        _ = self.position  # raises if it is missing
        return self.trace.blade_speed

    @property
    def depth(self) -> Array:
        """Depth of cut at the blade [m], 1 mm or more, (n,)."""
        return np.maximum(self._field("depth"), SHALLOWEST)

    @cached_property
    def at_blade(self) -> Trace:
        """Record with depth at the blade, unchanged without height."""
        return with_blade_depth(self.trace)

    @property
    def tells_depth(self) -> bool:
        """True for a record with height, or with a wanted depth."""
        return self.trace.height is not None or self.wanted is not None

    @cached_property
    def floor(self) -> Array:
        """Floor's depth below the surface every 0.5 mm [m], shape (m,).

        The floor reaches from the clamp to the tip. It is the truth, or as the simulator noted it in the record; of a
        record with height, that which the tissue would have under this blade; else the recorded depth.
        """
        if self.truth is not None and self.truth.floor is not None:
            return self.truth.floor
        noted = self.trace.metadata.get(FLOOR_AT_END)
        if noted is not None:
            return checked_floor(f"metadata {FLOOR_AT_END}", noted)
        tip, _ = np.maximum.accumulate(np.maximum(self.tip[: self.end + 1], 0.0)), self.model  # which limits positions
        grid = np.arange(N_POINTS, dtype=np.float64) * SPACING
        if self.trace.height is None:
            return self.profile.at(grid[: int(tip[-1] / SPACING + 0.5) + 1])
        instants = even_instants(self.time, 1.0 / FLOOR_EVERY)
        motion = (np.maximum(self.position, 0.0), self.trace.height, tip)
        path = BladePath(*(np.interp(instants, self.time, each) for each in motion))
        surface = DepthProfile.recorded(self.trace, by="score").at(grid)
        return expected_floor(self.tissue, surface, path)[0]

    @cached_property
    def depth_map(self) -> DepthMap:
        """Depth along the line, with wanted depth and layer below."""
        floor = self.floor
        wanted = None if self.wanted is None else self.wanted.at(np.arange(len(floor), dtype=np.float64) * SPACING)
        return DepthMap(depth=floor, wanted=wanted, layer=self.layer_depth)

    @cached_property
    def path_map(self) -> PathMap:
        """Distance of the cut to its line.

        It is the truth, or as the simulator noted it in the record; else as mean tissue would be cut.
        """
        x, y = self.trace.blade_x, self.trace.blade_y
        if self.line is None:
            raise Unavailable("no line to cut along was given")
        noted = self.trace.metadata.get(ASIDE_AT_END)
        if self.truth is not None and self.truth.aside is not None:
            aside = self.truth.aside
        elif noted is not None:
            aside = checked_aside(f"metadata {ASIDE_AT_END}", noted)
        elif x is None or y is None:
            raise Unavailable("the places of the blade were not recorded")
        else:
            aside = expected_cut(self.line, x, y, self.tip[: self.end + 1], self.tissue)
        return PathMap(line=self.line, aside=aside)

    @property
    def judged_map(self) -> CutMap | None:
        """Map for points and success: path, else wanted depth, else None."""
        if self.line is not None:
            return self.path_map
        return None if self.wanted is None else self.depth_map

    @property
    def angle(self) -> Array:
        """Angle of the blade [rad], shape (n,)."""
        return self._field("angle")

    @property
    def length(self) -> float:
        """Target length [m]."""
        if self.target_length is None:
            raise Unavailable("no target length was given")
        return self.target_length

    @property
    def newtons(self) -> Array:
        """Force [N], shape (n,)."""
        if self.trace.force_unit != "N":
            raise Unavailable("the force is normalised")
        return self.force

    @cached_property
    def unfinished(self) -> str:
        """Reason why the record is truncated, or ""."""
        return "" if self.truth is not None else is_truncated(self.trace)

    @cached_property
    def twofold(self) -> str:
        """Reason why the record holds two cuts, or ""."""
        return "" if self.noted_end is not None else holds_two_cuts(self.trace)

    def no_mark(self, work: float | None) -> str:
        """Return why a record with known tip has no score, or "".

        `work` is that over the fracture energy, if it is known.
        """
        if self.truth is not None:
            return ""
        tip = float(self.tip[-1])
        return (
            unseen(self.trace)
            or noisy(self.trace, self.even_force)
            or smoothed_motion(self.lurches)
            or levelled(self.even_force[self.even_advancing])
            or never_loaded(self.smooth_force, self.even_force, self.even_advancing)
            or (noted_ahead(self.noted_end, self.position) if self.noted_end is not None else "")
            or (implausible_work(work, tip) if work is not None else "")
        )

    @cached_property
    def lurches(self) -> Lurches:
        """Motion of the blade where the force falls suddenly."""
        return lurches_of(self.trace, np.interp(self.even_time, self.time, self.position), self.even_force)

    @property
    def end(self) -> int:
        """Index of the instant at which the cut ended."""
        if self.unfinished:
            raise Unavailable(self.unfinished)
        return len(self.trace) - 1

    @cached_property
    def advancing(self) -> NDArray[np.bool_]:
        """Mask of instants advancing over uncut tissue, shape (n,).

        Without position, from the first force to the last.
        """
        if self.trace.position is None:
            return under_force(self.time, self.even_time, self._smooth)
        x = self.position
        forward = self.trace.blade_speed > STANDSTILL_SPEED
        chosen: NDArray[np.bool_] = forward & (x >= np.maximum.accumulate(x) - 1e-4)
        if not chosen.any():
            raise Unavailable("the blade never advances")
        return chosen

    @cached_property
    def weights(self) -> Array:
        """Duration represented by each instant [s], shape (n,)."""
        step = np.diff(self.time)
        return np.asarray(0.5 * (np.append(step, 0.0) + np.append(0.0, step)))

    def mean(self, values: Array) -> float:
        """Return the mean of ``values`` while the blade advances."""
        w = self.weights[self.advancing]
        return float(w @ values[self.advancing] / w.sum())

    @property
    def tip_source(self) -> str:
        """Source of the tip: "truth", "return stroke", "estimated" or "unknown"."""
        if self.truth is not None:
            return "truth"
        try:
            _ = self.tip
        except Unavailable:
            return "unknown"
        return "return stroke" if self._learned["probed"] else "estimated"

    @cached_property
    def tip(self) -> Array:
        """Crack tip at every instant [m], shape (n,)."""
        if self.truth is not None:
            return self.truth.tip
        return self._ending_where_it_did(self._followed[0])

    @cached_property
    def jumps(self) -> Array:
        """Unstable growth at each instant [m].

        If estimated, growth is in windows of 40 ms, each run in its first.
        """
        if self.truth is not None:
            return self.truth.jump
        borders = even_instants(self.time, 1.0 / RUNS_EVERY)
        if len(borders) < 2:
            raise Unavailable(f"shorter than {RUNS_EVERY:g} s")
        a = np.interp(borders, self.time, self.tip)
        x = np.interp(borders, self.time, self.position)
        return runs_of(a, x, RUNS_EVERY)

    @cached_property
    def even_time(self) -> Array:
        """Sampling instants at 100 Hz, centres of 10 ms windows [s]."""
        return even_centres(self.time)

    @cached_property
    def smooth_force(self) -> Array:
        """Force at 100 Hz, low-pass at 5 Hz, on :attr:`even_time`."""
        _ = self.force  # raises if it is unusable
        return self._smooth

    @cached_property
    def even_advancing(self) -> NDArray[np.bool_]:
        """Mask :attr:`advancing`, sampled at 100 Hz."""
        chosen: NDArray[np.bool_] = np.interp(self.even_time, self.time, self.advancing.astype(float)) > 0.5
        if not chosen.any():
            raise Unavailable("the blade advances for less than 10 ms")
        return chosen

    @cached_property
    def quality(self) -> tuple[QualityIssue, ...]:
        """Issues of the record's signal."""
        return quality_issues(self.trace)

    @cached_property
    def spoiled(self) -> str:
        """Reason why the force is unusable, or ""."""
        return force_unusable(self.trace, self.quality)

    @cached_property
    def even_force(self) -> Array:
        """Force at 100 Hz by 10 ms means, on :attr:`even_time`."""
        _ = self.force  # raises if it is unusable
        return self._even

    @cached_property
    def _even(self) -> Array:
        return even_means(self.trace)

    @cached_property
    def _smooth(self) -> Array:
        return smoothed(self._even)

    def _field(self, name: str) -> Array:
        values: Array | None = getattr(self.at_blade, name)
        if values is None:
            raise Unavailable(f"{name} was not recorded")
        return values

    @cached_property
    def profile(self) -> DepthProfile:
        """Depth of cut over position."""
        _ = self.position, self.depth  # raises, naming the missing field
        found = DepthProfile.recorded(self.at_blade, by="score")
        if float(found.depth.max()) < SHALLOWEST:
            raise Unavailable(f"the depth of cut is below {1e3 * SHALLOWEST:g} mm everywhere")
        return DepthProfile(position=found.position, depth=np.maximum(found.depth, SHALLOWEST))

    @cached_property
    def model(self) -> CutModel:
        """Finite-element model; raises :class:`Unavailable` if the specimen is too short."""
        model = self.tissue.cut_model()
        if float(self.position.max()) > model.length:
            raise Unavailable("the cut is longer than the model's specimen, 15 cm")
        return model

    @cached_property
    def modulus(self) -> float:
        """Material modulus for estimating the tip [Pa], of cut or tissue."""
        return float(self._learned["stiffness_ratio"]) * self._believed

    def stiffness(self, modulus: float, tip: Array) -> Array:
        """Return K [N/m] at tip positions [m] for a modulus [Pa]."""
        a = np.clip(tip, 0.0, self.model.length)
        return (
            modulus
            * np.asarray(self.model.stiffness(a))
            * effective_depth(a, self.profile.at(tip), self.tissue.thickness)
        )

    @cached_property
    def elastic_force(self) -> Array:
        """Force less friction, at least zero [N], shape (n,)."""
        friction = float(self._learned["friction_per_depth"])
        return np.maximum(self.newtons - friction * self.profile.at(self.position), 0.0)

    @cached_property
    def _believed(self) -> float:
        """Material modulus believed without a return stroke [Pa]."""
        own = self.tissue.modulus if self.own_modulus is None else self.own_modulus
        return float(self.tissue.modulus * (own / self.tissue.modulus) ** _TRUSTED)

    @property
    def _learned(self) -> StructArray:
        """Learned from the first return stroke: :data:`~cutenv.sim.tissue.crack_tip.ASSESSED_TIP`."""
        learned: StructArray = self._followed[1][0]
        return learned

    @cached_property
    def _followed(self) -> tuple[Array, StructArray]:
        """Estimated tip at every instant [m], and :attr:`_learned`, shape (1,)."""
        known = np.zeros(1, ASSESSED_TIP)
        believe_mean(known, self.tissue.nominal_friction_per_depth)
        taught = self._follow(known.copy())[1]
        if taught["probed"][0]:
            known[["friction_per_depth", "stiffness_ratio"]] = taught[["friction_per_depth", "stiffness_ratio"]]
        tips, _ = self._follow(known.copy())
        known["probed"] = taught["probed"]
        return tips, known

    def _follow(self, memory: StructArray) -> tuple[Array, StructArray]:
        """Return tips [m] given ``memory``, and what the first return taught."""
        # Forces are compared with thresholds, which are for a slab as thick as usual.
        force, scale = self.newtons, THICKNESS / self.tissue.thickness
        readings = (self.position, self.trace.blade_speed, scale * self.profile.at(self.position), scale * force)
        instants = even_instants(self.time, 1.0 / ESTIMATED_EVERY)
        even = np.column_stack([np.interp(instants, self.time, values) for values in readings])
        stiffness = scale * self.stiffness(self._believed, np.arange(N_POINTS, dtype=np.float64) * SPACING)
        tips = np.zeros(len(instants))
        memory["position"], memory["tip"] = even[0, 0], min(float(even[0, 0]), 0.0)
        mean = MeanTissue(stiffness, len(stiffness), self.tissue.nominal_friction_per_depth)
        taught = np.zeros_like(memory)
        assess_tips(memory, taught, mean, even, tips)
        # A cut never heals: where drawing back locates the tip, it was not further before.
        tips = np.minimum.accumulate(tips[::-1])[::-1]
        return np.interp(self.time, instants, tips), taught

    @cached_property
    def own_modulus(self) -> float | None:
        """Material modulus from the cut's own loading ramps [Pa].

        It is None if fewer than three are steady.

        Livers differ by a third. Calibrated tissue is used with its calibrated modulus.
        """
        if self.trace.angle is None or self.trace.depth is None or self.tissue.calibration is not None:
            return None
        try:
            _ = self.force  # raises if it is unusable
            return modulus_of_ramps(self.at_blade, self.profile, self.tissue)
        except ValueError:
            return None  # outside the range measured for liver, for example at other angles

    @property
    def shown_end(self) -> float:
        """Crack tip at the end by forces alone [m]."""
        return float(self._followed[0][-1])

    @property
    def noted_end(self) -> float | None:
        """Final crack tip as noted by the simulator [m], or None."""
        return noted_tip(self.trace.metadata)

    def _ending_where_it_did(self, tip: Array) -> Array:
        """Return the estimated tip, stretched to its noted end."""
        noted = self.noted_end
        return tip if noted is None or tip[-1] <= 0.0 else np.minimum(tip * (noted / float(tip[-1])), noted)
