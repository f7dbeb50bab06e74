"""Policies of SAC, TQC and CrossQ whose actor sees the features, and whose critics see the hidden state as well."""

from __future__ import annotations

import math
from typing import Any

import gymnasium
import torch
from sb3_contrib.crossq.policies import CrossQPolicy
from sb3_contrib.tqc.policies import TQCPolicy
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from stable_baselines3.sac.policies import SACPolicy
from torch import nn


class FirstNumbers(BaseFeaturesExtractor):
    """The first ``count`` numbers of an observation."""

    def __init__(self, space: gymnasium.Space[Any], count: int) -> None:
        super().__init__(space, count)

    def forward(self, seen: torch.Tensor) -> torch.Tensor:
        """Return the first numbers of observations, shape (n, count)."""
        return seen[..., : self.features_dim]


class _Asymmetric:
    """Base of the three policies: what actor and critics see, and the actor's parameters.

    The actor sees the first ``features`` numbers, the critics the first ``critic``; the actor draws its actions with
    the standard deviation ``exploration`` until it has learned another.
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
        """Return the parameters of the actor; it shares none with the critics."""
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
