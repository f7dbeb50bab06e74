"""One number of the thesis beside ours, and a group of them."""

from __future__ import annotations

from dataclasses import dataclass, replace

SHOWN = "not a target"
"""Tolerance of a row that is only shown."""


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
    """Rows that belong together, and their summary in one line.

    Attributes
    ----------
    title, source : str
        Subject of the comparison, and its reference: table, equation, figure or section.
    ours, tolerance : str
        Summary of all rows.
    rows : tuple of Row
    notes : tuple of str
        Errata that were taken into account, and reasons why a row misses.
    """

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


def hits(rows: list[Row]) -> str:
    """Return how many of the claimed rows agree, in words."""
    claims = [row for row in rows if row.agrees is not None]
    return f"{sum(row.agrees is True for row in claims)} of {len(claims)}"


def exactly(what: str, reference: float, ours: float) -> Row:
    """Compare two counts."""
    return Row(
        what=what, reference=f"{reference:g}", ours=f"{ours:g}", tolerance="exact", agrees=bool(ours == reference)
    )


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


def printed_as(what: str, printed: float, ours: float, digit: float) -> Row:
    """Compare a number that shall round to the printed one, whose last digit counts ``digit``."""
    decimals = max(0, len(f"{digit:.6f}".rstrip("0").partition(".")[2]))
    return Row(
        what=what,
        reference=f"{printed:.{decimals}f}",
        ours=f"{ours:.{decimals + 2}f}",
        tolerance="printed digits",
        agrees=bool(abs(ours - printed) <= digit / 2 * (1 + 1e-9)),
    )


def at_most(what: str, ours: float, limit: float, *, reference: str = "0") -> Row:
    """Check that a residual is at most ``limit``."""
    return Row(what=what, reference=reference, ours=f"{ours:.1e}", tolerance=f"{limit:.0e}", agrees=bool(ours <= limit))


def holds(what: str, reference: str, ours: str, agrees: bool, *, tolerance: str = "shown") -> Row:
    """Check a statement of the thesis that is true or not."""
    return Row(what=what, reference=reference, ours=ours, tolerance=tolerance, agrees=bool(agrees))
