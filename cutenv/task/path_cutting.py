"""One episode of cutting along a drawn line on a simulated plant."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cutenv._base.arrays import Array, StructArray
from cutenv.cutting.dtypes import TICK
from cutenv.cutting.steering import LINE_REACH, STEERING, SteeringParameters, place_of_blade, place_of_tip
from cutenv.plant.simulator import SimulatedPlant
from cutenv.task.gentle_cutting import ShownPath, SimulatedCutting
from cutenv.task.map_assessed import MapAssessed
from cutenv.task.observation import COMPONENTS
from cutenv.task.path_beginning import begin_path_one, line_number, observe_path_at_start
from cutenv.task.path_cuts import PATH_STEP_MEMORY, path_errors, step_path_one
from cutenv.task.path_terms import ALL_PATH_COMPONENTS, PATH_ENDS, PATH_MAP, PathConstants
from cutenv.task_quantities import PATH_COSTS
from cutenv.tissue.drawn_lines import DrawnLines
from cutenv.tissue.grid import SPACING
from cutenv.tissue.lines import WIDTH, CutLine, places_within


def path_record(constants: PathConstants) -> StructArray:
    """Return the record of a path before it begins, :data:`~cutenv.task.path_terms.PATH_MAP` of shape (1,)."""
    record = np.zeros(1, PATH_MAP)
    for name in PathConstants.__dataclass_fields__:
        record[name] = getattr(constants, name)
    return record


def steering_record(parameters: SteeringParameters) -> StructArray:
    """Return the record of a place in the plane before a line is laid, of shape (1,)."""
    record = np.zeros(1, STEERING)
    record["crack_curvature"] = parameters.crack_curvature
    record["reach"], record["side"] = LINE_REACH, WIDTH
    record["response"] = record["waiting"] = round(parameters.response_time / TICK)
    return record


class PathCutting(MapAssessed, SimulatedCutting):
    """An episode: cut gently to a target length, along a drawn line.

    Parameters
    ----------
    plant : SimulatedPlant
        The tissue and blade to control; the blade stands at the clamp.
    drawn : DrawnLines
        The lines of which one is cut.
    kind : int
        Number of a kind, MIXED_LINES, or GIVEN_LINE, see :mod:`cutenv.task.path_beginning`.
    constants : PathConstants
        Weights and limits of the path.
    steering : SteeringParameters
        Constants of the law in the plane.
    key : tuple of int
        Seed and episode.
    arguments, keywords
        Those of :class:`~cutenv.task.gentle_cutting.SimulatedCutting`.

    Attributes
    ----------
    steerings, paths : Records, shape (1,)
        Place in the plane and map of the path, :data:`~cutenv.cutting.steering.STEERING` and
        :data:`~cutenv.task.path_terms.PATH_MAP`.
    line : CutLine
        The line to cut along.
    """

    end_names = PATH_ENDS
    map_costs = PATH_COSTS
    shown_as = "path"

    def __init__(
        self,
        plant: SimulatedPlant,
        *arguments: Any,
        drawn: DrawnLines,
        kind: int,
        constants: PathConstants,
        steering: SteeringParameters,
        key: tuple[int, int],
        **keywords: Any,
    ) -> None:
        super().__init__(plant, *arguments, **keywords)
        self.steerings = steering_record(steering)
        self.paths = path_record(constants)
        self.lateral: Array = np.zeros((1, self.ticks))
        """True force on the blade to its right since the last decision [N]."""
        self._memory: StructArray = np.zeros(1, PATH_STEP_MEMORY)
        number = line_number(np.uint64(key[0]), np.uint64(key[1]), kind)
        self.line: CutLine = drawn.lines[number]
        begin_path_one(plant.cuts, self.steerings, self.paths, drawn.records, number)

    @property
    def maps(self) -> StructArray:
        """The map of the path, shape (1,)."""
        return self.paths

    def step(self, action: NDArray[np.float64]) -> tuple[NDArray[np.float32], float]:
        """Command an action (3 numbers in [-1, 1]) for one decision; return observation, shape (28,), and reward."""
        self.last_action = action
        observation = np.empty((1, len(ALL_PATH_COMPONENTS)), np.float32)
        reward, self._end = step_path_one(
            self.plant.cuts, self.episode, self.steerings, self.paths, self.ticks, action.reshape(1, 3), observation,
            self._recorded, self.lateral, self._memory,
        )  # fmt: skip
        self._felt = self._recorded[0]
        return observation[0], reward

    def rest(self, angle: float) -> NDArray[np.float32]:
        """Return the observation at the start: the blade at rest, forces tared to zero."""
        observation = np.empty(len(ALL_PATH_COMPONENTS), np.float32)
        observation[: len(COMPONENTS)] = super().rest(angle)
        observe_path_at_start(self.plant.cuts, self.steerings, self.paths, observation)
        return observation

    @property
    def path_errors(self) -> dict[str, float]:
        """The path of the cut so far in numbers: area [mm2], mean and largest distance to the line [mm]."""
        found = path_errors(self.paths, self.plant.states["tip"])
        return {name: float(value[0]) for name, value in found.items()}

    @property
    def noted_path(self) -> dict[str, Any]:
        """Notes of a simulated record on its path, by key of its metadata: errors, line, and the cut beside it [m]."""
        from cutenv.scoring.path_map import LINE_KEY
        from cutenv.scoring.truth import ASIDE_AT_END

        errors = {name: round(value, 3) for name, value in self.path_errors.items()}
        noted = {LINE_KEY: places_within(self.line), ASIDE_AT_END: self.aside_to_tip}
        return errors | {key: np.round(values, 6).tolist() for key, values in noted.items()}

    @property
    def blade_place(self) -> tuple[float, float]:
        """Place of the blade, along and across the slab [m]."""
        return place_of_blade(self.plant.states, self.steerings)

    @property
    def tip_place(self) -> tuple[float, float]:
        """Place of the crack tip, along and across the slab [m]; hidden."""
        return place_of_tip(self.plant.states, self.steerings)

    @property
    def shown_path(self) -> ShownPath:
        """Path as a picture shows it."""
        line, steering, aside = self.line, self.steerings[0], self.cut_distance[:, np.newaxis]
        drawn, passed = np.column_stack((line.x, line.y)), slice(0, len(aside))
        left = np.column_stack((-np.sin(line.angle), np.cos(line.angle)))[passed]
        tip = np.array(self.tip_place)
        return ShownPath(
            drawn, round(self.target_length / SPACING), np.concatenate((drawn[passed] + aside * left, [tip])), tip,
            np.array(self.blade_place), np.array([steering["ahead"], steering["across"]]), float(steering["aside"]),
        )  # fmt: skip

    @property
    def aside_to_tip(self) -> Array:
        """Distance of the cut to the left of the line at each of its points up to the tip [m], shape (n,).

        Since its last turn the crack has run straight on.
        """
        steering, tip, passed = self.steerings[0], self.tip, self.cut_distance
        more = np.arange(len(passed), int(tip / SPACING) + 1)
        if len(more) == 0:
            return passed
        line, grid = self.line, np.arange(len(self.line.x)) * SPACING
        x, y, angle = (float(np.interp(tip, grid, each)) for each in (line.x, line.y, line.angle))
        east, north = self.tip_place
        end = (north - y) * np.cos(angle) - (east - x) * np.sin(angle)
        share = (more * SPACING - steering["settled"]) / (tip - steering["settled"])
        return np.append(passed, steering["tip_aside"] + (end - steering["tip_aside"]) * share)

    @property
    def cut_distance(self) -> Array:
        """Distance of the cut to the left of the line at each of its points that the tip has passed [m], shape (n,)."""
        steering = self.steerings[0]
        passed: Array = steering["cut"][: steering["cell"] + 1].copy()
        return passed
