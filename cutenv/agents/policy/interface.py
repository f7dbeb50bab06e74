"""The interface of a policy.

Reset at the start of a cut, then observations in, actions out; by column, in SI units.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from copy import deepcopy
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cutenv._base.arrays import Array, Array32, Indices
from cutenv._base.validation import one_of
from cutenv.task.episode import Episode
from cutenv.task.observation import (
    ANGLE_CENTRE,
    ANGLE_SCALE,
    COMPONENTS,
    OFFSETS,
    SCALES,
    checked_observation,
    speed_action,
)
from cutenv.task.registry import RegisteredTask


class Policy(Protocol):
    """A policy for ``cutenv/GentleCut-v1`` and everything with the same spaces."""

    def reset(self, rng: np.random.Generator) -> None:
        """Forget the last cut; ``rng`` gives the next one's randomness."""
        ...

    def __call__(self, observation: Array32) -> Array32:
        """Return the action, (2,) float32 in [-1, 1], for an observation, (12,)."""
        ...


@runtime_checkable
class PrivilegedPolicy(Protocol):
    """A policy that is given the hidden state.

    An oracle to compare with, never a competitor.
    """

    def set_state(self, cutting: Episode) -> None:
        """Take the hidden state at a cut's start, after ``reset``."""
        ...


class ArrayPolicy(ABC):
    """Base class of policies that decide for n cuts in one call."""

    def reset(self, rng: np.random.Generator) -> None:
        """Forget all cuts, and begin a single one."""
        self.begin([rng])

    def __call__(self, observation: Array32) -> Array32:
        """Return the action, (2,), for an observation, (12,), since :meth:`reset`."""
        action: Array32 = self.act(np.asarray(observation)[None])[0]
        return action

    @abstractmethod
    def begin(self, rngs: Sequence[np.random.Generator]) -> None:
        """Forget all cuts; begin ``len(rngs)``, each with its own randomness."""

    @abstractmethod
    def forget(self, cuts: Indices) -> None:
        """Begin those cuts again that are given by index."""

    privileged = False
    """True: it must be given the hidden state by :meth:`set_states`, like a :class:`PrivilegedPolicy`."""

    def set_states(self, cuttings: Sequence[Episode]) -> None:
        """Take all cuts' hidden states at the start, after :meth:`begin`."""
        raise NotImplementedError(f"{type(self).__name__} takes no hidden state.")

    @abstractmethod
    def act(self, observations: Array32) -> Array32:
        """Return actions, (n, 2) float32 in [-1, 1], for observations, (n, 12)."""


class CopiedPolicy(ArrayPolicy):
    """Adapter of a policy written for single cuts.

    A copy of it for each cut.
    """

    def __init__(self, policy: Policy) -> None:
        self._policy: Any = policy
        self.privileged = isinstance(policy, PrivilegedPolicy)

    def set_states(self, cuttings: Sequence[Episode]) -> None:
        """Show each copy its cut."""
        for policy, cutting in zip(self.copies, cuttings, strict=True):
            policy.set_state(cutting)

    def begin(self, rngs: Sequence[np.random.Generator]) -> None:
        """Make and reset a copy for each of ``len(rngs)`` cuts."""
        self.copies, self._rngs = [deepcopy(self._policy) for _ in rngs], list(rngs)
        self.forget(np.arange(len(rngs)))

    def forget(self, cuts: Indices) -> None:
        """Reset the copies of those cuts."""
        for n in cuts:
            self.copies[n].reset(self._rngs[n])

    def act(self, observations: Array32) -> Array32:
        """Return the action of every copy."""
        return np.stack([policy(seen) for policy, seen in zip(self.copies, observations, strict=True)])


def as_array_policy(policy: Policy) -> ArrayPolicy:
    """Return a policy for many cuts at once, itself or copies of it."""
    return policy if isinstance(policy, ArrayPolicy) else CopiedPolicy(policy)


def script_of(task: RegisteredTask, name: str) -> ArrayPolicy:
    """Make the script of a task that has this name.

    Raises ValueError if there is none.
    """
    return as_array_policy(task.scripts[one_of("script", name, task.scripts)]())


_COLUMNS = {component.name: k for k, component in enumerate(COMPONENTS)}
FORCE_COLUMN, FORCE_MEAN_COLUMN, FORCE_MIN_COLUMN, FORCE_MAX_COLUMN = (
    _COLUMNS[name] for name in ("force", "force_mean", "force_min", "force_max")
)
POSITION_COLUMN, SPEED_COLUMN, ANGLE_COLUMN, DEPTH_COLUMN, DISTANCE_COLUMN = (
    _COLUMNS[name] for name in ("position", "speed", "angle", "depth", "distance")
)
"""Columns of an observation, for compiled code and arrays."""


def in_si(observations: ArrayLike) -> Array:
    """Return observations, (n, 12), in SI; raise ValueError if invalid."""
    values: Array = checked_observation(observations) * SCALES + OFFSETS
    return values


def to_actions(speeds: Array, angles: Array | float) -> Array32:
    """Return clipped actions, (n, 2) float32, for speeds [m/s] and angles [rad]."""
    actions = np.empty((len(speeds), 2), np.float32)
    actions[:, 0], actions[:, 1] = speed_action(speeds), (angles - ANGLE_CENTRE) / ANGLE_SCALE
    return np.clip(actions, -1.0, 1.0, out=actions)


def choose(condition: NDArray[np.bool_], actions: Array32, others: Array32) -> Array32:
    """Return ``actions`` where ``condition`` holds, else ``others``, shape (n, 2)."""
    chosen: Array32 = np.where(condition[:, None], actions, others)
    return chosen
