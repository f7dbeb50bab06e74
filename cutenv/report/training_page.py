"""Page of a training run: the agent's results beside scripts, on specimens that it has never seen."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from cutenv._base.arrays import StructArray
from cutenv.report.cut_figure import cut_figure
from cutenv.report.glossary import LIMITS, MEANINGS, TERM_MEANINGS
from cutenv.report.page import (
    Html,
    PageSection,
    Row,
    definitions,
    element,
    escaped,
    estimate_text,
    folded,
    html_table,
    joined,
    number,
    page,
    paragraph,
    picture,
    write_page,
)
from cutenv.report.training_figures import costs_figure, curve_figure, heat_map, returns_figure
from cutenv.report.training_result import (
    COLUMNS,
    DIFFERENCES,
    SPECIMEN_CLASS,
    CutPicture,
    Score,
    TrainingResult,
)

__all__ = ["CutPicture", "TrainingResult", "training_headline", "write_training_page"]

_SHOWN_COST = 5e-4  # a smaller one is a bar without length


def write_training_page(path: Path, result: TrainingResult) -> None:
    """Write the page of a training run as one self-contained file.

    Parameters
    ----------
    path : Path
        Path of the page (.html), in a folder that exists; an older one is replaced as a whole.
    result : TrainingResult
        Result to write.

    Raises
    ------
    ImportError
        If matplotlib is not installed; the message gives the command that installs it.
    """
    sections = [
        PageSection("comparison", "Agent and scripts", _comparison(result)),
        PageSection("differences", "Agent minus each baseline", _differences(result)),
        PageSection("costs", "Where the reward goes", _costs(result)),
        PageSection("grid", "Constant feed at every speed and angle", _grid(result)),
        PageSection("cuts", "A cut above its force trace", _cuts(result)),
        PageSection("curve", "Learning curve", _curve(result)),
        PageSection("meaning", "What the numbers mean", _meaning()),
        PageSection("facts", "Facts of the run", definitions(list(result.facts.items()), "facts")),
    ]
    write_page(path, page(result.title, result.subtitle, _lead(result), sections))


def training_headline(result: TrainingResult) -> tuple[str, str, str]:
    """Return whether the agent beats the best script: a class (good, bad, open), a few words, and sentences.

    The paired difference of return decides, and only if its 95 % interval excludes 0.
    """
    difference = result.difference(result.best_script, "return")
    assert difference is not None, "a TrainingResult refuses to be without"
    mean, low, high = (float(difference[name]) for name in ("mean", "low_95", "high_95"))
    script = f"the best script ({result.best_script})"
    tried = f"Over {difference['cuts']:.0f} held-out specimens of class {result.facts[SPECIMEN_CLASS]}, "
    if low > 0.0:
        kind, word, claim = "good", "Better than the best script", f"{result.agent} beats {script}"
        tried += f"its return is higher by {_interval(mean, low, high)}"
    elif high < 0.0:
        kind, word, claim = "bad", "Not better than the best script", f"{result.agent} does not beat {script}"
        tried += f"its return is lower by {_interval(-mean, -high, -low)}"
    else:
        kind, word = "open", "Undecided"
        claim = f"Whether {result.agent} beats {script} is open"
        tried += f"its return differs by {_interval(mean, low, high)}, an interval that holds 0"
    own, other = (number(100.0 * result.score(name, "success")["mean"], 0) for name in result.compared()[:2])
    return kind, word, f"{claim}. {tried}; {own}\u00a0% of its cuts succeed, against {other}\u00a0%.{_left(result)}"


def _interval(mean: float, low: float, high: float) -> str:
    """Return a paired difference in words, with as many digits as keep the interval's ends apart from 0."""
    digits = next((n for n in range(2, 7) if all(round(end, n) for end in (low, high) if end)), 7)
    return f"{number(mean, digits)} (95\u00a0% interval {number(low, digits)} to {number(high, digits)})"


def _left(result: TrainingResult) -> str:
    """Return a sentence on the gap to the bound; "" without a bound."""
    if result.bound is None:
        return ""
    own, most = (float(result.score(policy, "return")["mean"]) for policy in (result.agent, result.bound))
    if own >= most:
        return f" Nothing is left to the upper bound ({result.bound}), which gets {number(most, 2)}."
    gap = f"{number(own, 2)} against {number(most, 2)}"
    return f" The gap to the upper bound ({result.bound}) is {number(most - own, 2)}: {gap}."


def _lead(result: TrainingResult) -> Html:
    kind, word, sentences = training_headline(result)
    return Html(
        f'<div class="verdict {kind}">\n{paragraph(word, "word")}\n{paragraph(sentences, "headline")}\n'
        f"{_stronger_scripts(result)}</div>"
    )


def _stronger_scripts(result: TrainingResult) -> Html:
    """Return a note on other policies that got more than the script named in the headline."""
    others = [policy for policy in result.policies if result.role(policy) == "other"]
    least = result.score(result.best_script, "return")["mean"]
    above = [policy for policy in others if result.score(policy, "return")["mean"] > least]
    if not above:
        return Html("")
    return paragraph(f"On these specimens {', '.join(above)} got more than {result.best_script}: see the comparison.")


def _named(result: TrainingResult, policy: str) -> Html:
    """Return a policy's name with its role."""
    chips = {"agent": "learned", "script": "best script", "bound": "upper bound: sees hidden state"}
    role = result.role(policy)
    chip = f' <span class="chip">{chips[role]}</span>' if role in chips else ""
    return Html(f"{escaped(policy)}{chip}")


def _heading(column: Score) -> Html:
    unit = f'<br><span class="unit">[{escaped(column.unit)}]</span>' if column.unit else ""
    return Html(f"{escaped(column.heading)}{unit}")


def _shown(row: Mapping[str, Any], column: Score) -> Html:
    mean, low, high = (column.factor * row[name] for name in ("mean", "low_95", "high_95"))
    if column.unit == "%":  # a normal interval of a share may reach beyond 0 or 100 %
        low, high = max(low, 0.0), min(high, 100.0)
    return estimate_text(mean, low, high, column.digits)


def _comparison(result: TrainingResult) -> Html:
    rows = [
        Row(
            [_named(result, policy), *(_shown(result.score(policy, column.name), column) for column in COLUMNS)],
            "own" if policy == result.agent else "",
        )
        for policy in result.policies
    ]
    cuts = result.score(result.agent, "return")["cuts"]
    bars = [result.bar(policy, "return") for policy in result.policies]
    spoken = ", ".join(f"{bar.policy} {bar.mean:.2f} [{bar.low:.2f}, {bar.high:.2f}]" for bar in bars)
    return joined(
        paragraph(
            "The best return first. The agent is judged on specimens that it has never seen, and every policy cuts the "
            "same ones."
        ),
        html_table(
            f"Means over {cuts:.0f} held-out specimens, with 95 % intervals",
            [Html("policy"), *map(_heading, COLUMNS)],
            rows,
        ),
        picture(
            partial(returns_figure, bars),
            f"Mean return with 95 % interval: {spoken}.",
            Html(
                "Return of every policy: mean and 95 % interval. Blue dot: learned; orange square: best script; open "
                "green diamond: upper bound."
            ),
        ),
    )


def _differences(result: TrainingResult) -> Html:
    baselines = list(dict.fromkeys(row["baseline"] for row in result.differences))
    rows = []
    for baseline in sorted(baselines, key=result.policies.index):
        cells = [(result.difference(baseline, column.name), column) for column in DIFFERENCES]
        shown = [Html("&ndash;") if row is None else _shown(row, column) for row, column in cells]
        rows.append(Row([_named(result, baseline), *shown, escaped(_decision(cells[0][0]))]))
    return joined(
        paragraph(
            f"Paired by specimen: what {result.agent} got, less what the baseline got on the same piece of tissue. "
            "Above 0 the agent is better."
        ),
        html_table(
            "Mean paired differences with 95 % intervals",
            [Html("baseline"), *map(_heading, DIFFERENCES), Html("by return, the agent is")],
            rows,
        ),
    )


def _decision(row: Mapping[str, Any] | None) -> str:
    if row is None:
        return "not compared"
    return "better" if row["low_95"] > 0.0 else "worse" if row["high_95"] < 0.0 else "undecided"


def _costs(result: TrainingResult) -> Html:
    policies = result.compared()
    costs = [term for term in result.terms() if term != "progress"]
    largest = {term: max(result.bar(policy, f"reward_{term}", -1.0).mean for policy in policies) for term in costs}
    shown = [term for term in sorted(costs, key=lambda term: -largest[term]) if largest[term] >= _SHOWN_COST]
    if not shown:
        return paragraph("No term of the reward was recorded, or no cost was incurred.")
    bars = [[result.bar(policy, f"reward_{term}", -1.0) for term in shown] for policy in policies]
    names = [TERM_MEANINGS[term] for term in shown]
    unpaid = [TERM_MEANINGS[term] for term in costs if term not in shown]
    caption = "Mean cost of a cut by term of the reward, with 95 % intervals; less is better."
    if unpaid:
        caption += f" No cost was incurred for: {', '.join(unpaid)}."
    dearest = ", ".join(f"{own[0].policy} {own[0].mean:.2f}" for own in bars)
    return joined(
        paragraph("Return is progress less these costs: what is not cut gently, and what is not right at the end."),
        picture(
            partial(costs_figure, names, bars),
            f"Costs of {', '.join(policies)}, term by term. The largest is {names[0]}: {dearest}.",
            escaped(caption),
        ),
        folded("The same as numbers", _cost_table(result, policies, [*shown, *(t for t in costs if t not in shown)])),
    )


def _cost_table(result: TrainingResult, policies: Sequence[str], costs: Sequence[str]) -> Html:
    """Return a table of all terms, which add up to the return."""
    earned = [term for term in result.terms() if term == "progress"]
    column = Score("", "", "", 3)
    rows = [
        Row([escaped(TERM_MEANINGS[term]), *(_shown(result.score(p, f"reward_{term}"), column) for p in policies)])
        for term in (*earned, *costs)
    ]
    rows.append(Row([Html("return"), *(_shown(result.score(p, "return"), column) for p in policies)], "total"))
    return html_table("Terms of the reward, which add up to the return", [Html("term"), *map(escaped, policies)], rows)


def _grid(result: TrainingResult) -> Html:
    best = max(result.grid, key=lambda row: float(row["mean"]))
    return joined(
        paragraph(
            "The simplest script: one speed and one angle all the way, then stop and unload. Each cell holds the mean "
            "return, plus or minus half of its 95 % interval, and the share of cuts that succeed. "
            f"The best is {best['speed_cm_s']:g} cm/s at {best['angle_deg']:g} degrees, with a return of "
            f"{number(best['mean'], 2)} and {number(100.0 * best['success'], 0)} % success; 90 degrees is upright."
        ),
        heat_map(result.grid),
    )


def _cuts(result: TrainingResult) -> Html:
    if not result.cuts:
        return paragraph("No cut was kept to be drawn.")
    beside = [cut.readings for cut in result.cuts]
    return joined(
        paragraph(
            "The tissue from the side, cut as far as the crack tip came; below it force, speed and angle of the blade, "
            "over its position. All cuts have the same scales. Where the force drops at once, the crack ran ahead."
        ),
        *(_cut(result, cut, beside) for cut in result.cuts),
    )


def _cut(result: TrainingResult, cut: CutPicture, beside: Sequence[StructArray]) -> Html:
    last = cut.readings[-1]
    beyond_mm = 1e3 * (float(last["tip"]) - cut.target_length)
    alt = (
        f"Cut by {cut.policy}: force up to {cut.readings['force'].max():.1f} N, {(cut.readings['jump'] > 0.0).sum()} "
        f"jumps, {last['time']:.1f} s; the crack tip ends {abs(beyond_mm):.1f} mm "
        f"{'beyond' if beyond_mm > 0.0 else 'short of'} the target of {1e3 * cut.target_length:.0f} mm."
    )
    draw = partial(_drawn, cut, beside)
    return joined(element("h3", _named(result, cut.policy)), picture(draw, alt, escaped(cut.caption)))


def _drawn(cut: CutPicture, beside: Sequence[StructArray], width: float) -> Any:
    return cut_figure(
        cut.readings,
        cut.depth,
        target_length=cut.target_length,
        force_limit_per_depth=cut.force_limit_per_depth,
        width=width,
        beside=beside,
    )


def _curve(result: TrainingResult) -> Html:
    if not result.curve:
        return paragraph("No learning curve was recorded.")
    first, last = result.curve[0], result.curve[-1]
    kept = "" if result.chosen_at is None else f" The checkpoint after {result.chosen_at:,} decisions was kept."
    return picture(
        partial(curve_figure, result.curve, result.chosen_at),
        f"Return of training episodes from {first['return']:.2f} to {last['return']:.2f}, success from "
        f"{first['success']:.2f} to {last['success']:.2f}, over {last['decisions']:,.0f} decisions.{kept}",
        escaped(
            "Return and success while training. Training episodes explore, so they do worse than the agent does "
            f"when it acts as it thinks best, which is how it is validated and judged.{kept}"
        ),
    )


def _meaning() -> Html:
    return joined(
        definitions(MEANINGS),
        Html("<h3>Limits of these results</h3>"),
        paragraph(LIMITS),
    )
