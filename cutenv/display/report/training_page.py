"""Page of a training run: agent beside scripts, on held-out specimens."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from cutenv._base.result_table import ResultTable
from cutenv.display.report.page import LIMITS, MEANINGS, further_meanings, number, term_meanings, write_page
from cutenv.display.report.record_figure import cut_figure, floor_figure, mean_depth_error_mm
from cutenv.display.report.training_result import (
    SPECIMEN_CLASS,
    CutPicture,
    Score,
    TrainingResult,
    comparison_table,
    costs_figure,
    curve_figure,
    differences_table,
    outcome,
    returns_figure,
)
from cutenv.task.reward import GAINS

__all__ = ["CutPicture", "TrainingResult", "training_headline", "write_training_page"]

_PALE, _DEEP = (0xF1, 0xF6, 0xFA), (0x00, 0x5A, 0x94)  # ends of the grid's colours
_SHOWN_COST = 5e-4  # a smaller one is a bar without length


def write_training_page(path: Path, result: TrainingResult) -> None:
    """Write a training run's page as one self-contained file.

    Parameters
    ----------
    path : Path
        Path of the page (.html), in a folder that exists; an older one is replaced as a whole.

    Raises
    ------
    ImportError
        If matplotlib is not installed; the message gives the command that installs it.
    """
    grid = result.grid
    write_page(
        path,
        "training.html",
        *(returns_figure, costs_figure, cut_figure, floor_figure, mean_depth_error_mm, curve_figure),
        result=result,
        headline=training_headline(result),
        stronger=_stronger_scripts(result),
        comparison=_comparison(result),
        differences=differences_table(result.differences_by_return(), "Mean paired differences with 95 % intervals"),
        bars=[result.bar(policy, "return") for policy in result.policies],
        best=max(grid, key=lambda row: float(row["mean"]), default=None),
        grid_heads=[("speed", "cm/s"), *(f"{angle:g}\u00b0" for angle in sorted({row["angle_deg"] for row in grid}))],
        shade=partial(grid_shade, [row["mean"] for row in grid]),
        meanings=(*MEANINGS, *further_meanings(one.name for one in result.columns)),
        limits=LIMITS,
        **_costs(result),
    )


def training_headline(result: TrainingResult) -> tuple[str, str, str]:
    """Return whether the agent beats the scripts: class, words, sentences.

    The class is good, bad or open. The paired difference of return decides, and only if its 95 % interval excludes 0.
    An agent that does not beat the script which taught it may still beat all others: then this comes first, and the
    comparison with its teacher second.
    """
    best, rival = result.best_script, result.rival_script
    tried = f"Over {_difference(result, best)['cuts']:.0f} held-out specimens of class {result.facts[SPECIMEN_CLASS]}, "
    kind = outcome(_difference(result, best))
    if kind != "good" and rival is not None and outcome(_difference(result, rival)) == "good":
        word = "Better than every script but its teacher"
        claim = f"{result.agent} beats {rival}, the best script that did not teach it"
        against = {"bad": "It does not beat", "open": "It is level with"}[kind]
        taught = f" {against} its teacher ({best}): there, {_compared(result, best)}."
        return "good", word, f"{claim}. {tried}{_compared(result, rival)}.{taught}{_left(result)}"
    script = f"the best script ({best})"
    word, claim = {
        "good": ("Better than the best script", f"{result.agent} beats {script}"),
        "bad": ("Not better than the best script", f"{result.agent} does not beat {script}"),
        "open": ("Undecided", f"Whether {result.agent} beats {script} is open"),
    }[kind]
    return kind, word, f"{claim}. {tried}{_compared(result, best)}.{_left(result)}"


def _difference(result: TrainingResult, script: str) -> Mapping[str, Any]:
    difference = result.difference(script, "return")
    assert difference is not None, "a TrainingResult refuses to be without"
    return difference


def _compared(result: TrainingResult, script: str) -> str:
    """Return paired differences from a script in words: return, success."""
    difference = _difference(result, script)
    mean, low, high = (float(difference[name]) for name in ("mean", "low_95", "high_95"))
    words = {
        "good": f"is higher by {_interval(mean, low, high)}",
        "bad": f"is lower by {_interval(-mean, -high, -low)}",
        "open": f"differs by {_interval(mean, low, high)}, an interval that holds 0",
    }
    return f"its return {words[outcome(difference)]}{_succeeded(result, script)}"


def _interval(mean: float, low: float, high: float) -> str:
    """Return a paired difference in words, its interval's ends distinct from 0."""
    digits = next((n for n in range(2, 7) if all(round(end, n) for end in (low, high) if end)), 7)
    return f"{number(mean, digits)} (95\u00a0% interval {number(low, digits)} to {number(high, digits)})"


def _succeeded(result: TrainingResult, script: str) -> str:
    """Return in words how success differs from a script's, if known."""
    difference = result.difference(script, "success")
    if difference is None:
        return ""
    how, sign = ("more", 100.0) if difference["mean"] >= 0.0 else ("less", -100.0)
    mean, *ends = (sign * float(difference[name]) for name in ("mean", "low_95", "high_95"))
    low, high = (number(min(max(end, -100.0), 100.0), 1) for end in sorted(ends))
    return f"; it succeeds {number(mean, 1)} points {how} often (95\u00a0% interval {low} to {high})"


def _left(result: TrainingResult) -> str:
    """Return a sentence on the gap to any bound."""
    if result.bound is None:
        return ""
    most, paired = result.score(result.bound, "return"), result.difference(result.bound, "return")
    gap = float(most["mean"] - result.score(result.agent, "return")["mean"]) if paired is None else -paired["mean"]
    if gap <= 0.0:
        return f" Nothing is left to the upper bound ({result.bound}), which gets {number(most['mean'], 2)}."
    bound = f"the upper bound ({result.bound}) gets {number(most['mean'], 2)}"
    return f" On {most['cuts']:.0f} of them {bound}, {number(gap, 2)} more than the agent."


def _comparison(result: TrainingResult) -> ResultTable:
    cuts = result.score(result.agent, "return")["cuts"]
    caption = f"Means over {cuts:.0f} held-out specimens, with 95 % intervals"
    return comparison_table(result.summary, result.columns, caption, result.agent)


def _stronger_scripts(result: TrainingResult) -> list[str]:
    """Return policies that got more than the headline's script."""
    others = [policy for policy in result.policies if result.role(policy) == "other"]
    least = result.score(result.best_script, "return")["mean"]
    return [policy for policy in others if result.score(policy, "return")["mean"] > least]


def _costs(result: TrainingResult) -> dict[str, Any]:
    """Return the reward's costs, largest first, with bars, and all terms."""
    policies, titles = result.compared(), term_meanings()
    costs = [term for term in result.terms() if term not in GAINS]
    largest = {term: max(result.bar(policy, f"reward_{term}", -1.0).mean for policy in policies) for term in costs}
    shown = [term for term in sorted(costs, key=lambda term: -largest[term]) if largest[term] >= _SHOWN_COST]
    unpaid = [term for term in costs if term not in shown]
    bars = [[result.bar(policy, f"reward_{term}", -1.0) for term in shown] for policy in policies]
    earned = [term for term in result.terms() if term in GAINS]
    terms = [(titles[term], Score(f"reward_{term}", "", "", 3)) for term in (*earned, *shown, *unpaid)]
    terms.append(("return", Score("return", "", "", 3)))
    return {
        "costs": [titles[term] for term in shown],
        "unpaid": [titles[term] for term in unpaid],
        "cost_bars": bars,
        "dearest": [f"{own[0].policy} {own[0].mean:.2f}" for own in bars if own],
        "terms": [(title, [score.cell(result.score(p, score.name)) for p in policies]) for title, score in terms],
    }


def grid_shade(means: Sequence[float], mean: float) -> str:
    """Return a cell's colours among all cells, as a style."""
    lowest, best = min(means), max(means)
    share = (mean - lowest) / (best - lowest) if best > lowest else 0.0
    colour = [round(pale + share * (deep - pale)) for pale, deep in zip(_PALE, _DEEP, strict=True)]
    ink = "#fff" if _luminance(colour) < 0.179 else "#000"  # where both have the same contrast
    return f"background:#{bytes(colour).hex()};color:{ink}"


def _luminance(colour: Sequence[int]) -> float:
    """Return the relative luminance of an sRGB colour by WCAG 2."""
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in (v / 255.0 for v in colour)]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]
