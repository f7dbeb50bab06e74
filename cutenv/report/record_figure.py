"""Figure of a whole record with what was found in it, for confirmation: tare, cuts, flaws."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from cutenv.measurement import QualityIssue
from cutenv.report.cut_figure import thinned
from cutenv.report.figure import new_figure, write_figure
from cutenv.trace import Trace

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_RAW, _FORCE, _QUIET, _CUT, _REFUSED, _DOUBTFUL = "0.65", "#0072b2", "#8a3ffc", "#009e73", "#d55e00", "#e69f00"
_WIDTH = 10.0  # [in]
_CROWDED = 8  # number of cuts beyond which there is room for their numbers only
_NARROWEST = 0.004  # share of the record at which even a flaw of two readings is drawn


@dataclass(frozen=True, kw_only=True, eq=False)
class RecordPicture:
    """Whole record with the cuts and the flaws that were found in it.

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
    """Write a picture of a whole record, in the format of the path's suffix (.png), with a title above it.

    Raises
    ------
    ImportError
        If matplotlib is not installed; the message gives the command that installs it.
    """
    write_figure(path, record_figure(picture), title)


def record_figure(picture: RecordPicture) -> Figure:
    """Draw the figure of :func:`draw_record`: force over time, and position below it if known."""
    record, quiet, cuts, flaws = picture.record, picture.quiet, picture.cuts, picture.flaws
    parts = list(cuts) or [slice(0, len(record))]
    with_position = record.position is not None
    figure = new_figure(_WIDTH, 5.6 if with_position else 4.0)
    rows = figure.subplots(2, 1, sharex=True, height_ratios=(2.4, 1.0)) if with_position else [figure.subplots()]
    force = rows[0]
    _draw_force(force, record, picture.tared)
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


def _draw_force(axes: Axes, record: Trace, tared: Trace | None) -> None:
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
        time = record.time[cut]
        axes.text(
            0.5 * (time[0] + time[-1]),
            0.985,
            str(number) if len(cuts) > _CROWDED else f"cut {number}\n{time[0]:.2f} to {time[-1]:.2f} s",
            transform=axes.get_xaxis_transform(),
            ha="center",
            va="top",
            fontsize=8,
            color="#00573f",
        )


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
    """Label kinds of flaws at the foot of the picture, one above the other where they would overlap."""
    for number, flaw in enumerate(found):
        first, last = (float(record.time[part][row]) for row in flaw.rows)
        axes.text(
            0.5 * (first + last),
            0.02 + 0.05 * (number % 3),
            flaw.kind,
            transform=axes.get_xaxis_transform(),
            ha="center",
            fontsize=8,
            color="#8c3d00",
        )


def _legend(axes: Axes) -> None:
    """Add a legend with one entry for each kind, above the picture."""
    handles, names = axes.get_legend_handles_labels()
    kinds = dict(zip(names, handles, strict=True))
    axes.legend(
        kinds.values(),
        kinds.keys(),
        loc="lower center",
        bbox_to_anchor=(0.5, 1.0),
        ncols=min(6, len(kinds)),
        fontsize=8,
        frameon=False,
    )
