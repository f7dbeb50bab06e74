"""Page of the depth of cut from video: the depth above the force, frames with what was found in them, their table."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cutenv.report.page import PHONE_WIDTH, new_figure, plain_axes, write_page, write_table
from cutenv.trace import Trace

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from cutenv.vision.crack_runs import RunsAndDrops
    from cutenv.vision.depth_record import FilmedDepth
    from cutenv.vision.marked_blade import DepthFrame


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


FRAME_COLUMNS = (
    "frame", "film_s", "time_s", "exposed_mm", "exposed_sd_mm", "along_mm", "along_sd_mm", "vertical_mm",
    "vertical_sd_mm", "left_out",
)  # fmt: skip
"""Columns of the table of frames; a frame that is left out has its reason and no lengths."""


@dataclass(frozen=True, kw_only=True, eq=False)
class FilmedRecord:
    """Record with the depth from a film, the runs seen in it, and some of its frames by number, (height, width)."""

    name: str
    trace: Trace
    filmed: FilmedDepth
    found: RunsAndDrops
    pictures: Mapping[int, NDArray[np.uint8]]


def write_depth_page(path: Path, record: FilmedRecord) -> None:
    """Write the page of a filmed cut into a folder that exists.

    Raises
    ------
    ImportError
        If matplotlib is not installed; the message gives the command that installs it.
    """
    filmed = record.filmed
    share = len(filmed.time) / len(filmed.frames)
    write_page(
        path,
        "depth.html",
        kind="good" if share >= 0.9 else "open",
        frames_figure=frames_figure,
        depth_figure=depth_figure,
        degrees=math.degrees(filmed.alignment.angle),
        low=1e3 * max(float(filmed.vertical.min()), 0.0),
        high=1e3 * float(filmed.vertical.max()),
        share=100.0 * share,
        **vars(record),
    )


def write_frame_table(path: Path, filmed: FilmedDepth) -> None:
    """Write :data:`FRAME_COLUMNS` of every frame as CSV."""
    used = iter(zip(filmed.along, filmed.along_sd, filmed.vertical, filmed.vertical_sd, strict=True))
    rows: list[Sequence[object]] = [FRAME_COLUMNS]
    for frame in filmed.frames:
        clock = [f"{frame.time:.5f}", f"{frame.time + filmed.alignment.lag:.5f}"]
        lengths = [""] * 6
        if frame.blade is not None:
            values = (frame.blade.exposed, frame.blade.exposed_sd, *next(used))
            lengths = [f"{1e3 * value:.4f}" for value in values]
        rows.append([frame.number, *clock, *lengths, frame.reason])
    write_table(path, rows)
