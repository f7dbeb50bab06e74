"""Train an agent to cut gently, compare it with all baselines, report.

PPO takes about 4 minutes on 2 cores, recurrent PPO, whose actor has a memory, about 20; SAC, TQC and CrossQ, which also
learn from a script's decisions, some four.  Behaviour cloning imitates a script, or a data set of 'cutenv datasets', in
some three minutes, without any trial of its own; IQL prefers the better decisions of two scripts or of a data set.
Everything is written to the folder runs/NAME; an interrupted run continues from its checkpoint with --resume.
Several tasks (--task gentle excision) are trained side by side, each in a process of its own, in runs/NAME-TASK.
"""

from __future__ import annotations

import argparse
import json
import shutil
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from cutenv._base.imports import require
from cutenv.agents.learning.arguments import (
    BadArguments,
    BCArguments,
    CrossQArguments,
    IQLArguments,
    LearnerArguments,
    PPOArguments,
    RecurrentPPOArguments,
    SACArguments,
    TQCArguments,
)
from cutenv.agents.learning.run_folder import RunRequest, add_run_options, run_request
from cutenv.commands.options import command_parser

LEARNERS: dict[str, tuple[str, type[LearnerArguments]]] = {
    "ppo": ("PPO", PPOArguments),
    "recurrent-ppo": ("recurrent PPO", RecurrentPPOArguments),
    "sac": ("SAC", SACArguments),
    "tqc": ("TQC", TQCArguments),
    "crossq": ("CrossQ", CrossQArguments),
    "bc": ("behaviour cloning", BCArguments),
    "iql": ("IQL", IQLArguments),
}
"""Name on the command line -> name in run.json, and class of the options."""

_OF_REPORT = ("jinja2", "matplotlib")

_EXAMPLES = {
    "ppo": ("", "--quick", "--resume runs/NAME", "--learner recurrent-ppo", "--learner bc"),
    "recurrent-ppo": ("--learner recurrent-ppo", "--learner recurrent-ppo --quick", "--resume runs/NAME"),
    **{
        name: (f"--learner {name}", f"--learner {name} --quick", "--resume runs/NAME")
        for name in ("sac", "tqc", "crossq")
    },
    "bc": ("--learner bc", "--learner bc --quick", "--learner bc --dataset cutenv/probe-v0", "--resume runs/NAME"),
    "iql": ("--learner iql", "--learner iql --quick", "--learner iql --dataset cutenv/probe-v0", "--resume runs/NAME"),
}
_NOTES = {
    "ppo": "Options worth trying: --task depth, --task path, --angle-mode fixed, --force unfelt, --history 6, "
    "--critic features.  The default script of --task depth is 'depth by force', that of --task path 'steer by force'."
}


def main(argv: Sequence[str]) -> int:
    """Train; return 0, 2 (bad input), 130 (Ctrl-C)."""
    several, rest = _several_tasks(argv)
    if several:
        return _side_by_side(several, rest)
    given = _parser(_learner(argv)).parse_args(argv)
    learner = given.learner
    del given.learner  # the rest are the options of the run
    try:
        _run(learner, run_request(LEARNERS[learner][1], given, learner))
    except BadArguments as error:
        print(f"cutenv train: {error}", file=sys.stderr)
        return 2
    return 0


def _several_tasks(argv: Sequence[str]) -> tuple[list[str], list[str]]:
    """Return several tasks of --task, and the other arguments."""
    first = _first_parser()
    first.add_argument("--task", nargs="+", default=[])
    chosen, rest = _known(first, argv)
    tasks = list(dict.fromkeys(chosen.task))
    return (tasks, rest) if len(tasks) > 1 and not {"-h", "--help"} & set(rest) else ([], [])


def _side_by_side(tasks: Sequence[str], rest: Sequence[str]) -> int:
    """Train several tasks in parallel, after checking all options."""
    from cutenv.agents.learning.side_by_side import train_side_by_side

    named = _first_parser()
    named.add_argument("--name")
    name, rest = _known(named, rest)
    stem = name.name or time.strftime("%Y%m%d-%H%M%S")
    arguments = {task: [*rest, "--task", task, "--name", f"{stem}-{task}"] for task in tasks}
    learner = _learner(rest)
    for own in arguments.values():
        given = _parser(learner).parse_args(own)
        try:
            if given.resume is not None:
                raise BadArguments("--resume continues one run, which knows its task; leave --task out.")
            del given.learner
            run_request(LEARNERS[learner][1], given, learner)
        except BadArguments as error:
            print(f"cutenv train: {error}", file=sys.stderr)
            return 2
    command = [sys.executable, "-m", "cutenv", "train"]
    return train_side_by_side({task: [*command, *own] for task, own in arguments.items()})


def training_options(learner: str, argv: Sequence[str]) -> LearnerArguments:
    """Return the options of a new run; raise BadArguments for a bad one."""
    kind = LEARNERS[learner][1]
    chosen = vars(_parser(learner).parse_args([*argv]))
    for name in ("learner", "quick", "from_nothing", "resume"):
        chosen.pop(name, None)
    return kind(**kind.completed(chosen))


def _learner(argv: Sequence[str]) -> str:
    """Return the learner's name, from run.json if resuming."""
    first = _first_parser()
    first.add_argument("--learner", choices=LEARNERS)
    first.add_argument("--resume", type=Path, metavar="RUN")
    chosen, _ = _known(first, argv)
    known = None if chosen.resume is None else _learner_of(chosen.resume)
    return chosen.learner or known or "ppo"


def _first_parser() -> argparse.ArgumentParser:
    """Return a parser of the few options that are read first."""
    return argparse.ArgumentParser(prog="cutenv train", add_help=False, allow_abbrev=False, exit_on_error=False)


def _known(first: argparse.ArgumentParser, argv: Sequence[str]) -> tuple[argparse.Namespace, list[str]]:
    """Return what a first parser knows, and the other arguments.

    What is wrong is left to the parser of all options, which says so on one line.
    """
    try:
        return first.parse_known_args(argv)
    except argparse.ArgumentError:
        return first.parse_args([]), list(argv)


def _learner_of(run: Path) -> str | None:
    """Return the learner recorded in run.json, or None."""
    try:
        agent = json.loads((run / "run.json").read_text())["agent"]
    except (OSError, ValueError, KeyError):
        return None
    return next((name for name, (known, _) in LEARNERS.items() if known == agent), None)


def _run(learner: str, request: RunRequest[Any]) -> None:
    """Run the learner, whose modules load torch."""
    require(*["tensorboard"] * request.arguments.tensorboard, *_OF_REPORT * bool(request.arguments.specimens))
    resume_command = f"{_program()} train --resume {request.run}"
    if learner == "bc":
        from cutenv.agents.learning import bc

        bc.run_learner(request, resume_command)
    elif learner == "iql":
        from cutenv.agents.learning import iql

        iql.run_learner(request, resume_command)
    else:
        from cutenv.agents.learning.on_policy import run_learner

        run_learner(_trial_learner(learner), request, resume_command)


def _trial_learner(name: str) -> Any:
    """Return a learner that learns by trial."""
    from cutenv.agents.learning.off_policy import OFF_POLICY
    from cutenv.agents.learning.on_policy import ON_POLICY

    return {**ON_POLICY, **OFF_POLICY}[name]


def _program() -> str:
    """Return this program's command, ``cutenv`` or Python with ``-m``."""
    if shutil.which("cutenv"):
        return "cutenv"
    python = Path(sys.executable)
    here = Path.cwd()
    return f"{python.relative_to(here) if python.is_relative_to(here) else python} -m cutenv"


def _parser(learner: str = "ppo") -> argparse.ArgumentParser:
    """Return the parser of the options of one learner."""
    about = f"{__doc__}\nThe options below are those of --learner {learner}; each learner's --help lists its own."
    parser = command_parser("train", about, examples=_EXAMPLES[learner], note=_NOTES.get(learner, ""))
    parser.option("--learner", "learner to train; default ppo, or that of a resumed run", learner, choices=LEARNERS)
    add_run_options(parser, LEARNERS[learner][1])
    return parser
