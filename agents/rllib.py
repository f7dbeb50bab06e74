"""PPO of Ray RLlib, with environment runners on many machines.

    python agents/rllib.py                            on this machine, a local cluster not reachable from outside
    python agents/rllib.py --address auto --workers 64      on the cluster to which this machine belongs
    python agents/rllib.py --resume runs/NAME         continues from the checkpoint of an interrupted run

Ray pins its own version of Gymnasium, and so needs a virtual environment of its own, with ``pip install
'cutenv[distributed]'``, on every machine of the cluster.  Each runner steps the native vector environment of the
installed cutenv; the folder of this program is sent to it, and nothing else of this machine.  Ray's usage reports are
off; a local cluster has no dashboard and listens on loopback.

It writes runs/<name>/: learning_curve.csv, checkpoint/ and policy/, which ``cutenv evaluate`` compares and
``cutenv demo --policy`` shows, without Ray and torch.  A checkpoint is RLlib's own kind, with pickles in it: resume
only your own.
"""

from __future__ import annotations

import csv
import dataclasses
import json
import math
import os
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cutenv.agents.learning.option_fields import check_ranges, option, parse
from cutenv.agents.learning.rllib_env import RunnerEnv
from cutenv.agents.learning.run_folder import origin, write_facts
from cutenv.agents.learning.seeds import ENVIRONMENT, TRAINING_SEEDS
from cutenv.agents.learning.statistics import write_csv
from cutenv.agents.policy import Network, save_policy
from cutenv.sim.tissue.specimen import CLASSES

if TYPE_CHECKING:
    from ray.rllib.algorithms.ppo import PPO

SEEDS_OF_A_RUN = 100_000  # of TRAINING_SEEDS
PACKAGES = ("cutenv", "gymnasium", "numpy", "numba", "scikit-fem", "ray", "torch")
_NAME = "gentle-cut-runner"
_LOOPBACK = "127.0.0.1"


@dataclass(frozen=True, kw_only=True)
class Arguments:
    """Arguments of a run, each a command-line option."""

    name: str = option("", "name of the run's folder below runs/; default date and time")
    resume: str = option("", "folder of an interrupted run to resume; its other arguments are kept")
    address: str = option("", "address of a Ray cluster: auto, HOST:6379 or ray://HOST:10001; default this machine")
    workers: int = option(2, "number of environment runners, a process and a core each", (1, 10_000))
    environments: int = option(32, "number of environments in each runner", (1, 10_000))
    iterations: int = option(200, "number of rounds of sampling and learning", (1, 10**9))
    seed: int = option(0, "seed of networks and training specimens", (0, len(TRAINING_SEEDS) // SEEDS_OF_A_RUN - 1))
    specimen_class: str = option("mixed", "tissue to train on", CLASSES)
    angle_mode: str = option("free", "turn the blade (free), or keep its angle (fixed)", ("free", "fixed"))
    control_hz: int = option(10, "decisions per second")
    history: int = option(0, "number of past decisions among the features", (0, 100))
    rollout: int = option(128, "number of decisions of each environment between updates", (2, 10**6))
    batch_size: int = option(1024, "number of decisions in a gradient step", (2, 10**9))
    epochs: int = option(8, "number of passes over the sampled decisions", (1, 10**6))
    learning_rate: float = option(3e-4, "learning rate of Adam", (1e-9, 1.0))
    gamma: float = option(1.0, "discount per decision", (0.0, 1.0))
    gae_lambda: float = option(0.95, "lambda of the generalised advantage estimate", (0.0, 1.0))
    hidden: int = option(64, "number of units in each of two layers", (1, 4096))
    checkpoint_every: int = option(20, "number of rounds between checkpoints", (1, 10**9))

    def __post_init__(self) -> None:
        check_ranges(self, SystemExit)
        if (self.workers + 1) * self.environments > SEEDS_OF_A_RUN:
            raise SystemExit(f"--workers times --environments is more than a run's {SEEDS_OF_A_RUN} seeds; give fewer")

    @property
    def environment(self) -> dict[str, Any]:
        """Keyword arguments of the environment."""
        return {name: getattr(self, name) for name in ("specimen_class", "angle_mode", "control_hz")}

    @property
    def training_seeds(self) -> range:
        """Seeds of all runners' environments: the local one's and workers'."""
        first = self.seed * SEEDS_OF_A_RUN
        return range(first, first + (self.workers + 1) * self.environments)


def connect(arguments: Arguments) -> None:
    """Join the cluster, or start one listening on loopback only.

    Do so before Ray is imported elsewhere.

    Raises RuntimeError if a local cluster can be reached from elsewhere, because Ray had been imported; it is shut down
    again.
    """
    # Ray reads these when it is imported. Without the second, it listens on every network of a Linux machine.
    os.environ["RAY_USAGE_STATS_ENABLED"] = "0"
    if not arguments.address:
        os.environ["RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER"] = "0"
    import ray

    shared = {"runtime_env": {"working_dir": str(Path(__file__).parent)}, "log_to_driver": False}
    if arguments.address:
        ray.init(address=arguments.address, **shared)
        return
    # "local", or Ray joins any cluster that was started on this machine; one additional core is for learning.
    ray.init(address="local", num_cpus=arguments.workers + 1, include_dashboard=False, **shared)
    addresses = {node["NodeManagerAddress"] for node in ray.nodes()}
    if addresses != {_LOOPBACK}:
        ray.shutdown()
        raise RuntimeError(f"the local cluster listens on {addresses}, not on {_LOOPBACK}: import ray after connect().")


def algorithm(arguments: Arguments, first_episode: int = 0) -> PPO:
    """Make an untrained agent with runners, beginning at ``first_episode``.

    Call it after :func:`connect`.
    """
    from ray.rllib.algorithms.ppo import PPOConfig
    from ray.rllib.core.rl_module.default_model_config import DefaultModelConfig
    from ray.tune.registry import register_env

    register_env(_NAME, RunnerEnv.of_runner)
    keywords = arguments.environment | {
        "first_seed": arguments.training_seeds.start,
        "first_episode": first_episode,
        "history": arguments.history,
    }
    config = (
        PPOConfig()
        .environment(_NAME, env_config=keywords)
        .env_runners(
            num_env_runners=arguments.workers,
            num_envs_per_env_runner=arguments.environments,
            gym_env_vectorize_mode="vector_entry_point",
            rollout_fragment_length=arguments.rollout,
            sample_timeout_s=None,  # a runner that dies is noticed; one that compiles is waited for
        )
        .training(
            train_batch_size_per_learner=arguments.workers * arguments.environments * arguments.rollout,
            minibatch_size=arguments.batch_size,
            num_epochs=arguments.epochs,
            lr=arguments.learning_rate,
            gamma=arguments.gamma,
            lambda_=arguments.gae_lambda,
            use_kl_loss=False,
            clip_param=0.2,
            vf_clip_param=float("inf"),  # returns are below 1, costs are not
            grad_clip=0.5,
        )
        .rl_module(
            model_config=DefaultModelConfig(
                fcnet_hiddens=[arguments.hidden, arguments.hidden],
                fcnet_activation="tanh",
                free_log_std=True,
                vf_share_layers=False,
            )
        )
        .callbacks(on_environment_created=share_seeds, on_episode_end=log_success)
        .debugging(seed=arguments.seed)
    )
    return config.build_algo()


def share_seeds(*, env: RunnerEnv, env_context: Any, **_: Any) -> None:
    """Give every runner its own specimens by its number."""
    env.share_seeds(env_context.worker_index)


def log_success(*, episode: Any, metrics_logger: Any, **_: Any) -> None:
    """Log successes in addition to RLlib's returns."""
    metrics_logger.log_value("success", float(episode.get_infos(-1)["is_success"]), window=200)


def train(
    ppo: PPO, arguments: Arguments, run: Path, curve: Sequence[Mapping[str, Any]] = ()
) -> list[Mapping[str, Any]]:
    """Train for some rounds or until interrupted, updating the curve.

    ``curve`` is that of a resumed run, up to its checkpoint.
    """
    curve = list(curve)
    begun = time.monotonic() - (float(curve[-1]["seconds"]) if curve else 0.0)
    try:
        while ppo.iteration < arguments.iterations:
            result = ppo.train()
            sampled = result["env_runners"]
            point: dict[str, Any] = {
                "iteration": result["training_iteration"],
                "decisions": result["num_env_steps_sampled_lifetime"],
                "seconds": round(time.monotonic() - begun, 1),
            }
            if not math.isnan(sampled.get("success", math.nan)):  # otherwise no cut has ended yet
                point |= {"return": sampled["episode_return_mean"], "success": sampled["success"]}
            curve.append(point)
            write_csv(run / "learning_curve.csv", curve)
            print("  ".join(f"{name} {value:.4g}" for name, value in point.items()), flush=True)
            if ppo.iteration % arguments.checkpoint_every == 0:
                ppo.save_to_path((run / "checkpoint").absolute())
    except KeyboardInterrupt:
        print(f"\ninterrupted; resume with: python agents/rllib.py --resume {run}")
    ppo.save_to_path((run / "checkpoint").absolute())
    return curve


def uncut_episode(arguments: Arguments, curve: Sequence[Mapping[str, Any]]) -> int:
    """Return an episode that no environment of this curve has reached."""
    if not curve:
        return 0
    decisions = max(float(point["decisions"]) for point in curve)
    return int(decisions) // (arguments.workers * arguments.environments) + 2  # one that had begun, and rounding


def network(ppo: PPO) -> Network:
    """Return the actor: its most likely action before clipping."""
    arrays = ppo.learner_group.get_weights()["default_policy"]
    tower = "encoder.actor_encoder.net.mlp"
    prefixes = [f"{tower}.{k}" for k in range(0, 2 * sum(name.startswith(tower) for name in arrays), 2)]
    prefixes = [prefix for prefix in prefixes if f"{prefix}.weight" in arrays] + ["pi.net.mlp.0"]
    return Network(tuple((arrays[f"{prefix}.weight"], arrays[f"{prefix}.bias"]) for prefix in prefixes), "tanh")


def record_run(arguments: Arguments, run: Path, packages: Sequence[str] = PACKAGES) -> dict[str, Any]:
    """Store the run's dependencies in its folder, also when resumed."""
    seeds = arguments.training_seeds
    facts = {
        "agent": "PPO of RLlib",
        "arguments": dataclasses.asdict(arguments),
        "environment": ENVIRONMENT,
        "seeds": {"training": [min(seeds), max(seeds)]},
        **origin(run, packages),
    }
    write_facts(run, facts)
    return facts


def main() -> None:
    """Train, and write the policy."""
    arguments = parse(Arguments, __doc__)
    resume = Path(arguments.resume) if arguments.resume else None
    if resume is not None:
        if not (resume / "checkpoint").is_dir():
            raise SystemExit(f"{resume} contains no checkpoint/; give the folder of an interrupted run.")
        kept = json.loads((resume / "run.json").read_text())["arguments"]
        arguments = dataclasses.replace(Arguments(**kept), address=arguments.address, resume=arguments.resume)
    run = resume or Path("runs") / (arguments.name or time.strftime("rllib-%Y%m%d-%H%M%S"))
    if resume is None and run.exists():
        raise SystemExit(f"{run} exists; give another --name, or --resume {run} to continue it.")
    run.mkdir(parents=True, exist_ok=True)
    facts = record_run(arguments, run)
    connect(arguments)
    earlier: list[dict[str, str]] = []
    if resume is not None:
        with (resume / "learning_curve.csv").open(newline="") as file:
            earlier = list(csv.DictReader(file))
    ppo = algorithm(arguments, uncut_episode(arguments, earlier))
    if resume is not None:
        ppo.restore_from_path((resume / "checkpoint").absolute())
        earlier = [row for row in earlier if int(row["iteration"]) <= ppo.iteration]
    curve = train(ppo, arguments, run, earlier)
    save_policy(
        run / "policy",
        network(ppo),
        environment=ENVIRONMENT,
        environment_arguments={"control_hz": arguments.control_hz, "angle_mode": arguments.angle_mode},
        features={"history": arguments.history},
        training=facts | {"decisions": int(float(curve[-1]["decisions"])) if curve else 0},
        replace=True,
    )
    ppo.stop()  # the cluster, if it is a local one, ends with this process
    print(f"policy: {run / 'policy'}")


if __name__ == "__main__":
    main()
