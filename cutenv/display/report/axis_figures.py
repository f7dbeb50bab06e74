"""Figures of a rig's axis: answers over the model, and speed."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from cutenv.display.report.page import new_figure, plain_axes, write_figure
from cutenv.records.measurement.constant_speed import SpeedTracking

if TYPE_CHECKING:
    from matplotlib.axes import Axes

StepResponse = tuple[str, NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]
"""Response of an axis: name, time [s], measured and modelled position [m], each of shape (n,)."""

_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#8a3ffc", "#e69f00")
_SIZE = (11.0, 8.5)  # [in]
_SPEED_SIZE = (9.0, 7.5)  # [in]
_DESIRED, _ACTUAL, _FORCE = "#000000", "#0072b2", "#d55e00"
_HEIGHT = 0.85  # height of a response over the distance to the next
_MIN_WIDTH = 1e-6  # [m]


def draw_identification(
    path: Path, steps: Sequence[StepResponse], sines: Sequence[StepResponse], *, title: str = ""
) -> None:
    """Write a figure of measured and modelled responses, above the errors."""
    figure = new_figure(*_SIZE)
    rows = figure.subplots(2, 2, sharex="col", height_ratios=(2.2, 1.0))
    for column, (answers, name) in enumerate(((steps, "steps of speed"), (sines, "sines of speed"))):
        _draw(rows[0][column], rows[1][column], answers)
        rows[0][column].set_title(name, fontsize=10)
        rows[1][column].set_xlabel("time since the first command [s]")
    rows[0][0].set_ylabel("position, each over its own range")
    rows[1][0].set_ylabel("measured - model [um]")
    rows[0][0].plot([], [], ".", color=_COLOURS[0], label="measured")
    rows[0][0].plot([], [], color="black", linewidth=0.7, label="model")
    rows[0][0].legend(fontsize=8, frameon=False, loc="upper left")
    write_figure(path, figure, title)


def _draw(above: Axes, below: Axes, answers: Sequence[StepResponse]) -> None:
    for number, (_, time, measured, model) in enumerate(answers):
        colour = _COLOURS[number % len(_COLOURS)]
        span = max(float(np.ptp(measured)), _MIN_WIDTH)  # each over its own range, one above the other
        least = float(measured.min())
        above.plot(time, number + _HEIGHT * (measured - least) / span, ".", markersize=2.5, color=colour)
        above.plot(time, number + _HEIGHT * (model - least) / span, color="black", linewidth=0.7)
        below.plot(time, 1e6 * (measured - model), ".", markersize=2.0, color=colour)
    named = [f"{name}\n{1e3 * float(np.ptp(measured)):.3g} mm" for name, _, measured, _ in answers]
    above.set_yticks([number + 0.5 * _HEIGHT for number in range(len(answers))], named, fontsize=8)
    below.axhline(0.0, color="black", linewidth=0.6)


def draw_speed(path: Path, found: SpeedTracking, *, title: str = "") -> None:
    """Write a figure of desired and actual speed, difference and force."""
    figure = new_figure(*_SPEED_SIZE)
    speeds, off, force = figure.subplots(3, 1, sharex=True, height_ratios=(2.2, 1.0, 1.0))
    time = found.time - found.time[0]
    speeds.plot(time, 100 * found.actual, color=_ACTUAL, linewidth=1.2, label="actual")
    speeds.plot(time, 100 * found.desired, color=_DESIRED, linewidth=1.0, linestyle="--", label="desired")
    speeds.set_ylabel("speed [cm/s]")
    speeds.legend(frameon=False, fontsize=9, loc="lower center", ncols=2)
    steady = found.steady
    off.plot(time[steady], 1e4 * (found.actual - found.desired)[steady], color=_ACTUAL, linewidth=0.9)
    off.axhline(0.0, color=_DESIRED, linewidth=0.8, linestyle="--")
    off.set_ylabel("actual - desired\n[0.1 mm/s]")
    force.plot(time, found.force, color=_FORCE, linewidth=0.8)
    force.set_ylabel("force [N]")
    force.set_xlabel("time [s]")
    for axes in (speeds, off, force):
        plain_axes(axes)
    write_figure(path, figure, title)
