"""Command line of a training run: its options, the folder of the run, and the options of a run that is resumed."""

from __future__ import annotations

import argparse
import dataclasses
import json
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Generic, TypeVar

from cutenv.learning.arguments import BadArguments, LearnerArguments, for_rig
from cutenv.learning.checkpoint import NAMES, checkpoint_of
from cutenv.learning.options import add_options, declared, flag_of, parse

Chosen = TypeVar("Chosen", bound=LearnerArguments)


@dataclasses.dataclass(frozen=True)
class RunRequest(Generic[Chosen]):
    """Training run requested on a command line."""

    arguments: Chosen
    """Options of the run."""
    run: Path
    """Folder of the run."""
    resume: bool
    """True to resume an interrupted run in this folder."""


def add_run_options(parser: argparse.ArgumentParser, kind: type[LearnerArguments]) -> None:
    """Add the options of a run: those of its learner, ``--quick`` and ``--resume``."""
    add_options(parser, kind)
    replaced = ", ".join(f"{name.replace('_', ' ')} {value}" for name, value in kind.quick.items())
    parser.add_argument("--quick", action="store_true", help=f"train for some two minutes: {replaced}")
    parser.add_argument("--resume", type=Path, metavar="RUN", help="folder of an interrupted run to resume")


def run_request(kind: type[Chosen], given: argparse.Namespace, prefix: str) -> RunRequest[Chosen]:
    """Check the options of a run, and return the run that they request.

    Parameters
    ----------
    kind : type
        Class of the options.
    given : argparse.Namespace
        Result of a parser with :func:`add_run_options`, and no other option.
    prefix : str
        First part of the default name of a run.

    Raises
    ------
    BadArguments
        For an option out of range, a folder that exists, or an option without effect on a run that is resumed.
    """
    chosen = dict(vars(given))
    is_quick, resume = chosen.pop("quick"), chosen.pop("resume")
    if resume is not None:
        if is_quick:
            raise BadArguments(f"--quick is for a new run, and {resume} keeps its arguments; leave it out.")
        return RunRequest(resumed(kind, resume, chosen), resume, resume=True)
    arguments = kind(**kind.completed(for_rig(chosen), quick=is_quick))
    name = arguments.name or time.strftime(f"{prefix}-%Y%m%d-%H%M%S")
    run = Path("runs") / name
    if run.exists():
        raise BadArguments(f"{run} exists; give another --name, or --resume {run} to continue it.")
    return RunRequest(dataclasses.replace(arguments, name=name), run, resume=False)


def resumed(kind: type[Chosen], run: Path, chosen: Mapping[str, Any]) -> Chosen:
    """Return the options of an interrupted run, updated with those chosen now.

    Raises
    ------
    BadArguments
        If there is no checkpoint, the run is another learner's, or an option would have no effect.
    """
    if checkpoint_of(run) is None:
        raise BadArguments(f"{run} contains no {' or '.join(NAMES)}; give the folder of an interrupted run.")
    kept = json.loads((run / "run.json").read_text())["arguments"]
    if set(kept) != {field.name for field in dataclasses.fields(kind)}:
        raise BadArguments(
            f"{run} was made by another learner, or by another version; resume it with the one that made it."
        )
    free = [field.name for field in dataclasses.fields(kind) if declared(kind, field.name)["resumable"]]
    for name, value in chosen.items():
        if name not in free and value != kept.get(name):
            raise BadArguments(
                f"{flag_of(name)} {value} would have no effect: {run} continues with {kept.get(name)!r}. Leave it out "
                f"or begin another run; a resumed run takes {', '.join(map(flag_of, free))}."
            )
    return kind(**(kept | chosen))


def run_program(train: Callable[[Chosen, Path], None], kind: type[Chosen], prefix: str, about: str | None) -> None:
    """Run one of the programs in ``agents/``: read its options, train into a new folder, print where the policy is."""
    arguments = parse(kind, about)
    arguments = dataclasses.replace(arguments, **for_rig({"rig": arguments.rig, "control_hz": arguments.control_hz}))
    run = Path("runs") / (arguments.name or time.strftime(f"{prefix}-%Y%m%d-%H%M%S"))
    train(arguments, run)
    print(f"policy: {run / 'policy'}")
