"""Run of a training.

Its command line, and its folder: run.json, checkpoints, and the actor, which needs no torch.
"""

from __future__ import annotations

import argparse
import dataclasses
import importlib.metadata
import json
import platform
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Generic, NoReturn, TypeVar

import gymnasium

from cutenv._base.output import atomic_write, check_writable
from cutenv._base.resources import git
from cutenv.agents.learning.arguments import BadArguments, LearnerArguments, for_rig
from cutenv.agents.learning.option_fields import add_options, declared, flag_of, parse
from cutenv.agents.learning.seeds import TEST_SEEDS, TRAINING_SEEDS, VALIDATION_SEEDS
from cutenv.agents.policy import Network, RecurrentNetwork, save_policy

PACKAGES = ("cutenv", "gymnasium", "numpy", "numba", "scikit-fem", "stable-baselines3", "sb3-contrib", "torch")


def record_run(arguments: LearnerArguments, run: Path, agent: str) -> dict[str, Any]:
    """Write run.json with all that the run depends on; return its content.

    A run that is resumed keeps the versions and the commit of its start.
    """
    gymnasium.make(
        arguments.learned_task.id, **arguments.environment
    ).close()  # refuses nonsense before anything is made
    ranges = {"training": TRAINING_SEEDS, "validation": VALIDATION_SEEDS, "test": TEST_SEEDS}
    used = {
        "training": arguments.training_seeds,
        "validation": arguments.validation_seeds,
        "test": TEST_SEEDS[: arguments.specimens],
    }
    for name, seeds in used.items():
        assert all(seed in ranges[name] for seed in (*seeds[:1], *seeds[-1:])), f"seeds of {name} leave their range"
    assert TRAINING_SEEDS.stop <= VALIDATION_SEEDS.start < VALIDATION_SEEDS.stop <= TEST_SEEDS.start
    try:
        run.mkdir(parents=True, exist_ok=True)
        check_writable("folder", run)
    except OSError as error:
        made = f"{run} cannot be made ({(error.strerror or '').lower()}). Start in a folder of your own."
        raise BadArguments(made if error.strerror else str(error)) from None
    content = {
        "agent": agent,
        "arguments": dataclasses.asdict(arguments),
        "environment": arguments.learned_task.id,
        "simulated_rig": arguments.simulated,
        "seeds": {name: [min(seeds), max(seeds)] for name, seeds in used.items() if seeds},
        **origin(run, PACKAGES),
    }
    write_facts(run, content)
    return content


def export(
    arguments: LearnerArguments, folder: Path, network: Network | RecurrentNetwork, facts: Mapping[str, Any]
) -> None:
    """Write an actor as policy.safetensors and card.json, which holds ``facts``."""
    save_policy(
        folder,
        network,
        environment=arguments.learned_task.id,
        environment_arguments={"control_hz": arguments.control_hz, **arguments.angle},
        features=arguments.features,
        **arguments.correction,
        training=facts,
        replace=True,
    )


def origin(run: Path, packages: Sequence[str]) -> dict[str, Any]:
    """Return versions and commit for ``run.json``, those of the start if resumed, with what was measured then.

    Commits that differ from the first are listed as ``resumed_at_commits``, each formatted by :func:`marked`.
    """
    present = {
        "versions": {
            **{name: importlib.metadata.version(name) for name in packages},
            "python": platform.python_version(),
        },
        "commit": git("rev-parse", "HEAD"),
        "uncommitted_changes": bool(git("status", "--porcelain", "--untracked-files=no")),
    }
    path = run / "run.json"
    if not path.is_file():
        return present
    kept = json.loads(path.read_text())
    first = {name: kept.get(name, value) for name, value in present.items()}
    later = list(kept.get("resumed_at_commits", ()))
    if marked(present) not in (marked(first), *later):
        later.append(marked(present))
    measured = {name: kept[name] for name in ("environments_share",) if name in kept}
    return first | ({"resumed_at_commits": later} if later else {}) | measured


def marked(facts: Mapping[str, Any]) -> str:
    """Return a run's commit, marked if changes were uncommitted."""
    return f"{facts['commit']}{'+changes' if facts.get('uncommitted_changes') else ''}"


def write_facts(run: Path, facts: Mapping[str, Any]) -> None:
    """Write ``run.json`` atomically."""
    with atomic_write(run / "run.json") as part:
        part.write_text(json.dumps(facts, indent=1) + "\n")


NAMES = ("checkpoint.zip", "checkpoint.safetensors")
"""File names of checkpoints, of Stable-Baselines3 and of behaviour cloning."""


def checkpoint_of(run: Path) -> Path | None:
    """Return a run's finished checkpoint, or None."""
    return next((run / name for name in NAMES if (run / name).is_file()), None)


def end_interrupted(run: Path, resume_command: str) -> NoReturn:
    """Print how to resume an interrupted run, and exit with Ctrl-C's status."""
    checkpoint = checkpoint_of(run)
    if checkpoint is not None:
        print(f"\ninterrupted; {checkpoint} is usable.\nResume with: {resume_command}")
    else:
        print(f"\ninterrupted before the first checkpoint: there is nothing to resume. {run} may be deleted.")
    raise SystemExit(130)


Chosen = TypeVar("Chosen", bound=LearnerArguments)


@dataclasses.dataclass(frozen=True)
class RunRequest(Generic[Chosen]):
    """Training run requested on a command line."""

    arguments: Chosen
    run: Path
    resume: bool  # True to resume an interrupted run in this folder


def add_run_options(parser: argparse.ArgumentParser, kind: type[LearnerArguments]) -> None:
    """Add a run's options: its learner's, ``--quick``, ``--from-nothing`` and ``--resume``."""
    add_options(parser, kind)
    replaced = ", ".join(f"{name.replace('_', ' ')} {value}" for name, value in kind.quick.items())
    parser.add_argument("--quick", action="store_true", help=f"train for some two minutes: {replaced}")
    if kind.from_nothing:
        own = ", ".join(f"{name.replace('_', ' ')} {value}" for name, value in kind.from_nothing.items())
        meaning = f"no script and no demonstrations, an easier task at first: demonstrations 0, {own}"
        parser.add_argument("--from-nothing", action="store_true", help=meaning)
    parser.add_argument("--resume", type=Path, metavar="RUN", help="folder of an interrupted run to resume")


def run_request(kind: type[Chosen], given: argparse.Namespace, prefix: str) -> RunRequest[Chosen]:
    """Check options of a parser with :func:`add_run_options`; return the run.

    ``prefix`` is the first part of its default name.

    Raises BadArguments for an option out of range, a folder that exists, or an option without effect on a run that is
    resumed.
    """
    chosen = dict(vars(given))
    is_quick, resume = chosen.pop("quick"), chosen.pop("resume")
    from_nothing = chosen.pop("from_nothing", False)
    if from_nothing and resume is None:
        chosen = kind.knowing_nothing(chosen, quick=is_quick)
    if resume is not None:
        for flag in ["--quick"] * is_quick + ["--from-nothing"] * from_nothing:
            raise BadArguments(f"{flag} is for a new run, and {resume} keeps its arguments; leave it out.")
        return RunRequest(resumed(kind, resume, chosen), resume, resume=True)
    arguments = kind(**kind.completed(for_rig(chosen), quick=is_quick))
    name = arguments.name or time.strftime(f"{prefix}-%Y%m%d-%H%M%S")
    run = Path("runs") / name
    if run.exists():
        raise BadArguments(f"{run} exists; give another --name, or --resume {run} to continue it.")
    return RunRequest(dataclasses.replace(arguments, name=name), run, resume=False)


def resumed(kind: type[Chosen], run: Path, chosen: Mapping[str, Any]) -> Chosen:
    """Return an interrupted run's options, updated with those chosen now.

    Raises BadArguments if there is no checkpoint, the run is another learner's, or an option would have no effect.
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
    """Run a program of ``agents/`` from options to trained policy."""
    arguments = parse(kind, about)
    arguments = dataclasses.replace(arguments, **for_rig({"rig": arguments.rig, "control_hz": arguments.control_hz}))
    run = Path("runs") / (arguments.name or time.strftime(f"{prefix}-%Y%m%d-%H%M%S"))
    train(arguments, run)
    print(f"policy: {run / 'policy'}")
