"""One cut by a person: the environment's own task at 1 kHz, every reading kept, scored as any other cut."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from cutenv.cutting.drive import Hand
from cutenv.cutting.records import READING, TICK, Records
from cutenv.envs.gentle_cut import GentleCutEnv
from cutenv.plant.protocol import depth_along, to_trace
from cutenv.plant.simulator import SimulatedPlant
from cutenv.play.hand import PLAYED_HAND, speed_toward
from cutenv.play.handle import Handle, Pose
from cutenv.play.haptics import Stylus
from cutenv.scoring import ReferenceSet, ScoreCard, score
from cutenv.task.gentle_cutting import GentleCutting
from cutenv.task.observation import to_action
from cutenv.trace import Trace
from cutenv.validation import in_range

UPDATES_HZ = round(1.0 / TICK)
FEWEST_READINGS = 100
"""Below which a cut that was given up is no record: a tenth of a second."""


class PlayedCut:
    """A specimen under a person's hand.

    It is an episode of ``GentleCutEnv(drive="hand", control_hz=1000)`` of the same seed: same specimen, target,
    ends and reward as an agent's. Its decisions are a millisecond apart.

    Parameters
    ----------
    specimen_class : str
        "uniform", "liver", "vascular" or "mixed".
    seed, episode : int
        Key of specimen, target and noise.
    target_length : float, optional
        [m]; default drawn from 0.060 to 0.100.
    deadline : float
        [s].
    hand : Hand
        What joins the person to the blade.
    handle : Handle, optional
        A drawn handle, which is led along.

    Raises
    ------
    ValueError
        If a value is out of range.
    """

    def __init__(
        self,
        *,
        specimen_class: str = "liver",
        seed: int = 0,
        episode: int = 0,
        target_length: float | None = None,
        deadline: float = 30.0,
        hand: Hand = PLAYED_HAND,
        handle: Handle | None = None,
    ) -> None:
        self.specimen_class, self.seed, self.episode = specimen_class, seed, episode
        in_range("seed", seed, 0, 2**63 - 1, "1", "Give a whole number from 0.")
        self._env = GentleCutEnv(
            specimen_class=specimen_class,
            target_length=target_length,
            deadline_s=deadline,
            control_hz=UPDATES_HZ,
            drive="hand",
            **dataclasses.asdict(hand),
        )
        self._hand, self._handle = hand, handle
        self._info = self._env.reset(seed=seed, options={"episode": episode})[1]
        self._readings: Records = np.zeros(round(deadline * UPDATES_HZ) + 1, READING)
        self._count = 0
        self.end = ""
        """Why it ended, one of the environment's ends; empty while it goes on."""

    @property
    def plant(self) -> SimulatedPlant:
        """What is cut."""
        return self._env.plant

    @property
    def cutting(self) -> GentleCutting:
        """The task."""
        return self._env.cutting

    @property
    def truth(self) -> dict[str, Any]:
        """Hidden state, and energies in joules, as the environment tells them; for practice."""
        told: dict[str, Any] = self._info["truth"] | self._info["energy"]
        return told

    @property
    def readings(self) -> Records:
        """Every reading so far, shape (n,); what is there does not change."""
        return self._readings[: self._count]

    @property
    def target_length(self) -> float:
        """[m]."""
        return self.cutting.target_length

    @property
    def pose(self) -> Pose | None:
        """Of the drawn handle, if there is one."""
        return None if self._handle is None else self._handle.pose

    def tick(self, stylus: Stylus) -> None:
        """A millisecond under a person's hand; nothing once it has ended."""
        if self.end:
            return
        state = self.plant.states[0]
        speed = speed_toward(stylus.position, state, self._hand)
        _, _, ended, _, self._info = self._env.step(to_action(speed, stylus.angle))
        assert self.cutting.readings is not None  # there is one since the step
        self._readings[self._count] = reading = self.cutting.readings[0]
        self._count += 1
        if ended:
            self.end = self._info["end"]
        if self._handle is not None:
            self._handle.step(
                hand=float(state["hand"]),
                hand_speed=float(state["hand_speed"]),
                angle=float(state["angle"]),
                force=float(reading["true_force"]),
                depth=float(depth_along(self.plant, state["blade"])),
            )

    def trace(self, **metadata: object) -> Trace:
        """What a rig would have recorded of it.

        Raises
        ------
        ValueError
            If there are less than two readings.
        """
        return to_trace(self.plant, self.readings, target_length_m=self.target_length, **metadata)

    def card(self, trace: Trace) -> ScoreCard:
        """The score of its record, as ``cutenv score`` gives it: from what a rig can measure."""
        return score(trace, target_length=self.target_length, reference=ReferenceSet.shipped())
