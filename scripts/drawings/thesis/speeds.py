"""Chapter 5: LEM by cut and against speed; the measured means, sampled livers, and the fits that the simulator uses."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from matplotlib.axes import Axes

from cutenv.records.measurement import loading_segments
from cutenv.sim.tissue import local_effective_modulus
from cutenv.sim.tissue.description import CUTS_PER_LIVER
from cutenv.sim.tissue.effective_modulus import linear_fit, power_fit
from scripts.derivations.specimens import SIGNIFICANT_DROP
from scripts.drawings.thesis.experiments import KIND, TRAVEL, mark_segments, name_segments
from scripts.drawings.thesis.style import DISPLACEMENT_LABEL, FORCE, INCLINED, LEM_LABEL, UPRIGHT, named, panels, save
from scripts.validation.thesis import drawn_livers
from scripts.validation.thesis.drawn_tables import BY_CUT, cut_means, means_by_cut
from scripts.validation.thesis.moduli import means_by_speed
from scripts.validation.thesis.virtual_cuts import cm_s, virtual_cut


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

LEGEND = """Filled: Tables 5.5 to 5.7 of the thesis.
Lines: fits computed from these tables,
and used by the simulator; v in cm/s.

Open, pale: livers drawn by the simulator,
cut by the thesis's protocol and measured
as the thesis measured, {cuts} cuts each.
Table 5.7 is of no model that Table 4.4
knows; and 5.5 and 5.6, of the same cuts,
fall with speed differently at 45°.

Equations 5.6 and 5.7 carry here the labels
that the data give them: the thesis prints
them under each other's.

Plane stress per depth (5.7) gives the quasi-
static modulus E0 = 48.4 kPa, its intercept
at 90°."""


def moduli_by_cut(path: Path, quick: bool) -> None:
    """Draw Figures 5.2 to 5.4: force against the length of cut with its segments, and the means of the cuts."""
    title = "Figures 5.2 to 5.4 anew: loading segments at 45° and 90° in one drawn liver, and the means of all cuts"
    figure, axes = panels(4, 2, (12.0, 11.0), title)
    for angle_deg, column in ((45, 0), (90, 1)):
        rows = [(number, v) for number, angle, v in BY_CUT if angle == angle_deg]
        for ax, (_, speed) in zip(axes[column::2], rows, strict=False):
            _draw_segments(ax, angle_deg, speed / 100)
        _draw_means(axes[6 + column], angle_deg, rows, quick)
    name_segments(axes[0])
    axes[0].legend(loc="upper left")
    highest = max(ax.get_ylim()[1] for ax in axes[:6])
    for ax in axes[:6]:
        ax.set_ylim(-0.2, highest)
        ax.set_xlim(0, 100 * TRAVEL + 0.2)
    for ax in axes[4:6]:
        ax.set_xlabel(DISPLACEMENT_LABEL)
    for ax in axes[0:6:2]:
        ax.set_ylabel("force [N]")
    save(figure, path)


def _draw_segments(ax: Axes, angle_deg: float, speed: float) -> None:
    trace = virtual_cut(KIND, speed=speed, angle_deg=angle_deg, turns=(TRAVEL,)).trace
    segments = loading_segments(trace, smallest_drop=SIGNIFICANT_DROP)
    ax.plot(100 * np.asarray(trace.position), trace.force, color="0.6", linewidth=0.6)
    mark_segments(ax, trace, segments)
    named(ax, f"{angle_deg:g}°, {cm_s(speed)}: {len(segments)} segments, {sum(s.is_steady for s in segments)} used")


def _draw_means(ax: Axes, angle_deg: float, rows: list[tuple[str, float]], quick: bool) -> None:
    """Draw measured means of the cuts with the standard deviation within each, and virtual ones beside them."""
    colour = INCLINED if angle_deg == 45 else UPRIGHT
    for at, (number, speed) in enumerate(rows):
        mean, sd = means_by_cut(number, speed, "plane_stress")
        spots = at + np.linspace(-0.35, -0.05, len(mean))
        ax.errorbar(spots, mean, sd, fmt="o", color=colour, ms=4, elinewidth=0.8, label="measured" if not at else None)
        drawn = [cut.as_measured["plane_stress", 0.3] / 1e3 for cut in drawn_livers.cuts(speed, angle_deg, quick)]
        spots = at + np.linspace(0.05, 0.35, len(drawn))
        means, within = [m.mean() for m in drawn], [m.std() for m in drawn]
        label = "drawn livers" if not at else None
        ax.errorbar(spots, means, within, fmt="s", mfc="white", color="0.45", ms=3, elinewidth=0.5, label=label)
        for side, values in ((-0.2, mean), (0.2, means)):
            ax.plot([at + side - 0.17, at + side + 0.17], [np.mean(values)] * 2, color=FORCE, linewidth=1.6, zorder=4)
    ax.set_xticks(range(len(rows)), [f"{v:g}" for _, v in rows])
    ax.set_ylim(0, 160)
    ax.legend(loc="upper right", ncols=2)
    figure = "5.3" if angle_deg == 45 else "5.4"
    named(ax, f"{figure}: each cut's mean ± SD within it; bar, mean of cuts", "cutting speed [cm/s]", LEM_LABEL)


def moduli_by_speed(path: Path, quick: bool) -> None:
    """Draw Figures 5.5 to 5.9."""
    title = "Figures 5.5 to 5.9 anew: LEM against cutting speed, mean ± SD; measured and fitted, and of drawn livers"
    figure, axes = panels(2, 3, (12.5, 7.2), title)
    for ax, panel in zip(axes, PANELS, strict=False):
        _draw(ax, panel, quick)
    axes[-1].axis("off")
    axes[-1].text(
        0.05,
        0.5,
        LEGEND.format(cuts=CUTS_PER_LIVER * drawn_livers.livers(quick)),
        transform=axes[-1].transAxes,
        va="center",
        linespacing=1.4,
    )
    save(figure, path)


def _draw(ax: Axes, panel: Panel, quick: bool) -> None:
    slowest, *_, fastest = drawn_livers.SPEEDS_CM_S
    line = np.linspace(slowest, fastest, 200)
    for angle_deg, colour, marker, shift in ((90, UPRIGHT, "o", -0.015), (45, INCLINED, "s", 0.015)):
        look: dict[str, Any] = {"fmt": marker, "color": colour, "ms": 4, "elinewidth": 0.8}
        speed, mean, sd = means_by_speed(panel.number, angle_deg, panel.formulation)
        ax.errorbar(speed + shift, mean, sd, label=f"{angle_deg}°: {_equation(panel, angle_deg)}", **look)
        speed = np.array(drawn_livers.speeds(quick))
        drawn = [cut_means(panel.number, angle_deg, panel.formulation, v, quick) for v in speed]
        mean, sd = ([of(values) for values in drawn] for of in (np.mean, np.std))
        ax.errorbar(speed + 3 * shift, mean, sd, mfc="white", alpha=0.55, **look)
        tissue = panel.formulation, panel.poisson, panel.depth_normalised
        fitted = local_effective_modulus(line / 100, math.radians(angle_deg), *tissue)
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
