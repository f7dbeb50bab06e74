"""A class of people held against pass marks and raters, and what supports them: Messick's five sources of validity."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from cutenv._base.arrays import Array
from cutenv._base.validation import in_range, one_of
from cutenv.scoring.metric import METRICS
from cutenv.scoring.score_card import whole_score
from cutenv.scoring.study.estimate import FEWEST_COMPARED, FEWEST_RELIABLE, Estimate
from cutenv.scoring.study.pass_mark import (
    IN_A_ROW,
    METHODS,
    SPREAD,
    Better,
    Method,
    PassMark,
    Proficiency,
    pass_mark,
    proficiency,
)
from cutenv.scoring.study.raters import RaterAgreement, RaterCorrelation, mean_mark, rater_agreement, rater_correlation
from cutenv.scoring.study.reliability import OneWay, one_way_reliability
from cutenv.scoring.study.separation import Separation, separation
from cutenv.scoring.study.study import OVERALL, NotEstimable, StudiedPeople, direction_of, leading_metrics, told

NO_EVIDENCE = "no evidence"


@dataclass(frozen=True, kw_only=True)
class ValidityEvidence:
    """One source of validity: its name, the question that it answers, and what was found, a sentence each."""

    source: str
    question: str
    found: tuple[str, ...]

    @property
    def is_there(self) -> bool:
        """True if the data say anything about this source."""
        return not self.found[0].startswith(NO_EVIDENCE)


def validity_evidence(setting: StandardSetting) -> tuple[ValidityEvidence, ...]:
    """Return what a class shows for each of Messick's sources of validity, by its first metric.

    Messick, American Psychologist 50 (1995) 741-749, doi 10.1037/0003-066X.50.9.741. Evidence is no verdict: whether it
    is enough for a use is for the people who use it to judge.
    """
    first = setting.standards[0]
    return (
        ValidityEvidence(
            source="Content",
            question="Do the cuts stand for the task that is to be learned?",
            found=(f"{NO_EVIDENCE}: experts judge this, and no number of these cuts does",),
        ),
        ValidityEvidence(
            source="Response process",
            question="Do the records hold what the people did?",
            found=_records(setting, first),
        ),
        ValidityEvidence(
            source="Internal structure",
            question="Would the same people get the same again?",
            found=_same(setting, first),
        ),
        ValidityEvidence(
            source="Relations to other variables",
            question="Does the number go with experience, and with what raters see?",
            found=_relations(setting, first),
        ),
        ValidityEvidence(
            source="Consequences", question="Whom does the pass mark judge wrongly?", found=_consequences(first)
        ),
    )


def _records(setting: StandardSetting, standard: Standard) -> tuple[str, ...]:
    cuts = len(setting.cuts)
    sources = Counter(cut.card.tip_source for cut in setting.cuts)
    tips = ", ".join(f"{source} in {count}" for source, count in sources.most_common())
    left = sum(map(len, setting.left.values()))
    return (
        f"{cuts - standard.missing} of {cuts} cuts have a value",
        *([f"{left} more were begun and left"] * bool(left)),
        f"origin of the crack tip: {tips}",
        f"{NO_EVIDENCE} on how the people understood the task",
    )


def _same(setting: StandardSetting, standard: Standard) -> tuple[str, ...]:
    found = []
    if isinstance(standard.reliability, OneWay):
        one, mean = standard.reliability.single, standard.reliability.mean
        found += [f"reliability of one cut: {_shown(one)}", f"reliability of a person's mean: {_shown(mean)}"]
    if isinstance(setting.agreement, RaterAgreement):
        raters = setting.agreement.raters
        found.append(f"agreement of {raters} raters, rank correlation: {_shown(setting.agreement.rank)}")
    return tuple(found) or (_without(standard.reliability),)


def _relations(setting: StandardSetting, standard: Standard) -> tuple[str, ...]:
    found = []
    if isinstance(standard.separation, Separation):
        P = standard.separation.superiority
        if standard.better == "lower":
            low, high = (None if end is None else 1.0 - end for end in (P.high, P.low))
            P = Estimate(value=1.0 - P.value, low=low, high=high)
        pair = f"one of group {setting.passing} is better than one of group {setting.failing}"
        found.append(f"probability that {pair}: {_shown(P)}")
    rater = ALL_RATERS if ALL_RATERS in standard.raters else next(iter(standard.raters), "")
    correlation = standard.raters.get(rater)
    if isinstance(correlation, RaterCorrelation):
        found.append(f"rank correlation with the marks of {rater}: {_shown(correlation.rank)}")
    return tuple(found) or (_without(standard.separation),)


def _consequences(standard: Standard) -> tuple[str, ...]:
    if not isinstance(standard.chosen, PassMark):
        return (_without(standard.chosen),)
    rates = ((standard.chosen.false_passes, "non-passing", "pass"), (standard.chosen.false_fails, "passing", "fail"))
    found = [
        f"{rate.observed} of {rate.people} people of the {group} group {verb}"
        + ("" if rate.theoretical is None else f"; under its normal curve {100.0 * rate.theoretical.value:.1f} %")
        for rate, group, verb in rates
        if rate.people
    ]
    return tuple(found) or (f"{NO_EVIDENCE}: the mark was held against no group",)


def _shown(each: Estimate) -> str:
    interval = "" if each.low is None or each.high is None else f" [{each.low:.2f}, {each.high:.2f}]"
    return f"{each.value:.2f}{interval}".replace("-", "\u2212")


def _without(told: object) -> str:
    return f"{NO_EVIDENCE}: {getattr(told, 'reason', 'not computed')}"


ALL_RATERS = "all raters"
"""Name under which the mean of the raters' marks is held."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Standard:
    """Pass marks of one metric, and what supports it.

    Attributes
    ----------
    metric, unit : str
        Name of the metric, or "overall_score", and its unit on the cards.
    better : {"higher", "lower"}
        Which values are better.
    series : mapping of str to ndarray
        Values of each operator's cuts, in order; cuts without a value are left out.
    missing : int
        Number of cuts without a value.
    left : mapping of str to tuple of int
        Cuts that were begun and left, by operator: how many cuts with a value stand before each.
    marks : mapping of str to PassMark or NotEstimable
        Pass mark by each method, or the reason why the people give none.
    chosen : PassMark or NotEstimable
        The mark that proficiency is counted by.
    proficiency : mapping of str to Proficiency
        How each operator's cuts meet it; empty without a mark.
    separation : Separation or NotEstimable
        Separation of the groups, the passing one above the other.
    reliability : OneWay or NotEstimable
        Reliability of a single cut and of a person's mean.
    raters : mapping of str to RaterCorrelation or NotEstimable
        Correlation with each rater's marks, and with the mean of all if there are two or more.
    """

    metric: str
    unit: str
    better: Better
    series: Mapping[str, Array]
    missing: int
    left: Mapping[str, tuple[int, ...]]
    marks: Mapping[Method, PassMark | NotEstimable]
    chosen: PassMark | NotEstimable
    proficiency: Mapping[str, Proficiency]
    separation: Separation | NotEstimable
    reliability: OneWay | NotEstimable
    raters: Mapping[str, RaterCorrelation | NotEstimable]


@dataclass(frozen=True, kw_only=True, eq=False)
class StandardSetting(StudiedPeople):
    """Pass marks for a class of people.

    Parameters
    ----------
    name : str
        Name of the class, for pages.
    cuts : sequence of StudiedCut
        The cuts, each operator's in the order in which they were made; with the raters' marks, if there are any.
    left : mapping of str to sequence of int, optional
        Cuts that were begun and left, by operator: how many finished ones stand before each. They pass no mark.
    passing, failing : str, optional
        Group that is to pass, and group that is not; of two groups the other one. Without groups only a teacher's mark
        can be held against the cuts.
    metrics : sequence of str, optional
        "overall_score" and names in :data:`~cutenv.scoring.METRICS` of which one way is better; by default the score
        and the metrics that lead it.
    given : mapping of str to float, optional
        Marks set by a teacher, by metric; in the metric's unit on the card.
    method : str
        Method whose mark proficiency is counted by; a teacher's mark goes before it.
    spread : float
        Distance of the mark from the experts' mean, in their standard deviations.
    in_a_row : int
        Number of consecutive passes that count as proficiency.
    best_mark : {"highest", "lowest"}
        Which end of the raters' scale is best.
    seed : int
        Seed of the bootstrap.

    Attributes
    ----------
    standards : tuple of Standard
        One for each metric that any cut has.
    agreement : RaterAgreement or NotEstimable
        Agreement of the raters with each other.
    notes : tuple of str
        Notes for the reader.

    Raises
    ------
    ValueError
        If there are no cuts, an operator is in two groups, force is in two units, or a name is not known.
    """

    passing: str | None = None
    failing: str | None = None
    metrics: Sequence[str] = ()
    given: Mapping[str, float] = field(default_factory=dict)
    method: Method = "contrasting groups"
    spread: float = SPREAD
    in_a_row: int = IN_A_ROW
    best_mark: str = "highest"
    seed: int = 1
    standards: tuple[Standard, ...] = field(init=False)
    agreement: RaterAgreement | NotEstimable = field(init=False)
    notes: tuple[str, ...] = field(init=False)

    def __post_init__(self) -> None:
        self._check()
        rng = np.random.default_rng(self.seed)
        notes = self._left_note()
        standards = [
            found
            for metric in self._chosen_metrics()
            if (found := self._standard(metric, notes, np.random.default_rng(rng.integers(2**63)))) is not None
        ]
        if not standards:
            raise ValueError(f"no metric could be computed from these cuts: {'; '.join(notes)}.")
        agreement: RaterAgreement | NotEstimable = NotEstimable("nobody rated the cuts")
        if self.raters:
            agreement = told(rater_agreement, self._marks(), [cut.operator for cut in self.cuts], rng=rng)
        object.__setattr__(self, "standards", tuple(standards))
        object.__setattr__(self, "agreement", agreement)
        object.__setattr__(self, "notes", tuple(notes))

    @property
    def raters(self) -> tuple[str, ...]:
        """Names of the raters, in order of appearance."""
        return tuple(dict.fromkeys(rater for cut in self.cuts for rater in cut.marks))

    def _check(self) -> None:
        self._check_cuts("pass marks need", "give")
        one_of("method", self.method, METHODS[:3])
        one_of("best_mark", self.best_mark, ("highest", "lowest"))
        in_range("in_a_row", self.in_a_row, 1, 100, "1")
        in_range("spread", self.spread, 0.1, 4.0, "1", "In standard deviations; 1 or 2 is usual.")
        check_metrics((*self.metrics, *self.given))
        if not self.given or self.passing is not None:
            failing = other_group([*self.group_of.values()], self.passing, self.failing)
            object.__setattr__(self, "failing", failing)

    def _chosen_metrics(self) -> Sequence[str]:
        if self.metrics:
            return tuple(dict.fromkeys((*self.metrics, *self.given)))
        return tuple(dict.fromkeys((OVERALL, *leading_metrics(self.cuts), *self.given)))

    def _marks(self) -> Array:
        return np.array([[cut.marks.get(rater, np.nan) for rater in self.raters] for cut in self.cuts], np.float64)

    def _standard(self, metric: str, notes: list[str], rng: np.random.Generator) -> Standard | None:
        values = self._values(metric, notes, named=metric in (*self.metrics, *self.given))
        if values is None:
            return None
        series = self._series(values)
        better: Better = "higher" if direction_of(metric) == "higher" else "lower"
        groups = [
            [own for operator, own in series.items() if group is not None and self.group_of[operator] == group]
            for group in (self.failing, self.passing)
        ]
        marks = {
            method: self._mark(metric, method, better, groups, rng)
            for method in METHODS
            if method != "set by the teacher" or metric in self.given
        }
        chosen = marks["set by the teacher" if metric in self.given else self.method]
        left = {operator: some for operator, some in self.left_among(metric).items() if operator in series}
        several = [own for own in series.values() if len(own) >= 2]
        few = min(map(len, groups))
        return Standard(
            metric=metric,
            unit=self._unit(metric),
            better=better,
            series=series,
            missing=int(np.isnan(values).sum()),
            marks=marks,
            chosen=chosen,
            proficiency={}
            if isinstance(chosen, NotEstimable)
            else {
                operator: proficiency(
                    *as_shown(metric, own, chosen.mark.value),
                    better=better,
                    in_a_row=self.in_a_row,
                    left=left.get(operator, ()),
                )
                for operator, own in series.items()
            },
            left=left,
            separation=NotEstimable(f"fewer than {FEWEST_COMPARED} people in a group")
            if few < FEWEST_COMPARED
            else told(separation, groups[1], groups[0]),
            reliability=NotEstimable(
                f"fewer than {FEWEST_RELIABLE} people with two cuts or more, and so few often differ by chance"
            )
            if len(several) < FEWEST_RELIABLE
            else told(one_way_reliability, several),
            raters=self._correlations(values, better, rng),
        )

    def _mark(
        self, metric: str, method: Method, better: Better, groups: Sequence[Sequence[Array]], rng: np.random.Generator
    ) -> PassMark | NotEstimable:
        if self.passing is None and method != "set by the teacher":
            return NotEstimable("the table names no group that is to pass")
        failing, passing = (np.array([own.mean() for own in group]) for group in groups)
        given = self.given[metric] if method == "set by the teacher" else None
        return told(pass_mark, failing, passing, method=method, better=better, spread=self.spread, given=given, rng=rng)

    def _correlations(
        self, values: Array, better: Better, rng: np.random.Generator
    ) -> dict[str, RaterCorrelation | NotEstimable]:
        people, table = [cut.operator for cut in self.cuts], self._marks()
        columns = dict(zip(self.raters, table.T, strict=True)) if self.raters else {}
        if len(columns) > 1:
            columns[ALL_RATERS] = mean_mark(table)
        return {
            rater: told(
                rater_correlation,
                values,
                marks,
                people,
                better=better,
                best_mark="highest" if self.best_mark == "highest" else "lowest",
                rng=rng,
            )
            for rater, marks in columns.items()
        }


def check_metrics(names: Sequence[str]) -> None:
    """Raise ValueError if one of the names is no metric, or one of which neither way is better."""
    rewarded = (OVERALL, *(name for name, metric in METRICS.items() if metric.direction != "none"))
    for name in names:
        if name in METRICS and name not in rewarded:
            raise ValueError(f"{name} cannot have a pass mark: neither way is better.")
        one_of("metric", name, rewarded)


def other_group(groups: Sequence[str], passing: str | None, failing: str | None) -> str | None:
    """Return the group that is not to pass: the one named, or of two groups the other; None if there is one group.

    Raises
    ------
    ValueError
        If a name is not among the groups, or it is not clear which group is meant.
    """
    known = tuple(dict.fromkeys(group for group in groups if group))
    if not known and passing is None and failing is None:
        return None
    if passing is None:
        raise ValueError(f"which group is to pass, of {', '.join(known)}? Name it with passing, or give a mark.")
    if not known:
        raise ValueError(f"group {passing!r} is to pass, but the operators have no groups; add a column group.")
    one_of("passing", passing, known)
    others = [group for group in known if group != passing]
    if failing is not None:
        return one_of("failing", failing, others)
    if len(others) > 1:
        raise ValueError(f"which group is not to pass, of {', '.join(others)}? Name it with failing.")
    return others[0] if others else None


def as_shown(metric: str, values: Array, mark: float) -> tuple[Array, float]:
    """Return values and mark as people are shown them: whole scores, and their mark with one decimal."""
    if metric != OVERALL:
        return values, mark
    return np.array([whole_score(value) for value in values.tolist()], np.float64), round(mark, 1)
