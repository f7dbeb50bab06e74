"""Tissue measurements of one record, and cuts in depth steps."""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from cutenv._base.arrays import Array
from cutenv.records.measurement.depth import DepthProfile, unit_stiffness, with_blade_depth
from cutenv.records.measurement.depth_sections import DepthSection, depth_sections
from cutenv.records.measurement.fracture import FractureEstimate, estimate_fracture_resistance
from cutenv.records.measurement.initiation import Hilltop, InitiationEstimate, hilltops, initiation_at
from cutenv.records.measurement.layer_fit import LayerFit, fit_layers
from cutenv.records.measurement.loading_ratio import LoadingRatio, loading_ratio
from cutenv.records.measurement.modulus import ModulusEstimate, elastic_record, moduli_of
from cutenv.records.measurement.segments import Segment, loading_segments
from cutenv.records.measurement.strokes import ReturnStroke, strokes
from cutenv.records.measurement.zero import zeroed
from cutenv.sim.tissue.cut_model import CutModel
from cutenv.sim.tissue.description import TissueDescription, measured_liver
from cutenv.sim.tissue.layers import Layers, layered_depth
from cutenv.sim.tissue.slab import effective_depth
from cutenv.sim.trace import Trace

SPECIMEN_KEY = "specimen"
"""Key in a trace's metadata for the piece of tissue (for example a liver); cuts of the same name share it."""

_FARTHEST_TIP, _SAME_DEPTH = 0.008, 1e-3  # [m] of the tip behind the blade; [m] by which the depth may change there
_DEPTH_EVERY = 0.5e-3  # [m] along the cut: a depth profile is smooth


@dataclass(frozen=True, kw_only=True, eq=False)
class MeasuredCut:
    """One record, measured.

    Attributes
    ----------
    trace : Trace
        The record, its force less the sensor's zero.
    specimen : str
        Name of the piece of tissue; "" if the record does not give it.
    speed, angle : float
        Median speed while the blade moves forward [m/s], and mean angle [rad].
    moduli : ModulusEstimate
        Local effective moduli; none if no loading segment was steady.
    fracture : FractureEstimate
        Fracture resistance, apparent and corrected.
    initiation : InitiationEstimate
        Hilltops of the force, and the units between them.
    return_stroke : ReturnStroke or None
        Tip, friction and unloading stiffness, where the record has a way back.
    depth : DepthProfile
        Depth of the cut every 0.5 mm.
    ramps, tops : list
        Loading segments and hilltops, which do not depend on the loading ratio.
    layers : Layers
        Layers of the tissue over the depth, where they are known; default one tissue throughout.
    unloaded : float or None
        Modulus of the material from all ways back of a cut in steps of depth [Pa].
    surface : DepthProfile or None
        Depth of cut of a blade at height 0, every 0.5 mm; None for a record without height, of which it is ``depth``.
    """

    trace: Trace
    name: str
    specimen: str
    speed: float
    angle: float
    moduli: ModulusEstimate
    fracture: FractureEstimate
    initiation: InitiationEstimate
    return_stroke: ReturnStroke | None
    depth: DepthProfile
    ramps: list[Segment]
    tops: list[Hilltop | None]
    layers: Layers = field(default_factory=Layers)
    unloaded: float | None = None
    surface: DepthProfile | None = None

    @property
    def flags(self) -> tuple[str, ...]:
        """Remarks on what weakens the estimates, each once."""
        return tuple(dict.fromkeys((*self.fracture.flags, *self.moduli.flags)))

    def unloading_modulus(self, model: CutModel) -> float | None:
        """Return the tip modulus from elastic unloading [Pa], or None."""
        back = self.return_stroke
        if self.unloaded is not None:
            return self.unloaded
        if back is None or back.stiffness == 0.0 or back.tip > model.length:
            return None
        return back.stiffness / float(unit_stiffness(back.tip, self.depth, model))

    @property
    def material_moduli(self) -> Array:
        """Material modulus times loading ratio by segment [Pa], shape (n_segments,).

        A local effective modulus is per depth of cut; in a slab that is not cut through it is higher.
        """
        depth = self.depth.at(self.moduli.position)
        effective = effective_depth(self.moduli.position, depth)
        if self.layers != Layers():
            pairs = zip(depth.tolist(), effective.tolist(), strict=True)
            effective = np.array([layered_depth(self.layers, *pair) for pair in pairs])
        return np.asarray(self.moduli.modulus * depth / effective)

    @property
    def material_modulus(self) -> float:
        """Mean of :attr:`material_moduli` [Pa]."""
        return float(self.material_moduli.mean())

    def with_loading_ratio(self, ratio: LoadingRatio, model: CutModel) -> MeasuredCut:
        """Return the same cut, measured with another loading ratio."""
        friction = self.moduli.friction_per_depth
        moduli = moduli_of(self.ramps, self.depth, model, ratio, friction_per_depth=friction)
        fracture = self.fracture
        if self.return_stroke is None:
            fracture = estimate_fracture_resistance(self.trace, loading_ratio=ratio)
        return dataclasses.replace(
            self,
            moduli=dataclasses.replace(moduli, flags=self.moduli.flags),
            fracture=fracture,
            initiation=initiation_at(self.tops, self.depth, model, ratio),
        )


def measure_cut(
    trace: Trace, model: CutModel, *, ratio: LoadingRatio = loading_ratio, name: str = "trace"
) -> MeasuredCut:
    """Measure one record.

    Parameters
    ----------
    trace : Trace
        With position, angle and depth; force in newtons.
    ratio : callable, optional
        Loading ratio r of a speed [m/s] and an angle [rad]; default that of pig liver.

    Raises
    ------
    ValueError
        If the record lacks what is needed, or has neither a steady segment nor a way back.
    """
    by = "measure_cut"
    trace.require_newtons(by=by)
    trace.require("position", "angle", "depth", by=by)
    surface = None if trace.height is None else _thinned(DepthProfile.recorded(trace, by=by))
    trace, _ = zeroed(with_blade_depth(trace))
    fracture = estimate_fracture_resistance(trace, loading_ratio=ratio)
    back = fracture.return_stroke
    depth = _thinned(DepthProfile.recorded(trace, by=by))
    friction = fracture.friction_per_depth
    elastic = elastic_record(trace, depth, friction)
    ramps = loading_segments(elastic)
    if surface is not None:
        ramps = [ramp for ramp in ramps if _at_one_depth(ramp, trace, depth)]
    moduli = moduli_of(ramps, depth, model, ratio, friction_per_depth=friction)
    if not len(moduli) and back is None:
        raise ValueError(
            f"it has no return stroke, and none of its {len(ramps)} loading segments is steady: the force must rise "
            "and drop again several times at one speed. Cut farther, or slower, or record the way back."
        )
    # Between ramps at one depth lie others: no unit is hilltop to hilltop in a record with height.
    tops: list[Hilltop | None] = hilltops(elastic, ramps) if surface is None else [None for _ in ramps]
    return MeasuredCut(
        trace=trace,
        name=name,
        specimen=str(trace.metadata.get(SPECIMEN_KEY, "")),
        speed=_speed(trace),
        angle=float(np.mean(trace.require("angle", by=by))),
        moduli=moduli,
        fracture=fracture,
        initiation=initiation_at(tops, depth, model, ratio),
        return_stroke=back,
        depth=depth,
        ramps=ramps,
        tops=tops,
        surface=surface,
    )


def by_specimen(cuts: list[MeasuredCut]) -> dict[str, list[MeasuredCut]]:
    """Return cuts by piece of tissue, in first appearance order."""
    groups: dict[str, list[MeasuredCut]] = {}
    for cut in cuts:
        groups.setdefault(cut.specimen, []).append(cut)
    return groups


def named(traces: list[Trace]) -> list[tuple[str, Trace]]:
    """Return traces with unique names, from metadata or number."""
    names = [str(trace.metadata.get("name") or f"trace {i}") for i, trace in enumerate(traces)]
    times = Counter(names)
    used = {name for name in names if times[name] == 1}
    found = []
    for i, (name, trace) in enumerate(zip(names, traces, strict=True)):
        if times[name] > 1:
            name = f"{name} ({i})"
            while name in used:  # the user's own names may end in numbers
                name = f"{name} ({i})"
            used.add(name)
        found.append((name, trace))
    return found


def _speed(trace: Trace) -> float:
    """Return the median speed of the forward strokes [m/s]."""
    forward = [trace.blade_speed[stroke.samples] for stroke in strokes(trace) if stroke.forward]
    return float(np.median(np.concatenate(forward)))


def _at_one_depth(ramp: Segment, trace: Trace, depth: DepthProfile) -> bool:
    """Return True if depth is nearly constant over a ramp."""
    position, _ = trace.require("position", "depth", by="measure_cut")
    x = position[ramp.samples]
    behind = np.linspace(max(float(x.min()) - _FARTHEST_TIP, float(position[0])), float(x.max()), 50)
    return float(np.ptp(depth.at(behind))) <= _SAME_DEPTH


def _thinned(depth: DepthProfile) -> DepthProfile:
    """Return the profile at fewer positions, for quick lookup."""
    first, last = float(depth.position[0]), float(depth.position[-1])
    places = np.linspace(first, last, max(2, round((last - first) / _DEPTH_EVERY) + 1))
    return DepthProfile(position=places, depth=depth.at(places))


_FLOORS = 3  # rounds of finding layers, and the floor under the blade in these


def find_layers(
    traces: Sequence[Trace],
    model: CutModel,
    *,
    tissue: TissueDescription | None = None,
    boundary: float | None = None,
    capsule_thickness: float | None = None,
) -> tuple[LayerFit, list[list[DepthSection]]]:
    """Find layers from cuts in depth steps, and sections of each.

    Layers and the floor of the cut under the blade, which yields less in a tougher layer, are found in turn. The
    arguments are those of :func:`~cutenv.records.measurement.depth_sections.depth_sections` and
    :func:`~cutenv.records.measurement.layer_fit.fit_layers`.
    """
    tissue = tissue or measured_liver()
    tissues, layers = [tissue] * len(traces), None
    for _ in range(_FLOORS):
        cuts = [depth_sections(trace, tissue=own, layers=layers) for trace, own in zip(traces, tissues, strict=True)]
        fit = fit_layers(cuts, model, boundary=boundary, capsule_thickness=capsule_thickness)
        layers, found = fit.layers, iter(zip(fit.resistance, fit.modulus, strict=True))
        tissues = [_like(tissue, *next(found)) if sections else tissue for sections in cuts]
    return fit, cuts


def _like(tissue: TissueDescription, resistance: float, modulus: float) -> TissueDescription:
    """Return the tissue with another resistance [J/m2] and modulus [Pa]."""
    whole = float(resistance) / (1.0 - tissue.friction_share)
    return dataclasses.replace(tissue, fracture_resistance=whole, modulus=float(modulus))


def in_layers(
    cuts: Sequence[MeasuredCut],
    traces: Sequence[Trace],
    model: CutModel,
    *,
    boundary: float | None = None,
    capsule_thickness: float | None = None,
) -> tuple[list[MeasuredCut], LayerFit | None]:
    """Find layers from records with height; return remeasured cuts and fit.

    Resistance and modulus of a cut in steps of depth are then those of the tissue between the layers.  The fit is None
    if no record has height, vertical force and a way back past the tip at one height.
    """
    names = [label for label, _ in named(list(traces))]
    deep = [
        (label, trace)
        for label, trace in zip(names, traces, strict=True)
        if trace.height is not None and trace.vertical_force is not None and any(cut.name == label for cut in cuts)
    ]
    if not deep:
        return list(cuts), None
    try:
        fit, sections = find_layers(
            [trace for _, trace in deep], model, boundary=boundary, capsule_thickness=capsule_thickness
        )
    except ValueError:  # no record has a section
        return list(cuts), None
    found = iter(zip(fit.resistance.tolist(), fit.modulus.tolist(), strict=True))
    told = {label: (own, *next(found)) for (label, _), own in zip(deep, sections, strict=True) if own}
    measured = []
    for cut in cuts:
        if cut.name in told:
            own, resistance, modulus = told[cut.name]
            friction = own[0].friction_per_depth
            fracture = dataclasses.replace(
                cut.fracture, corrected=resistance + friction, friction_per_depth=friction, return_stroke=own[-1].back
            )
            cut = dataclasses.replace(
                cut, fracture=fracture, return_stroke=own[-1].back, layers=fit.layers, unloaded=modulus
            )
        measured.append(cut)
    return measured, fit
