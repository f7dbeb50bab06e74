"""Compare policies on the same held-out specimens: scores, means and paired differences.

A policy is the name of a baseline or of a shipped policy (ppo-free), the folder of a training run or of a policy, which
holds policy.safetensors and card.json, or a class of your own, MODULE:CLASS. Those of another task than gentle cutting
are compared with each other alone.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cutenv.agents.learning.option_fields import class_in_words
from cutenv.commands import options
from cutenv.sim.tissue.specimen import CLASSES
from cutenv.task.registry import TASKS

if TYPE_CHECKING:
    from cutenv.agents.learning.evaluation import Contestant

_LOOK = 20  # specimens between two looks: a batch costs little more than a cut


@options.reports_errors("evaluate")
def main(argv: Sequence[str]) -> int:
    """Evaluate; return 0, 2 (bad input), 130 (Ctrl-C)."""
    arguments = _parser().parse_args(argv)
    try:
        _evaluate(arguments) if arguments.report is None else _report(arguments)
    except KeyboardInterrupt:
        print("\ncutenv evaluate: interrupted; nothing was written", file=sys.stderr)
        return 130
    return 0


def _evaluate(arguments: argparse.Namespace) -> None:
    from cutenv.agents.policy import BASELINES

    if arguments.list or not arguments.policies:
        from cutenv.agents.policy import SHIPPED

        feeds = [name for name in BASELINES if name.startswith("constant ")]
        print("gentle cutting:")
        print("\n".join(f"  {name}" for name in BASELINES if name not in feeds))
        print(f"  constant V cm/s A deg ({len(feeds)} of them): {feeds[0]} ... {feeds[-1]}")
        for task in TASKS.values():
            if not set(BASELINES).issuperset(task.scripts):
                print("\n".join([f"task {task.name}:", *(f"  {name}" for name in task.scripts)]))
        print("\n".join(["shipped agents:", *(f"  {name}" for name in SHIPPED)]))
        return
    from cutenv.agents.learning.evaluation import contestant, evaluate
    from cutenv.agents.learning.seeds import TEST_SEEDS, VALIDATION_SEEDS
    from cutenv.agents.learning.statistics import differences, summarise, write_csv
    from cutenv.agents.learning.training_report import print_compared
    from cutenv.display.report.training_result import columns_of

    seeds = VALIDATION_SEEDS if arguments.validation else TEST_SEEDS
    if not 2 <= arguments.specimens <= len(seeds):
        raise ValueError(f"--specimens {arguments.specimens} is outside 2 to {len(seeds)}")
    names = [name for given in arguments.policies for name in (BASELINES if given == "all" else [given])]
    chosen = {name: contestant(name) for name in dict.fromkeys(names)}
    tasks = {name: one.arguments.get("task", "gentle") for name, one in chosen.items()}
    if len(set(tasks.values())) > 1:
        told = ", ".join(f"{name!r} is for {task!r}" for name, task in tasks.items())
        raise ValueError(f"POLICY names policies of several tasks: {told}. Give those of one.")
    drawn = options.drawn_given(arguments)
    if arguments.out:
        options.made_folder("--out", arguments.out)
    if arguments.until is not None:
        _decide(arguments, chosen, seeds, drawn)
        return
    rows = evaluate(
        chosen,
        seeds[: arguments.specimens],
        drawn,
        processes=arguments.processes,
    )
    summary, paired = summarise(rows), differences(rows, next(iter(chosen)))
    if arguments.out:
        write_csv(arguments.out / "scores.csv", rows)
        write_csv(arguments.out / "summary.csv", summary)
        if paired:
            write_csv(arguments.out / "differences.csv", paired)
    kind = "validation" if arguments.validation else "held-out"
    print(f"\n{arguments.specimens} {kind} specimens of {class_in_words(vars(arguments))}, mean [95 % interval]\n")
    print_compared(summary, paired if len(chosen) <= 12 else [], columns_of(TASKS[next(iter(tasks.values()))]))


def _decide(
    arguments: argparse.Namespace, chosen: dict[str, Contestant], seeds: Sequence[int], drawn: dict[str, Any]
) -> None:
    """Let two policies cut until the better one is known."""
    import numpy as np

    from cutenv.agents.learning.evaluation import evaluate
    from cutenv.agents.learning.statistics import by_policy
    from cutenv.display.report.decision_page import ComparedOutcome, DecisionReport, write_decision
    from cutenv.records.scoring.study.sequential import RETURN_FLOOR, RETURN_TOP

    if len(chosen) != 2:
        raise ValueError(f"--until decided compares two policies, and {len(chosen)} are given. Give two.")
    question = options.question_given(arguments, smallest=0.05)
    if question.most > len(seeds):
        raise ValueError(f"--most {question.most} is above {len(seeds)}, the specimens there are. Give fewer.")
    names = list(chosen)
    rows: list[dict[str, Any]] = []
    while True:
        first = len(rows) // 2
        looked = seeds[first : min(first + _LOOK, question.most)]
        rows += evaluate(chosen, looked, drawn, processes=arguments.processes or 1)
        own = by_policy(rows)
        pairs = list(zip(*(own[name] for name in names), strict=True))
        scores = np.array(
            [[(np.clip(cut["return"], RETURN_FLOOR, RETURN_TOP), cut["success"]) for cut in pair] for pair in pairs]
        )
        report = DecisionReport(
            first=names[0],
            second=names[1],
            outcomes=[
                ComparedOutcome(name=name, differences=scores[:, 0, k] - scores[:, 1, k], question=question)
                for k, name in enumerate(("return", "success"))
            ],
            rows=[
                {"seed": a["seed"]}
                | {f"{side}_{key}": cut[key] for side, cut in (("first", a), ("second", b)) for key in _RAW}
                for a, b in pairs
            ],
            pair="specimen",
            pairs="specimens",
            notes=[
                f"a return below {RETURN_FLOOR:g} counts as {RETURN_FLOOR:g}",
                f"looked at after every {_LOOK} specimens",
            ],
        )
        if report.decision != "undecided" or len(pairs) == question.most:
            break
    print("\n".join(report.lines()))
    if arguments.out:
        print(f"page: {write_decision(arguments.out, report)[0]}")


_RAW = ("return", "success", "end", "tip_error_mm", "peak_force_N", "time_s")


def _report(arguments: argparse.Namespace) -> None:
    """Evaluate a finished run against all baselines; write its report."""
    from cutenv.agents.learning.training_report import compare

    run = arguments.report
    if not (run / "policy" / "card.json").is_file():
        raise ValueError(f"{run} contains no policy/card.json; give the folder of a finished run.")
    facts = json.loads((run / "run.json").read_text())
    compare(run, facts, processes=arguments.processes, baselines_of=arguments.baselines_of)


def _parser() -> argparse.ArgumentParser:
    parser = options.command_parser(
        "evaluate",
        __doc__,
        examples=(
            '"probe and creep" runs/NAME',
            "all --specimens 500 --out runs/all",
            '"return stroke" runs/NAME --until decided',
            "--list",
            "--report runs/NAME",
        ),
    )
    add = parser.option
    add("policies POLICY", "baseline, shipped policy, folder of a run or policy, MODULE:CLASS, or all", nargs="*")
    add("--list", "print the names of baselines, scripts and shipped agents")
    add("--specimen-class", "class of the specimens; default mixed", "mixed", choices=CLASSES)
    options.add_tissue(parser)
    add("--specimens N", "number of specimens; default 200", 200)
    add("--validation", "take validation specimens instead of test specimens")
    add("--out FOLDER", "write scores.csv, summary.csv and differences.csv here", Path)
    add("--processes N", "number of processes; default one per core", int)
    add("--report RUN", "evaluate a finished training run again, and report", Path)
    add("--baselines-of RUN", "with --report: reuse the baselines of another run", Path)
    options.add_question(parser, unit="specimen", smallest="0.05 of return", most=1000)
    return parser
