"""One episode of cutting along a line on a rig with an axis to the side: tip and path of the cut are estimates."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cutenv._base.arrays import Array, StructArray
from cutenv.cutting.sensor import SENSOR
from cutenv.cutting.steering import SteeringParameters
from cutenv.task.observation import ANGLE_CENTRE, ANGLE_SCALE, COMPONENTS, commanded_speed
from cutenv.task.path_beginning import line_number
from cutenv.task.path_cuts import commanded_turn
from cutenv.task.path_cutting import PathAssessed, path_record, steering_record
from cutenv.task.path_readings import assess_path_readings, expect_path, observe_path_at_rest
from cutenv.task.path_terms import ALL_PATH_COMPONENTS, PathConstants
from cutenv.tissue.description import TissueDescription
from cutenv.tissue.drawn_lines import DrawnLines
from cutenv.trace import PLACE


class RigPathCutting(PathAssessed):
    """An episode: cut gently to a target length along a line, assessed by what the rig measures.

    Parameters
    ----------
    plant : RigPlant
        A rig with an axis to the side; the blade stands at the clamp, in the middle.
    tissue : TissueDescription
        Tissue that the rig assumes.
    drawn : DrawnLines
        The lines of which one is cut.
    kind : int
        Number of a kind, MIXED_LINES, or GIVEN_LINE, see :mod:`cutenv.task.path_beginning`.
    constants, steering : PathConstants, SteeringParameters
        Weights and limit of the path; limit on the curvature of the expected crack.
    key : tuple of int
        Seed and episode.
    arguments, keywords
        Those of :class:`~cutenv.task.gentle_cutting.GentleCutting`.
    """

    plant: Any

    def __init__(
        self, plant: Any, tissue: TissueDescription, *arguments: Any, drawn: DrawnLines, kind: int,
        constants: PathConstants, steering: SteeringParameters, key: tuple[int, int], **keywords: Any,
    ) -> None:  # fmt: skip
        super().__init__(plant, tissue, *arguments, **keywords)
        self._measured: StructArray = self.nominal.copy()
        self.steerings, self.paths = steering_record(steering), path_record(constants)
        self.paths["lateral_noise"] = self.paths["lateral_resolution"] = 0.0  # the rig's own are in its readings
        self._sensors = np.zeros(1, SENSOR)
        number = line_number(np.uint64(key[0]), np.uint64(key[1]), kind)
        self.line = drawn.lines[number]
        self._beside: dict[str, Array] = {name: np.zeros(0) for name in (*PLACE, "lateral_force")}
        expect_path(self.nominal, self.steerings, self.paths, drawn.records, number)

    def step(self, action: NDArray[np.float64]) -> tuple[NDArray[np.float32], float]:
        """Command an action (3 numbers in [-1, 1]) for one decision; return observation, shape (28,), and reward."""
        speed, angle, turn = action.tolist()
        self.last_action = action
        commanded = float(commanded_speed(speed)), ANGLE_CENTRE + ANGLE_SCALE * angle
        return self._assess(self.plant.advance(*commanded, self.ticks, turn_rate=float(commanded_turn(turn))))

    def _assess(self, readings: StructArray) -> tuple[NDArray[np.float32], float]:
        beside = {name: self.plant.beside[name].copy() for name in (*PLACE, "lateral_force")}
        return self.assess(readings, beside, self.plant.heading.now)

    def assess(
        self, readings: StructArray, beside: dict[str, Array], heading: float
    ) -> tuple[NDArray[np.float32], float]:
        """Assess readings with places [m] and lateral forces [N], and a direction [rad]; return observation and reward.

        ``beside`` has "blade_x", "blade_y" and "lateral_force", each of shape (n,).
        """
        self._felt, self._beside = readings, beside
        observation = np.empty(len(ALL_PATH_COMPONENTS), np.float32)
        places = np.column_stack([beside[name] for name in PLACE])
        reward, self._end = assess_path_readings(
            self.episode, self.steerings, self.paths, self._measured, self._sensors, readings, places,
            beside["lateral_force"], (math.cos(heading), math.sin(heading)), self.last_action, observation,
        )  # fmt: skip
        return observation, reward

    @property
    def beside(self) -> dict[str, Array]:
        """Places and lateral force as measured with the readings since the last decision."""
        return {name: values[: self.updates] for name, values in self._beside.items()}

    def rest(self, angle: float) -> NDArray[np.float32]:
        """Return the observation at the start: the blade at rest, forces tared to zero."""
        observation = np.empty(len(ALL_PATH_COMPONENTS), np.float32)
        observation[: len(COMPONENTS)] = super().rest(angle)
        self.last_action = np.append(self.last_action, 0.0)
        observe_path_at_rest(self.steerings, self.paths, self._sensors, observation)
        return observation

    @property
    def noted(self) -> dict[str, Any]:
        """Target length and line for the metadata of a record, by key."""
        return super().noted | self.noted_line

    @property
    def success(self) -> bool:
        """True if it is a success of gentle cutting by the estimated tip, and the estimated cut is near its line."""
        return not self._stopped and super().success
