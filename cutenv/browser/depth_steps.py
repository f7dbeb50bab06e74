"""Milliseconds of a cut along a wanted depth that a hand leads: one function, compiled for Python and the browser."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np

from cutenv._base.arrays import Array, StructArray
from cutenv._engine.jit import njit
from cutenv.browser.stylus_steps import HandCut
from cutenv.cutting.descent import DESCENT
from cutenv.envs.depth_cut import DepthCutEnv
from cutenv.play.hand_model import descent_toward, speed_over
from cutenv.task.depth import DEPTH, DEPTH_CUT, DEPTH_STEP_MEMORY, DepthEpisode, step_depth_one
from cutenv.task.observation import ANGLE_CENTRE, ANGLE_SCALE, speed_action


@njit
def follow_deep_stylus(
    cuts: StructArray,
    episodes: StructArray,
    descents: StructArray,
    depths: StructArray,
    slabs: StructArray,
    stylus: Array,
    lag: float,
    acceleration: float,
    start: float,
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
    descents, depths, slabs : Records, shape (1,)
        :data:`~cutenv.cutting.descent.DESCENT` and :data:`~cutenv.task.depth_terms.DEPTH`, changed in place; slab.
    stylus : array, shape (n, 3)
        Wanted position of the hand [m], angle of the blade [rad], and level of the blade above that at the start [m].
    start : float
        Level of the blade at the start [m].
    memory, actions, observations : Records, array, shape (1,), (1, 3), (1, 22) float32
        Memory of the calls, :data:`~cutenv.task.depth_cuts.DEPTH_STEP_MEMORY`, action and observation.
    beside : array, shape (2, n)
        Filled with the level of the blade [m] and the true vertical force on it, upwards [N].
    outcome : array, shape (2,)
        Filled: index of the end in :data:`~cutenv.task.depth_terms.DEPTH_ENDS`, 0 while the cut goes on; 1 for a
        success.
    """
    done = end = 0
    for i in range(len(stylus)):
        speed = speed_over(stylus[i, 0] - cuts[0].states[0].hand, lag, acceleration)
        descent = descent_toward(descents[0].level, start + stylus[i, 2])
        # An action is of single precision, as an agent's.
        for k, action in enumerate((speed_action(speed), (stylus[i, 1] - ANGLE_CENTRE) / ANGLE_SCALE, descent)):
            actions[0, k] = min(max(float(np.float32(action)), -1.0), 1.0)
        done = i + 1
        end = step_depth_one(
            cuts, episodes, descents, depths, slabs, 1, actions, observations, readings[i:done], beside[1:, i:done],
            memory,
        )[1]  # fmt: skip
        beside[0, i] = descents[0].level
        if end != 0:
            break
    outcome[0] = end
    outcome[1] = 1.0 if end != 0 and depths[0].success == 1 else 0.0
    return done


class HandDepthCut(HandCut):
    """Cut by a person's hand along a wanted depth: what the page simulates, in Python.

    It is the cut of :class:`cutenv.play.played_depth_cut.PlayedDepthCut` with the same key.
    """

    environment = DepthCutEnv
    components = DEPTH_CUT.all_components
    record_kinds: ClassVar[dict[str, np.dtype[Any]]] = HandCut.record_kinds | {"descent": DESCENT, "depth": DEPTH}
    ends = DEPTH_CUT.ends
    stylus_numbers = 3
    """Numbers of the hand in each millisecond: position [m], angle [rad], level above that at the start [m]."""

    memory = DEPTH_STEP_MEMORY
    beside_fields = ("height", "vertical_force")

    def __init__(self, **keywords: Any) -> None:
        super().__init__(**keywords)
        self._start = float(self.descents["level"][0])

    @property
    def cutting(self) -> DepthEpisode:
        """Task of this cut."""
        cutting = self._env.cutting
        assert isinstance(cutting, DepthEpisode)
        return cutting

    @property
    def descents(self) -> StructArray:
        """Vertical motion, :data:`~cutenv.cutting.descent.DESCENT`, shape (1,)."""
        return self.cutting.motion

    @property
    def depths(self) -> StructArray:
        """Wanted depth and map of the depth, :data:`~cutenv.task.depth_terms.DEPTH`, shape (1,)."""
        return self.cutting.whole

    @property
    def records(self) -> dict[str, StructArray]:
        """Records of its whole state by name, each of shape (1,)."""
        return super().records | {"descent": self.descents, "depth": self.depths}

    @property
    def facts(self) -> dict[str, Any]:
        """Wanted depth and layer below, by key of a record's metadata."""
        return self.cutting.given_depth

    @property
    def noted(self) -> dict[str, Any]:
        """Notes of a record on this cut, by key of its metadata: environment, errors, wanted depth, layer, floor."""
        return {"environment": "cutenv/DepthCut-v1", **self.cutting.noted_depth}

    def _follow(self, places: Array, readings: StructArray, beside: Array, outcome: Array) -> int:
        done: int = follow_deep_stylus(
            self.cuts, self.episodes, self.descents, self.depths, self.cutting.slabs, places, self.hand.motor_lag,
            self.hand.acceleration, self._start, self._memory, self._action, self._observation, readings, beside,
            outcome,
        )  # fmt: skip
        return done
