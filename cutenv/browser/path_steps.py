"""Milliseconds of a cut along a drawn line that a hand leads: one function, compiled for Python and the browser."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np

from cutenv._base.arrays import Array, StructArray
from cutenv._engine.jit import njit
from cutenv.browser.stylus_steps import HandCut
from cutenv.cutting.steering import STEERING
from cutenv.envs.path_cut import PathCutEnv
from cutenv.play.hand_model import steered_toward
from cutenv.scoring.path_map import LINE_KEY
from cutenv.task.observation import ANGLE_CENTRE, ANGLE_SCALE, SPEED_SCALE, speed_action
from cutenv.task.path import PATH, PATH_CUT, PATH_STEP_MEMORY, TURN_SCALE, PathEpisode, step_path_one
from cutenv.tissue.drawn_lines import kind_of

_LATERAL = [each.name for each in PATH_CUT.all_components].index("lateral")
_NEWTONS = PATH_CUT.all_components[_LATERAL].scale


@njit
def follow_steered_stylus(
    cuts: StructArray,
    episodes: StructArray,
    steerings: StructArray,
    paths: StructArray,
    stylus: Array,
    lag: float,
    acceleration: float,
    memory: StructArray,
    actions: Array,
    observations: StructArray,
    readings: StructArray,
    beside: Array,
    outcome: Array,
) -> int:
    """Advance one cut by a millisecond for each place of a person's hand, until it ends; return their number.

    Parameters
    ----------
    cuts, episodes, lag, acceleration, readings
        See :func:`cutenv.browser.stylus_steps.follow_stylus`.
    steerings, paths : Records, shape (1,)
        :data:`~cutenv.cutting.steering.STEERING` and :data:`~cutenv.task.path_terms.PATH_MAP`, changed in place.
    stylus : array, shape (n, 3)
        Wanted place of the hand along the slab [m], angle of the blade [rad], and place across the slab, to the left
        [m].
    memory, actions, observations : Records, array, shape (1,), (1, 3), (1, 28) float32
        Memory of the calls, :data:`~cutenv.task.path_cuts.PATH_STEP_MEMORY`, action and observation.
    beside : array, shape (3, n)
        Filled with the place of the blade along and across the slab [m], and the measured force to its right [N].
    outcome : array, shape (2,)
        Filled: index of the end in :data:`~cutenv.task.path_terms.PATH_ENDS`, 0 while the cut goes on; 1 for a success.
    """
    state, steering = cuts[0].states[0], steerings[0]
    done = end = 0
    for i in range(len(stylus)):
        speed, turn = steered_toward(state, steering, stylus[i, 0], stylus[i, 2], lag, acceleration)
        tilt, turning = (stylus[i, 1] - ANGLE_CENTRE) / ANGLE_SCALE, speed_action(turn * (SPEED_SCALE / TURN_SCALE))
        # An action is of single precision, as an agent's.
        for k, action in enumerate((speed_action(speed), tilt, turning)):
            actions[0, k] = min(max(float(np.float32(action)), -1.0), 1.0)
        done = i + 1
        end = step_path_one(
            cuts, episodes, steerings, paths, 1, actions, observations, readings[i:done], beside[2:, i:done], memory
        )[1]
        beside[0, i], beside[1, i] = state.blade + steering.east, steering.north
        beside[2, i] = _NEWTONS * float(observations[0, _LATERAL])
        if end != 0:
            break
    outcome[0] = end
    outcome[1] = 1.0 if end != 0 and paths[0].success == 1 else 0.0
    return done


class HandPathCut(HandCut):
    """Cut by a person's hand along a drawn line: what the page simulates, in Python.

    It is the cut of :class:`cutenv.play.played_path_cut.PlayedPathCut` with the same key and line.

    Parameters
    ----------
    line : str
        Kind of line, as of :class:`~cutenv.envs.path_cut.PathCutEnv`.
    **keywords
        Those of :class:`~cutenv.browser.stylus_steps.HandCut`.
    """

    environment = PathCutEnv
    components = PATH_CUT.all_components
    record_kinds: ClassVar[dict[str, np.dtype[Any]]] = HandCut.record_kinds | {"steering": STEERING, "path": PATH}
    ends = PATH_CUT.ends
    stylus_numbers = 3
    """Numbers of the hand in each millisecond: place along [m], angle [rad], place across, to the left [m]."""

    memory = PATH_STEP_MEMORY
    beside_fields = ("blade_x", "blade_y", "lateral_force")

    def __init__(self, *, line: str = "mixed", **keywords: Any) -> None:
        super().__init__(line=line, **keywords)

    @property
    def cutting(self) -> PathEpisode:
        """Task of this cut."""
        cutting = self._env.cutting
        assert isinstance(cutting, PathEpisode)
        return cutting

    @property
    def steerings(self) -> StructArray:
        """Place in the plane, :data:`~cutenv.cutting.steering.STEERING`, shape (1,)."""
        return self.cutting.motion

    @property
    def paths(self) -> StructArray:
        """Map of the path, :data:`~cutenv.task.path_terms.PATH_MAP`, shape (1,)."""
        return self.cutting.whole

    @property
    def records(self) -> dict[str, StructArray]:
        """Records of its whole state by name, each of shape (1,)."""
        return super().records | {"steering": self.steerings, "path": self.paths}

    @property
    def facts(self) -> dict[str, Any]:
        """Line to cut along, by key of a record's metadata."""
        return {LINE_KEY: self.cutting.noted_path[LINE_KEY]}

    @property
    def noted(self) -> dict[str, Any]:
        """Notes of a record on this cut, by key of its metadata: environment, kind of line, errors, line, cut."""
        line = kind_of(int(self.paths["line"][0]))
        return {"environment": "cutenv/PathCut-v1", "line": line, **self.cutting.noted_path}

    def _follow(self, places: Array, readings: StructArray, beside: Array, outcome: Array) -> int:
        done: int = follow_steered_stylus(
            self.cuts, self.episodes, self.steerings, self.paths, places, self.hand.motor_lag, self.hand.acceleration,
            self._memory, self._action, self._observation, readings, beside, outcome,
        )  # fmt: skip
        return done
