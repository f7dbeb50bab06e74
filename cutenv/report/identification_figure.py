"""Figure of an axis's responses to steps and sines, over the fitted model."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from cutenv.report.figure import new_figure, write_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes

StepResponse = tuple[str, NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]
"""Response of an axis: name, time [s], measured and modelled position [m], each of shape (n,)."""

_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#8a3ffc", "#e69f00")
_SIZE = (11.0, 8.5)  # [in]
_HEIGHT = 0.85  # height of a response over the distance to the next
_LEAST = 1e-6  # [m]


def draw_identification(
    path: Path, steps: Sequence[StepResponse], sines: Sequence[StepResponse], *, title: str = ""
) -> None:
    """Write a figure: above, measured responses as dots over the model's lines; below, the model's errors.

    Parameters
    ----------
    path : Path
        Path of the picture; its suffix gives the format (.png).
    steps, sines : sequence of Answer
        Responses; times count from the first command.
    title : str
        Text above the picture.

    Raises
    ------
    ImportError
        If matplotlib is not installed; the message gives the command that installs it.
    """
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
        span = max(float(np.ptp(measured)), _LEAST)  # each over its own range, one above the other
        least = float(measured.min())
        above.plot(time, number + _HEIGHT * (measured - least) / span, ".", markersize=2.5, color=colour)
        above.plot(time, number + _HEIGHT * (model - least) / span, color="black", linewidth=0.7)
        below.plot(time, 1e6 * (measured - model), ".", markersize=2.0, color=colour)
    named = [f"{name}\n{1e3 * float(np.ptp(measured)):.3g} mm" for name, _, measured, _ in answers]
    above.set_yticks([number + 0.5 * _HEIGHT for number in range(len(answers))], named, fontsize=8)
    below.axhline(0.0, color="black", linewidth=0.6)
