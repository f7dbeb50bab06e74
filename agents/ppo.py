"""Train an agent to cut gently with PPO (Stable-Baselines3), compare it with every baseline, report.

    python agents/ppo.py                     about 10 minutes on 2 cores; writes runs/<name>/
    python agents/ppo.py --quick             about two minutes
    python agents/ppo.py --resume runs/NAME  goes on from the checkpoint of an interrupted run

The agent decides 10 times a second: a cut is then some 80 decisions, 300 at most.  gamma = 1 has no horizon, for a cut
ends by itself, and what it is scored by is the plain sum; with 0.995 progress made early is worth more, and the agent
learns a haste that the reward does not ask for.  It sees features that a person would work out; its critic sees
the hidden state too, which training needs and cutting does not.

It starts as a clone of the best script and learns on by trial; for a while only the critic does, because one that knows
nothing would spoil the clone.  Exploration is given and falls: a policy that may keep its noise leans on it.  What is
tried on validation specimens, and kept where it does best, is the running average of the actor.

What is worth changing, to see what it does: ``--angle-mode fixed``, ``--force unfelt``, ``--history 6``,
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
    """What a run depends on; every field is an option of the command line."""


def new_model(arguments: Arguments, environments: CutVecEnv) -> PPO:
    """An untrained agent."""
    return PPO(SeeingCritic, environments, **common_keywords(arguments))


def taught(model: PPO, arguments: Arguments) -> None:
    """Teach the actor the demonstrated script."""
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
