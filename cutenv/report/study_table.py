"""Study's numbers as text, and its cards as a file."""

from __future__ import annotations

import csv
import math
from pathlib import Path

import numpy as np

from cutenv._base.atomic_file import atomic_write
from cutenv.report.page import number, significant
from cutenv.scoring.score_card import DISCLAIMER
from cutenv.scoring.study import Estimate, Findings, Intraclass, NotEstimable, OneWay, Separation, Study, numbered

_LONGEST = 1e4  # number of cuts beyond which "how many" is meaningless


def table_lines(study: Study) -> list[str]:
    """Return the study's numbers as aligned text: metrics by person, reliability, separation, notes."""
    lines = [
        f"{study.name}: {len(study.cuts)} cuts of {len(study.operators)} {study.who}s",
        "",
        f"{'metric':24s} {'unit':6s} {'mean':>9s} {'SD between':>11s} {'SD within':>10s}  "
        f"{'ICC of one cut':21s} {'ICC of the mean':21s} {'cuts for 0.8':>12s}",
    ]
    for found in study.findings:
        mean, between, within = spread(found)
        reliability = found.reliability
        told = (
            reliability.reason
            if isinstance(reliability, NotEstimable)
            else f"{correlation_text(reliability.single):21s} {correlation_text(reliability.mean):21s} "
            f"{cuts_needed(reliability):>12s}"
        )
        lines.append(f"{found.metric:24s} {found.unit:6s} {mean:9.4g} {between:>11s} {within:>10s}  {told}".rstrip())
    if study.groups is not None:
        first, second = study.groups
        lines += ["", f"{'metric':24s} P({first} > {second}){'':4s} Hedges' g"]
        for found in study.findings:
            lines.append(f"{found.metric:24s} {_both(found.separation, 'superiority', 'difference')}")
    if len(study.sessions) > 1:
        lines += ["", f"{'metric':24s} {'ICC(A,1) of sessions':21s} ICC(C,1)"]
        for found in study.findings:
            lines.append(f"{found.metric:24s} {_both(found.retest, 'agreement', 'consistency')}")
    return [*lines, "", *(f"note: {note}" for note in (*study.notes, DISCLAIMER))]


def write_cards(path: Path, study: Study) -> None:
    """Write a row for each cut: its operator, and every metric; empty where a cut has none."""
    names = list(study.cuts[0].card.metrics)
    units = {name: study.cuts[0].card.unit(name) for name in names}
    heads = [name if unit == "1" else f"{name}_{_suffix(unit)}" for name, unit in units.items()]
    with atomic_write(path) as part, part.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["record", study.who, "group", "session", "number", "force_unit", "tip_source", *heads])
        for place, cut in numbered(study.cuts):
            card = cut.card
            values = [card.metrics[name].value for name in names]
            writer.writerow(
                [card.name, cut.operator, cut.group, cut.session, place, card.force_unit, card.tip_source]
                + ["" if value is None else f"{value:.6g}" for value in values]
            )


def _suffix(unit: str) -> str:
    """Return a unit as a part of a name: N/s is N_per_s, in distinction to N s."""
    return unit.removeprefix("1").replace("/", "_per_").replace(" ", "_").strip("_")


def spread(found: Findings) -> tuple[float, str, str]:
    """Return the mean over people, and standard deviations between and within them as text, "" if not known."""
    means = [float(values.mean()) for values in found.series.values()]
    if isinstance(found.reliability, OneWay):
        return (
            float(np.mean(means)),
            three_digits(found.reliability.between_sd),
            three_digits(found.reliability.within_sd),
        )
    return float(np.mean(means)), "", three_digits(found.scale) if found.scale > 0.0 else ""


def cuts_needed(told: OneWay) -> str:
    """Return the number of cuts whose mean would reach a reliability of 0.8, in words if none would."""
    cuts = told.cuts_for(0.8)
    return "none will do" if math.isinf(cuts) or cuts > _LONGEST else str(max(1, math.ceil(cuts)))


def _both(told: Separation | Intraclass | NotEstimable, first: str, second: str) -> str:
    """Return two estimates beside each other, or the reason why there are none."""
    if isinstance(told, NotEstimable):
        return told.reason
    shown = correlation_text if isinstance(told, Intraclass) else _plain_interval
    return f"{shown(getattr(told, first)):21s} {shown(getattr(told, second))}"


def correlation(value: float) -> str:
    """Return a correlation as text; those of means have no lower bound, and values below -1 have no meaning."""
    return f"< {number(-1.0, 0)}" if value < -1.0 else number(value, 2)


def correlation_text(each: Estimate) -> str:
    """Return a correlation with its interval as text."""
    return f"{correlation(each.value)} [{correlation(each.low)}, {correlation(each.high)}]"


def _plain_interval(each: Estimate) -> str:
    return f"{each.value:.2f} [{each.low:.2f}, {each.high:.2f}]"


def three_digits(value: float) -> str:
    """Return three significant digits in print typography."""
    return significant(value, 3)
