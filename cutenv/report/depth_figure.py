"""Figures of the depth of cut from video: frames with what was found in them, and the depth above the force."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cutenv.report.figure import PHONE_WIDTH, new_figure, plain_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from cutenv.trace import Trace
    from cutenv.vision.blade_depth import DepthFrame
    from cutenv.vision.crack_runs import RunsAndDrops
    from cutenv.vision.depth_record import FilmedDepth

_STRIP, _SURFACE, _BLADE, _ALONG, _OUT = "#e69f00", "#56b4e9", "#d55e00", "#8a3ffc", "#b00020"
_POINTS = 3000  # points of a line: more than a figure has pixels
_AROUND = 140  # of the blade that is shown to either side [px]


def frames_figure(filmed: FilmedDepth, pictures: Mapping[int, NDArray[np.uint8]], width: float) -> Figure:
    """Draw some frames with strip, surface and exposed blade, or the reason for which one is left out.

    Parameters
    ----------
    filmed : FilmedDepth
        Depth of the film.
    pictures : mapping
        Frames to show, by their number: grey values, shape (height, width); of a pair, the left one is shown.
    width : float
        Width [in].
    """
    shown = [frame for frame in filmed.frames if frame.number in pictures]
    columns = 2 if width < PHONE_WIDTH else max(len(shown), 1)
    rows = -(-len(shown) // columns)
    figure = new_figure(width, rows * (width / columns + 0.5))
    panels = np.atleast_1d(figure.subplots(rows, columns, squeeze=False)).ravel()
    for axes in panels:
        axes.set_axis_off()
    for axes, frame in zip(panels, shown, strict=False):
        _draw_frame(axes, frame, pictures[frame.number])
    return figure


def _draw_frame(axes: Axes, frame: DepthFrame, picture: NDArray[np.uint8]) -> None:
    axes.imshow(picture, cmap="gray", vmin=0, vmax=255, interpolation="nearest")
    if frame.blade is None:
        axes.set_title(f"{frame.time:.2f} s, left out:\n{frame.reason}", fontsize=7, color=_OUT)
        return
    view = frame.blade.view
    axes.plot(*np.stack([view.strip, view.surface]).T, color=_BLADE, linewidth=1.0)
    axes.plot(*view.strip_ends.T, color=_STRIP, linewidth=3.0)
    axes.plot(*view.surface_line.T, color=_SURFACE, linewidth=1.6)
    middle = 0.5 * (view.strip + view.surface)
    axes.set_xlim(middle[0] - _AROUND, middle[0] + _AROUND)
    axes.set_ylim(middle[1] + _AROUND, middle[1] - _AROUND)
    axes.set_title(f"{frame.time:.2f} s: {1e3 * frame.blade.exposed:.2f} mm\nexposed", fontsize=7)


def depth_figure(trace: Trace, filmed: FilmedDepth, found: RunsAndDrops, width: float) -> Figure:
    """Draw depth and length along the blade over time with the frames left out, above the force with the runs seen."""
    figure = new_figure(width, 5.0)
    depth, force = figure.subplots(2, 1, sharex=True, height_ratios=(1.6, 1.0))
    band: dict[str, Any] = {"color": _SURFACE, "alpha": 0.35, "linewidth": 0.0}
    vertical, sd = 1e3 * filmed.vertical, 2e3 * filmed.vertical_sd
    depth.fill_between(filmed.time, vertical - sd, vertical + sd, label="two standard errors", **band)
    depth.plot(filmed.time, 1e3 * filmed.along, ".", markersize=2.0, color=_ALONG, label="along the blade")
    step = max(1, len(trace) // _POINTS)
    (recorded,) = trace.require("depth", by="the figure")
    depth.plot(trace.time[::step], 1e3 * recorded[::step], color="#0072b2", linewidth=1.0, label="vertical")
    out = [frame.time + filmed.alignment.lag for frame in filmed.frames if frame.blade is None]
    depth.plot(out, np.zeros(len(out)), "|", markersize=8.0, color=_OUT, label="frames left out")
    depth.set_ylabel("depth of cut [mm]")
    force.plot(trace.time[::step], trace.force[::step], color="0.4", linewidth=0.9)
    marks = (([run.time for run in found.runs], "v", "run seen"), (found.drops, "|", "force drops"))
    for (times, marker, label), height, colour in zip(marks, (1.16, 1.08), (_STRIP, "0.4"), strict=True):
        at = np.full(len(times), height * float(trace.force.max()))
        force.plot(times, at, marker, markersize=5.0, color=colour, label=label)
    force.set_ylabel("force [N]" if trace.force_unit == "N" else "force")
    force.set_xlabel("time [s]")
    for axes in (depth, force):
        plain_axes(axes)
    figure.legend(loc="outside upper left", ncols=2 if width < PHONE_WIDTH else 4, frameon=False, fontsize=9)
    return figure
