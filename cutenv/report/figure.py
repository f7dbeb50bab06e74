"""Shared parts of the figures of pages: drawn for a desktop screen and for a phone, loading matplotlib when drawn."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Literal

from cutenv._base.atomic_file import atomic_write

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PHONE_WIDTH = 6.0
"""Width below which a figure is drawn for a phone [in]."""


def new_figure(width: float, height: float) -> Figure:
    """Return an empty figure of a size [in]; pages have figures of two widths, for a desktop screen and a phone.

    Raises
    ------
    ImportError
        If matplotlib is not installed; the message gives the command that installs it.
    """
    try:
        from matplotlib.figure import Figure  # an extra, and slow to import
    except ImportError as error:
        cure = "Pictures need matplotlib. Install it with: pip install 'cutenv[view]'"
        raise ModuleNotFoundError(cure, name="matplotlib") from error
    return Figure(figsize=(width, height), layout="constrained")


def write_figure(path: Path, figure: Figure, title: str = "") -> None:
    """Write a figure as a whole or not at all, with a title above it; the suffix gives the format (.png)."""
    if title:
        figure.suptitle(label(title), fontsize=11)
    with atomic_write(path) as part:
        figure.savefig(part, dpi=130)


def label(text: str) -> str:
    """Return text that matplotlib shows unchanged: a dollar sign starts no formula."""
    return text.replace("$", r"\$")


def plain_axes(axes: Axes, grid: Literal["x", "y"] = "y") -> None:
    """Remove the box around the drawing, and add faint grid lines across the axis that is read."""
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(axis=grid, color="0.5", alpha=0.25, linewidth=0.8)  # seen on white and on dark ground
    axes.set_axisbelow(True)
