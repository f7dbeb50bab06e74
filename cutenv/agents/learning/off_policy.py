"""SAC, TQC and CrossQ.

Learners that keep every decision, those of a script among them, and learn from all again.

The replay buffer begins with a script's demonstrations, with their noise, and keeps them: decisions of the agent are
added to them.  The actor begins as a clone of the script.  Its critics, which see the hidden state as well, learn alone
at first, because an untrained critic would spoil the clone.  gamma = 1 needs no horizon: every cut ends by itself, and
its score is the plain sum; the recursion is finite because a decision that ends a cut has no successor.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from sb3_contrib import TQC, CrossQ
from stable_baselines3 import SAC
from stable_baselines3.common.buffers import NStepReplayBuffer

from cutenv.agents.learning.arguments import CrossQArguments, OffPolicyArguments, SACArguments, TQCArguments
from cutenv.agents.learning.asymmetric_actors import AsymmetricCrossQPolicy, AsymmetricSACPolicy, AsymmetricTQCPolicy
from cutenv.agents.learning.cloning import Cloning, Demonstrations
from cutenv.agents.learning.on_policy import FallingRate, TrialLearner
from cutenv.agents.policy import Network

# options that Stable-Baselines3 knows by these names
_SAME = ["train_freq", "gradient_steps", "batch_size", "buffer_size", "gamma", "ent_coef", "target_entropy", "seed"]
_NORM_EPS = 1e-3  # of sb3-contrib's BatchRenorm


def off_policy_keywords(arguments: OffPolicyArguments) -> dict[str, Any]:
    """Return the keyword arguments of SAC, TQC or CrossQ."""
    own: dict[str, Any] = {}
    layers = {"pi": [arguments.hidden] * 2, "qf": [arguments.critic_hidden] * 2}
    policy = arguments.sizes | {"exploration": arguments.exploration, "net_arch": layers}
    if isinstance(arguments, SACArguments):
        own["tau"] = arguments.tau
    if isinstance(arguments, TQCArguments):
        own["top_quantiles_to_drop_per_net"] = arguments.top_quantiles_to_drop_per_net
    if isinstance(arguments, CrossQArguments):
        own["policy_delay"] = arguments.policy_delay
        policy["renorm_warmup_steps"] = 1000  # before the clone is ready, so that it acts as it was trained
    return {
        "learning_rate": FallingRate(arguments.learning_rate),
        "learning_starts": 0,
        "replay_buffer_class": NStepReplayBuffer,
        "replay_buffer_kwargs": {"n_steps": arguments.n_steps, "gamma": arguments.gamma},
        "policy_kwargs": policy,
        "device": "cpu",  # a network this small is slower on a GPU
        **{name: getattr(arguments, name) for name in _SAME},
        **own,
    }


def imitate(policy: Any, shown: Demonstrations, arguments: OffPolicyArguments) -> float:
    """Clone the demonstrated script into the actor; return the remaining error."""
    policy.set_training_mode(True)  # CrossQ's layers then learn the means that they subtract
    error = Cloning(policy.action_for, policy.actor_parameters(), shown.by_decision(), seed=arguments.seed).run()
    policy.set_training_mode(False)
    return error


def remember(model: Any, shown: Demonstrations) -> None:
    """Put demonstrations into a model's replay buffer."""
    last = len(shown.starts) - 2
    for k in range(last + 1):
        seen, after, ended = shown.observations[k], shown.observations[k + 1], shown.starts[k + 1]
        infos = [{"TimeLimit.truncated": k == last and not one} for one in ended]  # the agent's cuts do not continue it
        model.replay_buffer.add(seen, after, shown.taken[k], shown.rewards[k], ended | (k == last), infos)


def network(arrays: Mapping[str, np.ndarray], activation: str) -> Network:
    """Return the actor of a policy's parameters in NumPy.

    A normalisation before a layer becomes part of that layer; the activation is that of every layer but the last, which
    tanh follows.
    """
    parts = sorted({int(name.split(".")[2]) for name in arrays if name.startswith("actor.latent_pi.")})
    layers = []
    scale: np.ndarray = np.ones(1, np.float32)
    shift: np.ndarray = np.zeros(1, np.float32)
    for prefix in (*(f"actor.latent_pi.{part}" for part in parts), "actor.mu"):
        if f"{prefix}.ra_var" in arrays:
            scale = arrays[f"{prefix}.scale"] / np.sqrt(arrays[f"{prefix}.ra_var"] + np.float32(_NORM_EPS))
            shift = arrays[f"{prefix}.bias"] - arrays[f"{prefix}.ra_mean"] * scale
        else:
            weight, bias = arrays[f"{prefix}.weight"], arrays[f"{prefix}.bias"]
            layers.append((weight * scale, bias + (weight * shift).sum(1)))
            scale, shift = np.ones(1, np.float32), np.zeros(1, np.float32)
    return Network(tuple(layers), activation, "tanh")


def _learner(name: str, algorithm: Any, policy: type[Any]) -> TrialLearner:
    return TrialLearner(name, algorithm, policy, off_policy_keywords, imitate, network, "relu", remember)


OFF_POLICY = {
    "sac": _learner("SAC", SAC, AsymmetricSACPolicy),
    "tqc": _learner("TQC", TQC, AsymmetricTQCPolicy),
    "crossq": _learner("CrossQ", CrossQ, AsymmetricCrossQPolicy),
}
"""Learners by their names on the command line."""
