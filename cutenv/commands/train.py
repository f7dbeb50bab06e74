"""Train an agent to cut gently, compare it with every baseline, report.

    cutenv train                        PPO; about 10 minutes on 2 cores; writes runs/<name>/
    cutenv train --quick                about two minutes
    cutenv train --resume runs/NAME     continues an interrupted run from its checkpoint
    cutenv train --learner recurrent-ppo    the actor has a memory; about 20 minutes
    cutenv train --learner bc               behaviour cloning, without any trial; some three minutes
    cutenv train --learner bc --dataset ID  clones a Minari data set (cutenv datasets) instead of a script

Options worth trying with PPO: --angle-mode fixed, --force unfelt, --history 6, --critic features.
"""

from __future__ import annotations

import argparse
import json
import shutil
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from cutenv.learning.arguments import BadArguments, BCArguments, LearnerArguments, PPOArguments, RecurrentPPOArguments
from cutenv.learning.command_line import RunRequest, parse_run

LEARNERS: dict[str, tuple[str, type[LearnerArguments]]] = {
    "ppo": ("PPO", PPOArguments),
    "recurrent-ppo": ("recurrent PPO", RecurrentPPOArguments),
    "bc": ("behaviour cloning", BCArguments),
}
"""Name on the command line -> name in run.json, and class of the options."""


def main(argv: Sequence[str]) -> int:
    """Train; 2 if an option is bad, 130 after Ctrl-C."""
    try:
        learner, rest = _learner(argv)
        about = f"{__doc__}\nThe options below are those of --learner {learner}."
        request = parse_run(LEARNERS[learner][1], about, learner, rest, "cutenv train")
        _run(learner, request)
    except BadArguments as error:
        print(f"cutenv train: {error}", file=sys.stderr)
        return 2
    return 0


def _learner(argv: Sequence[str]) -> tuple[str, list[str]]:
    """Return the learner's name, read from run.json when resuming, and the rest of the command line."""
    first = argparse.ArgumentParser(prog="cutenv train", add_help=False, allow_abbrev=False)
    first.add_argument("--learner", choices=LEARNERS)
    chosen, rest = first.parse_known_args(argv)
    second = argparse.ArgumentParser(prog="cutenv train", add_help=False, allow_abbrev=False)
    second.add_argument("--resume", type=Path)
    resumed, _ = second.parse_known_args(rest)
    known = None if resumed.resume is None else _learner_of(resumed.resume)
    return chosen.learner or known or "ppo", rest


def _learner_of(run: Path) -> str | None:
    """Return the name of the learner that made a run, or None if run.json has none."""
    try:
        agent = json.loads((run / "run.json").read_text())["agent"]
    except (OSError, ValueError, KeyError):
        return None
    return next((name for name, (known, _) in LEARNERS.items() if known == agent), None)


def _run(learner: str, request: RunRequest[Any]) -> None:
    """Run the learner, whose modules load torch."""
    resume_command = f"{_program()} train --resume {request.run}"
    if learner == "bc":
        from cutenv.learning import bc

        bc.run_learner(request, resume_command)
    else:
        from cutenv.learning.on_policy import run_learner

        if learner == "ppo":
            from cutenv.learning.ppo import LEARNER
        else:
            from cutenv.learning.recurrent_ppo import LEARNER
        run_learner(LEARNER, request, resume_command)


def _program() -> str:
    """Return the command that starts this program: ``cutenv`` where the shell finds it, else Python with ``-m``."""
    if shutil.which("cutenv"):
        return "cutenv"
    python = Path(sys.executable)
    here = Path.cwd()
    return f"{python.relative_to(here) if python.is_relative_to(here) else python} -m cutenv"
