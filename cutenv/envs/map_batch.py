"""Batched cuts of a task whose reward is assessed by a map of the whole cut as well."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Sequence
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from cutenv._base.arrays import StructArray
from cutenv.envs.batch import CutBatch
from cutenv.task.map_costs import map_charges
from cutenv.task_quantities import MapCost


class MapBatch(CutBatch):
    """``count`` cuts of a task that adds costs of a map, and an end, to gentle cutting."""

    append: ClassVar[Callable[..., NDArray[np.float32]]]
    """Function that appends the hidden state, by records of the cuts, of the motion and of the map."""
    map_costs: ClassVar[Sequence[MapCost]]
    """Costs of the map."""
    shown_as: ClassVar[str]
    """Group of the info that has the errors of the map."""

    @property
    @abstractmethod
    def beside(self) -> tuple[StructArray, ...]:
        """Records that the task adds to those of the cuts: of the motion, of the map, and what all share."""

    @abstractmethod
    def truth(self) -> dict[str, Any]:
        """Return the hidden state that the task adds to the info, by name; each of shape (count,)."""

    def _stepped_with(self) -> tuple[Any, ...]:
        return self.beside, self.single.ticks

    def extra_terms(self) -> dict[str, NDArray[np.float64]]:
        """Return the costs of the map in the last step's reward, by name; each of shape (count,)."""
        return map_charges(self.beside[1], self.map_costs)

    def further_infos(self) -> dict[str, dict[str, NDArray[np.float64]]]:
        """Return what the task adds to the info, by group and name; each of shape (count,)."""
        return {"truth": self.truth(), "reward_terms": self.extra_terms(), self.shown_as: self.further_scores()}

    def append_hidden(self, features: NDArray[np.float32], which: NDArray[np.int64]) -> NDArray[np.float32]:
        """Append the hidden state of the cuts numbered ``which``, for a critic, to features of shape (m, size)."""
        return type(self).append(self.cuts, *self.beside[:2], features, which)

    def succeeded(self) -> NDArray[np.bool_]:
        """Return which cuts ended in success, shape (count,)."""
        success: NDArray[np.bool_] = self.beside[1]["success"] == 1
        return success
