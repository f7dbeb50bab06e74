"""Recurrent PPO.

Like PPO, but the actor has a memory (one layer of LSTM) instead of a history of decisions.

Its gradients go through whole cuts, so that an update costs four times as much and fewer are made.  Only the critic
learns for a larger share of the training.
"""

from __future__ import annotations

from sb3_contrib import RecurrentPPO

from cutenv.agents.learning.arguments import RecurrentPPOArguments
from cutenv.agents.learning.asymmetric_actors import RecurrentAsymmetricActorCritic
from cutenv.agents.learning.cloning import Cloning, Demonstrations
from cutenv.agents.learning.on_policy import OnPolicyLearner
from cutenv.agents.policy import RecurrentNetwork


def imitate(policy: RecurrentAsymmetricActorCritic, shown: Demonstrations, arguments: RecurrentPPOArguments) -> float:
    """Clone the script into the actor by cut; return remaining error."""
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


LEARNER = OnPolicyLearner(
    "recurrent PPO", RecurrentPPO, RecurrentAsymmetricActorCritic, imitate, RecurrentNetwork.from_state_dict
)
