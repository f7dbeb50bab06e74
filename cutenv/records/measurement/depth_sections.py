"""Sections of a cut with depth between unloadings: work and area.

A blade that has cut goes back past the tip, until only friction is left; all elastic energy is then given back, and the
force tells where the tip is.  Between two such returns

    G = (integral of F dx - integral of V dh - phi integral of D (|dx| + |dh|)) / A

is the fracture part of the resistance: work along the cut and downwards (V upwards on the blade, h its height), less
friction phi per depth D, over the area A that advancing and deepening open.  R = G + phi, as for a cut of one depth.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cutenv._base.arrays import Array
from cutenv._base.validation import in_range
from cutenv.records.measurement.depth import DepthProfile
from cutenv.records.measurement.strokes import ReturnStroke, fit_return_stroke, strokes
from cutenv.records.measurement.zero import zeroed
from cutenv.sim.quantities import MEASURABLE_DEPTH
from cutenv.sim.tissue.description import TissueDescription, measured_liver
from cutenv.sim.tissue.floor import FLOOR_EVERY, BladePath, expected_floor
from cutenv.sim.tissue.grid import LENGTH, N_POINTS, SPACING
from cutenv.sim.tissue.layers import Layers, layered_depth
from cutenv.sim.tissue.slab import effective_depth
from cutenv.sim.trace import Trace

SAME_HEIGHT = 0.3e-3
"""Change of the height on a way back up to which the tissue counts as unloaded at one depth [m]."""
_LEAST_AREA = 5e-6  # [m2] that a section opens
_TIP_ROUNDS = 4
_ENDLESS = 1.0  # [m], deeper than any slab
_WayBack = tuple[int, int, ReturnStroke]


@dataclass(frozen=True, kw_only=True, eq=False)
class DepthSection:
    """One section of a cut, between two unloadings."""

    start: float
    tip: float
    """Crack tip after it, `start` before [m]."""
    floor_before: Array
    floor_after: Array
    """Depth of the floor below the surface at each point of the grid [m], 0 where nothing is cut, shape (301,)."""
    work_along: float
    work_down: float
    """Work of the blade downwards, `work_along` along the cut [J]."""
    component_ahead: float
    norm_ahead: float
    """Integral of the norm of both forces, `component_ahead` of the force along the cut, over ground that the blade
    reached for the first time [J]: what the thesis took for the work, with the norm."""
    rubbed: float
    """Integral of depth over the way of the blade, both directions [m2]."""
    back: ReturnStroke
    """Way back that ends the section: tip, friction, stiffness of unloading."""
    depth: float
    """Depth of the blade at the tip, to which the stiffness belongs, while it went back [m]."""
    friction_per_depth: float
    """Friction on the moving blade per depth of cut, median of the record's ways back [N/m]."""

    def area(self, top: float = 0.0, bottom: float = _ENDLESS) -> float:
        """Return the area opened between two depths below the surface [m2]."""
        deeper = np.clip(self.floor_after, top, bottom) - np.clip(self.floor_before, top, bottom)
        return float(self.width @ deeper)

    @property
    def width(self) -> Array:
        """Cut length per grid point up to the tip [m], (301,)."""
        places = np.arange(N_POINTS, dtype=np.float64) * SPACING
        width = np.clip(self.tip - (places - 0.5 * SPACING), 0.0, SPACING)
        width[0] = min(0.5 * SPACING, self.tip)
        return np.asarray(width)

    @property
    def fracture_energy(self) -> float:
        """Work of both directions less friction [J]."""
        return self.work_along + self.work_down - self.friction_per_depth * self.rubbed

    @property
    def resistance(self) -> float:
        """Fracture resistance R of the section, friction included [J/m2]."""
        return self.fracture_energy / self.area() + self.friction_per_depth


def depth_sections(
    trace: Trace,
    *,
    tissue: TissueDescription | None = None,
    layers: Layers | None = None,
    reasons: list[str] | None = None,
) -> list[DepthSection]:
    """Divide a record with height into sections between unloadings.

    The record has position, height, depth (of a blade at height 0) and vertical force in newtons, from the start of the
    cut. Each way back past the tip, at one height, ends a section; `reasons` gets a line for each that ends none. The
    floor is expected under the blade of `tissue` (default pig liver), whose tougher layers yield less to a blade that
    is lowered; where the blade keeps its height while it advances, the floor is at that height, whatever the tissue. A
    ValueError says that the record lacks what is needed, or leaves the specimen of 15 cm.

    Thesis, section 6.2 and equations 6.1 to 6.4, with the area in place of length times one depth.
    """
    by, said = "depth_sections", [] if reasons is None else reasons
    trace.require_newtons(by=by)
    position, height, _, upwards = trace.require("position", "height", "depth", "vertical_force", by=by)
    in_range("position", float(position.max()), 0.0, LENGTH, "m", "A record of a specimen of 15 cm is needed.")
    tissue = tissue or measured_liver()
    surface = DepthProfile.recorded(trace, by=by)
    trace, _ = zeroed(trace)
    force = trace.force
    ends = _ways_back(trace, surface, said)
    if not ends:
        return []
    friction = float(np.median([back.friction_per_depth for _, _, back in ends]))
    floors, engaged = _floors(tissue, layers, surface, trace, ends)
    depth = np.clip(surface.at(position) - engaged, 0.0, tissue.thickness)
    along, down = np.diff(position, prepend=position[0]), np.diff(height, prepend=height[0])
    ahead = np.diff(np.maximum.accumulate(position), prepend=position[0])
    works = [
        _cumulated(force, along), -_cumulated(upwards, down), _cumulated(force, ahead),
        _cumulated(np.hypot(force, upwards), ahead),
    ]  # fmt: skip
    rubbed = _cumulated(depth, np.hypot(_travelled(trace, position), down))
    found, before, first, start = [], np.zeros(N_POINTS), 0, float(position[0])
    for (began, stop, back), after in zip(ends, floors, strict=True):
        turn = int(np.argmax(position[:stop]))
        W_x, W_z, component, norm = (float(each[stop - 1] - each[first]) for each in works)
        section = DepthSection(
            start=start,
            tip=back.tip,
            floor_before=before,
            floor_after=after,
            work_along=W_x,
            work_down=W_z,
            component_ahead=component,
            norm_ahead=norm,
            rubbed=float(rubbed[stop - 1] - rubbed[first]),
            back=back,
            depth=float(np.clip(surface.at(back.tip) - np.median(height[began:stop]), 0.0, tissue.thickness)),
            friction_per_depth=friction,
        )
        if section.area() >= _LEAST_AREA and section.depth >= MEASURABLE_DEPTH:
            found.append(section)
            before, first, start = after, stop - 1, back.tip
        else:
            said.append(f"the way back from {1e3 * position[turn]:.0f} mm: hardly anything was cut before it")
    return found


def opened_resistance(sections: Sequence[DepthSection]) -> dict[str, float]:
    """Return the sections' joint fracture resistance [J/m2], by kind of work.

    "both works": along the cut and downwards, less friction on all ways but once, over the area: what R is. "along":
    the same, of the force along the cut alone. "component ahead" and "norm ahead": the force along the cut, and the
    norm of both, over new ground, as the thesis did with the norm (sections 3.3.2 and 5.3); energy that is stored at
    the end counts as fracture.
    """
    if not sections:
        raise ValueError("there is no section: the record shows no way back past the tip at one height.")
    phi, area = sections[0].friction_per_depth, math.fsum(each.area() for each in sections)
    rubbed = phi * math.fsum(each.rubbed for each in sections)
    along, down, component, norm = (
        math.fsum(getattr(each, name) for each in sections)
        for name in ("work_along", "work_down", "component_ahead", "norm_ahead")
    )
    return {
        "both works": (along + down - rubbed) / area + phi,
        "along": (along - rubbed) / area + phi,
        "component ahead": component / area,
        "norm ahead": norm / area,
    }


def _ways_back(trace: Trace, surface: DepthProfile, said: list[str]) -> list[_WayBack]:
    """Return begin, end and findings of each retreat past the tip."""
    position, height = trace.require("position", "height", by="depth_sections")
    found, furthest = [], -math.inf
    moved = strokes(trace)
    for i, stroke in enumerate(moved):
        if stroke.forward or (i > 0 and not moved[i - 1].forward):
            continue
        turn = int(np.argmax(position[: stroke.stop]))
        if position[turn] <= furthest:
            continue
        back_to = next((s.start for s in moved[i + 1 :] if s.forward), len(trace))
        heights = height[stroke.start : stroke.stop]
        place = f"the way back from {1e3 * float(position[turn]):.0f} mm"
        if float(np.ptp(heights)) > SAME_HEIGHT:
            said.append(
                f"{place}: the height changes by {1e3 * float(np.ptp(heights)):.1f} mm on it, more than "
                f"{1e3 * SAME_HEIGHT:g}; keep it until only friction is left"
            )
            continue
        level = float(np.mean(heights))
        at_level = dataclasses.replace(surface, depth=np.maximum(surface.depth - level, 0.0))
        back = fit_return_stroke(trace.select(slice(0, back_to)), at_level)
        if back is None or back.stiffness <= 0.0:
            said.append(f"{place}: it does not pass the tip by 3 mm, or the tissue was not loaded")
            continue
        furthest = float(position[turn])
        found.append((stroke.start, back.stop, back))
    return found


def _floors(
    tissue: TissueDescription, layers: Layers | None, surface: DepthProfile, trace: Trace, ends: list[_WayBack]
) -> tuple[list[Array], Array]:
    """Return floors by section (301,) [m], and levels by reading [m]."""
    position, height = trace.require("position", "height", by="depth_sections")
    known = surface.at(np.arange(N_POINTS, dtype=np.float64) * SPACING)
    instants = np.arange(float(trace.time[0]), float(trace.time[-1]), FLOOR_EVERY)
    x, h = (np.interp(instants, trace.time, values) for values in (np.clip(position, 0.0, LENGTH), height))
    a = _tips(_Slab(tissue, layers or Layers(), surface), trace, ends, instants, h)
    _, engaged = expected_floor(tissue, known, BladePath(x, h, a), layers=layers)
    floors = []
    for _, stop, back in ends:
        n = max(int(np.searchsorted(instants, trace.time[stop - 1])), 2)
        until = a[:n].copy()
        until[-1] = max(back.tip, float(until[-2]))
        depth, _ = expected_floor(tissue, known, BladePath(x[:n], h[:n], until), layers=layers)
        floors.append(np.append(depth, np.zeros(N_POINTS - len(depth))))
    return floors, np.interp(trace.time, instants, engaged)


@dataclass(frozen=True, eq=False)
class _Slab:
    """Slab of a tissue in layers below a surface."""

    tissue: TissueDescription
    layers: Layers
    surface: DepthProfile

    def depth(self, place: Array, level: Array | float) -> Array:
        """Return the blade's depth within the slab at a level [m]."""
        return np.clip(self.surface.at(place) - level, MEASURABLE_DEPTH, self.tissue.thickness)

    def stiffness(self, tip: Array, level: Array | float) -> Array:
        """Return K over the modulus of the material [m]."""
        depth, model = self.depth(tip, level), self.tissue.cut_model()
        effective = effective_depth(tip, depth, self.tissue.thickness)
        if self.layers != Layers():
            pairs = zip(depth.tolist(), effective.tolist(), strict=True)
            effective = np.array([layered_depth(self.layers, *pair) for pair in pairs])
        return np.asarray(model.stiffness(np.clip(tip, 0.0, model.length)) * effective)


def _tips(slab: _Slab, trace: Trace, ends: list[_WayBack], instants: Array, levels: Array) -> Array:
    """Return tips [m] at instants [s] and ``levels`` [m], shape (n,).

    It is behind the blade by the elastic force over K, of which the way back that follows gives the modulus, and never
    goes back.
    """
    position, height = trace.require("position", "height", by="depth_sections")
    x, force, speed = (
        np.interp(instants, trace.time, values)
        for values in (np.clip(position, 0.0, LENGTH), trace.force, trace.blade_speed)
    )
    friction = float(np.median([back.friction_per_depth for _, _, back in ends]))
    tips, first, start = np.full(len(instants), ends[-1][2].tip), 0, max(float(position[0]), 0.0)
    for began, stop, back in ends:
        now = slice(first, int(np.searchsorted(instants, trace.time[stop - 1])))
        modulus = back.stiffness / float(slab.stiffness(np.array([back.tip]), float(height[began]))[0])
        elastic = np.maximum(force[now] - friction * slab.depth(x[now], levels[now]), 0.0)
        tip = x[now]
        for _ in range(_TIP_ROUNDS):  # of a = x - F/K(a)
            tip = np.clip(x[now] - elastic / (modulus * slab.stiffness(tip, levels[now])), start, back.tip)
        tips[now] = np.maximum.accumulate(np.where(speed[now] > 0.0, tip, start))
        first, start = now.stop, back.tip
    return np.maximum.accumulate(tips)


def _travelled(trace: Trace, position: Array) -> Array:
    """Return the way between readings [m], without noise at standstill."""
    way = np.zeros(len(position))
    for stroke in strokes(trace):
        step = np.diff(position[stroke.start : stroke.stop])
        way[stroke.start + 1 : stroke.stop] = step if stroke.forward else -step
    return way


def _cumulated(values: Array, steps: Array) -> Array:
    """Return the cumulative trapezoidal integral over ``steps``, shape (n,)."""
    mean = 0.5 * (values + np.concatenate(([values[0]], values[:-1])))
    return np.asarray(np.cumsum(mean * steps))
