"""A check of the thesis: one number beside ours is a row, and a group of rows an entry of the registry."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cutenv.sim.tissue.tables import table

SHOWN = "not a target"  # tolerance of a row that is only shown


@dataclass(frozen=True, kw_only=True)
class Row:
    """One comparison in words: ``agrees`` is None where two numbers are shown and nothing is claimed."""

    what: str
    reference: str
    ours: str
    tolerance: str
    agrees: bool | None


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """Rows that belong together, and their summary in one line; notes name errata, and why a row misses."""

    title: str
    source: str
    ours: str
    tolerance: str
    rows: tuple[Row, ...]
    notes: tuple[str, ...] = ()

    @property
    def misses(self) -> list[Row]:
        """Rows that do not agree."""
        return [row for row in self.rows if row.agrees is False]

    @property
    def claims(self) -> list[Row]:
        """Rows that claim to agree."""
        return [row for row in self.rows if row.agrees is not None]

    @property
    def verdict(self) -> str:
        """Verdict ``agrees``, ``MISS`` or ``shown``, with the number of rows."""
        n, hits = len(self.claims), len(self.claims) - len(self.misses)
        if n == 0:
            return "shown"
        return f"{'MISS' if self.misses else 'agrees'} ({hits}/{n})"


Found = tuple[list[Row], str]  # rows, and the summary of ours in words

Statements = Iterator[Row | tuple[str, Any]]
"""Rows, or what shall hold, in words, and whether it does, for every number of a column."""


@dataclass(frozen=True, kw_only=True)
class Check:
    """An entry of the registry; called with whether to be quick, it returns the :class:`Comparison`.

    ``misses`` are beginnings of the rows that are known to miss (a note says why), ``most_misses`` the number that may
    miss of a quick, random sample. All that are not ``listed`` compare the thesis with itself.
    """

    name: str
    title: str | Callable[[bool], str]
    source: str
    tolerance: str
    found: Callable[[bool], Found]
    notes: tuple[str, ...] = ()
    misses: tuple[str, ...] = ()
    most_misses: int = 0
    listed: bool = True

    def __call__(self, quick: bool) -> Comparison:
        """Compute all rows."""
        rows, ours = self.found(quick)
        title = self.title if isinstance(self.title, str) else self.title(quick)
        return Comparison(
            title=title, source=self.source, ours=ours, tolerance=self.tolerance, rows=tuple(rows), notes=self.notes
        )


def check(
    name: str, title: str | Callable[[bool], str], source: str, tolerance: str, **more: Any
) -> Callable[..., Check]:
    """Make a function of ``quick``, which returns rows and their summary, an entry of the registry."""
    return lambda found: Check(name=name, title=title, source=source, tolerance=tolerance, found=found, **more)


def statement(name: str, title: str, **more: Any) -> Callable[[Callable[[], Statements]], Check]:
    """Make a function that yields statements an entry of the registry that is tested, and not listed on a page."""

    def entry(rows_of: Callable[[], Statements]) -> Check:
        def found(quick: bool) -> Found:
            rows = [each if isinstance(each, Row) else everywhere(*each) for each in rows_of()]
            return rows, f"{hits(rows)} hold"

        return Check(name=name, title=title, source=name, tolerance="statement", found=found, listed=False, **more)

    return entry


def hits(rows: Iterable[Row]) -> str:
    """Return how many of the claimed rows agree, in words."""
    claims = [row for row in rows if row.agrees is not None]
    return f"{sum(row.agrees is True for row in claims)} of {len(claims)}"


def largest_difference(rows: Sequence[Row]) -> str:
    """Return the largest relative difference of the rows that claim to agree, in words."""
    claimed = [row for row in rows if row.agrees is not None] or rows
    return f"within {100 * max(abs(float(row.ours) / float(row.reference) - 1.0) for row in claimed):.1f} %"


def exactly(what: str, reference: float, ours: float) -> Row:
    """Compare two counts."""
    return holds(what, f"{reference:g}", f"{ours:g}", bool(ours == reference), tolerance="exact")


def near(
    what: str,
    reference: float,
    ours: float,
    *,
    relative: float | None = None,
    absolute: float | None = None,
    form: str = ".4g",
) -> Row:
    """Compare a number with its reference within ``relative`` or ``absolute`` tolerance; neither: only shown."""
    difference = abs(ours - reference)
    agrees: bool | None
    if relative is not None:
        tolerance, agrees = f"{100 * relative:.3g} %", bool(difference <= relative * abs(reference))
    elif absolute is not None:
        tolerance, agrees = f"{absolute:.3g}", bool(difference <= absolute * (1 + 1e-9))
    else:
        tolerance, agrees = SHOWN, None
    return Row(
        what=what, reference=format(reference, form), ours=format(ours, form), tolerance=tolerance, agrees=agrees
    )


def unclaimed(row: Row) -> Row:
    """Return the same row without a claim, as for a reference that is an erratum."""
    return replace(row, tolerance=SHOWN, agrees=None)


def refuted(row: Row) -> Row:
    """Return the contrary: a row that agrees where the given one misses."""
    return replace(row, what=f"not so: {row.what}", agrees=row.agrees is False)


def printed_as(what: str, printed: float, ours: float, digit: float) -> Row:
    """Compare a number that shall round to the printed one, whose last digit counts ``digit``."""
    decimals = max(0, len(f"{digit:.6f}".rstrip("0").partition(".")[2]))
    agrees = bool(abs(ours - printed) <= digit / 2 * (1 + 1e-9))
    return holds(what, f"{printed:.{decimals}f}", f"{ours:.{decimals + 2}f}", agrees, tolerance="printed digits")


def at_most(what: str, ours: float, limit: float, *, reference: str = "0") -> Row:
    """Check that a residual is at most ``limit``."""
    return holds(what, reference, f"{ours:.1e}", bool(ours <= limit), tolerance=f"{limit:.0e}")


def holds(what: str, reference: str, ours: str, agrees: bool, *, tolerance: str = "shown") -> Row:
    """Check a statement of the thesis that is true or not."""
    return Row(what=what, reference=reference, ours=ours, tolerance=tolerance, agrees=bool(agrees))


def everywhere(what: str, true: Any) -> Row:
    """Check a statement that shall hold for every number of a column."""
    return holds(what, "everywhere", f"{np.count_nonzero(true)} of {np.size(true)}", bool(np.all(true)))


def equal(what: str, one: Any, other: Any) -> Row:
    """Check that two numbers or columns are equal."""
    return holds(what, f"{one}", f"{other}", np.array_equal(one, other))


def erratum(number: str, words: str) -> Row:
    """Check that the erratum that the rows about it show is kept with its table."""
    return holds(f"erratum: {words}", "kept", "", any(words in text for text in table(number).errata))
