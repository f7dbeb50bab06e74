"""Score cards of many cuts, who made them, and statistics of each metric."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import ParamSpec, TypeVar

import numpy as np

from cutenv._base.arrays import Array
from cutenv._base.validation import in_range, one_of
from cutenv.records.scoring.cut_metrics import FORCE_WEIGHTS, METRICS, Direction
from cutenv.records.scoring.score_card import ScoreCard
from cutenv.records.scoring.study.estimate import FEWEST_COMPARED, FEWEST_RELIABLE
from cutenv.records.scoring.study.learning import FEWEST_IN_CURVE, Cusum, LearningCurve, cusum, learning_curve
from cutenv.records.scoring.study.reliability import Intraclass, OneWay, intraclass_correlation, one_way_reliability
from cutenv.records.scoring.study.separation import FEWEST_IN_A_GROUP, Separation, separation

STUDIED = (
    "tip_error", "overshoot", "largest_jump", "uncontrolled_share", "force_rate", "force_jerk", "force_drops",
    "mean_force_drop", "duration",
)  # fmt: skip
"""Metrics that are studied, beside the overall score, if none are named and the records have positions."""
OVERALL = "overall_score"  # name of the overall score among the metrics
P = ParamSpec("P")
T = TypeVar("T")


@dataclass(frozen=True, kw_only=True, eq=False)
class StudiedCut:
    """One cut of a study.

    Attributes
    ----------
    group : str
        Group of the operator; "" if the study has none.
    session : str
        Session of the cut; "" if the study has none.
    date : str
        Date and time of the cut in ISO 8601; "" if it is not known.
    marks : mapping of str to float
        Mark by each rater who gave one, on any scale.
    condition : str
        Condition of a crossover under which it was made, see :mod:`cutenv.records.scoring.study.crossover`; "" if none.
    """

    card: ScoreCard
    operator: str
    group: str = ""
    session: str = ""
    date: str = ""
    marks: Mapping[str, float] = field(default_factory=dict)
    condition: str = ""


@dataclass(frozen=True)
class NotEstimable:
    """Reason why a statistic cannot be computed from a study."""

    reason: str


@dataclass(frozen=True, kw_only=True, eq=False)
class Findings:
    """Statistics of one metric in a study.

    Attributes
    ----------
    series : mapping of str to ndarray
        Values of each operator's cuts, in order; cuts without a value are left out.
    reliability : OneWay or NotEstimable
        Reliability of single cuts and of means, over operators with two cuts or more.
    retest : Intraclass or NotEstimable
        Test-retest reliability of session means, over operators who were at every session.
    separation : Separation or NotEstimable
        Separation of the study's two groups, the first above the second.
    curves : mapping of str to LearningCurve or NotEstimable
        Learning curve by group, over the number of the cut; operators with two cuts or more.
    cusums : mapping of str to Cusum, or NotEstimable
        Cumulative sums by operator, for those with two cuts or more.
    target, scale : float
        Target and standard deviation for the cumulative sums; in the metric's unit.
    """

    metric: str
    unit: str
    series: Mapping[str, Array]
    missing: int
    reliability: OneWay | NotEstimable
    retest: Intraclass | NotEstimable
    separation: Separation | NotEstimable
    curves: Mapping[str, LearningCurve | NotEstimable]
    cusums: Mapping[str, Cusum] | NotEstimable
    target: float
    scale: float
    target_is: str


@dataclass(frozen=True, kw_only=True, eq=False)
class StudiedPeople:
    """Scored cuts of several people."""

    name: str  # name for pages
    cuts: Sequence[StudiedCut]  # the cuts, each operator's in the order in which they were made
    # cuts that were begun and left, by operator: how many of the operator's finished cuts stand before each of them
    left: Mapping[str, Sequence[int]] = field(default_factory=dict)

    @property
    def operators(self) -> tuple[str, ...]:
        """Codes of the operators, in order of appearance."""
        return tuple(dict.fromkeys(cut.operator for cut in self.cuts))

    @property
    def group_of(self) -> dict[str, str]:
        """Group of each operator."""
        return {cut.operator: cut.group for cut in self.cuts}

    def _check_cuts(self, what: str, cure: str, who: str = "operator") -> None:
        """Raise ValueError for no cuts, mixed force units or mixed groups."""
        if not self.cuts:
            raise ValueError(f"{what} cuts; there is none.")
        units = sorted({cut.card.force_unit for cut in self.cuts})
        if len(units) > 1:
            raise ValueError(f"force is in {' and in '.join(units)}; {cure} cuts of one unit at a time.")
        groups: dict[str, str] = {}
        for cut in self.cuts:
            if groups.setdefault(cut.operator, cut.group) != cut.group:
                raise ValueError(
                    f"{who} {cut.operator} is in groups {groups[cut.operator]!r} and {cut.group!r}; give one. "
                    "What changes from cut to cut is a session."
                )

    def _values(self, metric: str, notes: list[str], *, named: bool) -> Array | None:
        """Return a metric by cut, NaN where missing; None without any, a ValueError if it was ``named``."""
        scored = [value_of(cut.card, metric) for cut in self.cuts]
        silent = [reason for value, reason in scored if value is None]
        if silent:
            reason = f"{metric} is missing in {len(silent)} of {len(scored)} cuts: {silent[0]}"
            if len(silent) == len(scored) and named:
                raise ValueError(f"{reason}.")
            notes.append(reason)
        if len(silent) == len(scored):
            return None
        return np.array([np.nan if value is None else value for value, _ in scored])

    def _series(self, values: Array) -> dict[str, Array]:
        """Return the values of each operator who has any."""
        made_by, there = np.array([cut.operator for cut in self.cuts]), np.isfinite(values)
        return {each: own for each in self.operators if len(own := values[(made_by == each) & there])}

    def attempts(self) -> list[tuple[int, StudiedCut | str]]:
        """Return cuts numbered by operator from 1, abandoned ones as operator code."""
        waiting = {operator: list(some) for operator, some in self.left.items()}
        finished, number = Counter[str](), Counter[str]()
        rows: list[tuple[int, StudiedCut | str]] = []

        def add_left(operator: str, before: float) -> None:
            while waiting.get(operator) and waiting[operator][0] <= before:
                waiting[operator].pop(0)
                number[operator] += 1
                rows.append((number[operator], operator))

        for cut in self.cuts:
            add_left(cut.operator, finished[cut.operator])
            finished[cut.operator] += 1
            number[cut.operator] += 1
            rows.append((number[cut.operator], cut))
        for operator in waiting:
            add_left(operator, np.inf)
        return rows

    def _left_note(self) -> list[str]:
        """Return a note on abandoned cuts, or []."""
        told = ", ".join(f"{operator} {len(some)}" for operator, some in self.left.items() if some)
        return [
            f"begun and left: {told}; these cuts have no score, so means and spread are those of the others, and each "
            "breaks a row of passes"
        ] * bool(told)

    def left_among(self, metric: str) -> dict[str, tuple[int, ...]]:
        """Return by operator how many cuts with ``metric`` precede each abandoned one."""
        found = {}
        for operator, some in self.left.items():
            there = [value_of(cut.card, metric)[0] is not None for cut in self.cuts if cut.operator == operator]
            found[operator] = tuple(sum(there[:before]) for before in some)
        return found

    def _unit(self, metric: str) -> str:
        return "1" if metric == OVERALL else self.cuts[0].card.unit(metric)


@dataclass(frozen=True, kw_only=True, eq=False)
class Study(StudiedPeople):
    """A study: scored cuts of several people.

    Parameters
    ----------
    cuts : sequence of StudiedCut
        The cuts, each operator's in the order in which they were made.
    left : mapping of str to sequence of int, optional
        Cuts that were begun and left, by operator: how many finished ones stand before each.
    metrics : sequence of str, optional
        "overall_score" and names in :data:`~cutenv.records.scoring.METRICS`; by default the score and the leading
        metrics.
    groups : pair of str, optional
        Groups to compare; by default the two groups, if there are two.
    target_group : str, optional
        Group whose mean is the target of the cumulative sums; by default the mean over all operators is.
    target : float, optional
        The target itself, in the unit of the one metric.
    who : str
        Word for an operator, if another is wanted: for example "trial".

    Attributes
    ----------
    findings : tuple of Findings
        Statistics of each metric that any cut has.

    Raises
    ------
    ValueError
        If there are no cuts, an operator is in two groups, force is in two units, or a name is not known.
    """

    metrics: Sequence[str] = ()
    groups: tuple[str, str] | None = None
    target_group: str | None = None
    target: float | None = None
    who: str = "operator"
    findings: tuple[Findings, ...] = field(init=False)
    notes: tuple[str, ...] = field(init=False)

    def __post_init__(self) -> None:
        self._check_cuts("a study needs", "study", self.who)
        for metric in self.metrics:
            one_of("metric", metric, (OVERALL, *METRICS))
        known = tuple(dict.fromkeys(cut.group for cut in self.cuts))
        for name, group in (("group", self.groups or ()), ("target group", (self.target_group,))):
            for each in group:
                if each is not None:
                    one_of(name, each, known)
        if self.target is not None:
            if len(self.metrics) != 1:
                raise ValueError(f"target = {self.target:g} needs exactly one metric: name the metric it belongs to.")
            in_range("target", self.target, -1e12, 1e12, "1")
        if self.target is not None and self.target_group is not None:
            raise ValueError("give a target or a target group, not both.")
        if self.groups is None and len(known) == 2:
            object.__setattr__(self, "groups", known)
        notes = self._left_note()
        if self.groups is None and len(known) > 2:
            notes.append(f"of the groups {', '.join(known)} no two were named: their separation is not computed")
        findings = [found for metric in self._chosen() if (found := self._find(metric, notes)) is not None]
        if not findings:
            raise ValueError(f"no metric could be computed from these cuts: {'; '.join(notes)}.")
        notes += self._few(findings)
        object.__setattr__(self, "findings", tuple(findings))
        object.__setattr__(self, "notes", tuple(notes))

    @property
    def sessions(self) -> tuple[str, ...]:
        """Names of the sessions, in order of appearance."""
        return tuple(dict.fromkeys(cut.session for cut in self.cuts))

    def _chosen(self) -> Sequence[str]:
        return tuple(dict.fromkeys(self.metrics)) or (OVERALL, *leading_metrics(self.cuts))

    def _few(self, findings: Sequence[Findings]) -> list[str]:
        """Return a note on statistics without interval, for few people."""
        groups = max(
            (each.separation.people for each in findings if isinstance(each.separation, Separation)), default=()
        )
        curves = [
            c for each in findings for c in each.curves.values() if isinstance(c, LearningCurve) and c.low is None
        ]
        said = []
        if groups and min(groups) < FEWEST_IN_A_GROUP:
            said.append(
                f"the groups' difference ({groups[0]} and {groups[1]}, of at least {FEWEST_IN_A_GROUP} in each)"
            )
        if curves:
            least = max(int(each.people[0]) for each in curves)
            said.append(f"a group's learning ({least} of at least {FEWEST_IN_CURVE})")
        if not said:
            return []
        return [
            f"too few {self.who}s for an interval of {', of '.join(said)}: these values describe these {self.who}s, "
            "and no others"
        ]

    def _find(self, metric: str, notes: list[str]) -> Findings | None:
        values = self._values(metric, notes, named=bool(self.metrics))
        if values is None:
            return None
        series = self._series(values)
        several = {operator: values for operator, values in series.items() if len(values) >= 2}
        few = NotEstimable(
            f"fewer than {FEWEST_RELIABLE} {self.who}s with two cuts or more, and so few often differ by chance"
        )
        enough = len(several) >= FEWEST_RELIABLE
        reliability = if_estimable(one_way_reliability, list(several.values())) if enough else few
        target, target_is = self._target(series)
        within = _pooled(several)
        return Findings(
            metric=metric,
            unit=self._unit(metric),
            series=series,
            missing=int(np.isnan(values).sum()),
            reliability=reliability,
            retest=self._retest(values),
            separation=self._separation(series),
            curves=self._curves(several),
            cusums=self._cusums(metric, several, target, within),
            target=target,
            scale=within,
            target_is=target_is,
        )

    def _target(self, series: Mapping[str, Array]) -> tuple[float, str]:
        if self.target is not None:
            return self.target, "as given"
        group_of = self.group_of
        of_group = [values.mean() for operator, values in series.items() if group_of[operator] == self.target_group]
        if self.target_group is not None and of_group:
            return float(np.mean(of_group)), f"mean of group {self.target_group}"
        return float(np.mean([values.mean() for values in series.values()])), f"mean over all {self.who}s"

    def _cusums(
        self, metric: str, several: Mapping[str, Array], target: float, within: float
    ) -> dict[str, Cusum] | NotEstimable:
        direction = direction_of(metric)
        if direction == "none":
            return NotEstimable("neither way is better, so no target is reached")
        if within <= 0.0:
            return NotEstimable(f"no {self.who}'s cuts differ")
        sign = -1 if direction == "higher" else 1
        return {operator: cusum(values, target, within, sign=sign) for operator, values in several.items()}

    def _curves(self, several: Mapping[str, Array]) -> dict[str, LearningCurve | NotEstimable]:
        group_of = self.group_of
        curves: dict[str, LearningCurve | NotEstimable] = {}
        for group in dict.fromkeys(group_of.values()):
            own = [values for operator, values in several.items() if group_of[operator] == group]
            few = NotEstimable(f"fewer than {FEWEST_COMPARED} {self.who}s with two cuts or more")
            curves[group] = few if len(own) < FEWEST_COMPARED else if_estimable(learning_curve, own)
        return curves

    def _separation(self, series: Mapping[str, Array]) -> Separation | NotEstimable:
        if self.groups is None:
            return NotEstimable("the study has no two groups")
        group_of = self.group_of
        first, second = (
            [values for operator, values in series.items() if group_of[operator] == group] for group in self.groups
        )
        if min(len(first), len(second)) < FEWEST_COMPARED:
            return NotEstimable(f"fewer than {FEWEST_COMPARED} {self.who}s in a group ({len(first)} and {len(second)})")
        return if_estimable(separation, first, second)

    def _retest(self, values: Array) -> Intraclass | NotEstimable:
        if len(self.sessions) < 2:
            return NotEstimable("the study has one session")
        cells: dict[tuple[str, str], list[float]] = {}
        for cut, value in zip(self.cuts, values.tolist(), strict=True):
            if np.isfinite(value):
                cells.setdefault((cut.operator, cut.session), []).append(value)
        rows = [
            [float(np.mean(cells[operator, session])) for session in self.sessions]
            for operator in self.operators
            if all((operator, session) in cells for session in self.sessions)
        ]
        if len(rows) < FEWEST_RELIABLE:
            return NotEstimable(
                f"fewer than {FEWEST_RELIABLE} {self.who}s were at every session, and so few often differ by chance"
            )
        return if_estimable(intraclass_correlation, rows)


def value_of(card: ScoreCard, metric: str) -> tuple[float | None, str]:
    """Return a metric's or overall score's value, or None with reason."""
    if metric == OVERALL:
        return card.overall_score, card.no_score
    scored = card.metrics[metric]
    return scored.value, scored.unavailable


def direction_of(metric: str) -> Direction:
    """Return which values of a metric or score are better."""
    return "higher" if metric == OVERALL else METRICS[metric].direction


def leading_metrics(cuts: Sequence[StudiedCut]) -> tuple[str, ...]:
    """Return the metrics studied with the overall score by default."""
    moved = any(cut.card.metrics["idle_time"].value is not None for cut in cuts)
    return STUDIED if moved else tuple(FORCE_WEIGHTS)


def if_estimable(function: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> T | NotEstimable:
    """Return a statistic, or why these people do not allow it."""
    try:
        return function(*args, **kwargs)
    except ValueError as error:
        return NotEstimable(str(error).rstrip("."))


def _pooled(series: Mapping[str, Array]) -> float:
    """Return one person's SD, pooled over people, else 0."""
    degrees = sum(len(values) - 1 for values in series.values())
    squares = sum(float(np.sum((values - values.mean()) ** 2)) for values in series.values())
    return float(np.sqrt(squares / degrees)) if degrees else 0.0
