"""Figures of one cut, and of a whole record."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cutenv._base.arrays import Array, StructArray
from cutenv.display.report.page import PHONE_WIDTH, new_figure, plain_axes, write_figure
from cutenv.records.measurement import QualityIssue
from cutenv.sim.tissue.specimen import SPACING
from cutenv.sim.trace import Trace

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    from cutenv.display.report.training_result import CutPicture
    from cutenv.task.episode import ShownDepth


_TISSUE, _RUN, _FORCE, _TARGET, _ANGLE = "#f2d3c9", "#d55e00", "#0072b2", "#009e73", "#8a3ffc"
_FLOOR, _LAYER = "#0072b2", "#d55e00"
_BELOW = 3.0  # of the layer below that is shown [mm]
_TOLERANCE_MM = 3.0
_POINTS = 3000  # points of a line: more than a figure has pixels; 30 s at 1 kHz would be megabytes of vector drawing
_WIDE = 9.0  # [in] width as a file


def draw_cut(path: Path, cut: CutPicture, title: str) -> None:
    """Write a picture of one cut above its force trace.

    Parameters
    ----------
    path : Path
        Path of the picture; its suffix gives the format (.png).

    Raises
    ------
    ImportError
        If matplotlib is not installed; the message gives the command that installs it.
    """
    write_figure(path, cut_figure(cut), title)


def draw_pictures(path: Path, pictures: Mapping[str, NDArray[np.uint8]]) -> None:
    """Write titled pictures below each other, in the suffix's format."""
    first = next(iter(pictures.values()))
    height = _WIDE * first.shape[0] / first.shape[1] + 0.3
    figure = new_figure(_WIDE, height * len(pictures))
    for axes, (title, picture) in zip(np.atleast_1d(figure.subplots(len(pictures), 1)), pictures.items(), strict=True):
        axes.imshow(picture, interpolation="lanczos")
        axes.set_title(title, fontsize=9, loc="left")
        axes.set_axis_off()
    write_figure(path, figure)


def cut_figure(cut: CutPicture, *, width: float = _WIDE, others: Sequence[CutPicture] = ()) -> Figure:
    """Draw one cut above its force trace, speed and angle.

    The axes cover ``others``, too, so that all have the same scales; a figure for a phone, by its width [in], has its
    legend in fewer columns.
    """
    readings, depth = cut.readings, cut.depth
    phone = width < PHONE_WIDTH
    figure = new_figure(width, 6.4 if phone else 6.5)
    side, trace, motion = figure.subplots(3, 1, sharex=True, height_ratios=(1.5, 2.2, 1.0))
    _draw_side(side, readings, depth)
    side.fill_between([], [], [], color=_TARGET, alpha=0.15, label="target \u00b1 3 mm")
    _draw_force(trace, readings, depth, cut.force_limit_per_depth)
    _draw_motion(motion, readings)
    whose = "" if phone else ": blade (force, speed, angle), crack tip (cut)"
    motion.set_xlabel(f"distance from the clamp [mm]{whose}")
    target_mm = 1e3 * cut.target_length
    for axes in (side, trace, motion):
        axes.axvspan(target_mm - _TOLERANCE_MM, target_mm + _TOLERANCE_MM, color=_TARGET, alpha=0.15, linewidth=0)
        axes.axvline(target_mm, color=_TARGET, linewidth=1.2)
    side.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2 if phone else 6, fontsize=8, frameon=False)
    _set_scales(trace, motion, [each.readings for each in (cut, *others)], target_mm)
    return figure


def floor_figure(shown: ShownDepth, tip: float, target_length: float, width: float) -> Figure:
    """Draw a cut from the side, with depth to its own scale.

    The depth is that at the end, tip and target are lengths [m], the width is in inches.
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
    """Return the mean depth error up to the tip [m], in millimetres."""
    cut = np.arange(len(shown.floor)) * SPACING <= tip
    return float(1e3 * np.abs(shown.floor - shown.wanted)[cut].mean())


def thinned(x: Array, y: Array, points: int = _POINTS) -> tuple[Array, Array]:
    """Return the lowest and highest of every few points, shapes (n,)."""
    stride = -(-2 * len(y) // points)  # rounded up
    if stride <= 2:
        return x, y
    whole = len(y) // stride * stride
    blocks = y[:whole].reshape(-1, stride)
    extremes = np.sort(np.stack((blocks.argmin(axis=1), blocks.argmax(axis=1)), axis=1), axis=1)
    kept = (extremes + stride * np.arange(len(blocks))[:, None]).ravel()
    kept = np.unique(np.concatenate((kept, [0], np.arange(whole, len(y)), [len(y) - 1])))
    return x[kept], y[kept]


def _set_scales(trace: Axes, motion: Axes, cuts: Sequence[StructArray], target_mm: float) -> None:
    low, high = _extremes(cuts, "force")
    trace.set_ylim(min(-0.5, 1.1 * low), 1.25 * high + 0.2)
    low, high = (100.0 * value for value in _extremes(cuts, "speed"))
    margin = max(0.05 * (high - low), 0.05)  # the speed may be constant, or zero
    motion.set_ylim(low - margin, high + margin)
    motion.set_xlim(-2.0, max(target_mm, 1e3 * _extremes(cuts, "position")[1]) + 8.0)


def _extremes(cuts: Sequence[StructArray], name: str) -> tuple[float, float]:
    return min(float(cut[name].min()) for cut in cuts), max(float(cut[name].max()) for cut in cuts)


def _draw_force(axes: Axes, readings: StructArray, depth: Array, force_limit_per_depth: float) -> None:
    """Draw the force over position, below the force that ends cuts."""
    axes.plot(
        *thinned(1e3 * readings["position"], readings["force"]), color=_FORCE, linewidth=0.8, label="measured force"
    )
    along_mm = 1e3 * np.arange(len(depth)) * SPACING
    axes.plot(along_mm, force_limit_per_depth * depth, color="0.4", linestyle=":", label="force limit")
    axes.set_ylabel("force on the blade [N]")
    axes.legend(loc="upper center", ncols=2, frameon=False, borderpad=0.1)  # the limit leaves by the top left


def _draw_motion(axes: Axes, readings: StructArray) -> None:
    blade_mm = 1e3 * readings["position"]
    axes.plot(*thinned(blade_mm, 100.0 * readings["speed"]), color="black", linewidth=0.8)
    axes.set_ylabel("speed [cm/s]")
    angle = axes.twinx()
    angle.plot(*thinned(blade_mm, np.degrees(readings["angle"])), color=_ANGLE, linewidth=0.8)
    angle.set_ylabel("angle [deg]", color=_ANGLE)
    angle.set_ylim(40, 95)


def _draw_side(axes: Axes, readings: StructArray, depth: Array) -> None:
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


_RAW, _QUIET, _CUT, _REFUSED, _DOUBTFUL = "0.65", "#8a3ffc", "#009e73", "#d55e00", "#e69f00"
_WIDTH = 10.0  # [in]
_CROWDED = 8  # number of cuts beyond which there is room for their numbers only
_NARROWEST = 0.004  # share of the record at which even a flaw of two readings is drawn


@dataclass(frozen=True, kw_only=True, eq=False)
class RecordPicture:
    """Whole record with the cuts and flaws found in it.

    Attributes
    ----------
    record : Trace
        Record, unchanged.
    tared : Trace, optional
        The same record without the sensor's offset.
    quiet : slice, optional
        Instants of the record from which the offset was computed.
    cuts : sequence of slice
        Instants of each cut, in order of time.
    flaws : sequence of sequences of QualityIssue
        Flaws of each cut, or of the whole record if there is no cut; their rows are counted from the start of the cut.

    Raises
    ------
    ValueError
        If there are not as many lists of flaws as cuts, or `tared` is another record.
    """

    record: Trace
    tared: Trace | None = None
    quiet: slice | None = None
    cuts: Sequence[slice] = ()
    flaws: Sequence[Sequence[QualityIssue]] = ()

    def __post_init__(self) -> None:
        parts, whole = len(self.cuts) or 1, len(self.record)
        if self.flaws and len(self.flaws) != parts:
            raise ValueError(f"flaws of {len(self.flaws)} cuts do not fit {parts}. Give the flaws of each, or none.")
        if self.tared is not None and len(self.tared) != whole:
            raise ValueError(
                f"the tared record has {len(self.tared)} instants and the record {whole}: not the same one."
            )


def draw_record(path: Path, picture: RecordPicture, title: str = "") -> None:
    """Write a titled picture of a whole record, in the suffix's format.

    Raises
    ------
    ImportError
        If matplotlib is not installed; the message gives the command that installs it.
    """
    write_figure(path, record_figure(picture), title)


def record_figure(picture: RecordPicture, width: float | None = None) -> Figure:
    """Draw the figure of :func:`draw_record`, force above position; width [in]."""
    record, quiet, cuts, flaws = picture.record, picture.quiet, picture.cuts, picture.flaws
    parts = list(cuts) or [slice(0, len(record))]
    with_position = record.position is not None
    figure = new_figure(width or _WIDTH, 5.6 if with_position else 4.0)
    rows = figure.subplots(2, 1, sharex=True, height_ratios=(2.4, 1.0)) if with_position else [figure.subplots()]
    force = rows[0]
    _draw_whole_force(force, record, picture.tared)
    if quiet is not None:
        time, zero = record.time[quiet], float(record.force[quiet].mean())
        force.plot([time[0], time[-1]], [zero, zero], color=_QUIET, linewidth=4.0, alpha=0.7, label="taken for zero")
    for axes in rows:
        _mark_cuts(axes, record, cuts)
        for part, found in zip(parts, flaws, strict=bool(flaws)):
            _mark_flaws(axes, record, part, found)
    _number_cuts(force, record, cuts)
    for part, found in zip(parts, flaws, strict=bool(flaws)):
        _name_flaws(force, record, part, found)
    if record.position is not None:
        rows[1].plot(*thinned(record.time, 1e3 * record.position), color="black", linewidth=0.9)
        rows[1].set_ylabel("position [mm]")
    rows[-1].set_xlabel("time [s]")
    margin = 0.01 * record.duration
    rows[-1].set_xlim(record.time[0] - margin, record.time[-1] + margin)
    _legend(force)
    return figure


def _draw_whole_force(axes: Axes, record: Trace, tared: Trace | None) -> None:
    unit = "[N]" if record.force_unit == "N" else "(normalised)"
    axes.axhline(0.0, color="black", linewidth=0.6)
    if tared is None or np.array_equal(tared.force, record.force):
        axes.plot(*thinned(record.time, record.force), color=_FORCE, linewidth=0.8, label="force, nothing taken off")
    else:
        axes.plot(*thinned(record.time, record.force), color=_RAW, linewidth=0.8, label="as recorded")
        taken = float(np.median(record.force - tared.force))
        said = f"less the tare of {taken:.3g} {unit.strip('[]')}"
        axes.plot(*thinned(tared.time, tared.force), color=_FORCE, linewidth=0.8, label=said)
    axes.set_ylabel(f"force {unit}")
    low, high = axes.get_ylim()
    axes.set_ylim(low, high + 0.12 * (high - low))  # room for the numbers of the cuts


def _mark_cuts(axes: Axes, record: Trace, cuts: Sequence[slice]) -> None:
    for number, cut in enumerate(cuts):
        time = record.time[cut]
        axes.axvspan(
            time[0], time[-1], color=_CUT, alpha=0.13, linewidth=0, label="cut" if number == 0 else None, zorder=0
        )
        for border in (time[0], time[-1]):
            axes.axvline(border, color=_CUT, linewidth=1.0)


def _number_cuts(axes: Axes, record: Trace, cuts: Sequence[slice]) -> None:
    for number, cut in enumerate(cuts, 1):
        first, last = record.time[cut][[0, -1]].tolist()
        words = str(number) if len(cuts) > _CROWDED else f"cut {number}\n{first:.2f} to {last:.2f} s"
        _write(axes, (0.5 * (first + last), 0.985), words, "#00573f", va="top")


def _write(axes: Axes, at: tuple[float, float], words: str, colour: str, va: str = "baseline") -> None:
    """Write words at a time [s] and a share of the picture's height."""
    across = axes.get_xaxis_transform()
    axes.text(*at, words, transform=across, ha="center", va=va, fontsize=8, color=colour)


def _mark_flaws(axes: Axes, record: Trace, part: slice, found: Sequence[QualityIssue]) -> None:
    narrowest = _NARROWEST * record.duration
    for flaw in found:
        first, last = (float(record.time[part][row]) for row in flaw.rows)
        lacking = max(0.0, narrowest - (last - first))
        axes.axvspan(
            first - 0.5 * lacking,
            last + 0.5 * lacking,
            color=_REFUSED if flaw.refuse else _DOUBTFUL,
            alpha=0.35,
            linewidth=0,
            label="flaw that refuses the cut" if flaw.refuse else "flaw worth a look",
            zorder=1,
        )


def _name_flaws(axes: Axes, record: Trace, part: slice, found: Sequence[QualityIssue]) -> None:
    """Label flaws below the picture, stacked where they would overlap."""
    for number, flaw in enumerate(found):
        first, last = (float(record.time[part][row]) for row in flaw.rows)
        _write(axes, (0.5 * (first + last), 0.02 + 0.05 * (number % 3)), flaw.kind, "#8c3d00")


def _legend(axes: Axes) -> None:
    """Add a legend with one entry a kind, above the picture."""
    handles, names = axes.get_legend_handles_labels()
    kinds = dict(zip(names, handles, strict=True))
    place: dict[str, Any] = {"loc": "lower center", "bbox_to_anchor": (0.5, 1.0), "ncols": min(6, len(kinds))}
    axes.legend(kinds.values(), kinds.keys(), **place, fontsize=8, frameon=False)
