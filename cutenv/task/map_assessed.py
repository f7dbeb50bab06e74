"""Episode that is assessed by a map of the whole cut as well."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

from cutenv._base.arrays import StructArray
from cutenv.task.gentle_cutting import GentleCutting
from cutenv.task.map_costs import map_charges
from cutenv.task.reward import STOPPED
from cutenv.task_quantities import MapCost


class MapAssessed(GentleCutting):
    """Episode of a task that adds costs of a map, and an end, to gentle cutting."""

    end_names: ClassVar[Sequence[str]]
    """Names of the ends by code."""
    map_costs: ClassVar[Sequence[MapCost]]
    """Costs of the map."""
    shown_as: ClassVar[str]
    """Name of the line that shows all of them in a picture."""

    @property
    def maps(self) -> StructArray:
        """The record of the map, shape (1,), with the fields of :func:`cutenv.task.map_costs.map_fields`."""
        raise NotImplementedError

    @property
    def end(self) -> str:
        """Name of the reason why the episode ended, or an empty string."""
        return STOPPED if self._stopped else self.end_names[self._end]

    @property
    def success(self) -> bool:
        """True if it is a success of gentle cutting, and the map is within its tolerances."""
        return bool(self.maps["success"][0])

    @property
    def map_terms(self) -> dict[str, float]:
        """The costs of the map in the last step's reward."""
        return {name: float(value[0]) for name, value in map_charges(self.maps, self.map_costs).items()}

    @property
    def reward_terms(self) -> dict[str, float]:
        """The reward of the last step by term; costs are negative; the sum is the reward."""
        return super().reward_terms | self.map_terms

    @property
    def reward_totals(self) -> dict[str, float]:
        """The reward since the start by term; the sum is the return."""
        return super().reward_totals | self._map_totals

    @property
    def shown_totals(self) -> dict[str, float]:
        """The reward since the start by line of a picture, with one line for all costs of the map."""
        own = self._map_totals
        gentle = {name: total for name, total in self.reward_totals.items() if name not in own}
        return gentle | {self.shown_as: sum(own.values())}

    @property
    def _map_totals(self) -> dict[str, float]:
        return {name: float(value[0]) for name, value in map_charges(self.maps, self.map_costs, "total").items()}
