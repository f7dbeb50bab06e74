"""PPO, recurrent PPO, and a run of any learner of Stable-Baselines3.

Train, resume after an interruption, export, compare, report.

PPO has an asymmetric actor-critic that first imitates a script.  The agent decides 10 times a second: a cut is then
some 80 decisions, 300 at most.  gamma = 1 sets no horizon, because a cut ends by itself and its score is the plain sum;
with 0.995 early progress is worth more, and the agent learns to hurry, which the reward does not ask for.  The actor
sees hand-made features; the critic also sees the hidden state, which is needed in training and not for cutting.

The actor starts as a clone of the best script and then learns by trial.  At first only the critic learns, because an
untrained critic would spoil the clone.  The standard deviation of the actions is scheduled and falls: a policy that
learns it comes to rely on its noise.  The running average of the actor is validated, and kept where it does best.

The actor of recurrent PPO has a memory (one layer of LSTM) instead of a history of decisions.  Its gradients go through
whole cuts, so that an update costs four times as much and fewer are made.  Only the critic learns for a larger share of
the training.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from sb3_contrib import RecurrentPPO
from stable_baselines3 import PPO

from cutenv.agents.learning.arguments import LearnerArguments, PPOArguments, RecurrentPPOArguments, TrialArguments
from cutenv.agents.learning.asymmetric_actors import AsymmetricActorCritic, RecurrentAsymmetricActorCritic
from cutenv.agents.learning.cloning import Cloning, Demonstrations, script_demonstrations
from cutenv.agents.learning.environment_groups import EnvironmentGroups
from cutenv.agents.learning.evaluation import contestant, evaluate
from cutenv.agents.learning.option_fields import drawn_as
from cutenv.agents.learning.progress import Progress, save_model
from cutenv.agents.learning.run_folder import RunRequest, end_interrupted, export, record_run, write_facts
from cutenv.agents.learning.statistics import read_rows
from cutenv.agents.learning.training_report import compare
from cutenv.agents.policy import Network, RecurrentNetwork
from cutenv.agents.sb3 import FeatureVecEnv


class FallingRate:
    """A learning rate that falls linearly to a twentieth.

    :class:`Progress` sets the share of training that is done.
    """

    def __init__(self, rate: float) -> None:
        self.rate, self.share = rate, 0.0

    def __call__(self, remaining: float) -> float:
        """Return the rate, ignoring SB3's ``remaining`` share of decisions."""
        return self.rate * (1.0 - 0.95 * self.share)


@dataclass(frozen=True)
class TrialLearner:
    """Learner that a run trains: parts in which one differs from another."""

    name: str  # of the agent in reports
    algorithm: Any  # class of Stable-Baselines3 or sb3-contrib
    policy: type[Any]  # class of its actor and critics
    keywords: Callable[[Any], dict[str, Any]]  # those of the algorithm, by the options
    # clones demonstrations into a policy's actor, given the options, and returns the error left
    imitate: Callable[[Any, Demonstrations, Any], float]
    # makes the actor in NumPy from the policy's parameters and activation
    network: Callable[[Mapping[str, np.ndarray], str], Network | RecurrentNetwork]
    activation: str = "tanh"  # of the actor's layers
    # puts demonstrations into the replay buffer of a model that has one
    remember: Callable[[Any, Demonstrations], None] | None = None

    def new_model(self, arguments: Any, environments: FeatureVecEnv | EnvironmentGroups) -> Any:
        """Make an untrained agent."""
        return self.algorithm(self.policy, environments, **self.keywords(arguments))

    def pretrain(self, model: Any, arguments: Any) -> None:
        """Clone the demonstrated script into a model's actor."""
        shown = script_demonstrations(model.get_env(), arguments)
        if self.remember is not None:
            self.remember(model, shown)
        error = self.imitate(model.policy, shown, arguments)
        print(f"the clone's actions differ from those of {arguments.script!r} by {error:.3f} (root mean square)")

    def restore(self, model: Any, arguments: Any) -> None:
        """Show the demonstrations again; a checkpoint keeps no replay buffer."""
        if self.remember is not None:
            if arguments.demonstrations:
                self.remember(model, script_demonstrations(model.get_env(), arguments))
            print("the replay buffer begins again, with the demonstrations")


def sb3_keywords(arguments: PPOArguments) -> dict[str, Any]:
    """Return Stable-Baselines3's keyword arguments of PPO and recurrent PPO."""
    return {
        "learning_rate": FallingRate(arguments.learning_rate),
        "n_steps": arguments.rollout,
        "batch_size": arguments.batch_size,
        "n_epochs": arguments.epochs,
        "gamma": arguments.gamma,
        "gae_lambda": arguments.gae_lambda,
        "policy_kwargs": arguments.sizes,
        "seed": arguments.seed,
        "device": "cpu",  # a network this small is slower on a GPU
    }


def _imitate(policy: AsymmetricActorCritic, shown: Demonstrations, arguments: PPOArguments) -> float:
    return Cloning(policy.action_for, policy.actor_parameters(), shown.by_decision(), seed=arguments.seed).run()


def _imitate_by_cut(
    policy: RecurrentAsymmetricActorCritic, shown: Demonstrations, arguments: RecurrentPPOArguments
) -> float:
    cloning = Cloning(
        policy.actions_along,
        policy.actor_parameters(),
        shown.by_cut(),
        epochs=arguments.cloning_epochs,
        batch_size=4096,
        learning_rate=4e-3,
        seed=arguments.seed,
    )
    return cloning.run()


ON_POLICY = {
    "ppo": TrialLearner("PPO", PPO, AsymmetricActorCritic, sb3_keywords, _imitate, Network.from_state_dict),
    "recurrent-ppo": TrialLearner(
        "recurrent PPO",
        RecurrentPPO,
        RecurrentAsymmetricActorCritic,
        sb3_keywords,
        _imitate_by_cut,
        RecurrentNetwork.from_state_dict,
    ),
}
"""Learners by their names on the command line."""


def train(learner: TrialLearner, arguments: TrialArguments, run: Path, resume: bool) -> tuple[bool, float | None]:
    """Train; return whether it is complete, and the environments' share of time, None if none was left to train."""
    begun = time.monotonic()
    torch.set_num_threads(1)  # two thread pools on two cores compete
    checkpoint = run / "checkpoint.zip"
    environments = arguments.training_environments()
    events = str(run / "tensorboard") if arguments.tensorboard else None
    finished = True
    curve: list[dict[str, float]] = []
    extras = None
    if resume:
        model = learner.algorithm.load(checkpoint, env=environments, device="cpu", tensorboard_log=events)
        learner.restore(model, arguments)
        # Training cannot have reached it; else a resumed run would cut the same specimens again, from the first on.
        environments.first_episode = 1 + int(model.num_timesteps) // int(model.n_envs)
        curve = read_rows(run / "learning_curve.csv")
        curve = [point for point in curve if point["decisions"] <= model.num_timesteps]
        extras = getattr(model, "checkpoint_extras", None)
        environments.cuts = 0 if extras is None else extras.get("cuts", 0)
        print(f"resuming after {model.num_timesteps} decisions")
        if extras is None:
            print("the checkpoint contains no running average of the actor: the average starts again")
    else:
        model = learner.new_model(arguments, environments)
        model.tensorboard_log = events
        save_model(model, run / "untrained.zip")
        if arguments.demonstrations:
            learner.pretrain(model, arguments)
    progress = Progress(run, arguments, curve, begun, extras)
    progress.init_callback(model)
    trial_begun, spent = time.perf_counter(), environments.seconds
    remaining = max(arguments.timesteps - model.num_timesteps, 0)
    trains = remaining > 0 and progress.share < 1.0
    try:
        if trains:
            model.learn(remaining, callback=progress, reset_num_timesteps=not resume, tb_log_name="run")
            progress.validate()
    except KeyboardInterrupt:
        finished = False
    share = (environments.seconds - spent) / (time.perf_counter() - trial_begun) if trains else None
    progress.save_checkpoint()
    if finished and not (run / "policy.zip").is_file():  # training ended before the first validation
        save_model(model, run / "policy.zip")
    return finished, share


def time_to_threshold(arguments: LearnerArguments, curve: Sequence[Mapping[str, float]]) -> float | None:
    """Return the time [s] until the agent equalled the script in validation, or None."""
    shared = {**drawn_as(vars(arguments)), **arguments.angle, **arguments.simulated}
    several, seeds = {arguments.script: contestant(arguments.script)}, arguments.validation_seeds
    rows = evaluate(several, seeds, shared, description="script on validation specimens")
    threshold = float(np.mean([row["return"] for row in rows]))
    reached = (point["seconds"] for point in curve if point.get("validation_return", -np.inf) >= threshold)
    return next(reached, None)


def run_learner(learner: TrialLearner, request: RunRequest[Any], resume_command: str) -> None:
    """Train, export, evaluate and report into the folder of the run.

    Raises SystemExit with status 130 after Ctrl-C, having printed ``resume_command``.
    """
    arguments, run = request.arguments, request.run
    facts = record_run(arguments, run, learner.name)
    begun = time.monotonic()
    try:
        finished, share = train(learner, arguments, run, request.resume)
    except KeyboardInterrupt:  # before training, or a second time while it was being saved
        finished = False
    else:
        took = "" if share is None else f": the environments took {100.0 * share:.0f} % of the time"
        print(f"the training is {'complete' if finished else 'interrupted'}{took}")
    if not finished:
        end_interrupted(run, resume_command)
    curve = read_rows(run / "learning_curve.csv")
    seconds = curve[-1]["seconds"] if curve else time.monotonic() - begun
    facts["training_minutes"] = round(seconds / 60.0, 1)
    if share is not None:
        facts["environments_share"] = round(share, 3)
    try:
        for name in ("untrained", "policy"):
            model = learner.algorithm.load(run / f"{name}.zip", device="cpu")
            arrays = {key: value.detach().cpu().numpy() for key, value in model.policy.state_dict().items()}
            actor = learner.network(arrays, learner.activation)
            export(arguments, run / name, actor, {**facts, "decisions": int(model.num_timesteps)})
        write_facts(run, facts)
        if arguments.specimens:
            print(f"evaluating it and others on {arguments.specimens} held-out specimens, some minutes", flush=True)
            reached = time_to_threshold(arguments, curve)
            facts["level_with_script_after_s"] = reached
            write_facts(run, facts)
            compare(run, facts)
            if reached is not None:
                when = f"after {reached:.0f} s, demonstrations included"
                print(f"as good as {arguments.script!r} on the validation specimens {when}")
    except KeyboardInterrupt:
        print(f"\ninterrupted while evaluating; {run}/policy.zip is the trained agent.")
        print(f"Evaluate it with: {resume_command}")
        raise SystemExit(130) from None
