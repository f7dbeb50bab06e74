"""Evaluation of a policy on a rig beside the simulator.

It is text, JSON and page: verdict, differences, control clock.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cutenv._base.result_table import aligned
from cutenv._base.unit_table import shown_unit
from cutenv.agents.sim_to_real import Agreement, ClockKept, ComparedCut, Finding, force_over_position, force_rmse
from cutenv.display.report.page import PHONE_WIDTH, label, new_figure, number, plain_axes, spoken, write_page
from cutenv.display.report.study_page import three_digits, typeset

if TYPE_CHECKING:
    from matplotlib.figure import Figure


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
TWINS = (
    "This rig's specimens are laid by hand. Each was given a twin in the simulator, fitted to the first half of its "
    "record; the second halves are compared. A constant gain of the force cannot be told from a tougher tissue, and "
    "the twin takes it up: check it with known weights ('cutenv rig weigh')."
)


@dataclass(frozen=True, kw_only=True, eq=False)
class Evaluation:
    """Content of an evaluation's report."""

    policy: str  # names of policy, rig and class
    rig: str
    specimen_class: str
    seed: int
    agreement: Agreement
    clock: ClockKept  # timing of the rig's control clock
    given: Mapping[str, float] = field(default_factory=dict)  # identified on the rig, for the simulator; SI
    changed: Mapping[str, float] = field(default_factory=dict)  # of an emulated or fake rig; SI
    notes: tuple[str, ...] = ()  # further notes for the reader

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
        if self.agreement.twins:
            said.append(TWINS)
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
        said += [f"{name} is not compared: {reason}." for name, reason in self.agreement.not_compared.items()]
        return said

    def to_json(self) -> str:
        """Return JSON text with units in names or next to numbers."""
        verdict = self.agreement.verdict
        content: dict[str, Any] = {
            "schema": EVALUATION_SCHEMA,
            "policy": self.policy,
            "rig": self.rig,
            "specimen_class": self.specimen_class,
            "seed": self.seed,
            "paired": self.agreement.paired,
            "twins": self.agreement.twins,
            "specimens_rig": len(self.agreement.rig),
            "specimens_simulator": len(self.agreement.simulator),
            "identified_si": dict(self.given),
            "changed_si": dict(self.changed),
            "verdict": vars(verdict),
            "findings": [each.to_dict() for each in self.agreement.findings],
            "not_compared": self.agreement.not_compared,
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
            *aligned([_HEADS, *(_cells(each) for each in shown[:_MOST_ROWS])]),
        ]
        if len(shown) > _MOST_ROWS:
            lines.append(f"  and {len(shown) - _MOST_ROWS} more; all of them are on the page")
        return [*lines, "", *clock_lines(self.clock), *(f"note: {note}" for note in self.remarks)]


_HEADS = "rig minus simulator", "unit", "simulator", "rig", "difference [95 %]", "margin", "answer"


def _cells(found: Finding) -> list[str]:
    unit, (simulator, rig, shift, _, margin, _, answer) = _shown(found)
    return [found.measure.name, unit, simulator, rig, shift, margin, answer]


def rounded_text(value: float) -> str:
    """Return a number with three digits, rounding errors as zero."""
    return three_digits(0.0 if abs(value) < _ROUNDING else value)


def interval(value: float, low: float, high: float) -> str:
    """Return a value with interval, to the digits of the largest."""
    largest = max(abs(value), abs(low), abs(high))
    digits = 3 if largest == 0.0 else max(0, 2 - int(np.floor(np.log10(largest))))
    digits = min(digits, 6)
    return f"{number(value, digits)} [{number(low, digits)}, {number(high, digits)}]"


def clock_lines(clock: ClockKept) -> list[str]:
    """Return clock lines: histogram of periods, quantiles, latency."""
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
    """Return histogram bars of periods, 1 us or wider: from [s], to [s], count."""
    if not len(clock.periods):
        return []
    low, high = float(clock.periods.min()), float(clock.periods.max())
    middle = 0.5 * (low + high)
    half = max(0.5 * (high - low), 0.5e-6)
    counts, edges = np.histogram(clock.periods, bins=most if half > 0.5e-6 else 1, range=(middle - half, middle + half))
    return [(float(a), float(b), int(n)) for a, b, n in zip(edges, edges[1:], counts, strict=False)]


VERDICT_COLOURS = {"agree": "#0072b2", "differ": "#d55e00", "undecided": "#6b6b6b"}
_MARKERS = {"agree": "o", "differ": "D", "undecided": "s"}
_RIG, _SIMULATOR = "#d55e00", "#0072b2"
_MAX_DRAWN_MARGINS = 4.0  # margins beyond which a difference is drawn at the edge


def in_margins(end: float, margin: float) -> float:
    """Return a difference in margins, at most at the edge; a margin may be 0."""
    return float(
        np.clip(end / margin if margin else np.sign(end) * _MAX_DRAWN_MARGINS, -_MAX_DRAWN_MARGINS, _MAX_DRAWN_MARGINS)
    )


def differences_figure(findings: Sequence[Finding], width: float) -> Figure:
    """Draw every measure's difference with interval, in margins from -1 to 1."""
    phone = width < PHONE_WIDTH
    figure = new_figure(width, 1.2 + (0.34 if phone else 0.26) * len(findings))
    axes = figure.subplots()
    axes.axvspan(-1.0, 1.0, color="0.92", zorder=0)
    axes.axvline(0.0, color="0.6", linewidth=0.8)
    names = [label(spoken(each.measure.name)) for each in findings]
    told: set[str] = set()
    for row, each in enumerate(findings):
        low, value, high = (
            in_margins(end, each.shift.margin) for end in (each.shift.low, each.shift.value, each.shift.high)
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
    axes.set_xlim(-_MAX_DRAWN_MARGINS - 0.1, _MAX_DRAWN_MARGINS + 0.1)
    axes.set_ylim(-len(findings) + 0.4, 0.8)
    axes.set_xlabel("rig minus simulator, in margins, 95 % interval")
    plain_axes(axes, "x")
    figure.legend(loc="outside upper left", ncols=3, frameon=False, fontsize=9)
    return figure


def typical_pair(agreement: Agreement) -> tuple[int, ComparedCut, list[ComparedCut]] | None:
    """Return the specimen of median force difference, with cuts, or None."""
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
    """Draw both sides' force along the way, with the differences below."""
    phone = width < PHONE_WIDTH
    figure = new_figure(width, 5.2 if phone else 4.8)
    panels = figure.subplots(2, 1, sharex=True, height_ratios=[2, 1])
    for draw, each in enumerate(simulated):
        at, force = force_over_position(each.trace)
        name = "simulator, draws of noise" if draw == 0 else None
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
    """Draw histograms of control periods and latencies, logarithmic in count."""
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


_NAMED = 8  # measures named in a sentence
_KINDS = {"agree": ("good", "They agree"), "differ": ("bad", "They differ"), "undecided": ("open", "Undecided")}


def write_evaluation(path: Path, evaluation: Evaluation) -> None:
    """Write an evaluation as one self-contained page (.html).

    Raises ImportError if matplotlib is not installed; the message gives the command that installs it.
    """
    agreement = evaluation.agreement
    kind, word = _KINDS[agreement.verdict.answer]
    write_page(
        path,
        Path(__file__).with_name("evaluation.html"),
        evaluation=evaluation,
        kind=kind,
        word=word,
        headline=evaluation_headline(evaluation),
        findings=[(found, *_shown(found)) for found in agreement.findings],
        pair=typical_pair(agreement) if agreement.paired else None,
        specimens=_specimens(evaluation) if agreement.paired else [],
        bars=bars,
        three_digits=three_digits,
        typeset=typeset,
        clock_figure=clock_figure,
        differences_figure=differences_figure,
        force_figure=force_figure,
    )


def evaluation_headline(evaluation: Evaluation) -> str:
    """Return the verdict as a sentence."""
    agreement = evaluation.agreement
    verdict, measures = agreement.verdict, len(agreement.findings)
    if verdict.answer == "agree":
        return f"All {measures} measures are within their margins: the rig does what the simulator does."
    if verdict.answer == "differ":
        return f"{len(verdict.differ)} of {measures} measures differ: {_listed(verdict.differ)}."
    enough = "more than 1000 specimens" if verdict.needed is None else f"about {verdict.needed} specimens"
    still = f"{len(verdict.open)} of {measures} measures are open, none differs"
    return f"{still}: {_listed(verdict.open)}; {enough} would do."


def _shown(found: Finding) -> tuple[str, list[str]]:
    """Return a finding's unit and table cells, from simulator to answer."""
    unit = shown_unit(found.measure.unit)
    simulator, rig, margin, noise = (
        rounded_text(unit.from_si(value)) for value in (found.simulator, found.rig, found.shift.margin, found.noise)
    )
    shifts = [interval(*map(unit.from_si, (each.value, each.low, each.high))) for each in (found.shift, found.mean)]
    return unit.sign, [simulator, rig, *shifts, margin, noise, found.answer]


def _specimens(evaluation: Evaluation) -> list[tuple[ComparedCut, str, float]]:
    """Return each specimen's rig cut, and simulated ends and mean return."""
    rows = []
    for cut, simulated in zip(evaluation.agreement.rig, evaluation.agreement.simulator, strict=True):
        ends = ", ".join(dict.fromkeys(each.end for each in simulated))
        rows.append((cut, ends, sum(each.value for each in simulated) / len(simulated)))
    return rows


def _listed(names: tuple[str, ...]) -> str:
    more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
    return ", ".join(map(spoken, names[:_NAMED])) + more
