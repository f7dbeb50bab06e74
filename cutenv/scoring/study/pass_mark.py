"""Pass marks: from two groups of people, from the experts alone, or set by a teacher; and how often each errs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.stats import norm

from cutenv._base.arrays import Array
from cutenv._base.validation import in_range, one_of
from cutenv.scoring.study.estimate import BOOTSTRAP_SIZE, FEWEST_PEOPLE, Estimate, over_people, values_of, vanishes

Better = Literal["higher", "lower"]
Method = Literal["contrasting groups", "expert mean", "expert mean and SD", "set by the teacher"]
METHODS: tuple[Method, ...] = get_args(Method)
"""Methods by which a pass mark is found."""
SPREAD = 1.0
"""Default distance of the mark from the experts' mean, in their standard deviations."""
IN_A_ROW = 2
"""Default number of consecutive passes that count as proficiency."""


@dataclass(frozen=True, kw_only=True)
class ErrorRate:
    """Number of people of a group whom a mark judges wrongly.

    Attributes
    ----------
    observed, people : int
        Number of people judged wrongly, and number of people in the group.
    theoretical : Estimate or None
        Share under the group's normal curve, 0 to 1; None if there is no curve.
    no_curve : str
        Reason why there is no curve.
    """

    observed: int
    people: int
    theoretical: Estimate | None
    no_curve: str = ""


@dataclass(frozen=True, kw_only=True)
class PassMark:
    """A pass mark and its errors; every person is one value, the mean of the cuts.

    Attributes
    ----------
    method : str
        One of :data:`METHODS`.
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
    """Mean and standard deviation of a group; arrays of one shape if there are several."""

    mean: Array
    sd: Array


def crossing(failing: NormalCurve, passing: NormalCurve) -> Array:
    """Return where two normal curves of equal area cross between their means; NaN where they do not.

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
    """Find a pass mark, its interval, and its observed and theoretical false passes and false fails.

    Parameters
    ----------
    failing, passing : array_like of shape (n,)
        A value for each person of the non-passing and of the passing group; one unit. A group may be empty where the
        method does not need it.
    method : str
        "contrasting groups": where the groups' normal curves cross; "expert mean": mean of the passing group; "expert
        mean and SD": that mean, less (or, if lower is better, plus) ``spread`` standard deviations; "set by the
        teacher": ``given``.
    better : {"higher", "lower"}
        Which values are better.
    spread : float
        Number of standard deviations, 0.1 to 4.
    given : float, optional
        The teacher's mark; for that method only.
    rng : numpy.random.Generator
        Source of the resamples.

    Returns
    -------
    PassMark

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
    """Count a person's passes, and find the cut that completes the wanted number of passes in a row.

    Parameters
    ----------
    values : array_like of shape (n,)
        Values of the person's cuts, in their order; n is 1 or more.
    mark : float
        The mark, in the unit of the values.
    better : {"higher", "lower"}
        Which values are better.
    in_a_row : int
        Number of consecutive passes that count as proficiency, 1 to 100.
    left : sequence of int
        How many of the values stand before each cut that was begun and left.

    Returns
    -------
    Proficiency

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
    """Return curves of the people (first) and of their resamples; NaN where a group is too small for one."""
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
    """Return a group's errors at this very mark; ``wrong`` is 1 if the group errs by passing, -1 if by failing."""
    passed = passes(values, mark, "higher" if sign > 0.0 else "lower")
    observed = int(passed.sum()) if wrong > 0.0 else len(values) - int(passed.sum())
    shares = np.asarray(norm.sf(wrong * sign * (mark - curve.mean) / curve.sd))
    if np.isnan(shares[0]):
        few = f"fewer than {FEWEST_PEOPLE} people" if len(values) < FEWEST_PEOPLE else "nobody differs"
        return ErrorRate(observed=observed, people=len(values), theoretical=None, no_curve=few)
    theoretical = over_people(float(shares[0]), shares[1:], len(values))
    return ErrorRate(observed=observed, people=len(values), theoretical=theoretical)
