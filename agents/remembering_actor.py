"""Recurrent actor and a critic that may see the hidden state, for sb3-contrib's recurrent PPO."""

from __future__ import annotations

from typing import Any

import torch
from sb3_contrib.common.recurrent.policies import RecurrentActorCriticPolicy
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from torch import nn

State = tuple[torch.Tensor, torch.Tensor]


class First(BaseFeaturesExtractor):
    """Features extractor that keeps the first ``count`` numbers of the observation."""

    def __init__(self, observation_space: Any, count: int) -> None:
        super().__init__(observation_space, count)

    def forward(self, seen: torch.Tensor) -> torch.Tensor:
        """Return the first numbers only."""
        return seen[..., : self.features_dim]


class RememberingActor(RecurrentActorCriticPolicy):
    """Recurrent policy: an LSTM and one layer for the actor, two layers without memory for the critic.

    A critic that sees the hidden state needs no memory: the state is all that matters.
    """

    def __init__(self, *args: Any, features: int, critic: int, hidden: int, **kwargs: Any) -> None:
        super().__init__(
            *args,
            **kwargs,
            net_arch={"pi": [hidden], "vf": [hidden, hidden]},
            lstm_hidden_size=hidden,
            enable_critic_lstm=False,
            share_features_extractor=False,
        )
        self._sizes = {"features": features, "critic": critic, "hidden": hidden}
        # The base class gives both the same inputs.
        self.pi_features_extractor = First(self.observation_space, features)
        self.vf_features_extractor = First(self.observation_space, critic)
        self.lstm_actor = nn.LSTM(features, hidden)
        self.critic = nn.Linear(critic, hidden)
        self.log_std.requires_grad_(False)  # see Progress
        schedule = kwargs["lr_schedule"] if "lr_schedule" in kwargs else args[2]
        self.optimizer = self.optimizer_class(self.parameters(), lr=schedule(1), **self.optimizer_kwargs)

    @staticmethod
    def _process_sequence(
        features: torch.Tensor, lstm_states: State, episode_starts: torch.Tensor, lstm: nn.LSTM
    ) -> tuple[torch.Tensor, State]:
        """Reset the memory at a sequence's beginning first: the base class steps through any sequence with a start."""
        sequences = lstm_states[0].shape[1]
        starts = episode_starts.reshape(sequences, -1).clone()
        kept = (1.0 - starts[:, 0]).view(1, sequences, 1)
        starts[:, 0] = 0.0
        states = (kept * lstm_states[0], kept * lstm_states[1])
        return RecurrentActorCriticPolicy._process_sequence(features, states, starts.flatten(), lstm)

    def actor_parameters(self) -> list[nn.Parameter]:
        """Return the actor's parameters; it shares none with the critic."""
        return [
            *self.lstm_actor.parameters(),
            *self.mlp_extractor.policy_net.parameters(),
            *self.action_net.parameters(),
        ]

    def actions_along(self, seen: torch.Tensor) -> torch.Tensor:
        """Return the most likely actions along whole cuts, axes (decision, cut, ...), before clipping."""
        remembered, _ = self.lstm_actor(self.pi_features_extractor(seen))
        return self.action_net(self.mlp_extractor.forward_actor(remembered))
