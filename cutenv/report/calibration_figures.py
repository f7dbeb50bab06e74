"""Figures of a validation card: modulus against speed, resistance against length, predicted and measured force."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from cutenv.measurement import LeftOutCut, MeasuredCut
from cutenv.measurement.prediction import predicted_ramps
from cutenv.measurement.speed_dependence import BETWEEN
from cutenv.report.figure import PHONE_WIDTH, label, new_figure, plain_axes
from cutenv.tissue import CutModel, TissueDescription

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_STEEP, _FLAT = "#0072b2", "#d55e00"
_MEASURED, _SAME, _OTHER = "0.65", "#0072b2", "#d55e00"
_LETTERS = 24  # letters of a name in a title: a longer one would leave no room for the drawing on a phone
_POINTS = 2500  # points of a line: more than a figure has pixels


def speed_figure(tissue: TissueDescription, cuts: Sequence[MeasuredCut], width: float) -> Figure:
    """Draw the mean modulus of every cut with the spread of its segments against speed, and the fitted lines."""
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
    """Draw the fracture resistance of every cut against its length: work over area, and the thesis's formula."""
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
    """Draw the measured force of some cuts, and their ramps as predicted from other cuts."""
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
    """Return text shortened to so many letters; an ellipsis marks the omission."""
    return text if len(text) <= letters else f"{text[: letters - 1]}…"
