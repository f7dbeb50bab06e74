"""Arguments of every agent's program: one dataclass is its configuration and its command line."""

from __future__ import annotations

import argparse
import dataclasses
import json
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from checkpoints import NAMES, checkpoint_of
from evaluate import TEST_SEEDS, TRAINING_SEEDS, VALIDATION_SEEDS
from options import option
from vectorised import CutVecEnv

from cutenv.policy import SCRIPTS
from cutenv.tissue.specimen import CLASSES

MAX_ENVIRONMENTS = 1000  # seeds of TRAINING_SEEDS that one training run may use


@dataclass(frozen=True, kw_only=True)
class AgentArguments:
    """Arguments common to every agent's runs; every field is an option of the command line."""

    name: str = option("", "name of the run's folder below runs/; default date and time")
    seed: int = option(0, "seed of networks, exploration and training specimens")
    minutes: float = option(
        0.0, "wall-clock minutes after which training ends, demonstrations included; 0: no limit", resumable=True
    )
    specimen_class: str = option("mixed", "tissue to train and test on", CLASSES)
    angle_mode: str = option("free", "whether the agent turns the blade", ("free", "fixed"))
    fixed_angle_deg: float = option(90.0, "angle of a blade that the agent does not turn [deg]")
    control_hz: int = option(10, "decisions per second")
    history: int = option(6, "number of past decisions among the features")
    force: str = option("felt", "whether the agent feels the force", ("felt", "unfelt"))
    dead_zone: float = option(0.25, "share of the speed's action that means rest")
    environments: int = option(64, "number of environments that run side by side")
    hidden: int = option(64, "number of units in each layer")
    demonstrations: int = option(200_000, "number of decisions of a script to clone first; 0: none")
    script: str = option("probe and creep", "script to clone", tuple(SCRIPTS))
    demonstration_noise: float = option(0.15, "standard deviation of the noise added to half of the demonstrations")
    validation_specimens: int = option(200, "number of specimens that checkpoints are compared on")
    validations: int = option(16, "number of times that checkpoints are compared", resumable=True)
    specimens: int = option(
        200, "number of held-out specimens to evaluate on; 0: none, the policy is written all the same", resumable=True
    )
    checkpoint_seconds: float = option(20.0, "seconds between checkpoints", resumable=True)
    tensorboard: bool = option(False, "write events for TensorBoard into the run's folder", resumable=True)

    def __post_init__(self) -> None:
        for name, (low, high) in self.limits().items():
            if not low <= getattr(self, name) <= high:
                raise SystemExit(f"{_flag(name)} {getattr(self, name)} is outside {low} to {high}")
        if self.angle_mode == "free" and self.fixed_angle_deg != 90.0:
            raise SystemExit(f"--fixed-angle-deg {self.fixed_angle_deg:g} has no effect without --angle-mode fixed")
        if self.specimens == 1:
            raise SystemExit("--specimens 1 tells no interval; give 2 or more, or 0 for no evaluation")

    @classmethod
    def limits(cls) -> dict[str, tuple[float, float]]:
        """Return the admissible ranges of the numbers."""
        return {
            "seed": (0, len(TRAINING_SEEDS) // MAX_ENVIRONMENTS - 1),
            "minutes": (0.0, 1e6),
            "fixed_angle_deg": (45.0, 90.0),
            "history": (0, 100),
            "dead_zone": (0.0, 0.9),
            "environments": (1, MAX_ENVIRONMENTS),
            "hidden": (1, 4096),
            "demonstrations": (0, 10**9),
            "demonstration_noise": (0.0, 1.0),
            "validation_specimens": (2, len(VALIDATION_SEEDS)),
            "validations": (1, 10**6),
            "specimens": (0, len(TEST_SEEDS)),
            "checkpoint_seconds": (0.0, 1e6),
        }

    @classmethod
    def completed(cls, chosen: Mapping[str, Any]) -> dict[str, Any]:
        """Return the choices for a new run, with what follows from them; SystemExit for a contradiction."""
        return dict(chosen)

    @property
    def environment(self) -> dict[str, Any]:
        """Keyword arguments of the environment in which the agent is trained and tested."""
        return {"specimen_class": self.specimen_class, "control_hz": self.control_hz, **self.angle}

    @property
    def angle(self) -> dict[str, Any]:
        """Keyword arguments of the environment for the blade's angle: free, or fixed at a value."""
        return {"angle_mode": self.angle_mode} | (
            {"fixed_angle_deg": self.fixed_angle_deg} if self.angle_mode == "fixed" else {}
        )

    @property
    def features(self) -> dict[str, Any]:
        """Keyword arguments of :class:`cutenv.policy.Features`; the force only if it is not used."""
        return {"history": self.history} | ({} if self.force == "felt" else {"force": False})

    @property
    def training_seeds(self) -> range:
        """Seeds of the training environments."""
        first = self.seed * MAX_ENVIRONMENTS
        return range(first, first + self.environments)

    @property
    def validation_seeds(self) -> range:
        """Seeds of the specimens on which checkpoints are compared."""
        return VALIDATION_SEEDS[: self.validation_specimens]

    def environments_at(self, seeds: range) -> CutVecEnv:
        """Make environments with those seeds."""
        return CutVecEnv(seeds, dead_zone=self.dead_zone, **self.features, **self.environment)


Given = TypeVar("Given", bound=AgentArguments)


def parse(kind: type[Given], about: str | None, prefix: str, quick: Mapping[str, Any]) -> tuple[Given, Path, bool]:
    """Parse the command line: arguments, folder of the run, whether to resume it.

    ``prefix`` begins the name of a run without a given one; ``quick`` contains the values that ``--quick`` sets.
    """
    parser = argparse.ArgumentParser(description=about, formatter_class=argparse.RawDescriptionHelpFormatter)
    for field in dataclasses.fields(kind):
        flag, meaning = _flag(field.name), field.metadata["help"]
        if str(field.type) == "bool":
            parser.add_argument(flag, action="store_const", const=True, help=meaning)
            continue
        of = {"str": str, "int": int, "float": float}[str(field.type)]
        choices = field.metadata["choices"]
        default = f" (default {field.default})" if field.default != "" else ""
        shown = None if choices else {str: "TEXT", int: "N", float: "X"}[of]
        parser.add_argument(flag, type=of, choices=choices, metavar=shown, help=meaning + default)
    replaced = ", ".join(f"{name.replace('_', ' ')} {value}" for name, value in quick.items())
    parser.add_argument("--quick", action="store_true", help=f"some two minutes in all: {replaced}")
    parser.add_argument("--resume", type=Path, metavar="RUN", help="folder of an interrupted run to go on with")
    given = vars(parser.parse_args())
    is_quick, resume = given.pop("quick"), given.pop("resume")
    chosen = {name: value for name, value in given.items() if value is not None}
    if resume is not None:
        if is_quick:
            raise SystemExit(f"--quick is for a new run; leave it out, {resume} keeps its arguments.")
        return resumed(kind, resume, chosen), resume, True
    chosen = kind.completed(chosen)
    if is_quick:
        for name, value in quick.items():
            chosen.setdefault(name, value)
    arguments = kind(**chosen)
    name = arguments.name or time.strftime(f"{prefix}-%Y%m%d-%H%M%S")
    run = Path("runs") / name
    if run.exists():
        raise SystemExit(f"{run} exists; give another --name, or --resume {run} to go on with it.")
    return dataclasses.replace(arguments, name=name), run, False


def resumed(kind: type[Given], run: Path, chosen: Mapping[str, Any]) -> Given:
    """Return the arguments of an interrupted run, updated by those given; SystemExit for one without effect."""
    if checkpoint_of(run) is None:
        raise SystemExit(f"{run} holds no {' or '.join(NAMES)}; give the folder of an interrupted run.")
    kept = json.loads((run / "run.json").read_text())["arguments"]
    if set(kept) != {field.name for field in dataclasses.fields(kind)}:
        raise SystemExit(f"{run} is of another program, or of another version of it; go on with the one that made it.")
    free = [field.name for field in dataclasses.fields(kind) if field.metadata["resumable"]]
    for name, value in chosen.items():
        if name not in free and value != kept.get(name):
            raise SystemExit(
                f"{_flag(name)} {value} would have no effect: {run} goes on with {kept.get(name)!r}. Leave it out or "
                f"begin another run; what can be given anew is {', '.join(map(_flag, free))}."
            )
    return kind(**(kept | chosen))


def _flag(name: str) -> str:
    return "--" + name.replace("_", "-")
