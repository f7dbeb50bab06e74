"""One cut above its force trace, as a picture file."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from cutenv.cutting.records import Records
from cutenv.tissue.specimen import SPACING

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_TISSUE, _RUN, _FORCE, _TARGET, _ANGLE = "#f2d3c9", "#d55e00", "#0072b2", "#009e73", "#8a3ffc"
_TOLERANCE_MM = 3.0


def draw_cut(
    path: Path,
    readings: Records,
    depth: np.typing.NDArray[np.float64],
    *,
    target_length: float,
    force_limit_per_depth: float,
    title: str,
) -> None:
    """Write a picture of one cut above its force trace.

    Parameters
    ----------
    path : Path
        Of the picture; its suffix says which kind (.png).
    readings : Records
        The whole cut at 1 kHz, :data:`cutenv.cutting.records.READING`, shape (n,); hidden tip included.
    depth : array, shape (301,)
        Depth of cut along the line [m].
    target_length : float
        [m]
    force_limit_per_depth : float
        [N/m]
    title : str
        Above the picture.
    """
    from matplotlib.figure import Figure  # an extra, and slow to import

    figure = Figure(figsize=(9, 6.5), layout="constrained")
    side, trace, motion = figure.subplots(3, 1, sharex=True, height_ratios=(1.5, 2.2, 1.0))
    _draw_side(side, readings, depth)
    side.fill_between([], [], [], color=_TARGET, alpha=0.15, label="target \u00b1 3 mm")
    blade_mm = 1e3 * readings["position"]
    trace.plot(blade_mm, readings["force"], color=_FORCE, linewidth=0.8, label="measured force")
    along_mm = 1e3 * np.arange(len(depth)) * SPACING
    trace.plot(along_mm, force_limit_per_depth * depth, color="0.4", linestyle=":", label="force limit")
    trace.set_ylim(min(-0.5, 1.1 * float(readings["force"].min())), 1.25 * float(readings["force"].max()) + 0.2)
    trace.set_ylabel("force on the blade [N]")
    trace.legend(loc="upper left", frameon=False)
    motion.plot(blade_mm, 100.0 * readings["speed"], color="black", linewidth=0.8)
    motion.set_ylabel("speed [cm/s]")
    angle = motion.twinx()
    angle.plot(blade_mm, np.degrees(readings["angle"]), color=_ANGLE, linewidth=0.8)
    angle.set_ylabel("angle [deg]", color=_ANGLE)
    angle.set_ylim(40, 95)
    motion.set_xlabel("distance from the clamp [mm]: blade (force, speed, angle), crack tip (cut)")
    target_mm = 1e3 * target_length
    for axes in (side, trace, motion):
        axes.axvspan(target_mm - _TOLERANCE_MM, target_mm + _TOLERANCE_MM, color=_TARGET, alpha=0.15, linewidth=0)
        axes.axvline(target_mm, color=_TARGET, linewidth=1.2)
    side.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=6, fontsize=8, frameon=False)
    motion.set_xlim(-2.0, max(target_mm, float(blade_mm.max())) + 8.0)
    figure.suptitle(title, fontsize=11)
    figure.savefig(path, dpi=130)


def _draw_side(axes: Axes, readings: Records, depth: np.typing.NDArray[np.float64]) -> None:
    """The slab from the side: what is cut, what of it ran away, where the blade ended."""
    along_mm = 1e3 * np.arange(len(depth)) * SPACING
    depth_mm = 1e3 * depth
    tip_mm = 1e3 * float(readings["tip"][-1])
    axes.fill_between(along_mm, -depth_mm, 0.0, color=_TISSUE, linewidth=0, label="tissue")
    axes.fill_between(
        along_mm, -depth_mm, 0.0, where=list(along_mm <= tip_mm), color="#c9dff0", linewidth=0, label="cut"
    )
    runs = np.flatnonzero(readings["jump"] > 0.0)
    for number, k in enumerate(runs):
        end = 1e3 * float(readings["tip"][k])
        start = end - 1e3 * float(readings["jump"][k])
        axes.axvspan(
            start, end, ymin=0.0, ymax=0.08, color=_RUN, linewidth=0, label="ran uncontrolled" if number == 0 else None
        )
    blade_mm = 1e3 * float(readings["position"][-1])
    lean = depth_mm[min(round(blade_mm / 1e3 / SPACING), len(depth) - 1)] / np.tan(readings["angle"][-1])
    height = float(depth_mm.max())
    axes.plot([blade_mm, blade_mm - lean], [2.0, -height], color="black", linewidth=2, label="blade at the end")
    axes.axvline(tip_mm, color=_RUN, linestyle="--", linewidth=1, label="crack tip at the end")
    axes.set_ylabel("depth [mm]")
    axes.set_ylim(-1.25 * height, 4.0)
