"""Figure of desired and actual speed of the blade during cuts, over the force (the thesis's Figure 3.2)."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from cutenv._base.arrays import Array
from cutenv._base.atomic_file import atomic_write
from cutenv.report.figure import label, new_figure, plain_axes

_SETTLED = 0.3  # [s] after a change of the desired speed from which the actual one is compared with it
_DESIRED, _ACTUAL, _FORCE = "#d55e00", "#0072b2", "#555555"


class SpeedTrial(NamedTuple):
    """One cut: time [s], desired and actual speed [m/s], and force [N] at each reading, shape (n,) each."""

    time: Array
    desired: Array
    actual: Array
    force: Array

    def settled(self, speed: float) -> Array:
        """Return the actual speeds [m/s] from 0.3 s after ``speed`` was desired until another was."""
        wanted = np.isclose(self.desired, speed, rtol=1e-3, atol=0.0)
        begun = np.maximum.accumulate(np.where(wanted, 0.0, self.time))
        first = self.time[np.argmax(wanted)] if wanted.any() else np.inf
        return self.actual[wanted & (self.time - np.maximum(begun, first) >= _SETTLED)]

    def summary(self, speed: float) -> str:
        """Return in a line how well ``speed`` [m/s] was held."""
        settled = 100.0 * self.settled(speed)
        if not len(settled):
            return f"{100.0 * speed:.2f} cm/s: never held for {_SETTLED:g} s"
        off = settled - 100.0 * speed
        return (
            f"desired {100.0 * speed:.2f} cm/s, actual {settled.mean():.3f} cm/s on average over "
            f"{1e-3 * len(settled):.1f} s; standard deviation {settled.std():.3f}, greatest difference "
            f"{np.abs(off).max():.3f} cm/s; force up to {self.force.max():.1f} N"
        )


def draw_speeds(path: Path, trials: Sequence[SpeedTrial], *, title: str = "") -> None:
    """Write a figure: a column for each cut, speeds above, force below.

    Parameters
    ----------
    path : Path
        Path of the picture (.png).
    trials : sequence of SpeedTrial
        At least one.
    title : str
        Text above.

    Raises
    ------
    ValueError
        If there is no cut.
    ImportError
        If matplotlib is not installed; the message gives the command that installs it.
    """
    if not trials:
        raise ValueError("there is no cut to draw.")
    figure = new_figure(max(4.0 * len(trials), 7.0), 5.5)
    rows = figure.subplots(2, len(trials), sharex="col", height_ratios=(2.0, 1.0), squeeze=False)
    for above, below, trial in zip(*rows, trials, strict=True):
        above.plot(trial.time, 100.0 * trial.actual, color=_ACTUAL, linewidth=0.9, label="actual")
        above.plot(trial.time, 100.0 * trial.desired, color=_DESIRED, linewidth=1.4, linestyle="--", label="desired")
        below.plot(trial.time, trial.force, color=_FORCE, linewidth=0.9)
        below.set_xlabel("time since the cut began [s]")
        plain_axes(above)
        plain_axes(below)
    rows[0][0].set_ylabel("speed of the blade [cm/s]")
    rows[1][0].set_ylabel("force [N]")
    rows[0][0].legend(fontsize=9, frameon=False, loc="lower left")
    if title:
        figure.suptitle(label(title), fontsize=11)
    with atomic_write(path) as part:
        figure.savefig(part, dpi=130)
