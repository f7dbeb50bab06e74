"""Plan the number of livers for comparing two policies, by simulation."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from cutenv._base.output import progress_bar
from cutenv.commands.options import RIG, add_question, add_specimen_class, add_target_length, add_task, command_parser
from cutenv.commands.rig import reports_rig_errors
from cutenv.commands.rig.evaluate import SMALLEST_RETURN, rig_comparison


@reports_rig_errors("plan", TypeError, refused=2)
def main(argv: Sequence[str]) -> int:
    """Simulate the pairs, resample them, and print the plan."""
    arguments = _parser().parse_args(argv)
    from cutenv._base.validation import in_range
    from cutenv.records.scoring.study.sequential import planned_pairs

    pairs = int(in_range("--pilot", arguments.pilot, 20, 10_000, "1", "40 is a beginning."))
    with (
        rig_comparison(arguments) as comparison,
        progress_bar("simulating", "pair", total=pairs) as bar,
    ):
        found = comparison.pilot(pairs, bar)
    question = comparison.question
    first, second = comparison.names
    print(f"{first} against {second}, from {pairs} simulated pairs, at most {question.most} pairs:")
    for name, differences in zip(("return", "success"), found, strict=True):
        plan = planned_pairs(differences, question, seed=arguments.seed)
        mean, sd = float(differences.mean()), float(differences.std(ddof=1))
        chances = ", ".join(f"{said} {100.0 * share:.0f} %" for said, share in plan.chances.items() if share > 0.005)
        print(
            f"  {name}: difference {mean:+.3f} +- {1.96 * sd / pairs**0.5:.3f}, SD {sd:.3f}\n"
            f"    median {plan.median:.0f} pairs [{plan.low:.0f}, {plan.high:.0f}], nine in ten within "
            f"{plan.nine_in_ten:.0f}; {chances}\n"
            f"    a fixed design that finds {question.smallest:g} with a power of 0.9 by a t test: {plan.fixed} pairs"
        )
    livers = "a pair is a liver with two cuts side by side" if comparison.apart else "a pair is one drawn specimen"
    print(f"note: {livers}; brackets: 95 % interval of the median, by the choice of the simulated pairs")
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = command_parser(
        "rig plan", __doc__, examples=('"return stroke" "probe and creep" --rig fake --unknown --smallest 0.1',)
    )
    add = parser.option
    add("policies POLICY", "the two policies", nargs=2)
    add("--rig RIG", RIG, required=True)
    add_task(parser, "rig")
    add("--pilot N", "number of simulated pairs; default 100", 100)
    add_specimen_class(parser, "mixed")
    add_target_length(parser, "drawn from 60mm to 100mm")
    add("--tissue FILE", "tissue that specimens are drawn from; default measured pig liver", Path)
    add("--unknown", "let the two cuts of a pair lie side by side, as a lab's do")
    add("--seed N", "seed of the specimens; default 0", 0)
    add_question(parser, unit="pair of cuts", smallest=f"{SMALLEST_RETURN:g} of return", most=400, always=True)
    parser.set_defaults(change=[], opening=None, draws=2)
    return parser
