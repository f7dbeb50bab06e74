"""Colours, axes and files that the figures share."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

STRESS, STRAIN, SOLID = "#0072b2", "#d55e00", "#009e73"  # plane stress, plane strain, 3-D
FIRST, SECOND = "#c81e1e", "#1e46c8"  # red and blue cycles of Figures 6.5 to 6.7
UPRIGHT, INCLINED = "#0072b2", "#d55e00"  # 90 and 45 degrees
FORCE, PALE = "0.15", "0.8"

LEM_LABEL = "LEM [10$^3$ N/m$^2$]"
DISTANCE_LABEL = "distance from the constrained edge [cm]"
DISPLACEMENT_LABEL = "displacement of the blade [cm]"

STYLE = {  # Matplotlib settings for every figure
    "font.family": "DejaVu Sans",
    "font.size": 9,
    "axes.titlesize": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.axisbelow": True,
    "legend.frameon": False,
    "legend.fontsize": 8,
    "lines.linewidth": 1.0,
    "errorbar.capsize": 2.5,
}


def panels(
    rows: int, columns: int, size: tuple[float, float], title: str, **shared: object
) -> tuple[Figure, list[Axes]]:
    """Return a figure of ``size`` [inch] with its axes row by row."""
    figure = Figure(figsize=size, layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False, **shared)  # type: ignore[call-overload]
    figure.suptitle(title, fontsize=10, fontweight="bold")
    return figure, list(np.ravel(axes))


def named(axes: Axes, title: str, x: str = "", y: str = "") -> None:
    """Set the title at the left, and the labels."""
    axes.set_title(title, loc="left")
    axes.set_xlabel(x)
    axes.set_ylabel(y)


def save(figure: Figure, path: Path) -> None:
    """Write the picture."""
    figure.savefig(path, dpi=140)
