"""Scripted baselines: what a sensible engineer would program before learning anything."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Sequence

import numpy as np

from cutenv._base.arrays import Array, Array32, Indices
from cutenv._base.validation import in_range
from cutenv.policy.interface import ArrayPolicy
from cutenv.policy.signals import choose, in_si
from cutenv.policy.unloading import UPRIGHT, StopAndUnload
from cutenv.task.observation import to_action

INCLINED = math.radians(45.0)


class Script(ArrayPolicy):
    """Base class of scripts: cut by :meth:`command` until the shared routine stops and unloads."""

    def __init__(self, unloading: StopAndUnload | None = None) -> None:
        self.unloading = unloading or StopAndUnload()

    def begin(self, rngs: Sequence[np.random.Generator]) -> None:
        """Forget all cuts, and begin ``len(rngs)``; a script uses no randomness."""
        self.unloading.begin(len(rngs))

    def forget(self, cuts: Indices) -> None:
        """Begin those cuts again that are given by index."""
        self.unloading.forget(cuts)

    def act(self, observations: Array32) -> Array32:
        """Return the actions, shape (n, 2), for the observations of all cuts, shape (n, 12)."""
        seen = in_si(observations)
        ending, endings = self.unloading.endings(seen)
        return choose(ending, endings, self.command(seen))

    @abstractmethod
    def command(self, seen: Array) -> Array32:
        """Return the actions while cutting, shape (n, 2) or (2,), for observations in SI units, shape (n, 12)."""


class ConstantFeed(Script):
    """A constant speed [m/s] and angle [rad] up to the target."""

    def __init__(self, *, speed: float, angle: float = UPRIGHT, unloading: StopAndUnload | None = None) -> None:
        super().__init__(unloading)
        self._action = to_action(*checked_motion(speed, angle))

    def command(self, seen: Array) -> Array32:
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

    def command(self, seen: Array) -> Array32:
        """Return the slow action near the target, the fast one before."""
        return choose(self.unloading.left < self._approach, self._slow, self._fast)


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

    def command(self, seen: Array) -> Array32:
        """Return the inclined action in the middle of the cut, the upright one at its ends."""
        between = (self.unloading.tip > self._start) & (self.unloading.left > self._approach)
        return choose(between, self._inclined, self._upright)


class NoAction(ArrayPolicy):
    """A policy that never moves the blade."""

    def begin(self, rngs: Sequence[np.random.Generator]) -> None:
        """Do nothing: there is no state."""

    def forget(self, cuts: Indices) -> None:
        """Do nothing: there is no state."""

    def act(self, observations: Array32) -> Array32:
        """Return the action for speed zero, upright, for every observation."""
        return np.tile(to_action(0.0, UPRIGHT), (len(observations), 1))


class RandomAction(ArrayPolicy):
    """A policy of uniformly random actions."""

    def begin(self, rngs: Sequence[np.random.Generator]) -> None:
        """Use ``rngs`` for the next cuts, one for each."""
        self._rngs = list(rngs)

    def forget(self, cuts: Indices) -> None:
        """Do nothing: the next cuts go on with the random numbers."""

    def act(self, observations: Array32) -> Array32:
        """Return a random action for each observation."""
        return np.array([rng.uniform(-1.0, 1.0, 2) for rng in self._rngs], np.float32)


def checked_motion(speed: float, angle: float) -> tuple[float, float]:
    """Return speed [m/s] and angle [rad]; raise ValueError outside the range of the actions."""
    in_range("speed", speed, 0.0, 0.0254, "m/s", "Speeds are in m/s: 2.54 cm/s is 0.0254.")
    in_range("angle", angle, math.radians(45.0) - 1e-9, UPRIGHT + 1e-9, "rad", "90 degrees is 1.5708.")
    return speed, angle


def checked_approach(approach: float) -> float:
    """Return a distance before the target [m]; raise ValueError if it is longer than a specimen."""
    return in_range("approach", approach, 0.0, 0.15, "m", "15 mm is 0.015.")
