"""Figure of the desired and actual speed of a cut, as the thesis's Figure 3.2, with the force and their difference."""

from __future__ import annotations

from pathlib import Path

from cutenv.measurement.constant_speed import SpeedTracking
from cutenv.report.figure import new_figure, plain_axes, write_figure

_DESIRED, _ACTUAL, _FORCE = "#000000", "#0072b2", "#d55e00"
_SIZE = (9.0, 7.5)  # [in]


def draw_speed(path: Path, found: SpeedTracking, *, title: str = "") -> None:
    """Write a figure: desired and actual speed, their difference in the steady part, and the force, over time.

    Parameters
    ----------
    path : Path
        Path of the picture; its suffix gives the format (.png).
    found : SpeedTracking
        Result of :func:`cutenv.measurement.speed_tracking`.
    title : str
        Text above the picture.

    Raises
    ------
    ImportError
        If matplotlib is not installed; the message gives the command that installs it.
    """
    figure = new_figure(*_SIZE)
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
