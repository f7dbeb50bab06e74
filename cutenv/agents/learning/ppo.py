"""PPO with an asymmetric actor-critic that first imitates a script.

The agent decides 10 times a second: a cut is then some 80 decisions, 300 at most.  gamma = 1 sets no horizon, because a
cut ends by itself and its score is the plain sum; with 0.995 early progress is worth more, and the agent learns to
hurry, which the reward does not ask for.  The actor sees hand-made features; the critic also sees the hidden state,
which is needed in training and not for cutting.

The actor starts as a clone of the best script and then learns by trial.  At first only the critic learns, because an
untrained critic would spoil the clone.  The standard deviation of the actions is scheduled and falls: a policy that
learns it comes to rely on its noise.  The running average of the actor is validated, and kept where it does best.
"""

from __future__ import annotations

from stable_baselines3 import PPO

from cutenv.agents.learning.arguments import PPOArguments
from cutenv.agents.learning.asymmetric_actors import AsymmetricActorCritic
from cutenv.agents.learning.cloning import Cloning, Demonstrations
from cutenv.agents.learning.on_policy import OnPolicyLearner
from cutenv.agents.policy import Network


def imitate(policy: AsymmetricActorCritic, shown: Demonstrations, arguments: PPOArguments) -> float:
    """Clone the demonstrated script into the actor; return the remaining error."""
    return Cloning(policy.action_for, policy.actor_parameters(), shown.by_decision(), seed=arguments.seed).run()


LEARNER = OnPolicyLearner("PPO", PPO, AsymmetricActorCritic, imitate, Network.from_state_dict)
