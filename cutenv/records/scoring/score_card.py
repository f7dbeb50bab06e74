"""Score card of one cut.

All metrics, what they rest on, what is doubtful, and percentiles in a reference set.
"""

from __future__ import annotations

import contextlib
import dataclasses
import html
import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

from cutenv.records.measurement import DepthProfile
from cutenv.records.measurement.depth import LAYER_DEPTH_KEY, WANTED_DEPTH_KEY, depth_sd, wanted_depth
from cutenv.records.scoring.cut_map import LINE_KEY, DepthMap, PathMap
from cutenv.records.scoring.cut_metrics import FORCE_WEIGHTS, MAP_METRICS, METRICS, Metric, metric_named
from cutenv.records.scoring.doubts import doubts_of, taken_for_a_drive
from cutenv.records.scoring.points import ScorePoints, outcome_of, task_points
from cutenv.records.scoring.reference import ReferenceSet
from cutenv.records.scoring.scored_cut import ScoredCut
from cutenv.records.scoring.technique import TechniqueFault, technique_faults
from cutenv.records.scoring.truth import ASIDE_AT_END, FLOOR_AT_END, TIP_AT_END, Truth
from cutenv.records.scoring.validity import Unavailable, validity_warnings, without_spikes
from cutenv.sim.tissue import TissueDescription, measured_liver
from cutenv.sim.tissue.drawn_lines import along_line
from cutenv.sim.tissue.lines import CutLine, through
from cutenv.sim.trace import Trace

T = TypeVar("T")

SCORE_SCHEMA = "cutenv-score/2"
_ROUNDED_OFF = 1e-9  # rounding residue of a computed zero
FEWEST_WEIGHT = 0.5
"""Weight of the leading metrics that must be known for an overall score: with less it would be another score."""
DISCLAIMER = "Training feedback for research; not validated for assessment or credentialing of people."


def whole_score(score: float) -> int:
    """Round an overall score for display and for comparison with marks."""
    return round(score)


@dataclass(frozen=True, kw_only=True)
class Scored:
    """One metric of a cut, or the reason why there is none."""

    value: float | None
    unavailable: str = ""
    percentile: float | None = None


@dataclass(frozen=True, kw_only=True)
class ScriptScore:
    """Overall score and outcome of a script on a cut's specimen."""

    name: str
    overall_score: float
    outcome: str


@dataclass(frozen=True, kw_only=True)
class ScoreCard:
    """The metrics and the score of one cut.

    Attributes
    ----------
    metrics : mapping of str to Scored
        All of :data:`~cutenv.records.scoring.METRICS`, in their order; then those of the depth, where the record tells
        it.
    tip_source : str
        Source of the tip: "truth", "return stroke", "estimated" or "unknown".
    overall_score : float or None
        Sum of the points, 0 to 100. None if tip or target is unknown and there is no reference set either.
    outcome : str
        Outcome in a few words, as "success, 0.4 mm short"; "" if tip or target is unknown.
    points : tuple of ScorePoints
        Part by part: of the task if tip and target are known, see :func:`cutenv.records.scoring.points.task_points`;
        else the percentiles of the leading metrics of force times their weights.
    no_score : str
        Reason why there is no overall score; "" if there is one.
    reference : str
        Name and origin of the reference set; "" if there was none.
    scripts : tuple of ScriptScore
        What scripts got on this very specimen, for its difficulty; empty if that is unknown.
    depth_map : DepthMap or None
        Depth of the cut along its line; None for a record without height or wanted depth, or if it is unknown.
    path_map : PathMap or None
        Distance of the cut to its line; None without a line, or if it is unknown.
    """

    name: str
    force_unit: str
    metrics: Mapping[str, Scored]
    tip_source: str
    overall_score: float | None
    outcome: str
    points: tuple[ScorePoints, ...]
    no_score: str
    reference: str
    faults: tuple[TechniqueFault, ...]
    notes: tuple[str, ...]
    scripts: tuple[ScriptScore, ...] = ()
    depth_map: DepthMap | None = None
    path_map: PathMap | None = None

    def __getitem__(self, name: str) -> float:
        """Return a metric's value; raise ValueError if unavailable."""
        scored = self.metrics[name]
        if scored.value is None:
            raise ValueError(f"{name} is unavailable: {scored.unavailable}.")
        return scored.value

    def unit(self, name: str) -> str:
        """Return the unit of a metric on this card."""
        force = {"N": "N", "1": ""}[self.force_unit]
        unit = metric_named(name).unit.replace("F", force).strip()
        return f"1{unit}" if unit.startswith("/") else unit or "1"

    def readable(self, name: str) -> tuple[str, str]:
        """Return an available metric's value and unit for people.

        Lengths are in mm, areas in mm2; a pure number has no unit.
        """
        value, unit = self[name], self.unit(name)
        if unit == "m":
            value, unit = 1e3 * value, "mm"
        elif unit == "m2":
            value, unit = 1e6 * value, "mm2"
        shown = f"{value:.4g}" if abs(value) >= _ROUNDED_OFF else "0"
        return shown, "" if unit == "1" else unit

    def to_json(self) -> str:
        """Return JSON text, values in SI with units."""
        content = {
            "schema": SCORE_SCHEMA,
            "name": self.name,
            "force_unit": self.force_unit,
            "overall_score": self.overall_score,
            "outcome": self.outcome,
            "points": [dataclasses.asdict(each) for each in self.points],
            "no_score": self.no_score,
            "reference": self.reference,
            "tip_source": self.tip_source,
            "metrics": {
                name: {"unit": self.unit(name), "direction": metric_named(name).direction, **dataclasses.asdict(scored)}
                for name, scored in self.metrics.items()
            },
            "scripts_on_this_specimen": [dataclasses.asdict(each) for each in self.scripts],
            "faults": [dataclasses.asdict(fault) for fault in self.faults],
            "notes": list(self.notes),
            "disclaimer": DISCLAIMER,
        }
        return json.dumps(content, indent=1, allow_nan=False)

    def __str__(self) -> str:
        lines = [self.name, self.headline()]
        lines += [f"  {p.part:24s} {p.points:6.1f} of {p.most:3g} points: {p.reason}" for p in self.points]
        if self.scripts:
            lines.append(f"  scripts on this very specimen: {self.difficulty()}")
        for name, scored in self.metrics.items():
            if scored.value is None:
                lines.append(f"  {name:24s} unavailable: {scored.unavailable}")
                continue
            place = "" if scored.percentile is None else f"better than {scored.percentile:.0f} % of the reference"
            value, unit = self.readable(name)
            lines.append(f"  {name:24s} {value:>11s} {unit:6s} {place}".rstrip())
        lines += [f'  "better than" compares with {self.reference}'] if self.reference else []
        lines += [f"  fault: {fault.says}; {fault.try_next}" for fault in self.faults]
        lines += [f"  note: {note}" for note in (*self.notes, DISCLAIMER)]
        return "\n".join(lines)

    def headline(self) -> str:
        """Return the overall score in words, or why it is missing."""
        if self.overall_score is None:
            return f"no overall score: {self.no_score}"
        of = self.outcome or f"of the force alone, compared with {self.reference}"
        return f"overall score {self.overall_score:.0f} of 100: {of}"

    def difficulty(self) -> str:
        """Return scripts' scores on this specimen in a line, or ""."""
        return ", ".join(f"{each.name} {each.overall_score:.0f}" for each in self.scripts)

    def _repr_html_(self) -> str:
        rows = "".join(
            f"<tr><td>{name.replace('_', ' ')}</td><td>{_shown(scored)}</td><td>{html.escape(self.unit(name))}</td>"
            f"<td>{'' if scored.percentile is None else f'{scored.percentile:.0f} %'}</td></tr>"
            for name, scored in self.metrics.items()
        )
        among = f'<p>"Better than" compares with {html.escape(self.reference)}.</p>' if self.reference else ""
        faults = "".join(f"<li>{html.escape(f'{fault.says}: {fault.try_next}')}</li>" for fault in self.faults)
        return (
            f"<h3>{html.escape(self.name)}</h3><p>{html.escape(self.headline())}</p>"
            f"<table><tr><th>metric</th><th>value</th><th>unit</th><th>better than</th></tr>{rows}</table>{among}"
            f"<ul>{faults}</ul><p><small>{html.escape(DISCLAIMER)}</small></p>"
        )


def score(
    trace: Trace,
    *,
    target_length: float | None = None,
    truth: Truth | None = None,
    reference: ReferenceSet | None = None,
    tissue: TissueDescription | None = None,
    name: str | None = None,
    wanted: DepthProfile | None = None,
    layer_depth: float | None = None,
    line: CutLine | None = None,
) -> ScoreCard:
    """Score one cut by person, script, agent or rig.

    Parameters
    ----------
    trace : Trace
        The record; time and force at least.
    target_length : float, optional
        Length aimed at, from the clamp [m], 0.005 to 0.15; default ``trace.metadata["target_length_m"]`` if there.
    truth : Truth, optional
        Hidden state from a simulator; without it the tip is estimated, and a note on the card states it.
    reference : ReferenceSet, optional
        Set within which percentiles are computed. A record without tip or target has no overall score without one.
    tissue : TissueDescription, optional
        Tissue with which the tip is estimated; default pig liver.
    wanted : DepthProfile, optional
        Wanted depth of the cut below the surface, see :func:`cutenv.records.measurement.depth.wanted_depth`; default
        ``trace.metadata["wanted_depth_m"]`` if there.
    layer_depth : float, optional
        Depth below the surface at which another layer begins [m], 0.0005 to 0.1; default
        ``trace.metadata["layer_depth_m"]`` if there.
    line : CutLine, optional
        Line to cut along, of a record with the places of the blade, whose positions are then told along it; default
        through ``trace.metadata["line_m"]`` if there.

    Raises
    ------
    TypeError, ValueError
        If an argument is out of range, the truth belongs to another record, or a record beside a line has no places.
    """
    if not isinstance(trace, Trace):
        raise TypeError(
            f"trace must be a cutenv.sim.trace.Trace, got {type(trace).__name__}; cutenv.records.load reads one."
        )
    if target_length is None and trace.metadata.get("target_length_m") is not None:
        target_length = trace.metadata["target_length_m"]
    if wanted is None and trace.metadata.get(WANTED_DEPTH_KEY) is not None:
        wanted = wanted_depth(trace.metadata[WANTED_DEPTH_KEY], name=f"metadata {WANTED_DEPTH_KEY}")
    if line is not None:
        trace = positions_along(line, trace)
    elif trace.metadata.get(LINE_KEY) is not None:
        line = _noted_line(trace)
    trace, left_out = without_spikes(trace)
    cut = ScoredCut(
        trace=trace,
        line=line,
        target_length=target_length,
        truth=truth,
        tissue=tissue or measured_liver(),
        wanted=wanted,
        layer_depth=trace.metadata.get(LAYER_DEPTH_KEY) if layer_depth is None else layer_depth,
    )
    fits = reference is not None and reference.force_unit == trace.force_unit
    metrics = {each.name: _scored(each, cut, reference if fits else None) for each in METRICS.values()}
    for part, told in (("depth", cut.tells_depth), ("path", cut.line is not None)):
        if told:  # no reference set holds such cuts
            metrics |= {each.name: _scored(each, cut, None) for each in MAP_METRICS[part].values()}
    points, outcome, no_score = _overall(cut, metrics, reference)
    faults = () if cut.twofold else tuple(technique_faults(cut))
    return ScoreCard(
        name=name or str(trace.metadata.get("name", "cut")),
        force_unit=trace.force_unit,
        metrics=metrics,
        tip_source=cut.tip_source,
        overall_score=None if no_score else sum(each.points for each in points),
        outcome=outcome,
        points=points,
        no_score=no_score,
        reference="" if reference is None else f"{reference.name} ({len(reference)} cuts: {reference.about})",
        faults=faults,
        notes=(*score_notes(cut, points, outcome), *doubts_of(cut), *filter(None, (taken_for_a_drive(cut), left_out))),
        depth_map=_available(lambda: cut.depth_map) if cut.tells_depth and not cut.twofold else None,
        path_map=_available(lambda: cut.path_map) if cut.line is not None and not cut.twofold else None,
    )


def _available(compute: Callable[[], T]) -> T | None:
    with contextlib.suppress(Unavailable):
        return compute()
    return None


def _noted_line(trace: Trace) -> CutLine:
    """Return the line that a record holds."""
    try:
        return through(trace.metadata[LINE_KEY])
    except (TypeError, ValueError) as error:
        raise ValueError(f"metadata {LINE_KEY}: {error}") from None


def positions_along(line: CutLine, trace: Trace) -> Trace:
    """Return a record with positions as lengths along a line."""
    x, y = trace.blade_x, trace.blade_y
    if x is None or y is None:
        raise ValueError(
            "A line is given, and the record has no places of the blade. Record blade_x and blade_y, from the middle "
            "of the clamp, or leave the line out."
        )
    ends_elsewhere = (TIP_AT_END, ASIDE_AT_END)  # along and beside the record's own line
    notes = {key: value for key, value in trace.metadata.items() if key not in ends_elsewhere}
    return dataclasses.replace(trace, position=along_line(line, x, y)[0], speed=None, metadata=notes)


def _overall(
    cut: ScoredCut, metrics: Mapping[str, Scored], reference: ReferenceSet | None
) -> tuple[tuple[ScorePoints, ...], str, str]:
    """Return points, outcome and, if there is no score, the reason."""
    doubt = cut.twofold or cut.spoiled or cut.unfinished
    if doubt:
        return (), "", doubt
    known = {name: scored.value for name, scored in metrics.items() if scored.value is not None}
    try:
        points, outcome = task_points(cut, known), outcome_of(cut, known)
        doubt = cut.no_mark(known.get("work_over_fracture"))
        return ((), "", doubt) if doubt else (points, outcome, "")
    except Unavailable as error:
        why = "no reference set of such records"
        if cut.trace.position is not None:
            why = f"{error}, and there is no reference set of such records"
    if reference is None:
        return (), "", why
    if reference.force_unit != cut.trace.force_unit:
        unit, own = reference.force_unit, cut.trace.force_unit
        return (), "", f"the force of {reference.name} is in unit {unit!r}, this record's in {own!r}"
    ranked = {name: w for name, w in FORCE_WEIGHTS.items() if metrics[name].percentile is not None}
    total = sum(ranked.values())
    if total < FEWEST_WEIGHT:
        return (), "", f"leading metrics of {total:.0%} of the weight are known, and {FEWEST_WEIGHT:.0%} are needed"
    points = tuple(
        ScorePoints(
            part=name,
            points=w / total * float(metrics[name].percentile or 0.0),
            most=100.0 * w / total,
            reason=f"better than {metrics[name].percentile:.0f} % of {reference.name}",
        )
        for name, w in ranked.items()
    )
    return points, "", ""


def _scored(each: Metric, cut: ScoredCut, reference: ReferenceSet | None) -> Scored:
    if cut.twofold:
        return Scored(value=None, unavailable=cut.twofold)
    try:
        value = each.function(cut)
    except Unavailable as error:
        return Scored(value=None, unavailable=str(error))
    if not math.isfinite(value):
        return Scored(value=None, unavailable="it is not finite for this record")
    return Scored(value=value, percentile=None if reference is None else reference.percentile(each.name, value))


def _shown(scored: Scored) -> str:
    return html.escape(f"unavailable: {scored.unavailable}") if scored.value is None else f"{scored.value:.4g}"


EXPECTED_FLOOR = (
    "floor of the cut: that of mean tissue under a blade that moved so, by an assumed edge; the surface as recorded"
)
"""Note on a record whose floor is not known but expected."""
EXPECTED_CUT = "cut beside the line: that of mean tissue behind a blade that moved so, by the estimated tip"
"""Note on a record whose cut is not known but expected."""


def score_notes(cut: ScoredCut, points: Sequence[ScorePoints], outcome: str) -> list[str]:
    """Return a card's notes on sources and what is not counted."""
    notes = [
        {
            "truth": "tip: the simulator's own",
            "return stroke": "tip: from the return stroke, after which it is known to about 0.3 mm; estimated before",
            "estimated": "tip: estimated, by the cut's own loading; median error 1 to 2 mm, one in ten above 5 mm",
            "guessed": "tip: estimated with the stiffness of mean tissue; median error 2 mm, one in twenty above 7 mm",
            "unknown": "tip: unknown; force alone is judged",
        }["guessed" if cut.tip_source == "estimated" and cut.own_modulus is None else cut.tip_source]
    ]
    if cut.truth is None and cut.noted_end is not None:
        notes.append("where the tip ended is as the record notes it, and position and clock are as recorded")
    if cut.trace.height is not None and cut.trace.depth is not None:
        known = FLOOR_AT_END in cut.trace.metadata or (cut.truth is not None and cut.truth.floor is not None)
        notes.append("floor of the cut: the simulator's own" if known else EXPECTED_FLOOR)
    if cut.line is not None and _is_known(cut):
        known = ASIDE_AT_END in cut.trace.metadata or (cut.truth is not None and cut.truth.aside is not None)
        notes.append("cut beside the line: the simulator's own" if known else EXPECTED_CUT)
    if not points:
        notes.append("metrics, and no claim of skill")
    counted = {each.part for each in points}
    left = [] if outcome or not points else sorted(set(FORCE_WEIGHTS) - counted)
    if left:
        notes.append(f"not counted, without a value or a reference: {', '.join(left)}")
    sd = depth_sd(cut.trace)
    if sd is not None:
        notes.append(f"record: depth of cut measured to {1e3 * sd:.2f} mm (standard deviation)")
    return notes + validity_warnings(cut.trace, cut.quality)


def _is_known(cut: ScoredCut) -> bool:
    """Return True if the cut's path is known or expected."""
    with contextlib.suppress(Unavailable):
        return len(cut.path_map.aside) > 0
    return False
