"""Result of a training run as plain data, checked on construction."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cutenv._base.arrays import StructArray
from cutenv._base.result_table import ColumnHead, ResultRow, ResultTable
from cutenv._base.validation import array_in_range, in_range, one_of
from cutenv.display.report.page import PHONE_WIDTH, estimate_text, label, new_figure, plain_axes, term_meanings
from cutenv.sim.cutting.dtypes import READING
from cutenv.task.episode import ShownDepth
from cutenv.task.registry import RegisteredTask

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


Rows = Sequence[Mapping[str, Any]]

SPECIMEN_CLASS = "specimen class"
"""Name of the fact that the headline needs."""

_MAX_SCORE = 1e12  # no score is beyond it; NaN and infinity are refused with it
_SHARE = "It is a share of the cuts, not a percentage."
_ROUNDING = 1e-9
_CURE = "An interval needs two specimens or more; look for a NaN in the scores."


@dataclass(frozen=True)
class Score:
    """Score as a column: name in the data, heading, unit, digits shown."""

    name: str
    heading: str
    unit: str
    digits: int

    @property
    def factor(self) -> float:
        """Factor from the data's unit to the one shown, such as percent."""
        return 100.0 if self.unit in ("%", "percentage points") else 1.0

    @property
    def head(self) -> ColumnHead:
        """Heading of its column."""
        return (self.heading, self.unit) if self.unit else self.heading

    def cell(self, row: Mapping[str, Any] | None) -> str:
        """Return a mean with its interval, or a dash."""
        if row is None:
            return "\u2013"
        mean, low, high = (self.factor * float(row[name]) for name in ("mean", "low_95", "high_95"))
        if (least := {"%": 0.0, "percentage points": -100.0}.get(self.unit)) is not None:
            low, high = max(low, least), min(high, 100.0)  # a normal interval of a share may reach beyond
        return estimate_text(mean, low, high, self.digits)


COLUMNS = (
    Score("return", "return", "", 3),
    Score("success", "success", "%", 0),
    Score("tip_error_mm", "tip error", "mm", 2),
    Score("peak_force_N", "peak force", "N", 2),
    Score("time_s", "time", "s", 1),
    Score("largest_jump_mm", "largest jump", "mm", 2),
    Score("uncontrolled_share", "uncontrolled share", "%", 0),
)
"""Scores of the comparison, in its order."""

DIFFERENCES = (Score("return", "return", "", 3), Score("success", "success", "percentage points", 0))
"""Scores of the paired differences, in their order."""


def columns_of(task: RegisteredTask) -> tuple[Score, ...]:
    """Return the scores compared on a task."""
    return tuple(dict.fromkeys((*COLUMNS[:2], *(Score(*error) for error in task.errors), *COLUMNS[2:5])))


def comparison_table(
    summary: Sequence[Mapping[str, Any]], columns: Sequence[Score], caption: str = "", own: str = ""
) -> ResultTable:
    """Return policies' scores with intervals, best return first; ``own`` is marked."""
    values = {(row["policy"], row["score"]): row for row in summary}
    policies = sorted(dict.fromkeys(policy for policy, _ in values), key=lambda name: -values[name, "return"]["mean"])
    rows = [ResultRow(p, [column.cell(values.get((p, column.name))) for column in columns], p == own) for p in policies]
    return ResultTable(caption, ["policy", *(column.head for column in columns)], rows)


def differences_table(paired: Sequence[Mapping[str, Any]], caption: str = "") -> ResultTable:
    """Return a policy's paired differences from baselines, and whether it is better."""
    values = {(row["baseline"], row["score"]): row for row in paired}
    rows = []
    for baseline in dict.fromkeys(row["baseline"] for row in paired):
        cells = [column.cell(values.get((baseline, column.name))) for column in DIFFERENCES]
        found = values.get((baseline, "return"))
        rows.append(ResultRow(baseline, [*cells, "not compared" if found is None else _DECIDED[outcome(found)]]))
    return ResultTable(caption, ["baseline", *(column.head for column in DIFFERENCES), "by return"], rows)


_DECIDED = {"good": "better", "bad": "worse", "open": "undecided"}


def outcome(difference: Mapping[str, Any]) -> str:
    """Return what a paired difference says: good, bad or open."""
    return "good" if difference["low_95"] > 0.0 else "bad" if difference["high_95"] < 0.0 else "open"


@dataclass(frozen=True, kw_only=True)
class CutPicture:
    """Cut to be drawn.

    Parameters
    ----------
    policy : str
        Name of the policy.
    caption : str
        Text below the picture: the specimen, and the end.
    readings : StructArray
        The whole cut at 1 kHz, :data:`cutenv.sim.cutting.dtypes.READING`, shape (n,); hidden tip included.
    depth : array, shape (301,)
        Depth of cut along the line [m].
    target_length : float
        Target length [m].
    force_limit_per_depth : float
        Force limit over depth of cut [N/m].
    shown_depth : ShownDepth, optional
        Surface, floor, wanted floor and layer below, of a cut along a wanted depth.

    Raises
    ------
    TypeError, ValueError
        For readings that are empty, lack a field or hold NaN, and for lengths out of range.
    """

    policy: str
    caption: str
    readings: StructArray
    depth: NDArray[np.float64]
    target_length: float
    force_limit_per_depth: float
    shown_depth: ShownDepth | None = None

    def __post_init__(self) -> None:
        found = self.readings.dtype.names or ()
        for name in READING.names or ():
            if name not in found:
                raise ValueError(f"readings of {self.policy!r} lack the field {name!r}; they have {', '.join(found)}.")
            array_in_range(f"readings[{name!r}] of {self.policy!r}", self.readings[name], -1e9, 1e9, "SI")
        if not len(self.readings):
            raise ValueError(f"readings of {self.policy!r} are empty; give those of a whole cut.")
        if self.depth.ndim != 1 or not self.depth.size:
            raise ValueError(f"depth of {self.policy!r} must have shape (n,), got {self.depth.shape}.")
        array_in_range(f"depth of {self.policy!r}", self.depth, 0.0, 1.0, "m")
        in_range(f"target_length of {self.policy!r}", self.target_length, 0.0, 1.0, "m")
        in_range(f"force_limit_per_depth of {self.policy!r}", self.force_limit_per_depth, 0.0, 1e9, "N/m")


@dataclass(frozen=True, kw_only=True)
class TrainingResult:
    """Result of a training run as plain data.

    Parameters
    ----------
    title, subtitle : str
        Title and subtitle of the page.
    facts : mapping of str to str
        Facts that identify the run: seed, decisions, versions, commit; ``"specimen class"`` must be among them.
    summary : sequence of mappings
        Rows ``policy, score, mean, low_95, high_95, cuts``: every score of ``COLUMNS`` for every policy, and the terms
        ``reward_...`` for agent, best script and bound.  All policies met the same held-out specimens.
    differences : sequence of mappings
        Rows ``policy, baseline, score, mean, low_95, high_95, cuts``: agent minus baseline, paired by specimen; score
        ``return`` for the best script and the rival at least, ``success`` where known.  Those of these two may be of
        more specimens than the others; without a grid, those of every script.
    agent, best_script : str
        Learned policy, and the script to compare it with.
    rival_script : str or None
        If the best script taught the agent, the best of the others.
    bound : str or None
        Planner that knows the hidden state: an upper bound, not a competitor.
    grid : sequence of mappings
        Rows ``speed_cm_s, angle_deg, mean, low_95, high_95, success``: return of constant feed, one row for every pair
        of a speed and an angle.  Empty for a task without constant feeds.
    cuts : sequence of CutPicture
        Cuts of the agent and the best script on one specimen.
    curve : sequence of mappings
        Rows ``decisions, return, success`` and, where validated, ``validation_return, validation_success`` (otherwise
        absent or NaN).
    chosen_at : int or None
        Decisions before the kept checkpoint.
    columns : sequence of Score
        Scores of the comparison.

    Raises
    ------
    TypeError, ValueError
        For a missing policy, score or cell, and for an invalid number; names the row and the field.
    """

    title: str
    subtitle: str
    facts: Mapping[str, str]
    summary: Rows
    differences: Rows
    agent: str
    best_script: str
    bound: str | None
    grid: Rows
    cuts: Sequence[CutPicture]
    curve: Sequence[Mapping[str, float]]
    chosen_at: int | None
    rival_script: str | None = None
    columns: Sequence[Score] = COLUMNS

    def __post_init__(self) -> None:
        if SPECIMEN_CLASS not in self.facts:
            raise ValueError(f"facts must hold {SPECIMEN_CLASS!r}, which the headline names; got {list(self.facts)}.")
        _check_rows("summary", self.summary, ("policy", "score"), ("mean", "low_95", "high_95", "cuts"))
        _check_rows(
            "differences", self.differences, ("policy", "baseline", "score"), ("mean", "low_95", "high_95", "cuts")
        )
        self._check_policies()
        self._check_differences()
        self._check_counts()
        if self.grid:
            _check_rows("grid", self.grid, (), ("speed_cm_s", "angle_deg", "mean", "low_95", "high_95", "success"))
        for place, row in enumerate(self.grid):
            in_range(f"success of grid[{place}]", row["success"], 0.0, 1.0, "1", _SHARE)
        _check_whole(self.grid)
        if self.curve:
            _check_rows("curve", self.curve, (), ("decisions", "return", "success"))
        if self.chosen_at is not None:
            in_range("chosen_at", self.chosen_at, 0, _MAX_SCORE, "decisions")
        for place, cut in enumerate(self.cuts):
            one_of(f"cuts[{place}].policy", cut.policy, self.policies)

    def _check_policies(self) -> None:
        known = list(dict.fromkeys(row["policy"] for row in self.summary))
        for name in ("agent", "best_script", "bound", "rival_script"):
            policy = getattr(self, name)
            if policy is not None or name in ("agent", "best_script"):
                one_of(name, policy, known)
        if len(set(self.compared())) < len(self.compared()):
            raise ValueError(f"agent, best_script and bound must differ, got {', '.join(map(repr, self.compared()))}.")
        for policy in known:
            for column in self.columns:
                self.score(policy, column.name)
            in_range(f"success of {policy!r}", self.score(policy, "success")["mean"], 0.0, 1.0, "1", _SHARE)
        for policy in self.compared():
            for term in self.terms():
                one_of("summary: term of the reward", term, term_meanings())
                self.score(policy, f"reward_{term}")

    def _check_differences(self) -> None:
        for place, row in enumerate(self.differences):
            one_of(f"differences[{place}].policy", row["policy"], [self.agent])
            one_of(f"differences[{place}].baseline", row["baseline"], self.policies)
            one_of(f"differences[{place}].score", row["score"], [column.name for column in DIFFERENCES])
        for name, script in (("best_script", self.best_script), ("rival_script", self.rival_script)):
            if script is not None and self.difference(script, "return") is None:
                raise ValueError(
                    f"differences has no row of score 'return' with baseline {script!r}, the {name}; "
                    "the headline is made of it."
                )

    def _check_counts(self) -> None:
        closer = (self.best_script, self.rival_script) if self.grid else self.policies
        others = [row for row in self.differences if row["baseline"] not in (*closer, self.bound)]
        counts = sorted({row["cuts"] for row in (*self.summary, *others) if row.get("policy") != self.bound})
        if len(counts) > 1:
            raise ValueError(
                f"summary and differences count {', '.join(map(str, counts))} cuts; every policy but the bound must "
                "meet the same specimens, or they cannot be compared."
            )

    @property
    def policies(self) -> list[str]:
        """Every policy of the summary, the best return first."""
        return sorted(dict.fromkeys(row["policy"] for row in self.summary), key=lambda policy: -self._return(policy))

    def _return(self, policy: str) -> float:
        return float(self.score(policy, "return")["mean"])

    def score(self, policy: str, name: str) -> Mapping[str, Any]:
        """Return the summary's row for a policy and a score."""
        found = (row for row in self.summary if (row["policy"], row["score"]) == (policy, name))
        row = next(found, None)
        if row is None:
            raise ValueError(f"summary has no score {name!r} for policy {policy!r}; evaluate it for every policy.")
        return row

    def difference(self, baseline: str, name: str) -> Mapping[str, Any] | None:
        """Return the row of differences for a baseline and score, or None."""
        found = (row for row in self.differences if (row["baseline"], row["score"]) == (baseline, name))
        return next(found, None)

    def differences_by_return(self) -> list[Mapping[str, Any]]:
        """Return the rows of differences, of the best baseline first."""
        places = {policy: place for place, policy in enumerate(self.policies)}
        return sorted(self.differences, key=lambda row: places[row["baseline"]])

    def role(self, policy: str) -> str:
        """Return the role of a policy; see :data:`cutenv.display.report.training_result.ROLES`."""
        return {self.bound: "bound", self.best_script: "script", self.agent: "agent"}.get(policy, "other")

    def bar(self, policy: str, name: str, sign: float = 1.0) -> Bar:
        """Return a score with interval for figures; ``sign`` -1 gives costs."""
        row = self.score(policy, name)
        low, high = sorted((sign * row["low_95"], sign * row["high_95"]))
        return Bar(policy, self.role(policy), sign * row["mean"], low, high)

    def terms(self) -> list[str]:
        """Return the reward's terms, in the agent's order."""
        names = [row["score"] for row in self.summary if row["policy"] == self.agent]
        return [name.removeprefix("reward_") for name in names if name.startswith("reward_")]

    def compared(self) -> list[str]:
        """Return the agent, the best script and any bound."""
        return [policy for policy in (self.agent, self.best_script, self.bound) if policy is not None]


def _check_rows(name: str, rows: Rows, words: Sequence[str], numbers: Sequence[str]) -> None:
    """Raise an error for missing, repeated or invalid rows."""
    if not rows:
        raise ValueError(f"{name} is empty; give its rows.")
    seen = set()
    for place, row in enumerate(rows):
        for field in (*words, *numbers):
            if field not in row:
                raise ValueError(f"{name}[{place}] lacks {field!r}; it has {', '.join(map(repr, row))}.")
        key = tuple(row[word] for word in words)
        here = f"{name}[{place}] ({', '.join(map(str, key))})" if key else f"{name}[{place}]"
        if key and key in seen:
            raise ValueError(f"{here} comes twice; give one row for each.")
        seen.add(key)
        for field in numbers:
            in_range(f"{field} of {here}", row[field], -_MAX_SCORE, _MAX_SCORE, "1", _CURE if "mean" in row else "")
        if "mean" in row and not row["low_95"] - _ROUNDING <= row["mean"] <= row["high_95"] + _ROUNDING:
            raise ValueError(
                f"{here} has mean {row['mean']:g} outside of its interval "
                f"{row['low_95']:g} to {row['high_95']:g}; check which is which."
            )


def _check_whole(grid: Rows) -> None:
    """Raise an error for missing or repeated grid cells."""
    pairs = [(row["speed_cm_s"], row["angle_deg"]) for row in grid]
    for speed in dict.fromkeys(speed for speed, _ in pairs):
        for angle in dict.fromkeys(angle for _, angle in pairs):
            count = pairs.count((speed, angle))
            if count != 1:
                raise ValueError(f"grid has {count} rows for {speed:g} cm/s at {angle:g} degrees; give one.")


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
    """Draw every policy's return with interval, from above; width [in]."""
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
    """Draw costs as bars, grouped by term.

    The terms are in the reader's words, from above, and each policy has a cost for each; width in inches.
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
    """Draw return and success over training decisions, marking the kept checkpoint."""
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
    rows = [row for row in curve if math.isfinite(row.get(name, math.nan))]
    return [row["decisions"] for row in rows], [row[name] for row in rows]


def _plain_from_zero(axes: Axes) -> None:
    """Draw plain axes, with a zero line between values of both signs."""
    plain_axes(axes, "x")
    if axes.get_xlim()[0] < 0.0 < axes.get_xlim()[1]:
        axes.axvline(0.0, color="0.6", linewidth=0.8, zorder=0.5)
