"""Figures of a training run's page: returns, costs, the grid of constant feeds, the learning curve."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from cutenv.report.figure import PHONE_WIDTH, label, new_figure, plain_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

ROLES = ("agent", "script", "bound", "other")
"""Roles of a policy on the page: the learned one, the best script, the upper bound, another."""

_COLOURS = {"agent": "#0072b2", "script": "#e69f00", "bound": "#009e73", "other": "#6b6b6b"}
_MARKERS = {"agent": "o", "script": "s", "bound": "D", "other": "o"}
_RETURN, _VALIDATION, _KEPT = "#56b4e9", "#d55e00", "#009e73"


@dataclass(frozen=True)
class Bar:
    """Mean of a policy with its 95 % interval."""

    policy: str
    role: str
    mean: float
    low: float
    high: float

    def __str__(self) -> str:
        return f"{self.policy} {self.mean:.2f} [{self.low:.2f}, {self.high:.2f}]"


def returns_figure(bars: Sequence[Bar], width: float, quantity: str = "return") -> Figure:
    """Draw dot and interval of every policy's return, in the order given from above, for a width [in]."""
    phone = width < PHONE_WIDTH
    figure = new_figure(width, 0.75 + (0.5 if phone else 0.36) * len(bars))
    axes = figure.subplots()
    places = -np.arange(len(bars))
    for place, bar in zip(places, bars, strict=True):
        colour = _COLOURS[bar.role]
        axes.plot([bar.low, bar.high], [place, place], color=colour, linewidth=2.5, solid_capstyle="butt")
        inside = "white" if bar.role == "bound" else colour
        axes.plot(
            bar.mean, place, _MARKERS[bar.role], color=colour, markerfacecolor=inside, markersize=7, markeredgewidth=2
        )
    names = [label(textwrap.shorten(bar.policy, 60, placeholder=" ...")) for bar in bars]
    if phone:  # names beside the dots would leave no room for the dots
        axes.set_yticks([])
        for place, name in zip(places, names, strict=True):
            axes.annotate(name, (0.0, place), (2, 8), ("axes fraction", "data"), textcoords="offset points", fontsize=8)
    else:
        axes.set_yticks(places, [textwrap.fill(name, 36) for name in names])
    axes.set_ylim(-len(bars) + 0.5, 0.7 if phone else 0.5)
    axes.set_xlabel(quantity)
    _plain_from_zero(axes)
    return figure


def costs_figure(terms: Sequence[str], policies: Sequence[Sequence[Bar]], width: float) -> Figure:
    """Draw costs side by side, a group of bars for each term.

    Parameters
    ----------
    terms : sequence of str
        Terms in the reader's words, from above.
    policies : sequence of sequence of Bar
        Costs of each policy, one for each term.
    width : float
        Width [in].
    """
    phone = width < PHONE_WIDTH
    figure = new_figure(width, 1.0 + len(terms) * (0.12 + 0.14 * len(policies)) + (0.2 * len(policies) * phone))
    axes = figure.subplots()
    thickness = 0.8 / len(policies)
    for row, bars in enumerate(policies):
        places = -np.arange(len(terms)) - (row - 0.5 * (len(policies) - 1)) * thickness
        means = np.array([bar.mean for bar in bars])
        axes.barh(places, means, 0.92 * thickness, color=_COLOURS[bars[0].role], label=label(bars[0].policy))
        for place, bar in zip(places, bars, strict=True):
            axes.plot([bar.low, bar.high], [place, place], color="0.25", linewidth=0.9)
    axes.set_yticks(-np.arange(len(terms)), [textwrap.fill(term, 14) if phone else term for term in terms])
    axes.set_xlim(left=min(0.0, *(bar.mean for bars in policies for bar in bars)))
    axes.set_ylim(-len(terms) + 0.45, 0.55)
    axes.set_xlabel("cost, in units of return")
    figure.legend(loc="outside upper left", ncols=1 if phone else len(policies), frameon=False, fontsize=9)
    _plain_from_zero(axes)
    return figure


def curve_figure(curve: Sequence[Mapping[str, float]], chosen_at: int | None, width: float) -> Figure:
    """Draw return and success over the training decisions, and mark the checkpoint that was kept."""
    from matplotlib.ticker import EngFormatter

    phone = width < PHONE_WIDTH
    figure = new_figure(width, 4.6 if phone else 4.8)
    panels = figure.subplots(2, 1, sharex=True)
    for axes, name in zip(panels, ("return", "success"), strict=True):
        axes.plot(*_column(curve, name), color=_RETURN, linewidth=1.4, label="training episodes, exploring")
        decisions, values = _column(curve, f"validation_{name}")
        if len(values):
            axes.plot(
                decisions, values, "o-", color=_VALIDATION, linewidth=0.8, markersize=4.5, label="validation specimens"
            )
        if chosen_at is not None:
            axes.axvline(chosen_at, color=_KEPT, linestyle="--", linewidth=1.5, label="checkpoint kept")
        axes.set_ylabel(name)
        plain_axes(axes)
    panels[1].set_ylim(-0.03, 1.03)
    panels[1].set_xlabel("decisions")
    panels[1].xaxis.set_major_formatter(EngFormatter())
    handles, names = panels[0].get_legend_handles_labels()
    figure.legend(handles, names, loc="outside upper left", ncols=1 if phone else 3, frameon=False, fontsize=9)
    return figure


def _column(curve: Sequence[Mapping[str, float]], name: str) -> tuple[list[float], list[float]]:
    """Return decisions and values of a column where it has any."""
    rows = [row for row in curve if math.isfinite(row.get(name, math.nan))]
    return [row["decisions"] for row in rows], [row[name] for row in rows]


def _plain_from_zero(axes: Axes) -> None:
    """Draw plain axes that are read across, with a line at zero if there are values on both sides of it."""
    plain_axes(axes, "x")
    if axes.get_xlim()[0] < 0.0 < axes.get_xlim()[1]:
        axes.axvline(0.0, color="0.6", linewidth=0.8, zorder=0.5)
