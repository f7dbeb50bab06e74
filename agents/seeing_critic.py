"""An actor that sees the features, and a critic that sees the hidden state as well, for Stable-Baselines3."""

from __future__ import annotations

from typing import Any

import torch
from stable_baselines3.common.policies import ActorCriticPolicy
from torch import nn


class Extractor(nn.Module):
    """Two towers of tanh layers: the policy's sees the features, the critic's the hidden state as well."""

    def __init__(self, features: int, everything: int, hidden: int) -> None:
        super().__init__()
        self._features = features
        self.policy_net, self.value_net = _tower(features, hidden), _tower(everything, hidden)
        self.latent_dim_pi = self.latent_dim_vf = hidden

    def forward(self, seen: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Latent values of policy and critic."""
        return self.forward_actor(seen), self.forward_critic(seen)

    def forward_actor(self, seen: torch.Tensor) -> torch.Tensor:
        """Latent values of the policy, from the features alone."""
        return self.policy_net(seen[..., : self._features])

    def forward_critic(self, seen: torch.Tensor) -> torch.Tensor:
        """Latent values of the critic."""
        return self.value_net(seen)


def _tower(inputs: int, hidden: int) -> nn.Sequential:
    return nn.Sequential(nn.Linear(inputs, hidden), nn.Tanh(), nn.Linear(hidden, hidden), nn.Tanh())


class SeeingCritic(ActorCriticPolicy):
    """SB3's policy with :class:`Extractor`."""

    def __init__(self, *args: Any, features: int, hidden: int, **kwargs: Any) -> None:
        self._sizes = features, hidden
        super().__init__(*args, **kwargs)

    def _build_mlp_extractor(self) -> None:
        features, hidden = self._sizes
        self.mlp_extractor = Extractor(features, self.features_dim, hidden)

    def _build(self, lr_schedule: Any) -> None:
        super()._build(lr_schedule)
        self.log_std.requires_grad_(False)  # see Progress

    def _get_constructor_parameters(self) -> dict[str, Any]:
        features, hidden = self._sizes
        return super()._get_constructor_parameters() | {"features": features, "hidden": hidden}


def actor_parameters(model: Any) -> list[nn.Parameter]:
    """The parameters of the actor; it shares none with the critic."""
    return [*model.policy.mlp_extractor.policy_net.parameters(), *model.policy.action_net.parameters()]
