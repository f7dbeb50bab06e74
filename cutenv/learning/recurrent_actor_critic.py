"""Recurrent actor (LSTM) and feed-forward critic, which may see more, for the recurrent PPO of sb3-contrib."""

from __future__ import annotations

from typing import Any

import torch
from sb3_contrib.common.recurrent.policies import RecurrentActorCriticPolicy
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from torch import nn

LSTMState = tuple[torch.Tensor, torch.Tensor]


class Leading(BaseFeaturesExtractor):
    """Extractor of the first ``count`` numbers of an observation."""

    def __init__(self, observation_space: Any, count: int) -> None:
        super().__init__(observation_space, count)

    def forward(self, seen: torch.Tensor) -> torch.Tensor:
        """Return the first numbers of the observations."""
        return seen[..., : self.features_dim]


class RecurrentAsymmetricActorCritic(RecurrentActorCriticPolicy):
    """Policy with an LSTM and one layer as actor, and two layers without memory as critic.

    A critic that sees the hidden state needs no memory: the state is all that matters.
    """

    def __init__(self, *args: Any, features: int, critic: int, hidden: int, **kwargs: Any) -> None:
        own: dict[str, Any] = {
            "net_arch": {"pi": [hidden], "vf": [hidden, hidden]},
            "lstm_hidden_size": hidden,
            "enable_critic_lstm": False,
            "share_features_extractor": False,
        }
        super().__init__(*args, **(kwargs | own))
        self._sizes = {"features": features, "critic": critic, "hidden": hidden}
        # The base class gives both the same inputs.
        self.pi_features_extractor = Leading(self.observation_space, features)
        self.vf_features_extractor = Leading(self.observation_space, critic)
        self.lstm_actor = nn.LSTM(features, hidden)
        self.critic = nn.Linear(critic, hidden)
        self.log_std.requires_grad_(False)  # see Progress
        schedule = kwargs["lr_schedule"] if "lr_schedule" in kwargs else args[2]
        keywords = {"lr": schedule(1), **self.optimizer_kwargs}
        self.optimizer = self.optimizer_class(self.parameters(), **keywords)

    @staticmethod
    def _process_sequence(  # type: ignore[override]
        features: torch.Tensor, lstm_states: LSTMState, episode_starts: torch.Tensor, lstm: nn.LSTM
    ) -> tuple[torch.Tensor, LSTMState]:
        """Reset the states at the start of a sequence at once; the base class would go through it step by step."""
        sequences = lstm_states[0].shape[1]
        starts = episode_starts.reshape(sequences, -1).clone()
        kept = (1.0 - starts[:, 0]).view(1, sequences, 1)
        starts[:, 0] = 0.0
        states = (kept * lstm_states[0], kept * lstm_states[1])
        # The base class annotates one state, and returns two.
        return RecurrentActorCriticPolicy._process_sequence(features, states, starts.flatten(), lstm)  # type: ignore[return-value]

    def actor_parameters(self) -> list[nn.Parameter]:
        """Return the parameters of the actor; it shares none with the critic."""
        return [
            *self.lstm_actor.parameters(),
            *self.mlp_extractor.policy_net.parameters(),
            *self.action_net.parameters(),
        ]

    def actions_along(self, seen: torch.Tensor) -> torch.Tensor:
        """Return the most likely actions along whole cuts, axes (decision, cut, ...), before they are clipped."""
        remembered, _ = self.lstm_actor(self.pi_features_extractor(seen))
        actions: torch.Tensor = self.action_net(self.mlp_extractor.forward_actor(remembered))
        return actions
