"""Actors that see features, critics that see hidden state, in torch.

One of the actors has a memory (LSTM).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import torch
from sb3_contrib.common.recurrent.policies import RecurrentActorCriticPolicy
from sb3_contrib.crossq.policies import CrossQPolicy
from sb3_contrib.tqc.policies import TQCPolicy
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from stable_baselines3.sac.policies import SACPolicy
from torch import nn


class Extractor(nn.Module):
    """Two towers of tanh layers, for actor and critic.

    Each has inputs of its own.
    """

    def __init__(self, features: int, critic: int, hidden: int) -> None:
        super().__init__()
        self._features, self._critic = features, critic
        self.policy_net, self.value_net = _tower(features, hidden), _tower(critic, hidden)
        self.latent_dim_pi = self.latent_dim_vf = hidden

    def forward(self, seen: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Return the latent values of policy and critic."""
        return self.forward_actor(seen), self.forward_critic(seen)

    def forward_actor(self, seen: torch.Tensor) -> torch.Tensor:
        """Return the latent values of the policy, from the features alone."""
        latent: torch.Tensor = self.policy_net(seen[..., : self._features])
        return latent

    def forward_critic(self, seen: torch.Tensor) -> torch.Tensor:
        """Return the latent values of the critic."""
        latent: torch.Tensor = self.value_net(seen[..., : self._critic])
        return latent


def _tower(inputs: int, hidden: int) -> nn.Sequential:
    return nn.Sequential(nn.Linear(inputs, hidden), nn.Tanh(), nn.Linear(hidden, hidden), nn.Tanh())


def start_at(actions: Any, begin: Sequence[float]) -> None:
    """Add mean actions ``begin``, if any, to the action layer's bias."""
    if begin:
        actions.bias += torch.tensor(begin)


class AsymmetricActorCritic(ActorCriticPolicy):
    """Stable-Baselines3 policy whose actor and critic see different features.

    The actor sees the first ``features`` numbers, the critic the first ``critic``.  It draws its actions with a
    standard deviation that :class:`~cutenv.agents.learning.progress.Progress` sets.  Before it has learned anything its
    mean action is ``begin``, by default 0.
    """

    def __init__(
        self, *args: Any, features: int, critic: int, hidden: int, begin: Sequence[float] = (), **kwargs: Any
    ) -> None:
        self._sizes = {"features": features, "critic": critic, "hidden": hidden}
        super().__init__(*args, **kwargs)
        with torch.no_grad():
            start_at(self.action_net, begin)

    def _build_mlp_extractor(self) -> None:
        self.mlp_extractor = Extractor(**self._sizes)  # type: ignore[assignment]  # has all that is used of it

    def _build(self, lr_schedule: Any) -> None:
        super()._build(lr_schedule)
        self.log_std.requires_grad_(False)  # see Progress

    def _get_constructor_parameters(self) -> dict[str, Any]:
        return super()._get_constructor_parameters() | self._sizes

    def actor_parameters(self) -> list[nn.Parameter]:
        """Return the actor's parameters; none are shared with the critic."""
        return [*self.mlp_extractor.policy_net.parameters(), *self.action_net.parameters()]

    def action_for(self, seen: torch.Tensor) -> torch.Tensor:
        """Return the most likely action, before it is clipped."""
        action: torch.Tensor = self.action_net(self.mlp_extractor.forward_actor(seen))
        return action


class FirstNumbers(BaseFeaturesExtractor):
    """The first ``features_dim`` numbers of an observation."""

    def forward(self, seen: torch.Tensor) -> torch.Tensor:
        """Return the first numbers of observations, shape (n, count)."""
        return seen[..., : self.features_dim]


class _Asymmetric:
    """Base of the three policies.

    It holds what actor and critics see, and the actor's parameters. The actor sees the first ``features`` numbers, the
    critics the first ``critic``; the actor draws its actions with the standard deviation ``exploration`` until it has
    learned another.
    """

    actor: Any
    observation_space: Any

    def __init__(self, *args: Any, features: int, critic: int, exploration: float, **kwargs: Any) -> None:
        self._features, self._critic_inputs = features, critic
        super().__init__(*args, **kwargs)
        with torch.no_grad():
            self.actor.log_std.weight.mul_(0.01)
            self.actor.log_std.bias.fill_(math.log(exploration))

    def make_actor(self, features_extractor: Any = None) -> Any:
        """Make the actor."""
        parent: Any = super()
        return parent.make_actor(FirstNumbers(self.observation_space, self._features))

    def make_critic(self, features_extractor: Any = None) -> Any:
        """Make the critics, or their targets."""
        parent: Any = super()
        return parent.make_critic(FirstNumbers(self.observation_space, self._critic_inputs))

    def actor_parameters(self) -> list[nn.Parameter]:
        """Return the actor's parameters; none are shared with the critics."""
        return list(self.actor.parameters())

    def action_for(self, seen: torch.Tensor) -> torch.Tensor:
        """Return the most likely action."""
        action: torch.Tensor = self.actor(seen, deterministic=True)
        return action


class AsymmetricSACPolicy(_Asymmetric, SACPolicy):
    """Policy of SAC."""


class AsymmetricTQCPolicy(_Asymmetric, TQCPolicy):
    """Policy of TQC."""


class AsymmetricCrossQPolicy(_Asymmetric, CrossQPolicy):
    """Policy of CrossQ."""


LSTMState = tuple[torch.Tensor, torch.Tensor]


class RecurrentAsymmetricActorCritic(RecurrentActorCriticPolicy):
    """Policy with an LSTM actor and a critic without memory.

    A critic that sees the hidden state needs no memory: the state is all that matters.
    """

    def __init__(
        self, *args: Any, features: int, critic: int, hidden: int, begin: Sequence[float] = (), **kwargs: Any
    ) -> None:
        own: dict[str, Any] = {
            "net_arch": {"pi": [hidden], "vf": [hidden, hidden]},
            "lstm_hidden_size": hidden,
            "enable_critic_lstm": False,
            "share_features_extractor": False,
        }
        super().__init__(*args, **(kwargs | own))
        self._sizes = {"features": features, "critic": critic, "hidden": hidden}
        # The base class gives both the same inputs.
        self.pi_features_extractor = FirstNumbers(self.observation_space, features)
        self.vf_features_extractor = FirstNumbers(self.observation_space, critic)
        self.lstm_actor = nn.LSTM(features, hidden)
        self.critic = nn.Linear(critic, hidden)
        self.log_std.requires_grad_(False)  # see Progress
        schedule = kwargs["lr_schedule"] if "lr_schedule" in kwargs else args[2]
        keywords = {"lr": schedule(1), **self.optimizer_kwargs}
        self.optimizer = self.optimizer_class(self.parameters(), **keywords)
        with torch.no_grad():
            start_at(self.action_net, begin)

    @staticmethod
    def _process_sequence(  # type: ignore[override]
        features: torch.Tensor, lstm_states: LSTMState, episode_starts: torch.Tensor, lstm: nn.LSTM
    ) -> tuple[torch.Tensor, LSTMState]:
        """Reset the states at a sequence's start at once, for speed."""
        sequences = lstm_states[0].shape[1]
        starts = episode_starts.reshape(sequences, -1).clone()
        kept = (1.0 - starts[:, 0]).view(1, sequences, 1)
        starts[:, 0] = 0.0
        states = (kept * lstm_states[0], kept * lstm_states[1])
        # The base class annotates one state, and returns two.
        return RecurrentActorCriticPolicy._process_sequence(features, states, starts.flatten(), lstm)  # type: ignore[return-value]

    def actor_parameters(self) -> list[nn.Parameter]:
        """Return the actor's parameters; none are shared with the critic."""
        return [
            *self.lstm_actor.parameters(),
            *self.mlp_extractor.policy_net.parameters(),
            *self.action_net.parameters(),
        ]

    def actions_along(self, seen: torch.Tensor) -> torch.Tensor:
        """Return the most likely actions along whole cuts, unclipped, (decision, cut, ...)."""
        remembered, _ = self.lstm_actor(self.pi_features_extractor(seen))
        actions: torch.Tensor = self.action_net(self.mlp_extractor.forward_actor(remembered))
        return actions
