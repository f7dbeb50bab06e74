"""Figure of a cut along a wanted depth: the floor that was cut, the floor that was wanted, and the layer below."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cutenv.report.figure import PHONE_WIDTH, new_figure, plain_axes
from cutenv.tissue.grid import SPACING

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from cutenv.task.episode import ShownDepth

_TISSUE, _FLOOR, _LAYER, _TARGET = "#f2d3c9", "#0072b2", "#d55e00", "#009e73"
_BELOW = 3.0  # of the layer that is shown [mm]


def floor_figure(shown: ShownDepth, tip: float, target_length: float, width: float) -> Figure:
    """Draw one cut from the side, its depth to a scale of its own.

    Parameters
    ----------
    shown : ShownDepth
        Depth of the cut at its end.
    tip, target_length : float
        Crack tip at the end, and target length [m].
    width : float
        Width [in].
    """
    figure = new_figure(width, 3.6)
    axes = figure.subplots()
    along = 1e3 * np.arange(len(shown.floor)) * SPACING
    surface, floor, wanted, layer = (
        1e3 * levels for levels in (shown.surface, shown.floor, shown.wanted, shown.layer)
    )  # fmt: skip
    lowest = float(min(layer.min(), floor.min())) - _BELOW
    axes.fill_between(along, layer, surface, color=_TISSUE, linewidth=0, label="tissue")
    axes.fill_between(along, lowest, layer, color=_LAYER, alpha=0.35, linewidth=0, label="layer below, not seen")
    axes.plot(along, surface, color="0.4", linewidth=1.0, label="surface")
    axes.plot(along, wanted, color="black", linestyle="--", linewidth=1.0, label="wanted floor")
    cut = along <= 1e3 * tip
    axes.plot(along[cut], floor[cut], color=_FLOOR, linewidth=2.0, label="floor of the cut")
    axes.axvline(1e3 * target_length, color=_TARGET, linewidth=1.2, label="target")
    axes.set(xlim=(0.0, 1e3 * target_length + 15.0), ylim=(lowest, float(surface.max()) + 1.0))
    axes.set(xlabel="distance from the clamp [mm]", ylabel="height [mm]")
    plain_axes(axes)
    figure.legend(loc="outside upper center", ncols=2 if width < PHONE_WIDTH else 6, fontsize=8, frameon=False)
    return figure


def mean_depth_error_mm(shown: ShownDepth, tip: float) -> float:
    """Return the mean error of the depth along a cut, up to its tip [m], in millimetres."""
    cut = np.arange(len(shown.floor)) * SPACING <= tip
    return float(1e3 * np.abs(shown.floor - shown.wanted)[cut].mean())
