"""Asymmetric actor-critic for Stable-Baselines3: the actor sees the features, the critic the hidden state as well."""

from __future__ import annotations

from typing import Any

import torch
from stable_baselines3.common.policies import ActorCriticPolicy
from torch import nn


class Extractor(nn.Module):
    """Two towers of tanh layers, one for the actor and one for the critic, each with inputs of its own."""

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


class AsymmetricActorCritic(ActorCriticPolicy):
    """Policy of Stable-Baselines3 whose actor sees the first ``features`` numbers, and its critic the first ``critic``.

    It draws its actions with a standard deviation that :class:`~cutenv.learning.progress.Progress` sets.
    """

    def __init__(self, *args: Any, features: int, critic: int, hidden: int, **kwargs: Any) -> None:
        self._sizes = {"features": features, "critic": critic, "hidden": hidden}
        super().__init__(*args, **kwargs)

    def _build_mlp_extractor(self) -> None:
        self.mlp_extractor = Extractor(**self._sizes)  # type: ignore[assignment]  # has all that is used of it

    def _build(self, lr_schedule: Any) -> None:
        super()._build(lr_schedule)
        self.log_std.requires_grad_(False)  # see Progress

    def _get_constructor_parameters(self) -> dict[str, Any]:
        return super()._get_constructor_parameters() | self._sizes

    def actor_parameters(self) -> list[nn.Parameter]:
        """Return the parameters of the actor; it shares none with the critic."""
        return [*self.mlp_extractor.policy_net.parameters(), *self.action_net.parameters()]

    def action_for(self, seen: torch.Tensor) -> torch.Tensor:
        """Return the most likely action, before it is clipped."""
        action: torch.Tensor = self.action_net(self.mlp_extractor.forward_actor(seen))
        return action
