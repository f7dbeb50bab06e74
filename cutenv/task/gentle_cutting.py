"""One episode of gentle cutting on any plant: commands in, observation, reward terms and end out."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cutenv.compiled import compiled
from cutenv.cutting.records import PROFILE, READING, Records
from cutenv.plant.interface import Plant
from cutenv.task.assessment import assess, succeeded
from cutenv.task.estimate import estimate
from cutenv.task.observation import ANGLE_CENTRE, ANGLE_SCALE, COMPONENTS, SPEED_SCALE, observe
from cutenv.task.records import ENDS, PROGRESS, TERMS
from cutenv.task.weights import Limits, RewardWeights, task_record
from cutenv.tissue.description import TissueDescription
from cutenv.tissue.specimen import unit_stiffness


def nominal_profile(tissue: TissueDescription, depth: NDArray[np.float64]) -> Records:
    """What a rig expects to cut: mean modulus and resistance, and the depth measured beforehand, shape (301,)."""
    profile = np.zeros(len(depth), PROFILE)
    profile["depth"] = depth
    profile["stiffness"] = tissue.intercept_90 * unit_stiffness(tissue) * depth
    profile["toughness"] = (1.0 - tissue.friction_share) * tissue.fracture_resistance * depth
    return profile


@compiled
def decide_from_truth(
    tasks: Records,
    progresses: Records,
    truth: Records,
    nominal: Records,
    readings: Records,
    last_action: Records,
    terms: Records,
    observation: Records,
) -> None:
    """Assess the readings since the last decision by hidden state, and observe them; arrays of length 1 for records."""
    forces, tips, jumps = readings["true_force"], readings["tip"], readings["jump"]
    assess(tasks[0], progresses[0], truth, readings, forces, tips, jumps, terms)
    felt = readings[: progresses[0].updates]
    observe(tasks[0], nominal, felt, progresses[0].time, last_action, observation)


@compiled
def decide_from_estimate(
    tasks: Records,
    progresses: Records,
    nominal: Records,
    readings: Records,
    tips: Records,
    jumps: Records,
    last_action: Records,
    terms: Records,
    observation: Records,
) -> None:
    """The same as a rig can: tip and runs estimated from the measured force."""
    estimate(tasks[0], progresses[0], nominal, readings, tips, jumps)
    assess(tasks[0], progresses[0], nominal, readings, readings["force"], tips, jumps, terms)
    felt = readings[: progresses[0].updates]
    observe(tasks[0], nominal, felt, progresses[0].time, last_action, observation)


class GentleCutting:
    """An episode: cut from the clamp to ``target_length``, gently.

    Parameters
    ----------
    plant : Plant
        What is cut; it stands at the clamp.
    tissue : TissueDescription
        What the rig believes to cut; gives the nominal stiffness and friction.
    truth : Records, optional
        The true profile, shape (301,), if the reward is to be assessed from hidden state; else it is assessed from the
        rig's estimate of the tip.
    friction_per_depth : float
        Of the moving blade, true or nominal [N/m].
    target_length, deadline : float
        [m], [s].
    ticks : int
        Milliseconds between decisions.
    """

    def __init__(
        self,
        plant: Plant,
        tissue: TissueDescription,
        weights: RewardWeights,
        limits: Limits,
        *,
        truth: Records | None,
        friction_per_depth: float,
        target_length: float,
        deadline: float,
        ticks: int,
    ) -> None:
        self.plant = plant
        self.ticks = ticks
        self.target_length = target_length
        self.deadline = deadline
        self.terms = np.zeros(len(TERMS))
        self._totals = np.zeros(len(TERMS))
        self.readings: Records | None = None
        self.last_action = np.zeros(2)
        self.command = (0.0, ANGLE_CENTRE)
        self._task = task_record(
            weights,
            limits,
            target_length=target_length,
            deadline=deadline,
            friction_per_depth=friction_per_depth,
            speeds=(tissue.speed_min, tissue.speed_max),
        )
        self._progress = np.zeros(1, PROGRESS)
        self.nominal = nominal_profile(tissue, plant.depth)
        self._truth = truth
        self._tips, self._jumps = np.zeros(ticks), np.zeros(ticks)

    def step(self, action: NDArray[np.float64]) -> tuple[NDArray[np.float32], float]:
        """Command an action (2 numbers in [-1, 1]) for one decision; return observation, shape (12,), and reward."""
        speed, angle = self.command = (SPEED_SCALE * float(action[0]), ANGLE_CENTRE + ANGLE_SCALE * float(action[1]))
        self.last_action[:] = action
        readings = self.plant.advance(speed, angle, self.ticks)
        observation = np.empty(len(COMPONENTS), np.float32)
        if self._truth is None:
            decide_from_estimate(
                self._task, self._progress, self.nominal, readings, self._tips, self._jumps, self.last_action,
                self.terms, observation,
            )  # fmt: skip
        else:
            decide_from_truth(
                self._task, self._progress, self._truth, self.nominal, readings, self.last_action, self.terms,
                observation,
            )  # fmt: skip
        self._totals += self.terms
        self.readings = readings[: self.updates]
        return observation, float(self.terms.sum())

    def rest(self, angle: float) -> NDArray[np.float32]:
        """The observation at the start: the blade at rest at the clamp, force tared to zero."""
        self.last_action[:] = (0.0, (angle - ANGLE_CENTRE) / ANGLE_SCALE)
        readings = np.zeros(1, READING)
        readings["angle"] = angle
        observation = np.empty(len(COMPONENTS), np.float32)
        observe(self._task[0], self.nominal, readings, 0.0, self.last_action, observation)
        return observation

    def assessment(self) -> tuple[Records, Records]:
        """Copies of the task and of the progress made, as the compiled assessment takes them, shape (1,) each."""
        return self._task.copy(), self._progress.copy()

    @property
    def end(self) -> str:
        """Why the episode ended, or an empty string."""
        return ENDS[self._progress["end"][0]]

    @property
    def success(self) -> bool:
        """Finished, tip within 3 mm of the target, blade within 10 degrees of upright."""
        return bool(succeeded(self._task[0], self._progress[0]))

    @property
    def updates(self) -> int:
        """Milliseconds that counted of the last decision: all, or those up to the end."""
        return int(self._progress["updates"][0])

    @property
    def speed_out_of_range(self) -> bool:
        """Whether the blade moved outside the measured range of speed since the last decision."""
        return bool(self._progress["out_of_range"][0] > 0)

    @property
    def time(self) -> float:
        """Since the start [s]."""
        return float(self._progress["time"][0])

    @property
    def tip(self) -> float:
        """Crack tip as assessed: true, or as the rig estimates it [m]."""
        return float(self._progress["tip"][0])

    @property
    def cost(self) -> dict[str, float]:
        """Breaches in this step: largest force above the limit [N] and the tip's overshoot so far [m]."""
        over_limit, overshoot = self._progress["over_limit"], self._progress["overshoot"]
        return {"force_N": float(over_limit[0]), "overshoot_m": float(overshoot[0])}

    @property
    def reward_terms(self) -> dict[str, float]:
        """The reward of the last step by term; costs are negative; the sum is the reward."""
        return dict(zip(TERMS, self.terms.tolist(), strict=True))

    @property
    def reward_totals(self) -> dict[str, float]:
        """The reward since the start by term; the sum is the return."""
        return dict(zip(TERMS, self._totals.tolist(), strict=True))

    @property
    def force_limit_per_depth(self) -> float:
        """Force per depth of cut above which the task ends [N/m]."""
        return float(self._task[0]["force_limit_per_depth"])
