"""Scripted baselines: what a sensible engineer would program before learning anything."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod

import numpy as np

from cutenv._base.arrays import Array32
from cutenv._base.validation import in_range
from cutenv.policy.unloading import UPRIGHT, StopAndUnload
from cutenv.task.observation import to_action

INCLINED = math.radians(45.0)


class Script(ABC):
    """Base class of scripts: cut by :meth:`command` until the shared routine stops and unloads."""

    def __init__(self, unloading: StopAndUnload | None = None) -> None:
        self.unloading = unloading or StopAndUnload()

    def reset(self, rng: np.random.Generator) -> None:
        """Forget the last cut."""
        self.unloading.reset()

    def __call__(self, observation: Array32) -> Array32:
        """Return the action for an observation."""
        ending = self.unloading(observation)
        return self.command(observation) if ending is None else ending

    @abstractmethod
    def command(self, observation: Array32) -> Array32:
        """Return the action while cutting."""


class ConstantFeed(Script):
    """A constant speed [m/s] and angle [rad] up to the target."""

    def __init__(self, *, speed: float, angle: float = UPRIGHT, unloading: StopAndUnload | None = None) -> None:
        super().__init__(unloading)
        self._action = to_action(*checked_motion(speed, angle))

    def command(self, observation: Array32) -> Array32:
        """Return the constant action."""
        return self._action


class FastThenSlow(Script):
    """A fast feed up to ``approach`` [m] before the target (estimated tip), then a slow one."""

    def __init__(
        self,
        *,
        fast: float = 0.019,
        slow: float = 0.0127,
        approach: float = 0.030,
        angle: float = INCLINED,
        unloading: StopAndUnload | None = None,
    ) -> None:
        super().__init__(unloading)
        self._fast, self._slow = to_action(*checked_motion(fast, angle)), to_action(*checked_motion(slow, angle))
        self._approach = checked_approach(approach)

    def command(self, observation: Array32) -> Array32:
        """Return the slow action near the target, the fast one before."""
        return self._slow if self.unloading.left < self._approach else self._fast


class InclineBetween(Script):
    """Upright for the first ``start`` [m], then inclined, upright from ``approach`` [m] before the target."""

    def __init__(
        self,
        *,
        speed: float = 0.019,
        angle: float = INCLINED,
        start: float = 0.010,
        approach: float = 0.002,
        unloading: StopAndUnload | None = None,
    ) -> None:
        super().__init__(unloading)
        self._inclined = to_action(*checked_motion(speed, angle))
        self._upright = to_action(speed, UPRIGHT)
        self._start = in_range("start", start, 0.0, 0.15, "m", "10 mm is 0.010.")
        self._approach = checked_approach(approach)

    def command(self, observation: Array32) -> Array32:
        """Return the inclined action in the middle of the cut, the upright one at its ends."""
        begun = self.unloading.tip > self._start
        return self._inclined if begun and self.unloading.left > self._approach else self._upright


class NoAction:
    """A policy that never moves the blade."""

    def reset(self, rng: np.random.Generator) -> None:
        """Do nothing: there is no state."""

    def __call__(self, observation: Array32) -> Array32:
        """Return the action for speed zero, upright."""
        return to_action(0.0, UPRIGHT)


class RandomAction:
    """A policy of uniformly random actions."""

    def reset(self, rng: np.random.Generator) -> None:
        """Use ``rng`` for the next cut."""
        self._rng = rng

    def __call__(self, observation: Array32) -> Array32:
        """Return a random action."""
        return self._rng.uniform(-1.0, 1.0, 2).astype(np.float32)


def checked_motion(speed: float, angle: float) -> tuple[float, float]:
    """Return speed [m/s] and angle [rad]; raise ValueError outside the range of the actions."""
    in_range("speed", speed, 0.0, 0.0254, "m/s", "Speeds are in m/s: 2.54 cm/s is 0.0254.")
    in_range("angle", angle, math.radians(45.0) - 1e-9, UPRIGHT + 1e-9, "rad", "90 degrees is 1.5708.")
    return speed, angle


def checked_approach(approach: float) -> float:
    """Return a distance before the target [m]; raise ValueError if it is longer than a specimen."""
    return in_range("approach", approach, 0.0, 0.15, "m", "15 mm is 0.015.")
