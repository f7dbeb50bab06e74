"""The interface of a policy: reset at the start of a cut, then observations in, actions out."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from cutenv.task.gentle_cutting import GentleCutting


class Policy(Protocol):
    """A policy for ``cutenv/GentleCut-v1`` and everything with the same spaces."""

    def reset(self, rng: np.random.Generator) -> None:
        """Forget the last cut; ``rng`` is the only source of randomness for the next."""
        ...

    def __call__(self, observation: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the action, shape (2,) float32 in [-1, 1], for an observation, shape (12,)."""
        ...


@runtime_checkable
class PrivilegedPolicy(Protocol):
    """A policy that is given the hidden state: an oracle to compare with, never a competitor."""

    def set_state(self, cutting: GentleCutting) -> None:
        """Take the hidden state; called after ``reset`` with the cut at its start."""
        ...
