"""What every policy is: something that is told when a cut begins and answers observations with actions."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from cutenv.task.gentle_cutting import GentleCutting


class Policy(Protocol):
    """A policy for ``cutenv/GentleCut-v1`` and everything with the same spaces."""

    def reset(self, rng: np.random.Generator) -> None:
        """Forget the last cut; ``rng`` is the only source of chance for the next."""
        ...

    def __call__(self, observation: NDArray[np.float32]) -> NDArray[np.float32]:
        """The action, shape (2,) float32 in [-1, 1], for an observation, shape (12,)."""
        ...


@runtime_checkable
class SeesTruth(Protocol):
    """A policy that is shown the hidden state: an upper bound to compare with, and never a competitor."""

    def look_into(self, cutting: GentleCutting) -> None:
        """Called after ``reset`` with the cut at its start."""
        ...
