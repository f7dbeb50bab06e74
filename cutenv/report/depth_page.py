"""Page of the depth of cut from video, and the table of its frames."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from cutenv.report.depth_figure import depth_figure, frames_figure
from cutenv.report.page import write_page, write_table
from cutenv.trace import Trace

if TYPE_CHECKING:
    from cutenv.vision.crack_runs import RunsAndDrops
    from cutenv.vision.depth_record import FilmedDepth

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
