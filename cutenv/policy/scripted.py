"""Scripted baselines: what a sensible person would program before learning anything."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cutenv.policy.unloading import UPRIGHT, StopAndUnload
from cutenv.task.observation import to_action
from cutenv.validation import in_range

Array32 = NDArray[np.float32]


class ConstantFeed:
    """One speed [m/s] and one angle [rad] up to the target, then stop and unload."""

    def __init__(self, *, speed: float, angle: float = UPRIGHT, unloading: StopAndUnload | None = None) -> None:
        self._action = to_action(*_checked(speed, angle))
        self._unloading = unloading or StopAndUnload()

    def reset(self, rng: np.random.Generator) -> None:
        """Forget the last cut."""
        self._unloading.reset()

    def __call__(self, observation: Array32) -> Array32:
        """The action for an observation."""
        ending = self._unloading(observation)
        return self._action if ending is None else ending


class FastThenSlow:
    """Fast up to ``approach`` [m] before the target (estimated tip), then slow, then stop and unload."""

    def __init__(
        self,
        *,
        fast: float = 0.0254,
        slow: float = 0.0038,
        approach: float = 0.015,
        angle: float = UPRIGHT,
        unloading: StopAndUnload | None = None,
    ) -> None:
        self._fast, self._slow = to_action(*_checked(fast, angle)), to_action(*_checked(slow, angle))
        self._approach = in_range("approach", approach, 0.0, 0.15, "m", "15 mm is 0.015.")
        self._unloading = unloading or StopAndUnload()

    def reset(self, rng: np.random.Generator) -> None:
        """Forget the last cut."""
        self._unloading.reset()

    def __call__(self, observation: Array32) -> Array32:
        """The action for an observation."""
        ending = self._unloading(observation)
        if ending is not None:
            return ending
        near = self._unloading.distance_left(observation) < self._approach
        return self._slow if near else self._fast


class NoAction:
    """The blade never moves."""

    def reset(self, rng: np.random.Generator) -> None:
        """Nothing to forget."""

    def __call__(self, observation: Array32) -> Array32:
        """Speed zero, upright."""
        return to_action(0.0, UPRIGHT)


class RandomAction:
    """Uniformly random actions."""

    def reset(self, rng: np.random.Generator) -> None:
        """Take ``rng`` for the next cut."""
        self._rng = rng

    def __call__(self, observation: Array32) -> Array32:
        """A random action."""
        return self._rng.uniform(-1.0, 1.0, 2).astype(np.float32)


def _checked(speed: float, angle: float) -> tuple[float, float]:
    in_range("speed", speed, 0.0, 0.0254, "m/s", "Speeds are in m/s: 2.54 cm/s is 0.0254.")
    in_range("angle", angle, math.radians(45.0) - 1e-9, UPRIGHT + 1e-9, "rad", "90 degrees is 1.5708.")
    return speed, angle
