"""Page of an evaluation: agreement of a rig and the simulator, by measure, along the way, and in time."""

from __future__ import annotations

from pathlib import Path

from cutenv._base.unit_table import shown_unit
from cutenv.report.page import spoken, write_page
from cutenv.report.study_table import three_digits, typeset
from cutenv.sim_to_real import ComparedCut, Finding
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
    """Return the unit of a finding and its cells: simulator, rig, differences, margin, noise, answer."""
    unit = shown_unit(found.measure.unit)
    simulator, rig, margin, noise = (
        rounded_text(unit.from_si(value)) for value in (found.simulator, found.rig, found.shift.margin, found.noise)
    )
    shifts = [interval(*map(unit.from_si, (each.value, each.low, each.high))) for each in (found.shift, found.mean)]
    return unit.sign, [simulator, rig, *shifts, margin, noise, found.answer]


def _specimens(evaluation: Evaluation) -> list[tuple[ComparedCut, str, float]]:
    """Return by specimen the cut on the rig, and of the simulated ones the ends and the mean return."""
    rows = []
    for cut, simulated in zip(evaluation.agreement.rig, evaluation.agreement.simulator, strict=True):
        ends = ", ".join(dict.fromkeys(each.end for each in simulated))
        rows.append((cut, ends, sum(each.value for each in simulated) / len(simulated)))
    return rows


def _listed(names: tuple[str, ...]) -> str:
    more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
    return ", ".join(map(spoken, names[:_NAMED])) + more
