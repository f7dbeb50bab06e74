"""Validation card of a calibrated tissue: its values, the data behind them, and how well it predicts."""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Sequence
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np

from cutenv.measurement import LeftOutCut, MeasuredCut, estimate_local_effective_moduli, leave_one_out
from cutenv.report.calibration_figures import overlay_figure, resistance_figure, speed_figure
from cutenv.report.page import significant, write_page, write_text
from cutenv.tissue import CutModel, Layers, TissueDescription
from cutenv.tissue.parameter_provenance import Evidence, TissueCalibration

VALIDATION_SCHEMA = "cutenv-calibration-card/1"
_OVERLAID = 4  # cuts whose prediction is drawn
_DISPLAYED = {"Pa": (1e-3, "kPa"), "Pa s/m": (1e-5, "kPa s/cm"), "m": (1e3, "mm"), "m/s": (1e2, "cm/s")}
"""Factor and unit for display, by SI unit."""


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class ValidationCard:
    """Calibrated tissue, with the cuts from which it was calibrated.

    Parameters
    ----------
    tissue : TissueDescription
        Tissue with its ``calibration``.
    model : CutModel
        Finite-element model that the moduli belong to.
    cuts : sequence of MeasuredCut
        Cuts from :func:`~cutenv.measurement.measure_cuts`.

    Raises
    ------
    ValueError
        If the tissue was not calibrated from records.
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
        """Return the cuts' median ``own_rmse``, ``same_rmse`` or ``other_rmse`` [N], and in percent of the peak."""
        pairs = [
            (rmse, each.percent_of_peak(rmse)) for each in self.left_out if (rmse := getattr(each, source)) is not None
        ]
        if not pairs:
            return None
        newtons, percent = np.median(np.array(pairs, dtype=np.float64), axis=0)
        return float(newtons), float(percent)

    def to_json(self) -> str:
        """Return the card's content as JSON text; units are in the names."""
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
        """Return the measurements of one of the cuts; units are in the names."""
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
        """Return the cuts to draw: from the best predicted to the worst, evenly spaced."""
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
    """Write the card as one self-contained page, and its content as JSON beside it.

    Parameters
    ----------
    path : Path
        Path of the page (.html), in a folder that exists.
    card : ValidationCard
        Card to write.

    Returns
    -------
    Path
        Path of the JSON: the page's with the suffix ``.json``.

    Raises
    ------
    ImportError
        If matplotlib is not installed; the message gives the command that installs it.
    """
    write_page(
        path,
        "calibration_card.html",
        card=card,
        headline=calibration_headline(card),
        values=_values(card),
        rows=[card.row_of(cut) for cut in card.cuts],
        count=_count,
        overlay_figure=overlay_figure,
        resistance_figure=resistance_figure,
        speed_figure=speed_figure,
    )
    data = path.with_suffix(".json")
    write_text(data, card.to_json() + "\n")
    return data


def calibration_headline(card: ValidationCard) -> str:
    """Return a sentence or two on how well cuts are predicted that were left out."""
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


def _count(n: int, noun: str) -> str:
    return f"{n} {noun}" + ("" if n == 1 else "s")


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
    """Return the mean modulus as if the depth of cut were the model's thickness, as in Tables 5.1 to 5.5 [Pa]."""
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
