"""Chapter 5: LEM against speed, the measured means and the fits that the simulator uses."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
from matplotlib.axes import Axes

from cutenv.tissue import local_effective_modulus
from cutenv.tissue.modulus import linear_fit, power_fit
from cutenv.tissue.tables import table
from thesis_figures.style import INCLINED, LEM_LABEL, UPRIGHT, named, panels, save


class Panel(NamedTuple):
    """One figure of the thesis."""

    figure: str
    number: str  # of the table
    formulation: Literal["plane_stress", "plane_strain"]
    poisson: float
    depth_normalised: bool


PANELS = [
    Panel("5.5", "5.5", "plane_stress", 0.3, False),
    Panel("5.6", "5.5", "plane_strain", 0.3, False),
    Panel("5.7", "5.6", "plane_stress", 0.3, True),
    Panel("5.8", "5.6", "plane_strain", 0.3, True),
    Panel("5.9", "5.7", "plane_stress", 0.499, True),
]

LEGEND = """Points: Tables 5.5 to 5.7 of the thesis.
Lines: fits computed from these tables,
and used by the simulator; v in cm/s.

Equations 5.6 and 5.7 carry here the labels
that the data give them: the thesis prints
them under each other's.

Plane stress per depth (5.7) gives the quasi-
static modulus E0 = 48.4 kPa, its intercept
at 90°."""


def moduli_by_speed(path: Path, quick: bool) -> None:
    """Figures 5.5 to 5.9."""
    title = "Figures 5.5 to 5.9 anew: LEM against cutting speed, measured mean ± SD and fit"
    figure, axes = panels(2, 3, (12.5, 7.2), title)
    for ax, panel in zip(axes, PANELS, strict=False):
        _draw(ax, panel)
    axes[-1].axis("off")
    axes[-1].text(0.05, 0.5, LEGEND, transform=axes[-1].transAxes, va="center", linespacing=1.4)
    save(figure, path)


def _draw(ax: Axes, panel: Panel) -> None:
    data = table(panel.number)
    speed = data["speed_cm_s"]
    line = np.linspace(speed.min(), speed.max(), 200)
    for angle_deg, colour, marker, shift in ((90, UPRIGHT, "o", -0.015), (45, INCLINED, "s", 0.015)):
        mean, sd = (data[f"{x}_{panel.formulation}_{angle_deg}_deg_Pa"] / 1e3 for x in ("lem", "sd"))
        ax.errorbar(
            speed + shift,
            mean,
            sd,
            fmt=marker,
            color=colour,
            ms=4,
            elinewidth=0.8,
            label=f"{angle_deg}°: {_equation(panel, angle_deg)}",
        )
        fitted = local_effective_modulus(
            line / 100,
            math.radians(angle_deg),
            panel.formulation,
            poisson=panel.poisson,
            depth_normalised=panel.depth_normalised,
        )
        ax.plot(line, np.asarray(fitted) / 1e3, color=colour)
    ax.set_xlim(0, 2.7)
    ax.set_ylim(0, 110 if panel.number == "5.7" else 85)
    what = f"{panel.formulation.replace('_', ' ')}, ν = {panel.poisson:g}"
    ax.legend(loc="upper right")
    how = "force per depth" if panel.depth_normalised else "force as measured"
    named(ax, f"{panel.figure}: {what}, {how}", "cutting speed [cm/s]", LEM_LABEL)


def _equation(panel: Panel, angle_deg: int) -> str:
    if panel.number == "5.5" and angle_deg == 45:
        power = power_fit(formulation=panel.formulation)
        return f"{power.modulus_at_reference / 1e3:.2f} v$^{{{power.exponent:.2f}}}$"
    fit = linear_fit(panel.number, angle_deg=angle_deg, formulation=panel.formulation)
    return f"{fit.slope / 1e5:.2f} v + {fit.intercept / 1e3:.2f}".replace("-", "−")
