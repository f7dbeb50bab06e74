"""One episode of gentle cutting on any plant: commands in; observation, reward terms and end out."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cutenv._base.arrays import StructArray
from cutenv._engine.jit import njit, njit_internal
from cutenv.cutting.dtypes import PROFILE
from cutenv.plant.interface import Plant
from cutenv.task.assessment import assess, charge_end, succeeded
from cutenv.task.beginning import expect, rest
from cutenv.task.cuts import total
from cutenv.task.episode_dtypes import ENDS, EPISODE, STOPPED, TERMS
from cutenv.task.observation import ANGLE_CENTRE, ANGLE_SCALE, COMPONENTS, SPEED_SCALE, observe
from cutenv.task.tip_estimation import estimate_tips
from cutenv.task.weights import Limits, RewardWeights, task_record
from cutenv.tissue.description import TissueDescription
from cutenv.tissue.nominal import nominal_tissue


def nominal_profile(tissue: TissueDescription, depth: NDArray[np.float64]) -> StructArray:
    """Return the profile that a rig expects, shape (1,): mean modulus and resistance, and the measured depth [m]."""
    profile = np.zeros(1, PROFILE)
    profile["depth"] = depth
    _expect(nominal_tissue(tissue), profile)
    return profile


@njit
def _expect(nominal: StructArray, profiles: StructArray) -> None:
    expect(nominal[0], profiles[0])


@njit
def decide_from_truth(
    episodes: StructArray,
    truths: StructArray,
    readings: StructArray,
    action: StructArray,
    terms: StructArray,
    totals: StructArray,
    observation: StructArray,
) -> tuple[float, int, int]:
    """Assess the readings since the last decision by the hidden state, and observe; structured arrays of length 1.

    Returns the reward, the end as an index in :data:`~cutenv.task.episode_dtypes.ENDS`, and the number of readings
    that count.
    """
    task, progress = episodes[0].task, episodes[0].progress
    assess(task, progress, truths[0], readings, True, terms, terms, terms)  # no estimates are needed
    observe(task, episodes[0].nominal, readings[: progress.updates], progress.time, action, observation)
    return add(terms, totals), progress.end, progress.updates


@njit
def decide_from_estimate(
    episodes: StructArray,
    readings: StructArray,
    tips: StructArray,
    jumps: StructArray,
    action: StructArray,
    terms: StructArray,
    totals: StructArray,
    observation: StructArray,
) -> tuple[float, int, int]:
    """Assess and observe like :func:`decide_from_truth`, with tip and runs estimated from the measured force."""
    task, progress, nominal = episodes[0].task, episodes[0].progress, episodes[0].nominal
    estimate_tips(task, progress, nominal, readings, tips, jumps)
    assess(task, progress, nominal, readings, False, tips, jumps, terms)
    observe(task, nominal, readings[: progress.updates], progress.time, action, observation)
    return add(terms, totals), progress.end, progress.updates


@njit_internal
def add(terms: StructArray, totals: StructArray) -> float:
    """Add the terms of a step to the totals of the episode; return the reward, the sum of the step's terms."""
    for k in range(len(terms)):
        totals[k] += terms[k]
    return total(terms)


class GentleCutting:
    """An episode: cut gently from the clamp to ``target_length``.

    Parameters
    ----------
    plant : Plant
        The tissue and blade to control; the blade stands at the clamp.
    tissue : TissueDescription
        The tissue that the rig assumes; gives the nominal stiffness and friction.
    truth : Records, optional
        The true profile, shape (1,), if the reward is to be assessed from hidden state; otherwise it is assessed from
        the rig's estimate of the tip.
    friction_per_depth : float
        Friction of the moving blade over the depth of cut, true or nominal [N/m].
    target_length, deadline : float
        Length to cut [m]; time limit [s].
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
        truth: StructArray | None,
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
        self.last_action = np.zeros(2)
        self.command = (0.0, ANGLE_CENTRE)
        self.episode = np.zeros(1, EPISODE)
        self.episode["task"] = task_record(
            weights,
            limits,
            target_length=target_length,
            deadline=deadline,
            friction_per_depth=friction_per_depth,
            speeds=(tissue.speed_min, tissue.speed_max),
        )
        self.episode["nominal"] = nominal_profile(tissue, plant.depth)
        self._truth = truth
        self._tips, self._jumps = np.zeros(ticks), np.zeros(ticks)
        self._felt: StructArray | None = None
        self._end = 0
        self._stopped = False
        self.updates = 0
        """Milliseconds of the last decision that count: all, or those up to the end."""

    def step(self, action: NDArray[np.float64]) -> tuple[NDArray[np.float32], float]:
        """Command an action (2 numbers in [-1, 1]) for one decision; return observation, shape (12,), and reward."""
        speed, angle = action.tolist()
        speed, angle = self.command = (SPEED_SCALE * speed, ANGLE_CENTRE + ANGLE_SCALE * angle)
        self.last_action = action
        return self._decide(self.plant.advance(speed, angle, self.ticks))

    def stopped(self, readings: StructArray) -> tuple[NDArray[np.float32], float]:
        """End a cut whose plant was stopped by the rig's safety in the step after ``readings``; a safety end.

        Returns
        -------
        tuple of observation, shape (12,), and reward
            Same as for :meth:`step`.
        """
        ticks = len(readings)
        self._tips, self._jumps = np.zeros(ticks), np.zeros(ticks)
        observation, reward = self._decide(readings)
        if not self._end:
            before = float(self.terms.sum())
            was, self.progress["end"] = self.terms.copy(), ENDS.index("force_limit")
            charge_end(self.task[0], self.progress[0], self.nominal[0], self.terms)
            self._totals += self.terms - was
            reward += float(self.terms.sum()) - before
            self._end = int(self.progress["end"][0])
        self._stopped = True  # whatever end the readings show
        return observation, reward

    def _decide(self, readings: StructArray) -> tuple[NDArray[np.float32], float]:
        self._felt = readings
        action = self.last_action
        observation = np.empty(len(COMPONENTS), np.float32)
        if self._truth is None:
            reward, self._end, self.updates = decide_from_estimate(
                self.episode, readings, self._tips, self._jumps, action, self.terms, self._totals, observation
            )  # fmt: skip
        else:
            reward, self._end, self.updates = decide_from_truth(
                self.episode, self._truth, readings, action, self.terms, self._totals, observation
            )  # fmt: skip
        return observation, reward

    def rest(self, angle: float) -> NDArray[np.float32]:
        """Return the observation at the start: the blade at rest at the clamp, force tared to zero."""
        self.last_action = np.array([0.0, (angle - ANGLE_CENTRE) / ANGLE_SCALE])
        observation = np.empty(len(COMPONENTS), np.float32)
        rest(self.task[0], self.nominal[0], angle, observation)
        return observation

    @property
    def readings(self) -> StructArray | None:
        """Readings since the last decision that count; None before the first."""
        return None if self._felt is None else self._felt[: self.updates]

    # Properties, not attributes: a deep copy must not refer to the original's arrays.

    @property
    def task(self) -> StructArray:
        """Limits, weights and target of the task, shape (1,)."""
        return self.episode["task"]

    @property
    def progress(self) -> StructArray:
        """State of the assessment, shape (1,)."""
        return self.episode["progress"]

    @property
    def nominal(self) -> StructArray:
        """The profile that a rig expects, shape (1,)."""
        return self.episode["nominal"]

    def assessment(self) -> tuple[StructArray, StructArray]:
        """Return copies of the task and its progress for the compiled assessment, shape (1,) each."""
        return self.task.copy(), self.progress.copy()

    @property
    def end(self) -> str:
        """Name of the reason why the episode ended, or an empty string."""
        return STOPPED if self._stopped else ENDS[self._end]

    @property
    def success(self) -> bool:
        """True if finished, with the tip within 3 mm of the target and the blade within 10 degrees of upright."""
        return not self._stopped and bool(succeeded(self.task[0], self.progress[0]))

    @property
    def speed_out_of_range(self) -> bool:
        """True if the blade moved outside the measured range of speed since the last decision."""
        return bool(self.progress["out_of_range"][0] > 0)

    @property
    def time(self) -> float:
        """Time since the start [s]."""
        return float(self.progress["time"][0])

    @property
    def tip(self) -> float:
        """Crack tip as assessed: true, or estimated by the rig [m]."""
        return float(self.progress["tip"][0])

    @property
    def cost(self) -> dict[str, float]:
        """Limit breaches: largest force above the limit in this step [N] and the tip's overshoot so far [m]."""
        over_limit, overshoot = self.progress["over_limit"], self.progress["overshoot"]
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
        return float(self.task[0]["force_limit_per_depth"])
