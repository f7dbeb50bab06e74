"""Train an agent to cut gently with PPO (Stable-Baselines3), compare it with every baseline, report.

    python agents/ppo.py                     about 10 minutes on 2 cores; writes runs/<name>/
    python agents/ppo.py --quick             about two minutes
    python agents/ppo.py --resume runs/NAME  goes on from the checkpoint of an interrupted run

The agent decides 10 times a second: a cut is then some 80 decisions, 300 at most.  gamma = 1 has no horizon, for a cut
ends by itself, and what it is scored by is the plain sum; with 0.995 progress made early is worth more, and the agent
learns a haste that the reward does not ask for.  It sees features that a person would work out, and a short history;
its critic sees the hidden state too, which training needs and cutting does not.

It starts as a clone of the best script and learns on by trial; for a while only the critic does, because one that knows
nothing would spoil the clone.  Exploration is given and falls: a policy that may keep its noise leans on it.  What is
tried on validation specimens, and kept where it does best, is the running average of the actor.
"""

from __future__ import annotations

import argparse
import dataclasses
import importlib.metadata
import json
import platform
import subprocess
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium
import torch
from cloning import clone, demonstrations
from compare import compare, read_rows
from evaluate import ENVIRONMENT, TEST_SEEDS, TRAINING_SEEDS, VALIDATION_SEEDS, write_csv
from progress import Progress, save
from seeing_critic import SeeingCritic, actor_parameters
from stable_baselines3 import PPO
from vectorised import CutVecEnv

from cutenv.policy import BASELINES, SCRIPTS, Network, save_policy
from cutenv.policy.features import feature_count
from cutenv.tissue.specimen import CLASSES

QUICK = {"timesteps": 400_000, "validations": 4, "validation_specimens": 50, "specimens": 30}
MAX_ENVIRONMENTS = 1000  # seeds that one training run may take of TRAINING_SEEDS
PACKAGES = ("cutenv", "gymnasium", "numpy", "numba", "scikit-fem", "stable-baselines3", "torch")


def option(default: Any, meaning: str, choices: tuple[str, ...] | None = None) -> Any:
    """A field of the arguments that is an option of the command line."""
    return dataclasses.field(default=default, metadata={"help": meaning, "choices": choices})


@dataclass(frozen=True)
class Arguments:
    """What a run depends on; every field is an option of the command line."""

    name: str = option("", "folder below runs/; default: date and time")
    seed: int = option(0, "of networks, exploration and training specimens")
    timesteps: int = option(8_000_000, "decisions to train for")
    specimen_class: str = option("mixed", "tissue to train and test on", CLASSES)
    angle_mode: str = option("free", "whether the agent turns the blade", ("free", "fixed"))
    control_hz: int = option(10, "decisions per second")
    history: int = option(6, "past decisions among the features")
    dead_zone: float = option(0.25, "share of the speed's action that means rest")
    environments: int = option(64, "side by side")
    rollout: int = option(128, "decisions of each environment between updates")
    batch_size: int = option(1024, "decisions of a gradient step")
    epochs: int = option(8, "passes over a rollout")
    learning_rate: float = option(3e-4, "at the start; falls linearly to a twentieth")
    gamma: float = option(1.0, "discount of a decision")
    gae_lambda: float = option(0.95, "of the generalised advantage estimate")
    averaging: float = option(0.03, "share of the actor that its running average takes over at every update")
    hidden: int = option(64, "units in each of two layers")
    demonstrations: int = option(200_000, "decisions of a script that the actor is taught first; 0: none")
    script: str = option("probe and creep", "that is demonstrated", tuple(SCRIPTS))
    demonstration_noise: float = option(0.15, "standard deviation of what is added to half of them")
    critic_first: float = option(0.03, "share of the training in which only the critic learns, after a demonstration")
    exploration: float = option(0.15, "standard deviation of the actions at the start")
    last_exploration: float = option(0.05, "and at the end; falls by the same factor in equal times")
    validation_specimens: int = option(200, "on which checkpoints are compared")
    validations: int = option(16, "times that this is done")
    specimens: int = option(200, "held-out specimens of the evaluation")
    checkpoint_seconds: float = option(20.0, "between checkpoints")

    def __post_init__(self) -> None:
        limits = {
            "seed": (0, len(TRAINING_SEEDS) // MAX_ENVIRONMENTS - 1),
            "timesteps": (1, 10**12),
            "history": (0, 100),
            "dead_zone": (0.0, 0.9),
            "environments": (1, MAX_ENVIRONMENTS),
            "gamma": (0.0, 1.0),
            "validation_specimens": (2, len(VALIDATION_SEEDS)),
            "validations": (1, 10**6),
            "specimens": (2, len(TEST_SEEDS)),
        }
        for name, (low, high) in limits.items():
            if not low <= getattr(self, name) <= high:
                raise SystemExit(f"--{name.replace('_', '-')} {getattr(self, name)} is outside {low} to {high}")

    @property
    def environment(self) -> dict[str, Any]:
        """Keywords of the environment that the agent is trained and tested in."""
        return {name: getattr(self, name) for name in ("specimen_class", "angle_mode", "control_hz")}

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
        """Environments with those seeds."""
        return CutVecEnv(seeds, history=self.history, dead_zone=self.dead_zone, **self.environment)


@dataclass(frozen=True)
class LinearDecay:
    """A rate that falls linearly to a twentieth as training goes on."""

    rate: float

    def __call__(self, remaining: float) -> float:
        """The rate with a share of training ``remaining``, 1 to 0."""
        return self.rate * (0.05 + 0.95 * remaining)


def new_model(arguments: Arguments) -> PPO:
    """An untrained agent."""
    return PPO(
        SeeingCritic,
        arguments.environments_at(arguments.training_seeds),
        learning_rate=LinearDecay(arguments.learning_rate),
        n_steps=arguments.rollout,
        batch_size=arguments.batch_size,
        n_epochs=arguments.epochs,
        gamma=arguments.gamma,
        gae_lambda=arguments.gae_lambda,
        policy_kwargs={"features": feature_count(arguments.history), "hidden": arguments.hidden},
        seed=arguments.seed,
        device="cpu",  # a network this small is slower on a GPU
    )


def cloned(model: PPO, arguments: Arguments) -> None:
    """Teach the actor the demonstrated script."""
    shown, taught = demonstrations(
        model.get_env(),
        BASELINES[arguments.script],
        decisions=arguments.demonstrations,
        noise=arguments.demonstration_noise,
        seed=arguments.seed,
    )
    policy = model.policy
    error = clone(
        lambda seen: policy.action_net(policy.mlp_extractor.forward_actor(seen)),
        actor_parameters(model),
        shown,
        taught,
        seed=arguments.seed,
    )
    print(f"the clone's actions differ from those of {arguments.script!r} by {error:.3f} (root of the mean square)")


def train(arguments: Arguments, run: Path, resume: bool) -> tuple[bool, float]:
    """Train; return whether training came to its end, and the share of its time that the environments took."""
    torch.set_num_threads(1)  # two pools of threads on two cores fight
    checkpoint = run / "checkpoint.zip"
    if resume:
        environments = arguments.environments_at(arguments.training_seeds)
        model = PPO.load(checkpoint, env=environments, device="cpu")
        print(f"resuming after {model.num_timesteps} decisions")
    else:
        model = new_model(arguments)
        save(model, run / "untrained.zip")
        if arguments.demonstrations:
            cloned(model, arguments)
    progress = Progress(run, arguments, read_rows(run / "learning_curve.csv") if resume else [])
    whole, environments = True, model.get_env()
    begun, spent = time.perf_counter(), environments.seconds
    try:
        remaining = max(arguments.timesteps - model.num_timesteps, 0)
        if remaining:
            model.learn(remaining, callback=progress, reset_num_timesteps=not resume)
            progress.init_callback(model)
            progress.validate()
    except KeyboardInterrupt:
        whole = False
    share = (environments.seconds - spent) / (time.perf_counter() - begun)
    save(model, checkpoint)
    if whole and not (run / "policy.zip").is_file():  # ended before it was ever validated
        save(model, run / "policy.zip")
    if progress.curve:
        write_csv(run / "learning_curve.csv", progress.curve)
    return whole, share


def export(arguments: Arguments, run: Path, name: str, facts: dict[str, Any]) -> Path:
    """Write ``name``.zip's actor as a folder that needs no torch, ``name``/policy.safetensors and card.json."""
    model = PPO.load(run / f"{name}.zip", device="cpu")
    arrays = {key: value.detach().cpu().numpy() for key, value in model.policy.state_dict().items()}
    save_policy(
        run / name,
        Network.from_state_dict(arrays, "tanh"),
        environment=ENVIRONMENT,
        environment_arguments={"control_hz": arguments.control_hz, "angle_mode": arguments.angle_mode},
        features={"history": arguments.history},
        dead_zone=arguments.dead_zone,
        training=facts | {"decisions": int(model.num_timesteps)},
        replace=True,
    )
    return run / name


def record_run(arguments: Arguments, run: Path) -> dict[str, Any]:
    """Make the run's folder and keep there what the run depends on: arguments, seeds, versions, commit."""
    gymnasium.make(ENVIRONMENT, **arguments.environment).close()  # refuses nonsense before anything is made
    ranges = {"training": TRAINING_SEEDS, "validation": VALIDATION_SEEDS, "test": TEST_SEEDS}
    used = {
        "training": arguments.training_seeds,
        "validation": arguments.validation_seeds,
        "test": TEST_SEEDS[: arguments.specimens],
    }
    for name, seeds in used.items():
        assert seeds[0] in ranges[name], f"seeds of {name} begin outside their range"
        assert seeds[-1] in ranges[name], f"seeds of {name} end outside their range"
    assert TRAINING_SEEDS.stop <= VALIDATION_SEEDS.start < VALIDATION_SEEDS.stop <= TEST_SEEDS.start
    run.mkdir(parents=True, exist_ok=True)
    git = subprocess.run(
        ["git", "rev-parse", "HEAD"], cwd=Path(__file__).parent, capture_output=True, text=True, check=False
    )
    content = {
        "arguments": dataclasses.asdict(arguments),
        "environment": ENVIRONMENT,
        "seeds": {name: [min(seeds), max(seeds)] for name, seeds in used.items()},
        "versions": {name: importlib.metadata.version(name) for name in PACKAGES}
        | {"python": platform.python_version()},
        "commit": git.stdout.strip() or None,
    }
    (run / "run.json").write_text(json.dumps(content, indent=1) + "\n")
    return content


def parse() -> tuple[Arguments, Path, bool]:
    """The command line: arguments, folder of the run, whether to resume it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for field in dataclasses.fields(Arguments):
        kind = {"str": str, "int": int, "float": float}[str(field.type)]
        default = f" (default {field.default})" if field.default != "" else ""
        parser.add_argument(
            "--" + field.name.replace("_", "-"),
            type=kind,
            choices=field.metadata["choices"],
            metavar=None if field.metadata["choices"] else kind.__name__.upper(),
            help=field.metadata["help"] + default,
        )
    parser.add_argument("--quick", action="store_true", help="two minutes in all: 400 000 decisions, 30 specimens")
    parser.add_argument("--resume", type=Path, metavar="RUN", help="folder of an interrupted run to go on with")
    given = vars(parser.parse_args())
    quick, resume = given.pop("quick"), given.pop("resume")
    chosen = {name: value for name, value in given.items() if value is not None}
    if resume is not None:
        if not (resume / "checkpoint.zip").is_file():
            raise SystemExit(f"{resume} holds no checkpoint.zip; give the folder of an interrupted run.")
        kept = json.loads((resume / "run.json").read_text())["arguments"]
        return Arguments(**(kept | chosen)), resume, True
    if quick:
        for name, value in QUICK.items():
            chosen.setdefault(name, value)
    arguments = Arguments(**chosen)
    name = arguments.name or time.strftime("ppo-%Y%m%d-%H%M%S")
    run = Path("runs") / name
    if run.exists():
        raise SystemExit(f"{run} exists; give another --name, or --resume {run} to go on with it.")
    return dataclasses.replace(arguments, name=name), run, False


def main() -> None:
    """Train, evaluate, report."""
    arguments, run, resume = parse()
    facts = record_run(arguments, run)
    begun = time.monotonic()
    whole, share = train(arguments, run, resume)
    print(f"the environments took {100.0 * share:.0f} % of the time")
    if not whole:
        print(f"\ninterrupted; {run}/checkpoint.zip is usable.")
        print(f"Go on with: python3 scripts/start.py train --resume {run}")
        raise SystemExit(130)
    facts["training_minutes"] = round((time.monotonic() - begun) / 60.0, 1)
    facts["environments_share"] = round(share, 3)
    try:
        for name in ("policy", "untrained"):
            export(arguments, run, name, facts)
        compare(run, facts)
    except KeyboardInterrupt:
        print(f"\ninterrupted while evaluating; {run}/policy.zip is the trained agent.")
        print(f"Evaluate it with: python3 scripts/start.py train --resume {run}")
        raise SystemExit(130) from None


if __name__ == "__main__":
    main()
