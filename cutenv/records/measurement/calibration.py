"""Calibration of one tissue description from a set of records."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, NamedTuple, TypeVar

import numpy as np

from cutenv._base.validation import in_range
from cutenv.records.measurement.fracture import hardly_ran
from cutenv.records.measurement.layer_fit import LayerFit
from cutenv.records.measurement.loading_ratio import LoadingRatio
from cutenv.records.measurement.loading_ratio import loading_ratio as liver_loading_ratio
from cutenv.records.measurement.measured_cut import MeasuredCut, by_specimen, in_layers, measure_cut, named
from cutenv.records.measurement.pooled_cuts import (
    FEWEST_FOR_CORRELATION,
    FEWEST_FOR_INCLINED,
    NOT_RESAMPLED,
    PooledCuts,
    Variogram,
    cv_of,
    fit_variances,
    resampled,
)
from cutenv.records.measurement.speed_dependence import (
    BETWEEN,
    LEAST_SPEED_RATIO,
    SpeedDependence,
    fit_speed_dependence,
    is_between_the_measured,
)
from cutenv.records.measurement.strokes import fit_return_stroke
from cutenv.records.measurement.zero import NOTABLE
from cutenv.sim.tissue.cut_model import CutModel
from cutenv.sim.tissue.description import Evidence, TissueCalibration, TissueDescription, measured_liver
from cutenv.sim.tissue.slab import effective_depth
from cutenv.sim.tissue.specimen import SPACING, Specimen
from cutenv.sim.trace import Trace

_OFFSET = 0.1  # [N]; the note gives its effect on friction's share


def zero_notes(cuts: Sequence[MeasuredCut]) -> list[str]:
    """Return notes on sensor zeros: offsets subtracted and their effects.

    An unknown offset looks like friction, and where depth varies it looks like spread of the tissue.
    """
    notes = []
    unknown = [cut for cut in cuts if not cut.fracture.zero.is_known]
    if unknown:
        share = float(np.median([_OFFSET / (cut.depth.depth.max() * cut.fracture.corrected) for cut in unknown]))
        notes.append(
            f"{len(unknown)} of {len(cuts)} cuts do not show the sensor's zero: no rest out of the tissue, no way back "
            "along a depth that varies. Friction, an offset and the spread within and between cuts cannot be told "
            f"apart: {_OFFSET:g} N of offset change friction's share by {share:.2f} or more. Let the blade rest 0.2 s "
            "in air before and after every cut"
        )
    taken = [cut.fracture.zero.largest for cut in cuts if abs(cut.fracture.zero.largest) >= NOTABLE]
    if taken:
        notes.append(
            f"the sensor's zero was taken off the force: {min(taken):.2f} to {max(taken):.2f} N in {len(taken)} of "
            f"{len(cuts)} cuts"
        )
    left = [
        back.offset
        for cut in cuts
        if cut.return_stroke is not None
        and (back := fit_return_stroke(cut.trace, cut.depth, with_offset=True)) is not None
        and back.offset_error <= NOTABLE
    ]
    if left and abs(median := float(np.median(left))) > NOTABLE:
        notes.append(
            f"on the way back {len(left)} cuts show a constant {median:.2f} N (median) beside friction: the zero is "
            "not what the blade showed at rest, or friction does not follow the depth. Friction's share and the "
            "spreads are wrong by it"
        )
    return notes


def calibration_notes(cuts: Sequence[MeasuredCut], model: CutModel, found: dict[str, float]) -> list[str]:
    """Return notes on a calibration's cuts and findings."""
    notes: list[str] = []
    silent = sum(not len(cut.moduli) for cut in cuts)
    if silent:
        notes.append(
            f"{silent} of {len(cuts)} cuts show no steady loading segment: they give a resistance but no modulus"
        )
    notes += _extrapolated(cuts)
    notes += zero_notes(cuts)
    errors = [e / cut.fracture.corrected for cut in cuts if (e := cut.fracture.depth_error) is not None]
    if errors:
        worst = 100.0 * max(errors)
        notes.append(f"{len(errors)} of {len(cuts)} cuts tell their depth's error: by it, R to {worst:.1f} % or better")
    without = sum(cut.return_stroke is None for cut in cuts)
    if without:
        notes.append(f"{without} of {len(cuts)} cuts have no return stroke past the tip: less certain by about 5 %")
    unloading = [modulus for cut in cuts if (modulus := cut.unloading_modulus(model)) is not None]
    if unloading:
        over = float(np.mean(unloading)) / found["intercept_90"]
        notes.append(
            f"{len(unloading)} return strokes unload with {over:.2f} of the modulus for v -> 0 at 90 degrees: "
            "1 if the fall of the modulus with speed is growth of the cut while loading, as in the law"
        )
    if len({cut.specimen for cut in cuts}) == 1 and cuts[0].specimen == "":
        notes.append('no record names its specimen (metadata "specimen"): all count as cuts of one')
    flagged: dict[str, int] = {}
    for cut in cuts:
        for flag in cut.flags:
            if flag not in cut.fracture.zero.flags:  # zero_notes reports on the zero
                flagged[flag] = flagged.get(flag, 0) + 1
    notes += [f"{n} of {len(cuts)} cuts: {flag}" for flag, n in flagged.items()]
    return notes


def _how_far_off(evidence: Sequence[Evidence], found: dict[str, float], cuts: int, specimens: int) -> list[str]:
    """Return a note on the means' uncertainty and cuts needed.

    Those of one specimen tell nothing of others: there pig liver's spread between specimens stands in.
    """
    if specimens == 1:
        spread = measured_liver().modulus_between_liver_cv
        return [
            f"all {cuts} cuts are of one specimen, and the intervals hold for it alone. Pig livers differ by "
            f"{100.0 * spread:.0f} % in modulus (standard deviation): another specimen may be {196.0 * spread:.0f} % "
            f"off (95 %). A mean within {100.0 * _NEAR:.0f} % takes {math.ceil((1.96 * spread / _NEAR) ** 2)} "
            "specimens or more"
        ]
    errors = {
        each.name: max(each.high - found[each.name], found[each.name] - each.low) / found[each.name]
        for each in evidence
        if each.name in ("intercept_90", "fracture_resistance") and each.low is not None and each.high is not None
    }
    if len(errors) < 2 or max(errors.values()) <= _NEAR:
        return []
    modulus, resistance = errors["intercept_90"], errors["fracture_resistance"]
    wanted = math.ceil(specimens * (max(modulus, resistance) / _NEAR) ** 2)
    return [
        f"{cuts} cuts of {specimens} specimens are few: the mean modulus may be {100.0 * modulus:.0f} % off, the mean "
        f"resistance {100.0 * resistance:.0f} % (95 %). {100.0 * _NEAR:.0f} % takes some {wanted} specimens cut alike"
    ]


def _extrapolated(cuts: Sequence[MeasuredCut]) -> list[str]:
    """Return notes on angles whose speed range is extrapolated."""
    known = [cut for cut in cuts if len(cut.moduli)]
    slowest, fastest = (100.0 * end([cut.speed for cut in known]) for end in (min, max))
    notes = []
    for angle_deg, steep in ((90, True), (45, False)):
        own = [100.0 * cut.speed for cut in known if (cut.angle >= BETWEEN) is steep]
        if own and (max(own) * LEAST_SPEED_RATIO < fastest or min(own) > LEAST_SPEED_RATIO * slowest):
            notes.append(
                f"the modulus near {angle_deg} degrees was measured from {min(own):.2g} to {max(own):.2g} cm/s only: "
                f"from {slowest:.2g} to {fastest:.2g} cm/s, the range of the tissue, its line is extrapolated"
            )
    return notes


T = TypeVar("T")
ProgressBar = Callable[[Sequence[T]], Iterable[T]]

RESAMPLES = 400  # default number of bootstrap resamples
_FEWEST_UNLOADED = (
    8  # cuts with a way back needed for the loading ratio: the tissue at the tip scatters about the cut's mean
)
_ROUNDS = 3  # iterations of fitting the loading ratio and measuring with it: the tip depends on it weakly
_NEAR = 0.10  # relative error of a mean up to which no note is made
_DRAWS, _DRAW_ROUNDS = 200, 4  # sampled specimens, and iterations, to find the material with the measured moduli
_PLACES = np.arange(0.0215, 0.12, 0.006)  # typical positions of the segments of a long cut [m]


class RefusedRecord(NamedTuple):
    """A record that was left out, and the reason."""

    name: str
    reason: str


def calibrate(
    traces: Sequence[Trace],
    *,
    model: CutModel | None = None,
    name: str = "calibrated tissue",
    resamples: int = RESAMPLES,
    seed: int = 0,
    progress: ProgressBar[Any] | None = None,
    boundary: float | None = None,
    capsule_thickness: float | None = None,
) -> TissueDescription:
    """Make one tissue description from a set of records.

    Parameters
    ----------
    traces : sequence of Trace
        One cut each, with position, angle and depth, force in newtons; ``metadata["specimen"]`` names the piece of
        tissue, which several cuts may share. Return strokes past the tip are needed for friction; several speeds and
        both 45 and 90 degrees for the dependence of the modulus on them. Other numbers are pig liver's, with a note.
    model : CutModel, optional
        Model to which the moduli shall belong; default the thesis's, with the default mesh.
    resamples : int
        Number of bootstrap resamples of the cuts for the 95 % intervals, 0 to 100000; 0: no intervals.
    progress : callable, optional
        Wraps the sequence of records while they are measured, as ``tqdm`` does.
    boundary, capsule_thickness : float, optional
        Depth of a layer below, and thickness of a capsule [m], where they are known; for records with height, see
        :func:`cutenv.records.measurement.measured_cut.find_layers`.

    Returns
    -------
    TissueDescription
        ``to_json()`` is what ``gym.make("cutenv/GentleCut-v1", tissue=path)`` reads; ``calibration`` contains the
        evidence.

    Raises
    ------
    ValueError
        If no record can be measured, or they give no valid tissue; with the reasons.

    Notes
    -----
    Thesis, sections 3.3.2, 3.4, 5.1 and 6.2. See :func:`measure_cuts` and :func:`tissue_of` for the two halves.
    """
    check_resamples(resamples)
    model = model or CutModel()
    cuts, refused = measure_cuts(traces, model, progress=progress)
    cuts, layers = in_layers(cuts, traces, model, boundary=boundary, capsule_thickness=capsule_thickness)
    return with_findings(tissue_of(cuts, model, name=name, resamples=resamples, seed=seed), refused, layers)


def measure_cuts(
    traces: Sequence[Trace], model: CutModel, *, progress: ProgressBar[Any] | None = None
) -> tuple[list[MeasuredCut], list[RefusedRecord]]:
    """Measure every record with the loading ratio fitted to all.

    The loading ratio gives the distance of the tip behind the blade; it starts as pig liver's and is replaced by the
    fit to the cuts themselves.

    Returns
    -------
    cuts : list of MeasuredCut
    refused : list of RefusedRecord
        Records that cannot be measured.

    Raises
    ------
    ValueError
        If none can be measured.
    """
    cuts: list[MeasuredCut] = []
    refused: list[RefusedRecord] = []
    records = named(list(traces))
    for label, trace in progress(records) if progress else records:
        try:
            cut = measure_cut(trace, model, ratio=_as_liver, name=label)
            _check_angle(cut)
            cuts.append(cut)
        except (ValueError, RuntimeError) as error:
            refused.append(RefusedRecord(label, str(error)))
    if not cuts:
        raise ValueError(_none_measured(refused))
    for _ in range(_ROUNDS):
        ratio = loading_ratio_of_cuts(cuts, model)
        cuts = [cut.with_loading_ratio(ratio, model) for cut in cuts]
        refused += [RefusedRecord(cut.name, why) for cut in cuts if (why := _why_no_resistance(cut))]
        if not (cuts := [cut for cut in cuts if not _why_no_resistance(cut)]):
            raise ValueError(_none_measured(refused))
    return cuts, refused


def _why_no_resistance(cut: MeasuredCut) -> str:
    """Return why a cut shows no resistance, or ""."""
    assert cut.trace.position is not None, "the resistance is measured by it"
    if flags := hardly_ran(cut.fracture.cut_length, float(np.ptp(cut.trace.position))):
        return f"{flags[0]}. Cut 5 cm or farther, at an angle or speed at which the blade gets in"
    if cut.fracture.corrected <= 0.0:
        found = cut.fracture.corrected
        return f"its resistance is {found:.0f} J/m2, which no tissue has: check the force's zero and sign"
    return ""


def _none_measured(refused: Sequence[RefusedRecord]) -> str:
    reasons = "\n".join(f"  {each.name}: {each.reason}" for each in refused) or "  there is no record."
    return f"no record can be measured:\n{reasons}"


def loading_ratio_of_cuts(cuts: Sequence[MeasuredCut], model: CutModel) -> LoadingRatio:
    """Fit the loading ratio: force rise over that without growth.

    A cut with a way back shows both: its segments the one, its unloading the other. Their ratio does not depend on the
    stiffness of that cut's tissue; without it the intercept of the fit stands for the modulus without growth.
    """
    both = [
        (cut, modulus)
        for cut in cuts
        if len(cut.moduli) and (modulus := cut.unloading_modulus(model)) is not None and modulus > 0.0
    ]
    if len(both) < _FEWEST_UNLOADED:
        return speed_dependence_of(cuts).loading_ratio
    line = fit_speed_dependence(
        [cut.speed for cut, _ in both],
        [cut.angle for cut, _ in both],
        [cut.material_modulus / own for cut, own in both],
    )
    return lambda speed, angle: min(1.0, max(line.modulus(abs(speed), angle), 0.01))


def speed_dependence_of(cuts: Sequence[MeasuredCut]) -> SpeedDependence:
    """Fit the cuts' mean moduli against speed and angle."""
    known = [cut for cut in cuts if len(cut.moduli)]
    if not known:
        raise ValueError(
            f"none of {len(cuts)} cuts has a steady loading segment: the force must rise and drop again several times "
            "at one speed. Cut farther, or slower."
        )
    return fit_speed_dependence(
        [cut.speed for cut in known], [cut.angle for cut in known], [cut.material_modulus for cut in known]
    )


def tissue_of(
    cuts: Sequence[MeasuredCut],
    model: CutModel,
    *,
    name: str = "calibrated tissue",
    resamples: int = RESAMPLES,
    seed: int = 0,
) -> TissueDescription:
    """Combine measured cuts into a tissue description; see :func:`calibrate`."""
    check_resamples(resamples)
    pool = PooledCuts(list(cuts))
    found = pool.numbers(np.ones(len(cuts)))
    _check_intercepts(found, pool)
    rng = np.random.default_rng(seed)
    samples = [pool.numbers(resampled(rng, len(cuts))) for _ in range(int(resamples) if len(cuts) > 1 else 0)]
    liver = measured_liver()
    evidence, values = [], {}
    for field, how in _HOW.items():
        value = found[field]
        if math.isnan(value):
            values[field] = getattr(liver, field)
            evidence.append(Evidence(name=field, provenance="assumed", how=_WHY_NOT[field] + "; pig liver's stands in"))
            continue
        values[field] = value
        spread = np.array([] if field in NOT_RESAMPLED else [sample[field] for sample in samples])
        spread = spread[np.isfinite(spread)]
        low, high = np.quantile(spread, [0.025, 0.975]) if len(spread) > 0.5 * len(samples) > 0 else (None, None)
        if low is not None and high is not None:
            low, high = np.clip((low - _BIAS.get(field, 0.0), high + _BIAS.get(field, 0.0)), *_possible(field))
        provenance: Any = "measured" if field in pool.measured else "assumed"
        evidence.append(
            Evidence(
                name=field,
                provenance=provenance,
                how=how if provenance == "measured" else _WHY_NOT[field] + "; pig liver's, in proportion, stands in",
                low=None if low is None or provenance != "measured" else float(low),
                high=None if high is None or provenance != "measured" else float(high),
            )
        )
    specimens = len(by_specimen(list(cuts)))
    notes = _how_far_off(evidence, values, len(cuts), specimens) + calibration_notes(cuts, model, found)
    numbers: dict[str, Any] = {field: _rounded(value) for field, value in values.items()}
    try:
        tissue = dataclasses.replace(
            liver,
            name=name,
            element=model.element,
            formulation=model.formulation,
            poisson=model.poisson,
            calibration=TissueCalibration(
                cuts=len(cuts), specimens=specimens, evidence=tuple(evidence), notes=tuple(notes)
            ),
            **numbers,
        )
        return as_material(tissue)
    except ValueError as error:
        raise ValueError(
            f"these {len(cuts)} cuts together give no tissue: {error}. Leave out a cut that is unlike the others, or "
            "add more."
        ) from None


def _check_intercepts(found: Mapping[str, float], pool: PooledCuts) -> None:
    """Raise ValueError if the modulus extrapolates below zero at standstill."""
    for angle in (90, 45):
        modulus = found[f"intercept_{angle}"]
        if modulus <= 0.0:
            slowest, fastest = 100.0 * pool.speed_min, 100.0 * pool.speed_max
            raise ValueError(
                f"by these {len(pool.cuts)} cuts, at {slowest:.3g} to {fastest:.3g} cm/s, the modulus at {angle} "
                f"degrees falls to {modulus:.0f} Pa towards standstill, which no tissue has. Add cuts of other "
                "specimens, slower and faster ones."
            )


def with_findings(
    tissue: TissueDescription, refused: Sequence[RefusedRecord], layers: LayerFit | None = None
) -> TissueDescription:
    """Return a tissue with layers found and omitted records noted."""
    facts = tissue.calibration
    assert facts is not None, "made by tissue_of"
    left_out = [f"left out: {each.name}: {each.reason}" for each in refused]
    facts = dataclasses.replace(
        facts, evidence=(*facts.evidence, *(() if layers is None else layers.evidence)), notes=(*left_out, *facts.notes)
    )
    return dataclasses.replace(tissue, calibration=facts, layers=None if layers is None else layers.layers)


def check_resamples(resamples: int) -> None:
    """Raise early for an invalid number of resamples."""
    in_range("resamples", resamples, 0, 100_000, "1", "Some hundreds give an interval.")


def as_material(tissue: TissueDescription) -> TissueDescription:
    """Find the material whose specimens show a tissue's modulus and spread.

    The stiffness of a slab averages the field of moduli around the tip, so that segments show less of its spread than
    the material has. Specimens are evaluated at positions as far apart as segments are, without a cut: a segment's
    modulus is K over kappa and the effective depth. The same random numbers are used in every round.

    Evidence is adapted: ``modulus`` is added with the interval of ``intercept_90``, and the spread's interval becomes
    the material's, both in proportion.
    """
    kappa = np.asarray(tissue.cut_model().stiffness(_PLACES))
    points = np.rint(_PLACES / SPACING).astype(int)
    shown, material = tissue.modulus_within_cut_cv, tissue
    for _ in range(_DRAW_ROUNDS):
        drawn = [Specimen.drawn(n, tissue=material) for n in range(_DRAWS)]
        effective = effective_depth(_PLACES, drawn[0].depth[points], tissue.thickness)
        moduli = [specimen.stiffness()[points] / (kappa * effective) for specimen in drawn]
        level = float(np.mean(moduli)) / tissue.intercept_90
        (within,), _ = fit_variances(
            [Variogram.of([_PLACES] * _DRAWS, moduli)], np.ones(_DRAWS), tissue.correlation_length
        )
        found = cv_of(float(within))
        material = dataclasses.replace(
            material,
            modulus=_rounded(material.modulus / level),
            modulus_within_cut_cv=_rounded(min(material.modulus_within_cut_cv * shown / found, 1.0) if found else 0.0),
        )
    facts = tissue.calibration
    if facts is None:
        return material
    wider = material.modulus_within_cut_cv / shown if shown else 1.0
    evidence = []
    for each in facts.evidence:
        if each.name == "intercept_90":
            modulus = _scaled(each, material.modulus / tissue.intercept_90)
            evidence.append(
                dataclasses.replace(modulus, name="modulus", how=f"drawn specimens show intercept_90: {each.how}")
            )
        evidence.append(_scaled(each, wider) if each.name == "modulus_within_cut_cv" else each)
    return dataclasses.replace(material, calibration=dataclasses.replace(facts, evidence=tuple(evidence)))


def _scaled(evidence: Evidence, factor: float) -> Evidence:
    """Return the evidence for a number scaled by ``factor``."""
    if evidence.low is None or evidence.high is None:
        return evidence
    return dataclasses.replace(evidence, low=factor * evidence.low, high=factor * evidence.high)


def _possible(field: str) -> tuple[float, float]:
    """Return the possible range of a field's interval."""
    if field.startswith("slope"):
        return -math.inf, math.inf
    return 0.0, 1.0 if field in ("friction_share", "eta90") else math.inf


_BIAS = {
    "eta90": 0.015
}  # that virtual studies show beside the scatter of cuts (scripts/validation/measurement/calibration_studies.py)
_FIT = "least squares of the cuts' mean moduli, per effective depth, against speed and angle (5.1)"
_HOW = {
    "intercept_90": f"{_FIT}, for v -> 0 at 90 degrees",
    "slope_90": f"{_FIT}, at 90 degrees, in pig liver's steps",
    "intercept_45": f"{_FIT}, for v -> 0 at 45 degrees",
    "slope_45": f"{_FIT}, at 45 degrees",
    "speed_min": "slowest cut that shows a modulus",
    "speed_max": "fastest cut that shows a modulus",
    "modulus_between_liver_cv": "nested analysis of variance of the cuts' mean moduli over the fit, by specimen",
    "modulus_between_cut_cv": "the same, between cuts of one specimen, less what the field within a cut adds",
    "modulus_within_cut_cv": "variogram of the segments' moduli along the cuts; drawn specimens then show that; an "
    "error of the depth of 0.5 mm makes it a fifth too large in the median of virtual studies",
    "inclined_between_cut_cv": "spread between cuts flatter than 67.5 degrees, less that between steeper ones",
    "correlation_length": "variograms of moduli and initiation forces along the cuts",
    "fracture_resistance": "mean of the cuts' corrected resistance, work over area (6.1-6.4)",
    "fracture_between_cut_cv": "spread of the cuts' corrected resistance, less what the field within a cut adds",
    "fracture_within_cut_cv": "variogram of the initiation force per depth along the cuts",
    "friction_share": "friction per depth of the return strokes over the resistance",
    "eta90": "initiation force over the resistance of the unit it starts, hilltop to hilltop; its interval is that "
    "over cuts and 0.015 on either side, the bias that virtual studies show",
    "edge_depth": "fit of the bulge to the recorded depths",
    "crown_depth": "fit of the bulge to the recorded depths",
    "rise_length": "fit of the bulge to the recorded depths",
    "mean_depth": "mean of the recorded depths where segments were measured",
}
_WHY_NOT = {
    "intercept_90": "no cut steeper than 67.5 degrees",
    "slope_90": "cuts at this angle do not differ in speed by a factor of 1.5",
    "intercept_45": "no cut flatter than 67.5 degrees",
    "slope_45": "cuts at this angle do not differ in speed by a factor of 1.5",
    "modulus_between_liver_cv": "fewer than two specimens with cuts steeper than 67.5 degrees, one such cut of each, "
    "or no more cuts than the line over speed and angle has numbers",
    "modulus_between_cut_cv": "no specimen with two cuts steeper than 67.5 degrees, or no more cuts than the line over "
    "speed and angle has numbers",
    "modulus_within_cut_cv": "too few segments",
    "inclined_between_cut_cv": f"fewer than {FEWEST_FOR_INCLINED} cuts on either side of 67.5 degrees",
    "correlation_length": f"fewer than {FEWEST_FOR_CORRELATION} cuts",
    "fracture_between_cut_cv": "a single cut",
    "fracture_within_cut_cv": "too few hilltops",
    "friction_share": "no return stroke past the tip",
    "eta90": "no two steady segments in a row",
}


def _rounded(value: float) -> float:
    """Round to six digits, beyond any measurement's precision."""
    return float(f"{value:.6g}")


def _as_liver(speed: float, angle: float | None) -> float:
    """Return pig liver's loading ratio, at the nearest measured angle."""
    theta = math.pi / 2 if angle is None else min(max(angle, math.pi / 4), math.pi / 2)
    return liver_loading_ratio(speed, theta)


def _check_angle(cut: MeasuredCut) -> None:
    if not is_between_the_measured(cut.angle):
        raise ValueError(
            f"its blade is at {math.degrees(cut.angle):.0f} degrees; the law holds for 45 to 90. "
            "Angles are against the surface, upright is 90: for angles from the other side give 180 minus the angle."
        )
