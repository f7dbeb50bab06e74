"""Figures of an evaluation's page: differences over margins, force along the way, the control clock."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from cutenv.report.figure import PHONE_WIDTH, label, new_figure, plain_axes
from cutenv.report.page import spoken
from cutenv.sim_to_real import Agreement, ClockKept, ComparedCut, Finding, force_over_position, force_rmse

if TYPE_CHECKING:
    from matplotlib.figure import Figure

VERDICT_COLOURS = {"agree": "#0072b2", "differ": "#d55e00", "undecided": "#6b6b6b"}
_MARKERS = {"agree": "o", "differ": "D", "undecided": "s"}
_RIG, _SIMULATOR = "#d55e00", "#0072b2"
_FARTHEST = 4.0  # margins beyond which a difference is drawn at the edge


def differences_figure(findings: Sequence[Finding], width: float) -> Figure:
    """Draw every measure's difference with its interval, in margins: the band from -1 to 1 is no difference."""
    phone = width < PHONE_WIDTH
    figure = new_figure(width, 1.2 + (0.34 if phone else 0.26) * len(findings))
    axes = figure.subplots()
    axes.axvspan(-1.0, 1.0, color="0.92", zorder=0)
    axes.axvline(0.0, color="0.6", linewidth=0.8)
    names = [label(spoken(each.measure.name)) for each in findings]
    told: set[str] = set()
    for row, each in enumerate(findings):
        low, value, high = (
            float(np.clip(end / each.shift.margin, -_FARTHEST, _FARTHEST))
            for end in (each.shift.low, each.shift.value, each.shift.high)
        )
        colour, marker = VERDICT_COLOURS[each.answer], _MARKERS[each.answer]
        axes.plot([low, high], [-row, -row], color=colour, linewidth=2.0, solid_capstyle="butt")
        name = None if each.answer in told else each.answer
        axes.plot(value, -row, marker, color=colour, markersize=5, label=name, linestyle="none")
        told.add(each.answer)
        if phone:  # names beside the marks would leave no room for them
            place = ((0.0, -row), (2, 3), ("axes fraction", "data"))
            axes.annotate(names[row], place[0], place[1], place[2], textcoords="offset points", fontsize=7)
    axes.set_yticks([] if phone else -np.arange(len(findings)), [] if phone else names)
    axes.set_xlim(-_FARTHEST - 0.1, _FARTHEST + 0.1)
    axes.set_ylim(-len(findings) + 0.4, 0.8)
    axes.set_xlabel("rig minus simulator, in margins, 95 % interval")
    plain_axes(axes, "x")
    figure.legend(loc="outside upper left", ncols=3, frameon=False, fontsize=9)
    return figure


def typical_pair(agreement: Agreement) -> tuple[int, ComparedCut, list[ComparedCut]] | None:
    """Return the specimen with the median difference of force: its number, and the cuts; None if none is common."""
    found = [
        (rmse, place)
        for place, (cut, simulated) in enumerate(zip(agreement.rig, agreement.simulator, strict=True))
        if (rmse := force_rmse(cut.trace, simulated[0].trace)) is not None
    ]
    if not found:
        return None
    _, place = sorted(found)[len(found) // 2]
    return place, agreement.rig[place], agreement.simulator[place]


def force_figure(cut: ComparedCut, simulated: Sequence[ComparedCut], width: float) -> Figure:
    """Draw the force along the way on both sides, and below their difference and that of two simulated cuts."""
    phone = width < PHONE_WIDTH
    figure = new_figure(width, 5.2 if phone else 4.8)
    panels = figure.subplots(2, 1, sharex=True, height_ratios=[2, 1])
    for number, each in enumerate(simulated):
        at, force = force_over_position(each.trace)
        name = "simulator, draws of noise" if number == 0 else None
        panels[0].plot(1e3 * at, force, color=_SIMULATOR, linewidth=0.9, alpha=0.6, label=name)
    at, force = force_over_position(cut.trace)
    panels[0].plot(1e3 * at, force, color=_RIG, linewidth=1.1, label="rig")
    own_at, own = force_over_position(simulated[0].trace)
    for other, colour, name in ((simulated[1], _SIMULATOR, "simulator, another draw"), (cut, _RIG, "rig")):
        other_at, other_force = force_over_position(other.trace)
        common = own_at[(own_at >= other_at[0]) & (own_at <= other_at[-1])] if len(other_at) else own_at[:0]
        difference = (
            np.interp(common, other_at, other_force) - np.interp(common, own_at, own) if len(common) else common
        )
        panels[1].plot(1e3 * common, difference, color=colour, linewidth=0.9, label=name)
    panels[0].set_ylabel("force [N]")
    panels[1].set_ylabel("less the simulator [N]")
    panels[1].set_xlabel("position of the blade [mm], up to the first retreat")
    for axes in panels:
        plain_axes(axes)
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside upper left", ncols=2, frameon=False, fontsize=9)
    return figure


def clock_figure(clock: ClockKept, width: float) -> Figure:
    """Draw histograms of control periods and of the latency from force to command; counts on a logarithmic axis."""
    phone = width < PHONE_WIDTH
    figure = new_figure(width, 4.8 if phone else 2.9)
    panels = figure.subplots(2, 1) if phone else figure.subplots(1, 2)
    for axes, values, name in (
        (panels[0], clock.periods, "control period"),
        (panels[1], clock.latencies, "from force to command"),
    ):
        middle, half = 500.0 * float(np.ptp(values) + 2 * values.min()), max(500.0 * float(np.ptp(values)), 0.5)
        axes.hist(1e3 * values, bins=40, range=(middle - half, middle + half), color=_SIMULATOR)
        axes.set_yscale("log")
        axes.set_ylim(bottom=0.7)
        axes.set_xlabel(f"{name} [ms]")
        plain_axes(axes)
    panels[0].axvline(1e3 * clock.nominal, color=_RIG, linewidth=1.2, linestyle="--", label="asked for")
    panels[0].legend(frameon=False, fontsize=8)
    panels[0].set_ylabel("commands")
    return figure
