"""One episode of cutting along a wanted depth on a rig with a height axis: tip and floor are estimates."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cutenv._base.arrays import Array, StructArray
from cutenv.cutting.descent import DESCENT, DescentParameters
from cutenv.task.depth_cuts import commanded_descent
from cutenv.task.depth_cutting import DepthAssessed, depth_record
from cutenv.task.depth_readings import assess_depth_readings, drawn_layer, expect_depth, observe_depth_at_rest
from cutenv.task.depth_terms import ALL_COMPONENTS, DepthConstants
from cutenv.task.observation import ANGLE_CENTRE, ANGLE_SCALE, COMPONENTS, commanded_speed
from cutenv.tissue.description import TissueDescription
from cutenv.tissue.layers import Layers
from cutenv.tissue.nominal import nominal_tissue


def expected_descent(tissue: TissueDescription, descent: DescentParameters) -> StructArray:
    """Return the record of a blade in the mean tissue, :data:`~cutenv.cutting.descent.DESCENT` of shape (1,)."""
    record = np.zeros(1, DESCENT)
    record["toughness"] = (1.0 - tissue.friction_share) * tissue.fracture_resistance
    record["modulus"], record["bed"] = tissue.modulus, descent.bedding * tissue.modulus
    record["thickness"], record["edge_length"] = tissue.thickness, descent.edge_length
    for name in Layers.__dataclass_fields__:
        record[name] = getattr(Layers(), name)
    return record


class RigDepthCutting(DepthAssessed):
    """An episode: cut gently to a target length along a wanted depth, assessed by what the rig measures.

    Parameters
    ----------
    plant : RigPlant
        A rig with a height axis; the blade stands at the clamp.
    tissue : TissueDescription
        Tissue that the rig assumes.
    wanted : int
        Kind of wanted depth, a value of :data:`~cutenv.task.wanted_depth.WANTED_KINDS`.
    constants, descent : DepthConstants, DescentParameters
        Weights of the depth; edge and bedding of the blade that the expected floor has.
    key : tuple of int
        Seed and episode.
    arguments, keywords
        Those of :class:`~cutenv.task.gentle_cutting.GentleCutting`.

    Attributes
    ----------
    start_level : float
        Level of the blade at which the cut starts [m].
    """

    plant: Any

    def __init__(
        self, plant: Any, tissue: TissueDescription, *arguments: Any, wanted: int, constants: DepthConstants,
        descent: DescentParameters, key: tuple[int, int], **keywords: Any,
    ) -> None:  # fmt: skip
        super().__init__(plant, tissue, *arguments, **keywords)
        self._tissue, self._mean = tissue, nominal_tissue(tissue)
        self._beside = np.zeros(0), np.zeros(0)
        self._measured: StructArray = self.nominal.copy()
        self.descents, self.depths = expected_descent(tissue, descent), depth_record(constants)
        self.key = np.uint64(key[0]), np.uint64(key[1])
        self.start_level: float = expect_depth(
            self.descents, self.depths, plant.depth, self.target_length, wanted, self.key
        )

    def step(self, action: NDArray[np.float64]) -> tuple[NDArray[np.float32], float]:
        """Command an action (3 numbers in [-1, 1]) for one decision; return observation, shape (22,), and reward."""
        speed, angle, descent = action.tolist()
        self.last_action = action
        commanded = float(commanded_speed(speed)), ANGLE_CENTRE + ANGLE_SCALE * angle
        return self._assess(self.plant.advance(*commanded, self.ticks, float(commanded_descent(descent))))

    def _assess(self, readings: StructArray) -> tuple[NDArray[np.float32], float]:
        beside = self.plant.beside
        return self.assess(readings, beside["height"].copy(), beside["vertical_force"].copy())

    def assess(self, readings: StructArray, heights: Array, vertical: Array) -> tuple[NDArray[np.float32], float]:
        """Assess readings with the level [m] and the vertical force [N] at each; return observation and reward."""
        self._felt, self._beside = readings, (heights, vertical)
        observation = np.empty(len(ALL_COMPONENTS), np.float32)
        reward, self._end = assess_depth_readings(
            self.episode, self.descents, self.depths, self._measured, self._mean, readings, heights, vertical,
            self.last_action, observation,
        )  # fmt: skip
        return observation, reward

    @property
    def beside(self) -> dict[str, Array]:
        """Height and vertical force as measured with the readings since the last decision."""
        heights, vertical = (values[: self.updates] for values in self._beside)
        return {"height": heights, "vertical_force": vertical}

    def rest(self, angle: float) -> NDArray[np.float32]:
        """Return the observation at the start: the blade at rest, forces tared to zero."""
        observation = np.empty(len(ALL_COMPONENTS), np.float32)
        observation[: len(COMPONENTS)] = super().rest(angle)
        self.last_action = np.append(self.last_action, 0.0)
        observe_depth_at_rest(self.descents, self.depths, self._measured, observation)
        return observation

    def layers_below(self) -> Layers:
        """Return the layers that ``cutenv/DepthCut-v1`` draws for this key, to be laid on an imitated rig."""
        drawn, known = self.descents.copy(), self._tissue.layers or Layers()
        for name in ("deep_toughness", "deep_modulus"):
            drawn[name] = getattr(known, name)
        drawn_layer(drawn, self.depths["wanted"][0], self.key)
        names = ("boundary", "deep_toughness", "deep_modulus")
        return dataclasses.replace(known, **{name: float(drawn[name][0]) for name in names})

    @property
    def success(self) -> bool:
        """True if it is a success of gentle cutting by the estimated tip, as deep as wanted by the expected floor."""
        return not self._stopped and bool(self.depths["success"][0])
