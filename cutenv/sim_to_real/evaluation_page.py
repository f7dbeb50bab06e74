"""Page of an evaluation: agreement of a rig and the simulator, by measure, along the way, and in time."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from cutenv._base.unit_table import shown_unit
from cutenv.report.page import (
    Html,
    PageSection,
    Row,
    definitions,
    element,
    escaped,
    folded,
    html_table,
    joined,
    page,
    paragraph,
    picture,
    write_page,
)
from cutenv.report.study_figures import typeset
from cutenv.report.study_table import three_digits
from cutenv.sim_to_real import Finding
from cutenv.sim_to_real.evaluation_figures import clock_figure, differences_figure, force_figure, typical_pair
from cutenv.sim_to_real.evaluation_result import Evaluation, bars, interval, rounded_text

_NAMED = 8  # measures named in a sentence
_KINDS = {"agree": ("good", "They agree"), "differ": ("bad", "They differ"), "undecided": ("open", "Undecided")}


def write_evaluation(path: Path, evaluation: Evaluation) -> None:
    """Write an evaluation as one self-contained page.

    Parameters
    ----------
    path : Path
        Path of the page (.html), in a folder that exists.
    evaluation : Evaluation
        Evaluation to write.

    Raises
    ------
    ImportError
        If matplotlib is not installed; the message gives the command that installs it.
    """
    sections = [PageSection("differences", "Rig minus simulator", _differences(evaluation))]
    if evaluation.agreement.paired:
        sections.append(PageSection("force", "Force along the way", _force(evaluation)))
    sections += [
        PageSection("clock", "The control clock", _clock(evaluation)),
        PageSection("meaning", "What the numbers mean", _meaning(evaluation)),
    ]
    write_page(path, page(evaluation.title, evaluation.subtitle, _lead(evaluation), sections))


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


def _lead(evaluation: Evaluation) -> Html:
    kind, word = _KINDS[evaluation.agreement.verdict.answer]
    said = "".join(paragraph(remark) for remark in evaluation.remarks)
    return Html(
        f'<div class="verdict '
        f'{kind}">\n{paragraph(word, "word")}\n{paragraph(evaluation_headline(evaluation), "headline")}\n'
        f"{said}</div>"
    )


def _differences(evaluation: Evaluation) -> Html:
    findings = evaluation.agreement.findings
    heads = ["measure", "simulator", "rig", "difference", "mean difference", "margin", "noise alone", "answer"]
    rows = []
    for each in findings:
        unit = shown_unit(each.measure.unit)
        shown = [(shift.value, shift.low, shift.high) for shift in (each.shift, each.mean)]
        shifts = [_cell(interval(*map(unit.from_si, each_shown))) for each_shown in shown]
        numbers = [rounded_text(unit.from_si(value)) for value in (each.simulator, each.rig)]
        rest = [rounded_text(unit.from_si(value)) for value in (each.shift.margin, each.noise)] + [each.answer]
        named = element("span", escaped(f" [{typeset(unit.sign)}]"), "unit") if unit.sign != "1" else Html("")
        name = Html(f"{escaped(each.measure.name.replace('_', ' '))}{named}")
        cells = [name, *map(escaped, numbers), *shifts, *map(escaped, rest)]
        rows.append(Row(cells, "own" if each.answer == "differ" else ""))
    pairs = (
        "Each specimen is cut on both sides. Its cut on the rig is compared with the mean of its simulated cuts, which "
        "differ by the noise of the force sensor alone."
        if evaluation.agreement.paired
        else "The sides cut different specimens, so the difference is one of means (Welch)."
    )
    return joined(
        paragraph(
            f"{pairs} The margin is the largest difference that does not count: the effect of noise on one cut, or the "
            "instruments' resolution, if that is more. A measure agrees if its 90 % interval lies within the margin "
            "(two one-sided tests at 5 %; drawn are 95 % intervals, which may reach beyond), and differs if it is "
            "surely beyond."
        ),
        picture(
            partial(differences_figure, findings),
            "Difference of every measure in margins, with its 95 % interval",
            escaped("The grey band is the margin; differences beyond four margins are drawn at the edge."),
        ),
        html_table("Rig minus simulator, 95 % intervals", [escaped(head) for head in heads], rows),
    )


def _force(evaluation: Evaluation) -> Html:
    pair = typical_pair(evaluation.agreement)
    if pair is None:
        return paragraph("No cut on the rig has 5 mm of its way in common with a simulated one.")
    place, cut, simulated = pair
    return joined(
        paragraph(
            "A crack runs by itself when the force is high enough, and small causes decide where: one run that "
            "comes a little later changes the force by newtons for a while. So the rig's difference has to be compared "
            "with that of two simulated cuts with other noise."
        ),
        picture(
            partial(force_figure, cut, simulated),
            "Force over position of the blade on the rig and in the simulator, and their difference",
            escaped(f"Specimen {place + 1}, whose difference is the median. It ended {cut.end} on the rig."),
        ),
        folded("Every specimen", _specimens(evaluation)),
    )


def _specimens(evaluation: Evaluation) -> Html:
    agreement = evaluation.agreement
    rows = []
    for place, (cut, simulated) in enumerate(zip(agreement.rig, agreement.simulator, strict=True), 1):
        ends = ", ".join(dict.fromkeys(each.end for each in simulated))
        mean = sum(each.value for each in simulated) / len(simulated)
        cells = [str(place), cut.end, ends, three_digits(cut.value), three_digits(mean)]
        rows.append(Row([escaped(cell) for cell in cells], "own" if cut.end not in ends else ""))
    heads = [escaped(head) for head in ("specimen", "end on the rig", "in the simulator", "return on the rig", "mean")]
    return html_table("Ends and returns of every specimen", heads, rows)


def _clock(evaluation: Evaluation) -> Html:
    clock = evaluation.clock
    if not len(clock.periods) or not len(clock.latencies):
        return paragraph("No control period was measured.")
    rows = [
        Row([escaped(name), *(escaped(f"{1e3 * value:.3f}") for value in clock.spread(of).values())])
        for name, of in (("control period [ms]", "periods"), ("from force to command [ms]", "latencies"))
    ]
    heads = [escaped(head) for head in ("", *clock.spread("periods"))]
    counted = [Row([escaped(f"{1e3 * low:.3f} to {1e3 * high:.3f}"), escaped(n)]) for low, high, n in bars(clock)]
    return joined(
        paragraph(
            f"{len(clock.periods)} control periods of {1e3 * clock.nominal:g} ms: jitter (standard deviation) "
            f"{1e3 * clock.jitter:.3f} ms; {clock.overruns} commands more than 2 ms late, which cost "
            f"{clock.skipped:.2f} s; {clock.garbled} packets that were not readings."
        ),
        picture(
            partial(clock_figure, clock),
            "Histograms of control periods and of the latency from force to command",
            escaped("Latency: from the newest reading that a decision knew to its command on the bus."),
        ),
        html_table("Quantiles", heads, rows),
        folded(
            "Histogram as numbers",
            html_table("Control periods", [escaped("from, to [ms]"), escaped("commands")], counted),
        ),
    )


def _meaning(evaluation: Evaluation) -> Html:
    entries = [
        (
            "Difference",
            "For most measures, the typical difference of a specimen (Hodges and Lehmann, with Wilcoxon's interval): a "
            "decision that falls one reading later can end one cut otherwise, and that one would rule a mean. Such "
            "cuts are counted by success and end agreement, which are means. The mean difference is given too, "
            "with its t interval.",
        ),
        (
            "Margin",
            "The largest of: the root mean square of the difference that noise alone makes between two simulated cuts "
            "of a specimen; 1 % of the simulator's mean; what a zero of the force that is off by 0.05 N shows; and a "
            "tenth of what the task tolerates, such as 0.3 mm. A run of the crack 0.3 mm off is no difference.",
        ),
        (
            "Agree",
            "Two one-sided tests at 5 % show that the difference is within the margin. All measures must pass, so no "
            "correction for their number is needed.",
        ),
        (
            "Differ",
            "A test at 5 % shows that the difference is beyond the margin, after Holm's correction for the number of "
            "measures: one of several dozen would do, and chance has as many tries.",
        ),
        ("Undecided", "Neither: more specimens are needed; how many is what would decide four times in five."),
        *((each.measure.name.replace("_", " "), _meaning_of(each)) for each in evaluation.agreement.findings),
    ]
    return definitions(entries)


def _meaning_of(each: Finding) -> str:
    return each.measure.meaning


def _cell(text: str) -> Html:
    value, _, rest = text.partition(" ")
    return Html(f'{escaped(value)} <span class="interval">{escaped(rest)}</span>')


def _listed(names: tuple[str, ...]) -> str:
    more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
    return ", ".join(name.replace("_", " ") for name in names[:_NAMED]) + more
