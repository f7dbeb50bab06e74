"""Chapter 3, section 3.4: depth of cut from a film of the blade, and what it does to the moduli; of a rendered film."""

from __future__ import annotations

import math
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from cutenv.records.measurement import estimate_local_effective_moduli
from cutenv.sim.tissue import CutModel
from cutenv.sim.trace import Trace
from scripts.drawings.thesis.experiments import KIND
from scripts.drawings.thesis.style import (
    DISPLACEMENT_LABEL,
    DISTANCE_LABEL,
    FIRST,
    FORCE,
    LEM_LABEL,
    STRAIN,
    STRESS,
    named,
    panels,
    save,
)
from scripts.validation.thesis.drawn_livers import measure_as_the_thesis
from scripts.validation.thesis.virtual_cuts import PLACES, SPEEDS, cm_s, virtual_cut

if TYPE_CHECKING:
    from cutenv.vision.depth_record import FilmedDepth
    from cutenv.vision.marked_blade import BladeInSpace

TOTAL, STRIP, WIDTH = 0.0425, 0.004, 0.008  # of the blade, from the strip's centre to its end as in the thesis [m]
FIELD, TRAVEL, SHOWN = 0.17, 0.10, 0.06  # width of what a camera sees, travel, and place of the frame that is shown [m]


class FilmedLiver(NamedTuple):
    """Record with the depth from its film, the depth that was put in [m], and one frame of the film."""

    trace: Trace
    true_depth: NDArray[np.float64]
    filmed: FilmedDepth
    frame: NDArray[np.uint8]
    blade: BladeInSpace


@cache
def filmed_liver(rate: float) -> FilmedLiver:
    """Cut a drawn liver, film it with two cameras at some frames a second, and measure its depth from the film."""
    # OpenCV and PyAV are an extra, which the other figures do not need.
    from cutenv.vision.cameras import CalibrationBoard, calibrate_cameras
    from cutenv.vision.depth_record import filmed_depth
    from cutenv.vision.film_source import VideoFrame
    from cutenv.vision.marked_blade import BladeCameras, MarkedBlade
    from scripts.validation.vision.rendering.filmed_cut import film_cut

    cut = virtual_cut(KIND, speed=SPEEDS[1], turns=(TRAVEL, 0.0))
    (position,) = cut.trace.require("position", by="filmed_liver")
    film = film_cut(
        cut.trace.time, position, cut.specimen.depth, angle=math.pi / 2, seed=34, rate=rate, total=TOTAL, strip=STRIP,
        width=WIDTH, field=FIELD, spoilt=0.0,
    )  # fmt: skip
    boards = [(f"board {number}", image) for number, image in enumerate(film.boards(16)[0])]
    cameras = calibrate_cameras(boards, CalibrationBoard(columns=10, rows=7, spacing=0.053 * FIELD), stereo=True)
    blade = MarkedBlade(total=TOTAL, strip=STRIP, width=WIDTH)
    frames = [VideoFrame(n, float(t), image) for n, (t, image) in enumerate(zip(film.time, film.frames(), strict=True))]
    filmed = filmed_depth(list(BladeCameras(cameras, blade).measure_all(frames)), cut.trace, blade)
    before = [frame for frame in filmed.frames if frame.blade is not None and film.ends[frame.number, 1] <= SHOWN]
    shown = max(before, key=lambda frame: float(film.ends[frame.number, 1]))
    assert shown.blade is not None
    left = frames[shown.number].image[:, : film.cameras[0].width]
    return FilmedLiver(filmed.onto(cut.trace), cut.specimen.depth, filmed, left, shown.blade)


def _liver(quick: bool) -> FilmedLiver:
    return filmed_liver(2.0 if quick else 5.0)


def depth_in_an_image(path: Path, quick: bool) -> None:
    """Draw Figures 3.10 and 3.11: a frame of the left camera, and strip, surface and exposed blade in it."""
    liver = _liver(quick)
    title = "Figures 3.10 and 3.11 anew: rendered frame of the left camera, and depth of cut from it"
    figure, (whole, near) = panels(1, 2, (10.0, 4.2), title, width_ratios=(1.4, 1.0))
    for ax in (whole, near):
        ax.imshow(liver.frame, cmap="gray", vmin=0, vmax=255)
        ax.set_axis_off()
    view = liver.blade.view
    near.plot(*view.strip_ends.T, color="#e69f00", linewidth=4.0, label="marker strip")
    near.plot(*view.surface_line.T, color="#56b4e9", linewidth=2.0, label="edge of the top surface")
    near.plot(*np.stack([view.strip, view.surface]).T, color=STRAIN, linewidth=1.5, label="exposed length of the blade")
    (column, row), reach = 0.5 * (view.strip + view.surface), 70
    near.set_xlim(column - reach, column + reach)
    near.set_ylim(row + reach, row - reach)
    near.legend(loc="lower left", facecolor="white", frameon=True)
    exposed = 1e3 * liver.blade.exposed
    named(whole, "3.10: snapshot")
    named(near, f"3.11: depth = {1e3 * TOTAL:.1f} mm − {exposed:.1f} mm exposed = {1e3 * TOTAL - exposed:.1f} mm")
    save(figure, path)


def moduli_with_depth(path: Path, quick: bool) -> None:
    """Draw Figures 3.12 and 3.13: force and depth of cut; moduli with and without normalising by the depth."""
    liver = _liver(quick)
    title = f"Figures 3.12 and 3.13 anew: depth of cut from the film and moduli; one drawn liver, {cm_s(SPEEDS[1])}"
    figure, axes = panels(3, 1, (7.5, 8.0), title)
    forward = liver.trace.select(slice(int(np.argmax(np.asarray(liver.trace.position))) + 1))
    position, depth = forward.require("position", "depth", by="figure 3.12")
    axes[0].plot(100 * position, forward.force, color=FORCE, linewidth=0.6)
    axes[1].plot(100 * position, 100 * depth, color=STRESS, label="from the film")
    axes[1].plot(100 * PLACES, 100 * liver.true_depth, "--", color=FIRST, label="put in")
    axes[1].set_ylim(bottom=0)
    axes[1].legend(loc="lower right")
    named(axes[0], "3.12: force as measured", y="force [N]")
    named(axes[1], "3.12: depth of cut", DISPLACEMENT_LABEL, "depth [cm]")
    _draw_moduli(axes[2], forward)
    for ax in axes:
        ax.set_xlim(0, 100 * TRAVEL)
    save(figure, path)


def _draw_moduli(ax: Axes, trace: Trace) -> None:
    regular = measure_as_the_thesis(trace)
    normalised = estimate_local_effective_moduli(trace, CutModel(), friction_per_depth=0.0, loading_ratio=0.0)
    for found, marker, colour, name in (
        (regular, "o", STRESS, "LEM, force as measured"),
        (normalised, "s", STRAIN, "normalised LEM, force per depth of cut"),
    ):
        ax.plot(100 * found.position, found.modulus / 1e3, marker, color=colour, ms=4, label=name)
    ax.set_ylim(bottom=0)
    ax.legend(loc="lower right")
    named(
        ax,
        "3.13: LEM rises with the liver's bulge; per depth it falls, for the slab is not cut through",
        DISTANCE_LABEL,
        LEM_LABEL,
    )
