"""Milliseconds of a cut that a hand leads: one function, compiled for Python and for the browser."""

from __future__ import annotations

import dataclasses
from typing import Any, ClassVar

import numpy as np

from cutenv._base.arrays import Array, StructArray
from cutenv._engine.jit import njit
from cutenv.cutting.drive import Hand
from cutenv.cutting.dtypes import READING, TICK
from cutenv.cutting.simulate import CUT
from cutenv.envs.gentle_cut import GentleCutEnv
from cutenv.plant.protocol import recorded_trace
from cutenv.play.hand_model import PLAYED_HAND, speed_over
from cutenv.task.assessment import succeeded
from cutenv.task.cuts import EPISODE, step_one
from cutenv.task.observation import ANGLE_CENTRE, ANGLE_SCALE, COMPONENTS, Component, speed_action
from cutenv.task.reward import ENDS
from cutenv.trace import Trace


@njit
def follow_stylus(
    cuts: StructArray,
    episodes: StructArray,
    stylus: Array,
    lag: float,
    acceleration: float,
    actions: Array,
    observations: StructArray,
    readings: StructArray,
    outcome: Array,
) -> int:
    """Advance one cut by a millisecond for each place of a person's hand, until it ends; return their number.

    Parameters
    ----------
    cuts, episodes : Records, shape (1,)
        :data:`~cutenv.cutting.simulate.CUT` and :data:`~cutenv.task.cuts.EPISODE`, changed in place.
    stylus : array, shape (n, 2)
        Wanted position of the hand [m] and angle of the blade [rad].
    lag, acceleration : float
        Of the hand [s], [m/s2].
    actions, observations : array, shape (1, 2), (1, 12) float32
        Memory of the calls.
    readings : Records, shape (n, 1)
        :data:`~cutenv.cutting.dtypes.READING`, filled up to the end.
    outcome : array, shape (2,)
        Filled: index of the end in :data:`~cutenv.task.reward.ENDS`, 0 while the cut goes on; 1 for a success.
    """
    done = end = 0
    for i in range(len(stylus)):
        speed = speed_over(stylus[i, 0] - cuts[0].states[0].hand, lag, acceleration)
        # An action is of single precision, as an agent's.
        for k, action in enumerate((speed_action(speed), (stylus[i, 1] - ANGLE_CENTRE) / ANGLE_SCALE)):
            actions[0, k] = min(max(float(np.float32(action)), -1.0), 1.0)
        done = i + 1
        end = step_one(cuts, episodes, 1, True, actions, observations, readings[i:done])[1]
        if end != 0:
            break
    outcome[0] = end
    outcome[1] = 1.0 if end != 0 and succeeded(episodes[0].tasks[0], episodes[0].progresses[0]) else 0.0
    return done


class HandCut:
    """Cut by a person's hand that is given as positions and angles: what the page simulates, in Python.

    It is the cut of :class:`cutenv.play.PlayedCut` with the same key, without its window's needs.

    Parameters
    ----------
    specimen_class : str
        "uniform", "liver", "vascular" or "mixed".
    seed, episode : int
        Key of specimen, target and noise.
    target_length : float, optional
        Length of the cut [m]; drawn from 0.060 to 0.100 by default.
    deadline : float
        Time for the cut [s].
    hand : Hand
        Coupling between the person and the blade.
    **task
        Further arguments of the environment.

    Attributes
    ----------
    end : str
        Cause of the end, one of the environment's ends; empty while the cut goes on.
    success : bool
        True once the cut has ended in success.
    """

    environment: type[GentleCutEnv] = GentleCutEnv
    """Environment whose episode it is."""
    components: tuple[Component, ...] = COMPONENTS
    """Components of its observation."""
    record_kinds: ClassVar[dict[str, np.dtype[Any]]] = {"cut": CUT, "episode": EPISODE}
    """Records of its whole state, in the order in which its law takes them."""
    ends: tuple[str, ...] = ENDS
    """Names of its ends by code."""
    stylus_numbers = 2
    """Numbers of the hand in each millisecond: position [m] and angle [rad]."""
    memory: np.dtype[Any] | None = None
    """Record that its law needs within a millisecond."""
    beside_fields: tuple[str, ...] = ()
    """Fields of a trace that its law fills beside the readings."""

    def __init__(
        self,
        *,
        specimen_class: str = "liver",
        seed: int = 0,
        episode: int = 0,
        target_length: float | None = None,
        deadline: float = 30.0,
        hand: Hand = PLAYED_HAND,
        **task: Any,
    ) -> None:
        self._env = self.environment(
            specimen_class=specimen_class,
            target_length=target_length,
            deadline_s=deadline,
            control_hz=round(1.0 / TICK),
            drive="hand",
            **dataclasses.asdict(hand),
            **task,
        )
        self._env.reset(seed=seed, options={"episode": episode})
        self.hand = hand
        self.end, self.success = "", False
        self._memory: StructArray = np.zeros(1, self.memory)  # a number if there is none
        self._action = np.zeros((1, self.stylus_numbers))
        self._observation = np.zeros((1, len(self.components)), np.float32)
        self._beside: list[Array] = []

    @property
    def cuts(self) -> StructArray:
        """State of tissue, blade, drive and sensor, :data:`~cutenv.cutting.simulate.CUT`, shape (1,)."""
        return self._env.plant.cuts

    @property
    def episodes(self) -> StructArray:
        """State of the task, :data:`~cutenv.task.cuts.EPISODE`, shape (1,)."""
        return self._env.cutting.record

    @property
    def records(self) -> dict[str, StructArray]:
        """Records of its whole state by the names of :attr:`record_kinds`, each of shape (1,)."""
        return {"cut": self.cuts, "episode": self.episodes}

    @property
    def facts(self) -> dict[str, Any]:
        """Notes of a record that are known at the start, by key of its metadata: wanted depth or line."""
        return {}

    @property
    def beside(self) -> Array:
        """Fields of the trace beside the readings, :attr:`beside_fields`, at every reading so far, shape (k, n)."""
        return np.concatenate([np.zeros((len(self.beside_fields), 0)), *self._beside], axis=1)

    @property
    def target_length(self) -> float:
        """Target length [m]."""
        return self._env.cutting.target_length

    @property
    def measured_depth(self) -> Array:
        """Depth of cut along the line as measured beforehand, shape (301,) [m]: that of the record."""
        return self._env.plant.depth

    @property
    def noted(self) -> dict[str, Any]:
        """Notes of a record on this cut, by key of its metadata; nothing where no depth is wanted."""
        return {}

    def follow(self, stylus: Any) -> StructArray:
        """Advance by a millisecond for each row of ``stylus``, until the cut ends; return the readings.

        Parameters
        ----------
        stylus : array_like, shape (n, 2)
            Wanted position of the hand, from the clamp [m], and angle of the blade [rad].
        """
        places = np.ascontiguousarray(stylus, dtype=np.float64).reshape(-1, self.stylus_numbers)
        readings, outcome = np.zeros((len(places), 1), READING), np.zeros(2)
        if self.end:
            return readings[:0, 0]
        beside = np.zeros((len(self.beside_fields), len(places)))
        done = self._follow(places, readings, beside, outcome)
        self._beside.append(beside[:, :done])
        self.end, self.success = self.ends[int(outcome[0])], bool(outcome[1])
        return readings[:done, 0]

    def _follow(self, places: Array, readings: StructArray, beside: Array, outcome: Array) -> int:
        done: int = follow_stylus(
            self.cuts, self.episodes, places, self.hand.motor_lag, self.hand.acceleration, self._action,
            self._observation, readings, outcome,
        )  # fmt: skip
        return done

    def trace(self, readings: StructArray, **metadata: object) -> Trace:
        """Return all readings of this cut, shape (n,), as a rig would have recorded them.

        Raises
        ------
        ValueError
            If there are fewer than two.
        """
        trace = recorded_trace(readings, self.measured_depth, **metadata)
        beside = zip(self.beside_fields, self.beside.copy(), strict=True)
        return dataclasses.replace(trace, **dict(beside))
