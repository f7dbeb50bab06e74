"""Messick's five sources of validity, filled with what a class of people shows, and "no evidence" elsewhere."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

from cutenv.scoring.study.estimate import Estimate
from cutenv.scoring.study.pass_mark import PassMark
from cutenv.scoring.study.raters import RaterAgreement, RaterCorrelation
from cutenv.scoring.study.reliability import OneWay
from cutenv.scoring.study.separation import Separation
from cutenv.scoring.study.standard_setting import ALL_RATERS, Standard, StandardSetting

NO_EVIDENCE = "no evidence"


@dataclass(frozen=True, kw_only=True)
class ValidityEvidence:
    """One source of validity: its name, the question that it answers, and what was found, a sentence each."""

    source: str
    question: str
    found: tuple[str, ...]

    @property
    def is_there(self) -> bool:
        """True if the data say anything about this source."""
        return not self.found[0].startswith(NO_EVIDENCE)


def validity_evidence(setting: StandardSetting) -> tuple[ValidityEvidence, ...]:
    """Return what a class shows for each of Messick's sources of validity, by its first metric.

    Messick, American Psychologist 50 (1995) 741-749, doi 10.1037/0003-066X.50.9.741. Evidence is no verdict: whether it
    is enough for a use is for the people who use it to judge.
    """
    first = setting.standards[0]
    return (
        ValidityEvidence(
            source="Content",
            question="Do the cuts stand for the task that is to be learned?",
            found=(f"{NO_EVIDENCE}: experts judge this, and no number of these cuts does",),
        ),
        ValidityEvidence(
            source="Response process",
            question="Do the records hold what the people did?",
            found=_records(setting, first),
        ),
        ValidityEvidence(
            source="Internal structure",
            question="Would the same people get the same again?",
            found=_same(setting, first),
        ),
        ValidityEvidence(
            source="Relations to other variables",
            question="Does the number go with experience, and with what raters see?",
            found=_relations(setting, first),
        ),
        ValidityEvidence(
            source="Consequences", question="Whom does the pass mark judge wrongly?", found=_consequences(first)
        ),
    )


def _records(setting: StandardSetting, standard: Standard) -> tuple[str, ...]:
    cuts = len(setting.cuts)
    sources = Counter(cut.card.tip_source for cut in setting.cuts)
    tips = ", ".join(f"{source} in {count}" for source, count in sources.most_common())
    return (
        f"{cuts - standard.missing} of {cuts} cuts have a value",
        f"origin of the crack tip: {tips}",
        f"{NO_EVIDENCE} on how the people understood the task",
    )


def _same(setting: StandardSetting, standard: Standard) -> tuple[str, ...]:
    found = []
    if isinstance(standard.reliability, OneWay):
        one, mean = standard.reliability.single, standard.reliability.mean
        found += [f"reliability of one cut: {_shown(one)}", f"reliability of a person's mean: {_shown(mean)}"]
    if isinstance(setting.agreement, RaterAgreement):
        raters = setting.agreement.raters
        found.append(f"agreement of {raters} raters, rank correlation: {_shown(setting.agreement.rank)}")
    return tuple(found) or (_without(standard.reliability),)


def _relations(setting: StandardSetting, standard: Standard) -> tuple[str, ...]:
    found = []
    if isinstance(standard.separation, Separation):
        P = standard.separation.superiority
        if standard.better == "lower":
            low, high = (None if end is None else 1.0 - end for end in (P.high, P.low))
            P = Estimate(value=1.0 - P.value, low=low, high=high)
        pair = f"one of group {setting.passing} is better than one of group {setting.failing}"
        found.append(f"probability that {pair}: {_shown(P)}")
    rater = ALL_RATERS if ALL_RATERS in standard.raters else next(iter(standard.raters), "")
    correlation = standard.raters.get(rater)
    if isinstance(correlation, RaterCorrelation):
        found.append(f"rank correlation with the marks of {rater}: {_shown(correlation.rank)}")
    return tuple(found) or (_without(standard.separation),)


def _consequences(standard: Standard) -> tuple[str, ...]:
    if not isinstance(standard.chosen, PassMark):
        return (_without(standard.chosen),)
    rates = ((standard.chosen.false_passes, "non-passing", "pass"), (standard.chosen.false_fails, "passing", "fail"))
    found = [
        f"{rate.observed} of {rate.people} people of the {group} group {verb}"
        + ("" if rate.theoretical is None else f"; under its normal curve {100.0 * rate.theoretical.value:.1f} %")
        for rate, group, verb in rates
        if rate.people
    ]
    return tuple(found) or (f"{NO_EVIDENCE}: the mark was held against no group",)


def _shown(each: Estimate) -> str:
    interval = "" if each.low is None or each.high is None else f" [{each.low:.2f}, {each.high:.2f}]"
    return f"{each.value:.2f}{interval}".replace("-", "\u2212")


def _without(told: object) -> str:
    return f"{NO_EVIDENCE}: {getattr(told, 'reason', 'not computed')}"
