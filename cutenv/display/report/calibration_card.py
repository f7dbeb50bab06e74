"""Validation card of a tissue: values, data, predictions, figures."""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Sequence
from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cutenv.display.report.page import PHONE_WIDTH, label, new_figure, plain_axes, significant, write_page, write_text
from cutenv.display.report.study_page import count
from cutenv.records.measurement import LeftOutCut, MeasuredCut, estimate_local_effective_moduli, leave_one_out
from cutenv.records.measurement.prediction import predicted_ramps
from cutenv.records.measurement.speed_dependence import BETWEEN
from cutenv.sim.tissue import CutModel, Layers, TissueDescription
from cutenv.sim.tissue.description import Evidence, TissueCalibration

if TYPE_CHECKING:
    from matplotlib.figure import Figure


_STEEP, _FLAT = "#0072b2", "#d55e00"
_MEASURED, _SAME, _OTHER = "0.65", "#0072b2", "#d55e00"
_LETTERS = 24  # letters of a name in a title: a longer one would leave no room for the drawing on a phone
_POINTS = 2500  # points of a line: more than a figure has pixels


def speed_figure(tissue: TissueDescription, cuts: Sequence[MeasuredCut], width: float) -> Figure:
    """Draw mean modulus against speed, with spread of segments and fits."""
    figure = new_figure(width, 3.6)
    axes = figure.subplots()
    v = np.linspace(tissue.speed_min, tissue.speed_max, 2)
    for steep, colour, marker, angle, name in (
        (True, _STEEP, "o", math.pi / 2, "90°"),
        (False, _FLAT, "s", math.pi / 4, "45°"),
    ):
        own = [cut for cut in cuts if len(cut.moduli) and (cut.angle >= BETWEEN) is steep]
        # Cuts of one speed are side by side, in their order.
        shift = 0.004 * (tissue.speed_max - tissue.speed_min) * (1.0 if steep else -1.0)
        places = [100.0 * (cut.speed + shift * (1 + i % 5)) for i, cut in enumerate(own)]
        means, sds = ([getattr(cut.moduli, what) / 1e3 for cut in own] for what in ("mean", "sd"))
        axes.errorbar(
            places, means, sds, fmt=marker, color=colour, ecolor=colour, elinewidth=0.6, markersize=4, alpha=0.75,
            label=f"cuts at {name}" if own else None,
        )  # fmt: skip
        dashed = "-" if own else "--"
        tells = "" if own else ", not measured"
        axes.plot(
            100.0 * v,
            [tissue.local_effective_modulus(at, angle) / 1e3 for at in v],
            dashed,
            color=colour,
            label=f"line at {name}{tells}",
        )
    axes.set_xlabel("speed [cm/s]")
    axes.set_ylabel("local effective modulus [kPa]")
    axes.set_ylim(bottom=0.0)
    plain_axes(axes)
    figure.legend(loc="outside upper left", ncols=2 if width < PHONE_WIDTH else 4, frameon=False, fontsize=9)
    return figure


def resistance_figure(cuts: Sequence[MeasuredCut], width: float) -> Figure:
    """Draw fracture resistance against length, with the thesis's formula."""
    figure = new_figure(width, 3.4)
    axes = figure.subplots()
    length = [100.0 * cut.fracture.cut_length for cut in cuts]
    axes.plot(length, [cut.fracture.apparent for cut in cuts], "x", color=_FLAT, label="apparent, W/(B x)")
    axes.plot(
        length, [cut.fracture.corrected for cut in cuts], "o", color=_STEEP, markersize=5, label="work over area cut"
    )
    axes.set_xlabel("length of cut, by the tip [cm]")
    axes.set_ylabel("fracture resistance [J/m²]")
    axes.set_xlim(left=0.0)
    axes.set_ylim(bottom=0.0)
    plain_axes(axes)
    figure.legend(loc="outside upper left", ncols=2, frameon=False, fontsize=9)
    return figure


def overlay_figure(shown: Sequence[tuple[MeasuredCut, LeftOutCut]], model: CutModel, width: float) -> Figure:
    """Draw measured forces, and ramps predicted from other cuts."""
    figure = new_figure(width, 0.4 + 2.5 * len(shown))
    panels = np.atleast_1d(figure.subplots(len(shown), 1))
    for axes, (cut, left_out) in zip(panels, shown, strict=True):
        (position,) = cut.trace.require("position", by="overlay_figure")
        forward = slice(0, int(np.argmax(position)) + 1)
        step = max(1, forward.stop // _POINTS)
        x, F = 100.0 * position[forward][::step], cut.trace.force[forward][::step]
        axes.plot(x, F, color=_MEASURED, linewidth=0.9, label="measured")
        for modulus, colour, style, name in (
            (left_out.other_modulus, _OTHER, "--", "predicted from another specimen"),
            (left_out.same_modulus, _SAME, "-", "predicted from other cuts of the specimen"),
        ):
            if modulus is None:
                continue
            for i, ramp in enumerate(predicted_ramps(cut, model, modulus)):
                ends = [0, -1]
                axes.plot(
                    100.0 * ramp.position[ends], ramp.predicted[ends], style, color=colour, linewidth=1.8,
                    label=None if i else name,
                )  # fmt: skip
        name, specimen = (_shortened(text, _LETTERS) for text in (cut.name, cut.specimen or "specimen not named"))
        title = f"{name}, {specimen}, {100.0 * cut.speed:.2g} cm/s, {math.degrees(cut.angle):.0f}°"
        axes.set_title(label(title), fontsize=10, loc="left")
        axes.set_ylabel("force [N]")
        axes.set_ylim(bottom=min(0.0, float(F.min())))
        plain_axes(axes)
    panels[-1].set_xlabel("blade [cm]")
    handles, names = panels[0].get_legend_handles_labels()
    figure.legend(
        handles, names, loc="outside upper left", ncols=1 if width < PHONE_WIDTH else 3, frameon=False, fontsize=9
    )
    return figure


def _shortened(text: str, letters: int) -> str:
    return text if len(text) <= letters else f"{text[: letters - 1]}…"


VALIDATION_SCHEMA = "cutenv-calibration-card/1"
_OVERLAID = 4  # cuts whose prediction is drawn
_DISPLAYED = {"Pa": (1e-3, "kPa"), "Pa s/m": (1e-5, "kPa s/cm"), "m": (1e3, "mm"), "m/s": (1e2, "cm/s")}
"""Factor and unit for display, by SI unit."""


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class ValidationCard:
    """Calibrated tissue, with the cuts from which it was calibrated.

    The cuts are those of :func:`~cutenv.records.measurement.measure_cuts`. Raises ValueError if the tissue was not
    calibrated from records.
    """

    tissue: TissueDescription
    model: CutModel
    cuts: Sequence[MeasuredCut]
    left_out: Sequence[LeftOutCut] = dataclasses.field(init=False)
    """Every cut, predicted from the others."""

    def __post_init__(self) -> None:
        if self.tissue.calibration is None:
            raise ValueError(f"tissue {self.tissue.name!r} was not calibrated from records: there is nothing to show.")
        object.__setattr__(self, "left_out", leave_one_out(self.cuts, self.model))

    @property
    def calibration(self) -> TissueCalibration:
        """Data and methods behind the tissue."""
        assert self.tissue.calibration is not None, "refused above"
        return self.tissue.calibration

    def median_error(self, source: str) -> tuple[float, float] | None:
        """Return a median error [N], and in percent of the peak.

        ``source`` is ``own_rmse``, ``same_rmse`` or ``other_rmse``.
        """
        pairs = [
            (rmse, each.percent_of_peak(rmse)) for each in self.left_out if (rmse := getattr(each, source)) is not None
        ]
        if not pairs:
            return None
        newtons, percent = np.median(np.array(pairs, dtype=np.float64), axis=0)
        return float(newtons), float(percent)

    def to_json(self) -> str:
        """Return the card's content as JSON, with units in names."""
        errors = {source: self.median_error(source) for source in ("own_rmse", "same_rmse", "other_rmse")}
        content: dict[str, Any] = {
            "schema": VALIDATION_SCHEMA,
            "tissue": json.loads(self.tissue.to_json()),
            "median_prediction_error": {
                source: None if pair is None else {"rmse_N": pair[0], "percent_of_peak": pair[1]}
                for source, pair in errors.items()
            },
            "cuts": [self.row_of(cut) for cut in self.cuts],
            "left_out": [_left_out_content(each) for each in self.left_out],
        }
        return json.dumps(content, indent=1, allow_nan=False)

    def row_of(self, cut: MeasuredCut) -> dict[str, Any]:
        """Return the measurements of a cut, with units in names."""
        plain = _without_depth(cut, self.model)
        found = len(cut.moduli) > 0
        return {
            "name": cut.name,
            "specimen": cut.specimen,
            "speed_cm_s": 100.0 * cut.speed,
            "angle_deg": math.degrees(cut.angle),
            "segments": len(cut.moduli),
            "modulus_Pa": cut.moduli.mean if found else None,
            "sd_modulus_Pa": cut.moduli.sd if found else None,
            "modulus_without_depth_Pa": plain,
            "unloading_modulus_Pa": cut.unloading_modulus(self.model),
            "apparent_resistance_J_m2": cut.fracture.apparent,
            "resistance_J_m2": cut.fracture.corrected,
            "friction_N_m": cut.fracture.friction_per_depth,
            "cut_length_cm": 100.0 * cut.fracture.cut_length,
            "return_stroke": cut.return_stroke is not None,
            "flags": list(cut.flags),
        }

    def shown(self) -> list[tuple[MeasuredCut, LeftOutCut]]:
        """Return cuts to draw, evenly spaced from best to worst predicted."""
        by_name = {cut.name: cut for cut in self.cuts}

        def error(each: LeftOutCut) -> float:
            known = [rmse for rmse in (each.same_rmse, each.other_rmse, each.own_rmse) if rmse is not None]
            return known[0] / each.peak_force

        ranked = sorted(self.left_out, key=error)
        if not ranked:
            return []
        places = np.unique(np.linspace(0, len(ranked) - 1, min(_OVERLAID, len(ranked))).round().astype(int))
        return [(by_name[ranked[i].name], ranked[i]) for i in places]


def write_validation_card(path: Path, card: ValidationCard) -> Path:
    """Write the card as self-contained page and as JSON, whose path is returned."""
    write_page(
        path,
        "calibration_card.html",
        *(overlay_figure, resistance_figure, speed_figure),
        card=card,
        headline=calibration_headline(card),
        values=_values(card),
        rows=[card.row_of(cut) for cut in card.cuts],
        count=count,
    )
    data = path.with_suffix(".json")
    write_text(data, card.to_json() + "\n")
    return data


def calibration_headline(card: ValidationCard) -> str:
    """Return in words how well left-out cuts are predicted."""
    same, other, own = (card.median_error(source) for source in ("same_rmse", "other_rmse", "own_rmse"))
    parts = []
    if same is not None:
        parts.append(f"from other cuts of its own specimen to {_error(same)}")
    if other is not None:
        parts.append(f"from another specimen to {_error(other)}")
    if own is None:
        return "No cut shows a steady loading segment: there is no force to predict."
    if not parts:
        return (
            f"A single cut cannot be predicted from others; its segments' own moduli give its force to {_error(own)}."
        )
    return (
        f"The loading ramps of a cut that was left out are predicted {', '.join(parts)} (median over the cuts); "
        f"every segment's own modulus gives {_error(own)}."
    )


def _error(pair: tuple[float, float]) -> str:
    return f"{pair[0]:.2f} N, {pair[1]:.1f} % of the peak"


def _values(card: ValidationCard) -> list[tuple[Evidence, str, str, str]]:
    """Return each value's provenance, and value, unit and interval as shown."""
    about = {field.name: field.metadata for field in dataclasses.fields(TissueDescription)}
    about |= {f"layers.{field.name}": field.metadata for field in dataclasses.fields(Layers)}
    rows = []
    for each in card.calibration.evidence:
        factor, unit = _DISPLAYED.get(about[each.name]["unit"], (1.0, about[each.name]["unit"]))
        interval = ""
        if each.low is not None and each.high is not None:
            interval = f"{significant(factor * each.low, 4)} to {significant(factor * each.high, 4)}"
        value = significant(factor * attrgetter(each.name)(card.tissue), 4)
        rows.append((each, value, "" if unit == "1" else unit, interval))
    return rows


def _without_depth(cut: MeasuredCut, model: CutModel) -> float | None:
    """Return the mean modulus [Pa] at the model's thickness, as in Tables 5.1 to 5.5."""
    found = estimate_local_effective_moduli(
        cut.trace, model, depth_normalised=False, friction_per_depth=0.0, loading_ratio=0.0
    )
    return found.mean if len(found) else None


def _left_out_content(each: LeftOutCut) -> dict[str, Any]:
    content = dataclasses.asdict(each)
    units = {"speed": "speed_m_s", "angle": "angle_rad", "peak_force": "peak_force_N"}
    for name in list(content):
        if name.endswith("modulus"):
            units[name] = f"{name}_Pa"
        elif name.endswith("rmse"):
            units[name] = f"{name}_N"
    return {units.get(name, name): value for name, value in content.items()}
