"""Pass marks, their error rates, and evidence for them.

A pass mark is found from two groups of people, from the experts alone, or set by a teacher. A class of people is held
against pass marks and raters; what supports them is Messick's five sources of validity.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.stats import norm

from cutenv._base.arrays import Array
from cutenv._base.validation import in_range, one_of
from cutenv.records.scoring.cut_metrics import METRICS
from cutenv.records.scoring.score_card import whole_score
from cutenv.records.scoring.study.estimate import (
    BOOTSTRAP_SIZE,
    FEWEST_COMPARED,
    FEWEST_PEOPLE,
    FEWEST_RELIABLE,
    Estimate,
    over_people,
    values_of,
    vanishes,
)
from cutenv.records.scoring.study.reliability import (
    OneWay,
    RaterAgreement,
    RaterCorrelation,
    mean_mark,
    one_way_reliability,
    rater_agreement,
    rater_correlation,
)
from cutenv.records.scoring.study.separation import Separation, separation
from cutenv.records.scoring.study.study import (
    OVERALL,
    NotEstimable,
    StudiedPeople,
    direction_of,
    if_estimable,
    leading_metrics,
)

Better = Literal["higher", "lower"]
Method = Literal["contrasting groups", "expert mean", "expert mean and SD", "set by the teacher"]
METHODS: tuple[Method, ...] = get_args(Method)  # methods by which a pass mark is found
SPREAD = 1.0  # default distance of the mark from the experts' mean, in their standard deviations
IN_A_ROW = 2  # default number of consecutive passes that count as proficiency


@dataclass(frozen=True, kw_only=True)
class ErrorRate:
    """Number of people in a group judged wrongly by a mark.

    Attributes
    ----------
    observed, people : int
        Number of people judged wrongly, and number of people in the group.
    theoretical : Estimate or None
        Share under the group's normal curve, 0 to 1; None if there is no curve.
    """

    observed: int
    people: int
    theoretical: Estimate | None
    no_curve: str = ""


@dataclass(frozen=True, kw_only=True)
class PassMark:
    """A pass mark and its errors.

    Every person is one value, the mean of the cuts.

    Attributes
    ----------
    mark : Estimate
        The mark; who reaches it passes. In the unit of the values.
    false_passes : ErrorRate
        People of the non-passing group who pass.
    false_fails : ErrorRate
        People of the passing group who fail.
    """

    method: Method
    mark: Estimate
    false_passes: ErrorRate
    false_fails: ErrorRate


@dataclass(frozen=True, kw_only=True)
class Proficiency:
    """Passes of a person's cuts.

    Attributes
    ----------
    cuts, passes, longest : int
        Number of cuts, of passes, and of passes in the longest row; a cut that was left is one without a pass.
    left : int
        Number of cuts that were begun and left, among them.
    reached_at : int or None
        Number of the cut, from 1, that completes the first row of the wanted length; None if there is none.
    """

    cuts: int
    passes: int
    longest: int
    reached_at: int | None
    left: int = 0


class NormalCurve(NamedTuple):
    """Mean and standard deviation of a group, or of several as arrays."""

    mean: Array
    sd: Array


def crossing(failing: NormalCurve, passing: NormalCurve) -> Array:
    """Return where two normal curves cross between means, or NaN.

    Each curve is higher at its own mean only if the curves are far enough apart for their spreads; then they cross
    once between the means. Closed form: the logarithms of the densities are equal at the root of a quadratic.
    """
    d = passing.mean - failing.mean
    with np.errstate(divide="ignore", invalid="ignore"):
        spreads = np.log(passing.sd / failing.sd)
        at_failing = 0.5 * (d / passing.sd) ** 2 + spreads  # logarithm of the curves' ratio at the first mean
        at_passing = -0.5 * (d / failing.sd) ** 2 + spreads  # and at the second
        A, B = 0.5 * d**2 * (passing.sd**-2.0 - failing.sd**-2.0), -((d / passing.sd) ** 2)
        u = 2.0 * at_failing / (-B + np.sqrt(B**2 - 4.0 * A * at_failing))
        return np.asarray(np.where((at_failing > 0.0) & (at_passing < 0.0), failing.mean + d * u, np.nan))


def pass_mark(
    failing: ArrayLike,
    passing: ArrayLike,
    *,
    method: Method = "contrasting groups",
    better: Better = "higher",
    spread: float = SPREAD,
    given: float | None = None,
    rng: np.random.Generator,
) -> PassMark:
    """Find a pass mark, its interval and error rates.

    Parameters
    ----------
    failing, passing : array_like of shape (n,)
        A value for each person of the non-passing and of the passing group; one unit. A group may be empty where the
        method does not need it.
    method : str
        "contrasting groups": where the groups' normal curves cross; "expert mean": mean of the passing group; "expert
        mean and SD": that mean, less (or, if lower is better, plus) ``spread`` standard deviations; "set by the
        teacher": ``given``.
    spread : float
        Number of standard deviations, 0.1 to 4.
    given : float, optional
        The teacher's mark; for that method only.

    Raises
    ------
    TypeError, ValueError
        If an argument is out of range, or the people give no evidence for a mark; the message says why.

    Notes
    -----
    Contrasting groups with theoretical errors: Jorgensen, Konge & Subhi, Advances in Simulation 3 (2018) 5, doi
    10.1186/s41077-018-0064-7. Resamples are drawn within each group, so the groups keep their sizes.
    """
    one_of("method", method, METHODS)
    sign = {"higher": 1.0, "lower": -1.0}[one_of("better", better, get_args(Better))]
    k = in_range("spread", spread, 0.1, 4.0, "1", "In standard deviations; 1 or 2 is usual.")
    groups = [values_of("failing", failing, fewest=0), values_of("passing", passing, fewest=0)]
    if (given is None) == (method == "set by the teacher"):
        raise ValueError(f"given = {given} does not go with the method {method!r}: a teacher's mark needs it.")
    if method == "contrasting groups":
        _check_contrast(groups[0], groups[1], sign)
    elif method != "set by the teacher" and len(groups[1]) < FEWEST_PEOPLE:
        raise ValueError(f"fewer than {FEWEST_PEOPLE} people in the passing group ({len(groups[1])})")
    elif method == "expert mean and SD" and vanishes(float(groups[1].std(ddof=1)) ** 2, groups[1]):
        raise ValueError("nobody differs in the passing group, so it has no curve")
    # The first row is the people themselves; the others are resamples of them.
    curves = [_curves(values, rng) for values in groups]
    marks = _marks(method, curves, sign, k, given)
    mark = float(marks[0])
    sizes = {"contrasting groups": min(map(len, groups)), "set by the teacher": 0}.get(method, len(groups[1]))
    return PassMark(
        method=method,
        mark=Estimate(value=mark) if given is not None else over_people(mark, marks[1:], sizes),
        false_passes=_errors(groups[0], curves[0], mark, sign, wrong=1.0),
        false_fails=_errors(groups[1], curves[1], mark, sign, wrong=-1.0),
    )


def passes(values: Array, mark: float, better: Better) -> NDArray[np.bool_]:
    """Return which values reach a mark; the mark itself does."""
    return np.asarray(values >= mark if better == "higher" else values <= mark)


def proficiency(
    values: ArrayLike, mark: float, *, better: Better, in_a_row: int = IN_A_ROW, left: Sequence[int] = ()
) -> Proficiency:
    """Count a person's passes, and find the cut that completes proficiency.

    Parameters
    ----------
    values : array_like of shape (n,)
        Values of the person's cuts, in their order; n is 1 or more.
    in_a_row : int
        Number of consecutive passes that count as proficiency, 1 to 100.
    left : sequence of int
        How many of the values stand before each cut that was begun and left.

    Raises
    ------
    TypeError, ValueError
        If an argument is out of range.
    """
    wanted = int(in_range("in_a_row", in_a_row, 1, 100, "1"))
    reached = np.insert(passes(values_of("values", values, fewest=1), mark, better), list(left), False)
    row, longest, at = 0, 0, None
    for number, passed in enumerate(reached, 1):
        row = row + 1 if passed else 0
        longest = max(longest, row)
        if row == wanted and at is None:
            at = number
    return Proficiency(cuts=len(reached), passes=int(reached.sum()), longest=longest, reached_at=at, left=len(left))


def _check_contrast(failing: Array, passing: Array, sign: float) -> None:
    few = min(len(failing), len(passing))
    if few < FEWEST_PEOPLE:
        raise ValueError(f"fewer than {FEWEST_PEOPLE} people in a group ({len(failing)} and {len(passing)})")
    for name, values in (("non-passing", failing), ("passing", passing)):
        if vanishes(float(values.var(ddof=1)), values):
            raise ValueError(f"nobody differs in the {name} group, so it has no curve")
    first, second = (NormalCurve(values.mean(), values.std(ddof=1)) for values in (failing, passing))
    if sign * (second.mean - first.mean) <= 0.0:
        raise ValueError("the groups stand in the wrong order: the passing one is no better")
    if np.isnan(crossing(first, second)):
        raise ValueError("the groups overlap wholly: no mark between their means parts them")


def _curves(values: Array, rng: np.random.Generator) -> NormalCurve:
    """Return normal curves of people (first) and resamples, else NaN."""
    n = len(values)
    if n < FEWEST_PEOPLE:
        mean = float(values.mean()) if n else np.nan
        return NormalCurve(np.full(BOOTSTRAP_SIZE + 1, mean), np.full(BOOTSTRAP_SIZE + 1, np.nan))
    drawn = np.vstack([values, values[rng.integers(n, size=(BOOTSTRAP_SIZE, n))]])
    sd = drawn.std(axis=1, ddof=1)
    return NormalCurve(drawn.mean(axis=1), np.where(sd > 0.0, sd, np.nan))


def _marks(method: Method, curves: Sequence[NormalCurve], sign: float, spread: float, given: float | None) -> Array:
    failing, passing = curves
    if method == "contrasting groups":
        right = sign * (passing.mean - failing.mean) > 0.0
        return np.where(right, crossing(failing, passing), np.nan)
    if method == "expert mean":
        return passing.mean
    if method == "expert mean and SD":
        return passing.mean - sign * spread * passing.sd
    return np.full(len(passing.mean), given, np.float64)


def _errors(values: Array, curve: NormalCurve, mark: float, sign: float, wrong: float) -> ErrorRate:
    """Return a group's error rate at a mark.

    ``wrong`` is 1 if the group errs by passing, -1 if by failing.
    """
    passed = passes(values, mark, "higher" if sign > 0.0 else "lower")
    observed = int(passed.sum()) if wrong > 0.0 else len(values) - int(passed.sum())
    shares = np.asarray(norm.sf(wrong * sign * (mark - curve.mean) / curve.sd))
    if np.isnan(shares[0]):
        few = f"fewer than {FEWEST_PEOPLE} people" if len(values) < FEWEST_PEOPLE else "nobody differs"
        return ErrorRate(observed=observed, people=len(values), theoretical=None, no_curve=few)
    theoretical = over_people(float(shares[0]), shares[1:], len(values))
    return ErrorRate(observed=observed, people=len(values), theoretical=theoretical)


NO_EVIDENCE = "no evidence"


@dataclass(frozen=True)
class ValidityEvidence:
    """One source of validity."""

    source: str
    question: str
    found: tuple[str, ...]  # a sentence each

    @property
    def is_there(self) -> bool:
        """True if the data say anything about this source."""
        return not self.found[0].startswith(NO_EVIDENCE)


def validity_evidence(setting: StandardSetting) -> tuple[ValidityEvidence, ...]:
    """Return evidence for each of Messick's sources of validity.

    Messick, American Psychologist 50 (1995) 741-749, doi 10.1037/0003-066X.50.9.741. Evidence is no verdict: whether it
    is enough for a use is for the people who use it to judge.
    """
    first = setting.standards[0]
    sources = (
        (
            "Content",
            "Do the cuts stand for the task that is to be learned?",
            (f"{NO_EVIDENCE}: experts judge this, and no number of these cuts does",),
        ),
        ("Response process", "Do the records hold what the people did?", _records(setting, first)),
        ("Internal structure", "Would the same people get the same again?", _same(setting, first)),
        (
            "Relations to other variables",
            "Does the number go with experience, and with what raters see?",
            _relations(setting, first),
        ),
        ("Consequences", "Whom does the pass mark judge wrongly?", _consequences(first)),
    )
    return tuple(ValidityEvidence(source, question, found) for source, question, found in sources)


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


ALL_RATERS = "all raters"  # name under which the mean of the raters' marks is held


@dataclass(frozen=True, kw_only=True, eq=False)
class Standard:
    """Pass marks of one metric, and what supports it.

    Attributes
    ----------
    series : mapping of str to ndarray
        Values of each operator's cuts, in order; cuts without a value are left out.
    left : mapping of str to tuple of int
        Cuts that were begun and left, by operator: how many cuts with a value stand before each.
    marks : mapping of str to PassMark or NotEstimable
        Pass mark by each method, or the reason why the people give none.
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
    cuts : sequence of StudiedCut
        The cuts, each operator's in the order in which they were made; with the raters' marks, if there are any.
    left : mapping of str to sequence of int, optional
        Cuts that were begun and left, by operator: how many finished ones stand before each. They pass no mark.
    passing, failing : str, optional
        Group that is to pass, and group that is not; of two groups the other one. Without groups only a teacher's mark
        can be held against the cuts.
    metrics : sequence of str, optional
        "overall_score" and names in :data:`~cutenv.records.scoring.METRICS` of which one way is better; by default the
        score and the metrics that lead it.
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

    Attributes
    ----------
    standards : tuple of Standard
        One for each metric that any cut has.
    agreement : RaterAgreement or NotEstimable
        Agreement of the raters with each other.

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
            agreement = if_estimable(rater_agreement, self._marks(), [cut.operator for cut in self.cuts], rng=rng)
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
            else if_estimable(separation, groups[1], groups[0]),
            reliability=NotEstimable(
                f"fewer than {FEWEST_RELIABLE} people with two cuts or more, and so few often differ by chance"
            )
            if len(several) < FEWEST_RELIABLE
            else if_estimable(one_way_reliability, several),
            raters=self._correlations(values, better, rng),
        )

    def _mark(
        self, metric: str, method: Method, better: Better, groups: Sequence[Sequence[Array]], rng: np.random.Generator
    ) -> PassMark | NotEstimable:
        if self.passing is None and method != "set by the teacher":
            return NotEstimable("the table names no group that is to pass")
        failing, passing = (np.array([own.mean() for own in group]) for group in groups)
        given = self.given[metric] if method == "set by the teacher" else None
        return if_estimable(
            pass_mark, failing, passing, method=method, better=better, spread=self.spread, given=given, rng=rng
        )

    def _correlations(
        self, values: Array, better: Better, rng: np.random.Generator
    ) -> dict[str, RaterCorrelation | NotEstimable]:
        people, table = [cut.operator for cut in self.cuts], self._marks()
        columns = dict(zip(self.raters, table.T, strict=True)) if self.raters else {}
        if len(columns) > 1:
            columns[ALL_RATERS] = mean_mark(table)
        return {
            rater: if_estimable(
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
    """Raise ValueError for names of no metric, or without direction."""
    rewarded = (OVERALL, *(name for name, metric in METRICS.items() if metric.direction != "none"))
    for name in names:
        if name in METRICS and name not in rewarded:
            raise ValueError(f"{name} cannot have a pass mark: neither way is better.")
        one_of("metric", name, rewarded)


def other_group(groups: Sequence[str], passing: str | None, failing: str | None) -> str | None:
    """Return the non-passing group, named or the other of two."""
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
    """Return values and mark as shown to people, rounded.

    Scores are whole, and their mark has one decimal.
    """
    if metric != OVERALL:
        return values, mark
    return np.array([whole_score(value) for value in values.tolist()], np.float64), round(mark, 1)
