"""One episode of cutting along a wanted depth on a simulated plant."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cutenv._base.arrays import Array, Struct, StructArray
from cutenv.cutting.descent import DescentParameters, descent_records
from cutenv.plant.simulator import SimulatedPlant
from cutenv.task.depth_beginning import begin_depth_one, observe_depth_at_start
from cutenv.task.depth_cuts import DEPTH_STEP_MEMORY, depth_errors, step_depth_one
from cutenv.task.depth_terms import ALL_COMPONENTS, DEPTH, DEPTH_ENDS, DepthConstants
from cutenv.task.gentle_cutting import ShownDepth, SimulatedCutting
from cutenv.task.map_assessed import MapAssessed
from cutenv.task.observation import COMPONENTS
from cutenv.task_quantities import DEPTH_COSTS
from cutenv.tissue.grid import SPACING


def depth_record(constants: DepthConstants) -> StructArray:
    """Return the record of a cut's depth before it begins, :data:`~cutenv.task.depth_terms.DEPTH` of shape (1,)."""
    record = np.zeros(1, DEPTH)
    for name in DepthConstants.__dataclass_fields__:
        record[name] = getattr(constants, name)
    return record


def depth_shown(descent: Struct, depth: Struct) -> ShownDepth:
    """Return the depth of a cut as a picture shows it, from its vertical motion and its map."""
    surface = descent["surface"]
    return ShownDepth(
        float(descent["level"]), surface, descent["floor"], surface - depth["wanted"],
        surface - float(descent["boundary"]),
    )  # fmt: skip


class DepthAssessed(MapAssessed):
    """Episode whose depth of cut is assessed as well, by a map of its floor.

    Attributes
    ----------
    descents, depths : Records, shape (1,)
        Vertical motion and map of the depth, :data:`~cutenv.cutting.descent.DESCENT` and
        :data:`~cutenv.task.depth_terms.DEPTH`.
    """

    descents: StructArray
    depths: StructArray

    end_names = DEPTH_ENDS
    map_costs = DEPTH_COSTS
    shown_as = "depth"

    @property
    def maps(self) -> StructArray:
        """The map of the depth, shape (1,)."""
        return self.depths

    @property
    def depth_errors(self) -> dict[str, float]:
        """The depth of the cut in numbers: areas [mm2], depth into the layer below and mean error [mm]."""
        found = depth_errors(self.depths, np.array([self.target_length]))
        return {name: float(value[0]) for name, value in found.items()}

    @property
    def shown_depth(self) -> ShownDepth:
        """Depth as a picture shows it."""
        return depth_shown(self.descents[0], self.depths[0])

    @property
    def floor(self) -> Array:
        """Depth of the cut below the surface at each point [m], shape (301,); 0 where nothing is cut."""
        cut: Array = self.descents["surface"][0] - self.descents["floor"][0]
        return cut

    @property
    def floor_to_tip(self) -> Array:
        """Depth of the cut at each point from the clamp to the tip [m], shape (n,)."""
        return np.maximum(self.floor[: int(self.descents["cell"][0]) + 1], 0.0)

    @property
    def noted(self) -> dict[str, Any]:
        """Target length and wanted depth for the metadata of a record, by key."""
        from cutenv.measurement.depth import WANTED_DEPTH_KEY, corners  # slow to import, for a record alone

        wanted = self.depths["wanted"][0]
        return super().noted | {WANTED_DEPTH_KEY: corners(np.arange(len(wanted), dtype=np.float64) * SPACING, wanted)}

    @property
    def given_depth(self) -> dict[str, Any]:
        """Depths that are given, by key of a record's metadata: the wanted one, and the layer below if there is one."""
        from cutenv.measurement.depth import LAYER_DEPTH_KEY, WANTED_DEPTH_KEY

        given, boundary = {WANTED_DEPTH_KEY: self.noted[WANTED_DEPTH_KEY]}, float(self.descents["boundary"][0])
        return given | ({LAYER_DEPTH_KEY: boundary} if boundary < float(self.descents["thickness"][0]) else {})

    @property
    def noted_depth(self) -> dict[str, Any]:
        """Notes of a simulated record on its depth, by key of its metadata: errors, given depths, floor at the end."""
        from cutenv.scoring.truth import FLOOR_AT_END

        errors = {name: round(value, 3) for name, value in self.depth_errors.items()}
        return errors | self.given_depth | {FLOOR_AT_END: np.round(self.floor_to_tip, 6).tolist()}


class DepthCutting(DepthAssessed, SimulatedCutting):
    """An episode: cut gently to a target length, along a wanted depth, without opening the layer below.

    Parameters
    ----------
    plant : SimulatedPlant
        The tissue and blade to control; the blade stands at the clamp.
    wanted : int
        Kind of wanted depth, a value of :data:`~cutenv.task.wanted_depth.WANTED_KINDS`.
    layer : bool
        Whether there is another layer below.
    constants : DepthConstants
        Weights and limits of the depth.
    descent : DescentParameters
        Constants of the vertical motion.
    key : tuple of int
        Seed and episode.
    arguments, keywords
        Those of :class:`~cutenv.task.gentle_cutting.SimulatedCutting`.
    """

    def __init__(
        self,
        plant: SimulatedPlant,
        *arguments: Any,
        wanted: int,
        layer: bool,
        constants: DepthConstants,
        descent: DescentParameters,
        key: tuple[int, int],
        **keywords: Any,
    ) -> None:
        super().__init__(plant, *arguments, **keywords)
        specimen = plant.specimen
        self.slabs = specimen.tissue.slab()
        self.descents = descent_records([specimen], specimen.tissue.layers if layer else None, descent)
        self.depths = depth_record(constants)
        self._level_before = 0.0
        self.vertical: Array = np.zeros((1, self.ticks))
        """True vertical force on the blade since the last decision, upwards [N]."""
        self._memory: StructArray = np.zeros(1, DEPTH_STEP_MEMORY)
        begin_depth_one(
            plant.cuts, self.episode, self.descents, self.depths, self.slabs,
            (1.0 - specimen.tissue.friction_share, descent.bedding), (wanted, int(layer)),
            (np.uint64(key[0]), np.uint64(key[1])),
        )  # fmt: skip

    def step(self, action: NDArray[np.float64]) -> tuple[NDArray[np.float32], float]:
        """Command an action (3 numbers in [-1, 1]) for one decision; return observation, shape (22,), and reward."""
        self.last_action, self._level_before = action, float(self.descents["level"][0])
        observation = np.empty((1, len(ALL_COMPONENTS)), np.float32)
        reward, self._end = step_depth_one(
            self.plant.cuts, self.episode, self.descents, self.depths, self.slabs, self.ticks, action.reshape(1, 3),
            observation, self._recorded, self.vertical, self._memory,
        )  # fmt: skip
        self._felt = self._recorded[0]
        return observation[0], reward

    @property
    def beside(self) -> dict[str, Array]:
        """Height, linear between two decisions, and true vertical force at the readings since the last one."""
        count = self.updates
        heights = np.linspace(self._level_before, float(self.descents["level"][0]), count + 1)[1:]
        return {"height": heights, "vertical_force": self.vertical[0, :count].copy()}

    def rest(self, angle: float) -> NDArray[np.float32]:
        """Return the observation at the start: the blade at rest, forces tared to zero."""
        observation = np.empty(len(ALL_COMPONENTS), np.float32)
        observation[: len(COMPONENTS)] = super().rest(angle)
        observe_depth_at_start(self.plant.cuts, self.episode, self.descents, self.depths, observation)
        return observation
