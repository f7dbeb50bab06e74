"""Records of cuts in steps of depth: their layers, and the cuts measured with these."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

from cutenv.measurement.depth_sections import DepthSection, depth_sections
from cutenv.measurement.layer_fit import LayerFit, fit_layers
from cutenv.measurement.measured_cut import MeasuredCut, named
from cutenv.tissue.cut_model import CutModel
from cutenv.tissue.description import TissueDescription, measured_liver
from cutenv.trace import Trace

_FLOORS = 3  # rounds of finding layers, and the floor under the blade in these


def find_layers(
    traces: Sequence[Trace],
    model: CutModel,
    *,
    tissue: TissueDescription | None = None,
    boundary: float | None = None,
    capsule_thickness: float | None = None,
) -> tuple[LayerFit, list[list[DepthSection]]]:
    """Find layers from records of cuts in steps of depth; also return the sections of each.

    Layers and the floor of the cut under the blade, which yields less in a tougher layer, are found in turn.

    Parameters
    ----------
    traces : sequence of Trace
        Records as :func:`~cutenv.measurement.depth_sections.depth_sections` takes them.
    model, boundary, capsule_thickness
        See :func:`cutenv.measurement.layer_fit.fit_layers`.
    tissue : TissueDescription, optional
        Tissue whose floor is expected at first; default pig liver.

    Raises
    ------
    ValueError
        If a record lacks what is needed, or none has a section.
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
    """Return the tissue with the fracture part of another resistance [J/m2], and another modulus [Pa]."""
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
    """Find the layers that records with height tell; return the cuts measured with these layers, and the fit.

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
