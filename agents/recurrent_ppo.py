"""Train a recurrent agent with recurrent PPO (sb3-contrib), compare it with every baseline, report.

    python agents/recurrent_ppo.py                     about 20 minutes on 2 cores; writes runs/<name>/
    python agents/recurrent_ppo.py --quick             some three minutes
    python agents/recurrent_ppo.py --resume runs/NAME  continues from the checkpoint of an interrupted run

As in ppo.py, but the actor is an LSTM (one layer), so its features contain no history of decisions; its gradients
go through whole cuts, so an update costs four times as much and fewer are made; the critic has a larger share of the
updates to itself at the start.  ``--history 6`` gives both memory and history.
"""

from __future__ import annotations

from dataclasses import dataclass

from cloning import clone, demonstrations
from learning import Learner, TrialArguments, common_keywords, main
from options import option
from remembering_actor import RememberingActor
from sb3_contrib import RecurrentPPO
from vectorised import CutVecEnv

from cutenv.policy import BASELINES, RecurrentNetwork


@dataclass(frozen=True, kw_only=True)
class Arguments(TrialArguments):
    """Arguments of a run; every field is an option of the command line."""

    timesteps: int = option(4_000_000, "number of decisions to train for", resumable=True)
    epochs: int = option(4, "number of passes over a rollout")
    critic_first: float = option(0.15, "share of the training in which only the critic learns, after a demonstration")
    cloning_epochs: int = option(15, "number of passes over the demonstrations")

    @classmethod
    def limits(cls) -> dict[str, tuple[float, float]]:
        """Return the admissible ranges of the numbers."""
        return super().limits() | {"cloning_epochs": (1, 10**6)}


def new_model(arguments: Arguments, environments: CutVecEnv) -> RecurrentPPO:
    """Make an untrained agent."""
    return RecurrentPPO(RememberingActor, environments, **common_keywords(arguments))


def taught(model: RecurrentPPO, arguments: Arguments) -> None:
    """Train the actor to imitate the demonstrated script, cut by cut."""
    shown = demonstrations(
        model.get_env(),
        BASELINES[arguments.script],
        decisions=arguments.demonstrations,
        noise=arguments.demonstration_noise,
        seed=arguments.seed,
    )
    policy = model.policy
    error = clone(
        policy.actions_along,
        policy.actor_parameters(),
        shown.cuts(),
        epochs=arguments.cloning_epochs,
        batch_size=4096,
        learning_rate=4e-3,
        seed=arguments.seed,
    )
    print(f"the clone's actions differ from those of {arguments.script!r} by {error:.3f} (root of the mean square)")


LEARNER = Learner("recurrent PPO", RecurrentPPO, new_model, taught, RecurrentNetwork.from_state_dict)

if __name__ == "__main__":
    main(LEARNER, Arguments, __doc__, "recurrent_ppo.py")
