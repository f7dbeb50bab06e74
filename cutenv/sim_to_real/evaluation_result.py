"""Evaluation of a policy on a rig beside the simulator, as text and JSON: verdict, differences, control clock."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from cutenv._base.unit_table import shown_unit
from cutenv.report.page import number
from cutenv.report.study_table import three_digits
from cutenv.sim_to_real import Agreement, ClockKept, Finding

EVALUATION_SCHEMA = "cutenv-evaluation/1"
LEADING = (
    "return", "success", "end_agreement", "force_rmse", "force_offset", "position_rmse", "peak_force", "duration",
    "tip_error", "mean_lag",
)  # fmt: skip
"""Measures that the short table always shows; others only if they do not agree."""
_MOST_ROWS = 20  # rows of the short table: a screen
_ROUNDING = 1e-6  # in any unit that is shown
_BARS = 6  # bars of the histogram as text
_LONGEST_BAR = 40  # characters
UNPAIRED = (
    "This rig's specimens are laid by hand, so the two sides cut different specimens: unpaired differences, which "
    "include the spread between specimens. Ends and curves cannot be compared cut by cut."
)


@dataclass(frozen=True, kw_only=True, eq=False)
class Evaluation:
    """Content of an evaluation's report.

    Attributes
    ----------
    policy, rig, specimen_class : str
        Names of policy, rig and class.
    seed : int
        Seed of the specimens.
    agreement : Agreement
        Agreement of the cuts.
    clock : ClockKept
        Timing of the rig's control clock.
    given : mapping of str to float
        Constants identified on the rig and given to the simulator, in SI.
    changed : mapping of str to float
        Constants of an emulated or fake rig that were changed, in SI.
    notes : tuple of str
        Further notes for the reader.
    """

    policy: str
    rig: str
    specimen_class: str
    seed: int
    agreement: Agreement
    clock: ClockKept
    given: Mapping[str, float] = field(default_factory=dict)
    changed: Mapping[str, float] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    @property
    def title(self) -> str:
        """Title of the page."""
        return f"{self.policy} on {self.rig} and in the simulator"

    @property
    def subtitle(self) -> str:
        """Number and kind of the cuts, in words."""
        agreement = self.agreement
        draws = len(agreement.simulator[0])
        return (
            f"{len(agreement.rig)} specimens on the rig, {len(agreement.simulator)} in the simulator, {draws} draws of "
            f"noise each; class {self.specimen_class}, seed {self.seed}"
        )

    @property
    def remarks(self) -> list[str]:
        """Notes, and remarks that follow from the numbers."""
        said = list(self.notes)
        if not self.agreement.paired:
            said.append(UNPAIRED)
        if self.agreement.too_few:
            said.append(
                f"{len(self.agreement.rig)} specimens are too few to establish any difference among so many measures; "
                "take a dozen or more."
            )
        if self.clock.overruns:
            said.append(
                f"{self.clock.overruns} of {len(self.clock.periods)} commands were more than 2 ms late and cost "
                f"{self.clock.skipped:.2f} s: differences may come from this computer."
            )
        said += [f"{name} is not compared: {reason}." for name, reason in self.agreement.untold.items()]
        return said

    def to_json(self) -> str:
        """Return JSON text; units are in the names or beside the numbers."""
        verdict = self.agreement.verdict
        content: dict[str, Any] = {
            "schema": EVALUATION_SCHEMA,
            "policy": self.policy,
            "rig": self.rig,
            "specimen_class": self.specimen_class,
            "seed": self.seed,
            "paired": self.agreement.paired,
            "specimens_rig": len(self.agreement.rig),
            "specimens_simulator": len(self.agreement.simulator),
            "identified_si": dict(self.given),
            "changed_si": dict(self.changed),
            "verdict": vars(verdict),
            "findings": [each.to_dict() for each in self.agreement.findings],
            "not_compared": self.agreement.untold,
            "cuts": [
                {
                    "rig": {"end": cut.end, "return": cut.value, "success": cut.success},
                    **(
                        {"simulator": [{"end": s.end, "return": s.value, "success": s.success} for s in simulated]}
                        if self.agreement.paired
                        else {}
                    ),
                }
                for cut, simulated in zip(self.agreement.rig, self.agreement.simulator, strict=False)
            ],
            "clock": {
                **self.clock.to_dict(),
                "histogram": [{"from_s": low, "to_s": high, "commands": n} for low, high, n in bars(self.clock)],
            },
            "notes": self.remarks,
        }
        return json.dumps(content, indent=1, allow_nan=False)

    def lines(self) -> list[str]:
        """Return the lines of a summary that fits on a screen."""
        agreement = self.agreement
        answers = [each.answer for each in agreement.findings]
        counted = ", ".join(f"{answers.count(each)} {each}" for each in ("agree", "differ", "undecided"))
        shown = [each for each in agreement.findings if each.measure.name in LEADING or each.answer != "agree"]
        lines = [
            self.title,
            self.subtitle,
            "",
            f"verdict: {agreement.verdict}",
            f"  of {len(answers)} measures {counted}",
            "",
            f"{'rig minus simulator':24s} {'unit':5s} {'simulator':>10s} {'rig':>10s}  {'difference [95 %]':29s} "
            f"{'margin':>8s}  answer",
        ]
        lines += [_line(each) for each in shown[:_MOST_ROWS]]
        if len(shown) > _MOST_ROWS:
            lines.append(f"  and {len(shown) - _MOST_ROWS} more; all of them are on the page")
        return [*lines, "", *clock_lines(self.clock), *(f"note: {note}" for note in self.remarks)]


def _line(each: Finding) -> str:
    unit, shift = shown_unit(each.measure.unit), each.shift
    values = [rounded_text(unit.from_si(value)) for value in (each.simulator, each.rig)]
    difference = interval(*map(unit.from_si, (shift.value, shift.low, shift.high)))
    margin = three_digits(unit.from_si(shift.margin))
    return (
        f"{each.measure.name:24s} {unit.sign:5s} {values[0]:>10s} {values[1]:>10s}  {difference:29s} {margin:>8s}  "
        f"{each.answer}"
    )


def rounded_text(value: float) -> str:
    """Return a number with three digits; a rounding error counts as zero."""
    return three_digits(0.0 if abs(value) < _ROUNDING else value)


def interval(value: float, low: float, high: float) -> str:
    """Return a value with its interval, all to the digits of the largest."""
    largest = max(abs(value), abs(low), abs(high))
    digits = 3 if largest == 0.0 else max(0, 2 - int(np.floor(np.log10(largest))))
    digits = min(digits, 6)
    return f"{number(value, digits)} [{number(low, digits)}, {number(high, digits)}]"


def clock_lines(clock: ClockKept) -> list[str]:
    """Return lines on the control clock: a histogram of its periods, quantiles, latency."""
    if not len(clock.periods):
        return ["control clock: no period was measured"]
    lines = [
        f"control clock: {len(clock.periods)} periods of {1e3 * clock.nominal:g} ms, jitter SD "
        f"{1e3 * clock.jitter:.3f} ms, overruns {clock.overruns}, skipped {clock.skipped:.2f} s",
        f"  period  {_quantiles(clock.spread('periods'))}",
        f"  force to command  {_quantiles(clock.spread('latencies'))}",
    ]
    counts = bars(clock)
    most = max(n for _, _, n in counts)
    for low, high, n in counts:
        bar = "#" * max(round(_LONGEST_BAR * n / most), int(n > 0))
        lines.append(f"  {1e3 * low:8.3f} to {1e3 * high:8.3f} ms {n:7d} {bar}".rstrip())
    return lines


def _quantiles(spread: Mapping[str, float]) -> str:
    return ", ".join(f"{name} {1e3 * value:.3f}" for name, value in spread.items()) + " ms" if spread else "unknown"


def bars(clock: ClockKept, most: int = _BARS) -> Sequence[tuple[float, float, int]]:
    """Return the histogram of the control periods: from [s], to [s], count; bins no finer than a microsecond."""
    if not len(clock.periods):
        return []
    low, high = float(clock.periods.min()), float(clock.periods.max())
    middle = 0.5 * (low + high)
    half = max(0.5 * (high - low), 0.5e-6)
    counts, edges = np.histogram(clock.periods, bins=most if half > 0.5e-6 else 1, range=(middle - half, middle + half))
    return [(float(a), float(b), int(n)) for a, b, n in zip(edges, edges[1:], counts, strict=False)]
