"""Recurrent PPO: like PPO, but the actor has a memory (one layer of LSTM) instead of a history of decisions.

Its gradients go through whole cuts, so that an update costs four times as much and fewer are made.  Only the critic
learns for a larger share of the training.
"""

from __future__ import annotations

from sb3_contrib import RecurrentPPO

from cutenv.learning.arguments import RecurrentPPOArguments
from cutenv.learning.cloning import clone, demonstrations
from cutenv.learning.on_policy import OnPolicyLearner, sb3_keywords
from cutenv.learning.recurrent_actor_critic import RecurrentAsymmetricActorCritic
from cutenv.policy import BASELINES, RecurrentNetwork
from cutenv.sb3 import FeatureVecEnv


def new_model(arguments: RecurrentPPOArguments, environments: FeatureVecEnv) -> RecurrentPPO:
    """Make an untrained agent."""
    return RecurrentPPO(RecurrentAsymmetricActorCritic, environments, **sb3_keywords(arguments))


def pretrain(model: RecurrentPPO, arguments: RecurrentPPOArguments) -> None:
    """Clone the demonstrated script into the actor, cut by cut."""
    shown = demonstrations(
        model.get_env(),  # type: ignore[arg-type]  # a FeatureVecEnv, as new_model was given
        BASELINES[arguments.script],
        decisions=arguments.demonstrations,
        noise=arguments.demonstration_noise,
        seed=arguments.seed,
    )
    policy = model.policy
    assert isinstance(policy, RecurrentAsymmetricActorCritic)
    error = clone(
        policy.actions_along,
        policy.actor_parameters(),
        shown.by_cut(),
        epochs=arguments.cloning_epochs,
        batch_size=4096,
        learning_rate=4e-3,
        seed=arguments.seed,
    )
    print(f"the clone's actions differ from those of {arguments.script!r} by {error:.3f} (root mean square)")


LEARNER = OnPolicyLearner("recurrent PPO", RecurrentPPO, new_model, pretrain, RecurrentNetwork.from_state_dict)
