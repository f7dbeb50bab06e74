"""Train an agent to cut gently with PPO (Stable-Baselines3), compare it with every baseline, report.

    python agents/ppo.py                     about 10 minutes on 2 cores; writes runs/<name>/
    python agents/ppo.py --quick             about two minutes
    python agents/ppo.py --resume runs/NAME  continues from the checkpoint of an interrupted run

The agent decides 10 times a second: a cut takes some 80 decisions, 300 at most.  We use gamma = 1, because episodes end
by themselves and the score is the plain sum of rewards; gamma = 0.995 would reward speed that the task does not ask
for.  The agent's inputs are features that an engineer would compute; its critic also sees the hidden state (asymmetric
actor-critic), which training needs and cutting does not.

It starts as a clone of the best script and continues by reinforcement learning; at first only the critic learns,
because an untrained one would spoil the clone.  Exploration is scheduled and falls: a policy that may keep its noise
comes to depend on it.  The running average of the actor is validated, and the best one is kept.

Options worth changing to see their effect: ``--angle-mode fixed``, ``--force unfelt``, ``--history 6``,
``--critic features``.
"""

from __future__ import annotations

from dataclasses import dataclass

from cloning import clone, demonstrations
from learning import Learner, TrialArguments, common_keywords, main
from seeing_critic import SeeingCritic
from stable_baselines3 import PPO
from vectorised import CutVecEnv

from cutenv.policy import BASELINES, Network


@dataclass(frozen=True, kw_only=True)
class Arguments(TrialArguments):
    """Arguments of a run; every field is an option of the command line."""


def new_model(arguments: Arguments, environments: CutVecEnv) -> PPO:
    """Make an untrained agent."""
    return PPO(SeeingCritic, environments, **common_keywords(arguments))


def taught(model: PPO, arguments: Arguments) -> None:
    """Train the actor to imitate the demonstrated script."""
    shown = demonstrations(
        model.get_env(),
        BASELINES[arguments.script],
        decisions=arguments.demonstrations,
        noise=arguments.demonstration_noise,
        seed=arguments.seed,
    )
    policy = model.policy
    error = clone(policy.action_for, policy.actor_parameters(), shown.decisions(), seed=arguments.seed)
    print(f"the clone's actions differ from those of {arguments.script!r} by {error:.3f} (root of the mean square)")


LEARNER = Learner("PPO", PPO, new_model, taught, Network.from_state_dict)

if __name__ == "__main__":
    main(LEARNER, Arguments, __doc__, "ppo.py")
