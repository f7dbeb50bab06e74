"""Train an agent to cut gently with PPO (Stable-Baselines3), evaluate it beside scripts, keep everything.

    python agents/ppo.py                     a few minutes on 2 cores; writes runs/<name>/
    python agents/ppo.py --quick             about a minute
    python agents/ppo.py --resume runs/NAME  goes on from the checkpoint of an interrupted run

The agent decides 10 times a second: an episode is then about 80 decisions, and gamma = 0.995 looks 200 of them ahead.
Its speed has a dead zone, because nothing that jitters can hold still, and a cut is finished at rest.
"""

from __future__ import annotations

import argparse
import dataclasses
import importlib.metadata
import json
import math
import platform
import subprocess
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import torch
from evaluate import (
    ENVIRONMENT,
    TEST_SEEDS,
    TRAINING_SEEDS,
    Contestant,
    evaluate,
    print_table,
    run_cut,
    summarise,
    write_csv,
)
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.vec_env import VecEnv
from tqdm import tqdm

from cutenv.policy import ConstantFeed, FastThenSlow, RandomAction, TipEstimate
from cutenv.report import draw_cut
from cutenv.task.observation import BOUND, COMPONENTS, SCALES
from cutenv.tissue.specimen import CLASSES

MAX_ENVIRONMENTS = 1000  # seeds that one training run may take of TRAINING_SEEDS
POSITION, DISTANCE = ([c.name for c in COMPONENTS].index(name) for name in ("position", "distance"))
PACKAGES = ("cutenv", "gymnasium", "numpy", "numba", "scikit-fem", "stable-baselines3", "torch")


def option(default: Any, meaning: str, choices: tuple[str, ...] | None = None) -> Any:
    """A field of the arguments that is an option of the command line."""
    return dataclasses.field(default=default, metadata={"help": meaning, "choices": choices})


@dataclass(frozen=True)
class Arguments:
    """What a run depends on; every field is an option of the command line."""

    name: str = option("", "folder below runs/; default: date and time")
    seed: int = option(0, "of networks, exploration and training specimens")
    timesteps: int = option(1_500_000, "decisions to train for")
    specimen_class: str = option("liver", "tissue to train and test on", CLASSES)
    angle_mode: str = option("free", "whether the agent turns the blade", ("free", "fixed"))
    control_hz: int = option(10, "decisions per second")
    dead_zone: float = option(0.25, "share of the speed's action that means rest")
    environments: int = option(16, "side by side")
    rollout: int = option(512, "decisions of each environment between updates")
    batch_size: int = option(256, "decisions of a gradient step")
    epochs: int = option(4, "passes over a rollout")
    learning_rate: float = option(1e-3, "at the start; falls linearly to a tenth")
    gamma: float = option(0.995, "discount of a decision")
    gae_lambda: float = option(0.95, "of the generalised advantage estimate")
    hidden: int = option(64, "units in each of two layers")
    specimens: int = option(100, "held-out specimens of the evaluation")
    checkpoint_seconds: float = option(20.0, "between checkpoints")

    def __post_init__(self) -> None:
        limits = {
            "seed": (0, len(TRAINING_SEEDS) // MAX_ENVIRONMENTS - 1),
            "timesteps": (1, 10**12),
            "dead_zone": (0.0, 0.9),
            "environments": (1, MAX_ENVIRONMENTS),
            "gamma": (0.0, 1.0),
            "specimens": (2, len(TEST_SEEDS)),
        }
        for name, (low, high) in limits.items():
            if not low <= getattr(self, name) <= high:
                raise SystemExit(f"--{name.replace('_', '-')} {getattr(self, name)} is outside {low} to {high}")


class Adapter(gymnasium.Wrapper[Any, Any, Any, Any]):
    """What stands between the environment and the network: features on one side, a dead zone on the other."""

    def __init__(self, env: gymnasium.Env[Any, Any], dead_zone: float) -> None:
        super().__init__(env)
        self._dead_zone = dead_zone
        self._features = Features()
        assert env.observation_space.shape is not None
        size = env.observation_space.shape[0] + Features.ADDED
        self.observation_space = gymnasium.spaces.Box(-BOUND, BOUND, (size,), np.float32)

    def reset(self, **kwargs: Any) -> tuple[np.ndarray, dict[str, Any]]:
        """Reset the environment; the observation with its features."""
        observation, info = self.env.reset(**kwargs)
        self._features.reset()
        return self._features(observation), info

    def step(self, action: np.ndarray) -> tuple[np.ndarray, Any, bool, bool, dict[str, Any]]:
        """Step with the speed past the dead zone; the observation with its features."""
        observation, reward, terminated, truncated, info = self.env.step(past_dead_zone(action, self._dead_zone))
        return self._features(observation), reward, terminated, truncated, info


class Features:
    """An observation, and in it what a person would compute first: where the tip is, were the tissue the mean one."""

    ADDED = 2

    def __init__(self) -> None:
        self._tip_estimate = TipEstimate()

    def reset(self) -> None:
        """Forget the last cut."""
        self._tip_estimate.reset()

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        """The observation with distance of the estimated tip from target and blade, in cm, at its end."""
        position, distance = observation[POSITION] * SCALES[POSITION], observation[DISTANCE] * SCALES[DISTANCE]
        tip = self._tip_estimate(observation)
        added = np.array([position + distance - tip, position - tip], np.float32) / 0.01
        return np.concatenate((observation, np.clip(added, -BOUND, BOUND)))


def past_dead_zone(action: np.ndarray, width: float) -> np.ndarray:
    """Map an action's speed so that -width to width is zero and +-1 stays +-1."""
    result = np.array(action, np.float32)
    result[0] = math.copysign(max(abs(result[0]) - width, 0.0) / (1.0 - width), result[0])
    return result


class Agent:
    """A trained network as a policy: the most likely action."""

    def __init__(self, model: PPO, dead_zone: float) -> None:
        self._model, self._dead_zone = model, dead_zone
        self._features = Features()

    def reset(self, rng: np.random.Generator) -> None:
        """Forget the last cut."""
        self._features.reset()

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        """The action for an observation."""
        action, _ = self._model.predict(self._features(observation), deterministic=True)
        return past_dead_zone(np.clip(action, -1.0, 1.0), self._dead_zone)


class Progress(BaseCallback):
    """Progress bar, learning curve and checkpoints."""

    def __init__(self, run: Path, total: int, seconds: float) -> None:
        super().__init__()
        self._run, self._total, self._seconds = run, total, seconds
        self._saved = time.monotonic()
        self.curve: list[dict[str, float]] = []

    def _on_training_start(self) -> None:
        self._bar = tqdm(
            total=self._total, initial=self.num_timesteps, desc="training", unit="decision", smoothing=0.05
        )

    def _on_step(self) -> bool:
        return self.num_timesteps < self._total

    def _on_rollout_end(self) -> None:
        episodes = self.model.ep_info_buffer or []
        if episodes:
            mean_return = float(np.mean([episode["r"] for episode in episodes]))
            success = float(np.mean(self.model.ep_success_buffer or [0.0]))
            self.curve.append({"decisions": self.num_timesteps, "return": mean_return, "success": success})
            self._bar.set_postfix_str(f"return {mean_return:.2f}, success {success:.2f}")
        self._bar.update(min(self.num_timesteps, self._total) - self._bar.n)
        if time.monotonic() - self._saved > self._seconds:
            save(self.model, self._run / "checkpoint.zip")
            self._saved = time.monotonic()

    def _on_training_end(self) -> None:
        self._bar.close()


def save(model: PPO, path: Path) -> None:
    """Save a model all at once: an interruption leaves the last whole checkpoint."""
    part = path.with_name(path.stem + ".part.zip")
    model.save(part)
    part.replace(path)


def environments(arguments: Arguments) -> VecEnv:
    """The training environments, each with its own seed of the training range."""
    seeds = range(arguments.seed * MAX_ENVIRONMENTS, arguments.seed * MAX_ENVIRONMENTS + arguments.environments)
    assert set(seeds) <= set(TRAINING_SEEDS), "a training seed outside its range could meet a test specimen"
    return make_vec_env(
        lambda: Adapter(gymnasium.make(ENVIRONMENT, **environment_arguments(arguments)), arguments.dead_zone),
        n_envs=arguments.environments,
        seed=seeds.start,
    )


def environment_arguments(arguments: Arguments) -> dict[str, Any]:
    """Keywords of the environment that the agent is trained and tested in."""
    return {
        "specimen_class": arguments.specimen_class,
        "angle_mode": arguments.angle_mode,
        "control_hz": arguments.control_hz,
    }


def new_model(arguments: Arguments) -> PPO:
    """An untrained agent."""
    return PPO(
        "MlpPolicy",
        environments(arguments),
        learning_rate=LinearDecay(arguments.learning_rate),
        n_steps=arguments.rollout,
        batch_size=arguments.batch_size,
        n_epochs=arguments.epochs,
        gamma=arguments.gamma,
        gae_lambda=arguments.gae_lambda,
        policy_kwargs={"net_arch": [arguments.hidden, arguments.hidden], "log_std_init": -0.5},
        seed=arguments.seed,
        device="cpu",  # a network this small is slower on a GPU
    )


@dataclass(frozen=True)
class LinearDecay:
    """A rate that falls linearly to a tenth as training goes on."""

    rate: float

    def __call__(self, remaining: float) -> float:
        """The rate with a share of training ``remaining``, 1 to 0."""
        return self.rate * (0.1 + 0.9 * remaining)


def train(arguments: Arguments, run: Path, resume: bool) -> tuple[PPO, bool]:
    """Train; return the agent and whether training came to its end."""
    torch.set_num_threads(1)  # two pools of threads on two cores fight
    checkpoint = run / "checkpoint.zip"
    if resume:
        model = PPO.load(checkpoint, env=environments(arguments), device="cpu")
        print(f"resuming after {model.num_timesteps} decisions")
    else:
        model = new_model(arguments)
    progress = Progress(run, arguments.timesteps, arguments.checkpoint_seconds)
    curve_file = run / "learning_curve.csv"
    earlier = read_curve(curve_file) if resume else []
    whole = True
    try:
        remaining = max(arguments.timesteps - model.num_timesteps, 0)
        if remaining:
            model.learn(remaining, callback=progress, reset_num_timesteps=not resume)
    except KeyboardInterrupt:
        whole = False
    save(model, checkpoint)
    if earlier or progress.curve:
        write_csv(curve_file, earlier + progress.curve)
    model.get_env().close()
    return model, whole


def read_curve(path: Path) -> list[dict[str, float]]:
    """The learning curve of an earlier part of the run."""
    if not path.is_file():
        return []
    lines = path.read_text().splitlines()
    names = lines[0].split(",")
    return [dict(zip(names, map(float, line.split(",")), strict=True)) for line in lines[1:]]


def record_run(arguments: Arguments, run: Path) -> None:
    """Make the run's folder and keep there what the run depends on: arguments, seeds, versions, commit."""
    gymnasium.make(ENVIRONMENT, **environment_arguments(arguments)).close()  # refuses nonsense before anything is made
    run.mkdir(parents=True, exist_ok=True)
    git = subprocess.run(
        ["git", "rev-parse", "HEAD"], cwd=Path(__file__).parent, capture_output=True, text=True, check=False
    )
    content = {
        "arguments": dataclasses.asdict(arguments),
        "environment": ENVIRONMENT,
        "seeds": {
            "training": [arguments.seed * MAX_ENVIRONMENTS + k for k in range(arguments.environments)],
            "test": [TEST_SEEDS.start, TEST_SEEDS.start + arguments.specimens - 1],
        },
        "versions": {name: importlib.metadata.version(name) for name in PACKAGES}
        | {"python": platform.python_version()},
        "commit": git.stdout.strip() or None,
    }
    (run / "run.json").write_text(json.dumps(content, indent=1) + "\n")


def report(arguments: Arguments, model: PPO, run: Path) -> None:
    """Evaluate the agent beside scripts on held-out specimens; write and print the scores, draw one cut."""
    at_own_rate = {"control_hz": arguments.control_hz}
    agent = Contestant(Agent(model, arguments.dead_zone), at_own_rate)
    inclined = math.radians(60.0)
    contestants = {
        "PPO": agent,
        "constant 1.27 cm/s, 90 deg": Contestant(ConstantFeed(speed=0.0127)),
        "fast-then-slow, 60 deg": Contestant(FastThenSlow(angle=inclined)),
        "PPO untrained": Contestant(Agent(new_model(arguments), arguments.dead_zone), at_own_rate),
        "random": Contestant(RandomAction(), at_own_rate),
    }
    seeds = TEST_SEEDS[: arguments.specimens]
    shared = {"specimen_class": arguments.specimen_class, "angle_mode": arguments.angle_mode}
    rows = evaluate(contestants, seeds, shared)
    write_csv(run / "scores.csv", rows)
    summary = summarise(rows)
    write_csv(run / "summary.csv", summary)

    env = gymnasium.make(ENVIRONMENT, **environment_arguments(arguments))
    scores, readings = run_cut(env, agent.policy, seeds[0])
    unwrapped: Any = env.unwrapped
    draw_cut(
        run / "cut.png",
        readings,
        unwrapped.specimen.depth,
        target_length=unwrapped.cutting.target_length,
        force_limit_per_depth=unwrapped.force_limit_per_depth,
        title=f"PPO on held-out specimen {seeds[0]}: {scores['end']}, return {scores['return']:.2f}, "
        f"tip error {scores['tip_error_mm']:.1f} mm",
    )
    print(f"\n{arguments.specimens} held-out specimens of class {arguments.specimen_class}, mean [95 % interval]\n")
    print_table(summary, ("return", "success", "tip_error_mm", "peak_force_N", "time_s"))
    print(f"\nWritten to {run}/: policy.zip, scores.csv (every cut), summary.csv (means and intervals),")
    print("learning_curve.csv, run.json (arguments, seeds, versions), cut.png (one cut above its force trace)")


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
    parser.add_argument("--quick", action="store_true", help="about a minute in all: 300 000 decisions")
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
        chosen.setdefault("timesteps", 300_000)
    arguments = Arguments(**chosen)
    name = arguments.name or time.strftime("ppo-%Y%m%d-%H%M%S")
    run = Path("runs") / name
    if run.exists():
        raise SystemExit(f"{run} exists; give another --name, or --resume {run} to go on with it.")
    return dataclasses.replace(arguments, name=name), run, False


def main() -> None:
    """Train, evaluate, report."""
    arguments, run, resume = parse()
    record_run(arguments, run)
    model, whole = train(arguments, run, resume)
    if not whole:
        print(f"\ninterrupted after {model.num_timesteps} decisions; {run}/checkpoint.zip is usable.")
        print(f"Go on with: python3 scripts/start.py train --resume {run}")
        raise SystemExit(130)
    save(model, run / "policy.zip")
    try:
        report(arguments, model, run)
    except KeyboardInterrupt:
        print(f"\ninterrupted while evaluating; {run}/policy.zip is the trained agent.")
        print(f"Evaluate it with: python3 scripts/start.py train --resume {run}")
        raise SystemExit(130) from None


if __name__ == "__main__":
    main()
