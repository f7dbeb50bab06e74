"""One episode of gentle cutting on any plant: commands in; observation, reward terms and end out."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cutenv._base.arrays import Array, StructArray
from cutenv._engine.jit import njit
from cutenv.cutting.dtypes import PROFILE, READING
from cutenv.plant.interface import Plant
from cutenv.plant.simulator import SimulatedPlant
from cutenv.task.assessment import assess_readings, charge_end, succeeded
from cutenv.task.beginning import begin_at, expect
from cutenv.task.cuts import EPISODE, Cuts, rest_one, step_one, tell_one
from cutenv.task.info import COST, GROUPS, OUT_OF_RANGE, PLACES, WHOLE
from cutenv.task.observation import ANGLE_CENTRE, ANGLE_SCALE, COMPONENTS, commanded_speed
from cutenv.task.reward import ENDS, STOPPED, TERMS
from cutenv.task.weights import Limits, RewardWeights, task_record
from cutenv.tissue.crack_tip import believe_mean
from cutenv.tissue.description import TissueDescription
from cutenv.tissue.nominal import nominal_tissue

_GROUPS = {group: tuple(field.name for field in fields) for group, fields in GROUPS.items()}


def nominal_profile(tissue: TissueDescription, depth: NDArray[np.float64]) -> StructArray:
    """Return the profile that a rig expects, shape (1,): mean modulus and resistance, and the measured depth [m]."""
    profile = np.zeros(1, PROFILE)
    profile["depth"] = depth
    _expect(nominal_tissue(tissue), profile)
    return profile


@njit
def _expect(nominal: StructArray, profiles: StructArray) -> None:
    expect(nominal[0], profiles[0])


class ShownDepth(NamedTuple):
    """Depth of a cut for a picture, above the plane to which a blade at level 0 cuts [m]; arrays of shape (301,)."""

    level: float
    """Level of the blade's lower end."""
    surface: Array
    floor: Array
    """Floor of the cut, hidden; where nothing is cut, the surface."""
    wanted: Array
    """Wanted floor, below the true surface."""
    layer: Array
    """Upper side of the layer below, hidden."""


class ShownPath(NamedTuple):
    """Path of a cut for a picture: places along and across the slab, to the left [m]."""

    line: Array
    """The line, every 0.5 mm, shape (301, 2)."""
    target: int
    """Point of the line where the cut is to end."""
    cut: Array
    """The cut from the clamp to its tip, hidden, shape (n, 2)."""
    tip: Array
    """Shape (2,), hidden."""
    blade: Array
    """Shape (2,)."""
    heading: Array
    """Direction in which the blade points, shape (2,)."""
    aside: float
    """Distance of the blade to the left of the line."""


class GentleCutting:
    """An episode: cut gently from the clamp to ``target_length``, assessed by the rig's estimate of the tip.

    Parameters
    ----------
    plant : Plant
        The tissue and blade to control; the blade stands at the clamp.
    tissue : TissueDescription
        The tissue that the rig assumes; gives the nominal stiffness and friction.
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
        friction_per_depth: float,
        target_length: float,
        deadline: float,
        ticks: int,
    ) -> None:
        self.plant = plant
        self.ticks = ticks
        self.target_length = target_length
        self.deadline = deadline
        self._views: tuple[NDArray[np.float64], NDArray[np.int64]] | None = None
        self.last_action = np.zeros(2)
        self.episode = np.zeros(1, EPISODE)
        self.episode["tasks"] = task_record(
            weights,
            limits,
            target_length=target_length,
            deadline=deadline,
            friction_per_depth=friction_per_depth,
            speeds=(tissue.speed_min, tissue.speed_max),
        )
        self.episode["nominals"] = nominal_profile(tissue, plant.depth)
        believe_mean(self.episode["tips"], friction_per_depth)
        self._felt: StructArray | None = None
        self._end = 0
        self._stopped = False

    def step(self, action: NDArray[np.float64]) -> tuple[NDArray[np.float32], float]:
        """Command an action (2 numbers in [-1, 1]) for one decision; return observation, shape (12,), and reward."""
        speed, angle = action.tolist()
        self.last_action = action
        commanded = float(commanded_speed(speed)), ANGLE_CENTRE + ANGLE_SCALE * angle
        return self._assess(self.plant.advance(*commanded, self.ticks))

    def stopped(self, readings: StructArray) -> tuple[NDArray[np.float32], float]:
        """End a cut whose plant was stopped by the rig's safety in the step after ``readings``; a safety end.

        Returns
        -------
        tuple of observation, shape (12,), and reward
            Same as for :meth:`step`.
        """
        observation, reward = self._assess(readings)
        if not self._end:
            before = self.terms.copy()
            self.progress["end"] = self._end = ENDS.index("force_limit")
            charge_end(self.task[0], self.progress[0], self.nominal[0], self.episode["infos"][0, 0])
            self.episode["totals"] += self.terms - before
            reward += float(self.terms.sum()) - float(before.sum())
        self._stopped = True  # whatever end the readings show
        return observation, reward

    def _assess(self, readings: StructArray) -> tuple[NDArray[np.float32], float]:
        self._felt = readings
        observation = np.empty(len(COMPONENTS), np.float32)
        reward, self._end = assess_readings(self.episode, readings, self.last_action, observation)
        return observation, reward

    def rest(self, angle: float) -> NDArray[np.float32]:
        """Return the observation at the start: the blade at rest, force tared to zero."""
        self.last_action = np.array([0.0, (angle - ANGLE_CENTRE) / ANGLE_SCALE])
        observation = np.empty(len(COMPONENTS), np.float32)
        rest_one(self.episode, angle, self.last_action[1], observation)
        return observation

    @property
    def readings(self) -> StructArray | None:
        """Readings since the last decision that count; None before the first."""
        return None if self._felt is None else self._felt[: self.updates]

    @property
    def beside(self) -> dict[str, Array]:
        """Further measurements at these readings, by field of a trace; none where the blade keeps its height."""
        return {}

    @property
    def noted(self) -> dict[str, Any]:
        """Facts about the task for the metadata of a record, by key."""
        return {"target_length_m": self.target_length}

    @property
    def updates(self) -> int:
        """Milliseconds of the last decision that count: all, or those up to the end."""
        return int(self.progress["updates"][0])

    # Properties, not attributes: a deep copy must not refer to the original's arrays.

    @property
    def task(self) -> StructArray:
        """Limits, weights and target of the task, shape (1,)."""
        task: StructArray = self.episode["tasks"][0]
        return task

    @property
    def progress(self) -> StructArray:
        """State of the assessment, shape (1,)."""
        progress: StructArray = self.episode["progresses"][0]
        return progress

    @property
    def nominal(self) -> StructArray:
        """The profile that a rig expects, shape (1,)."""
        nominal: StructArray = self.episode["nominals"][0]
        return nominal

    @property
    def terms(self) -> NDArray[np.float64]:
        """The reward of the last step by term, shape (13,): a view."""
        return self._numbers()[0][PLACES["reward_terms"]]

    def info(self) -> list[float]:
        """Return the fields of the last step's info, :data:`cutenv.task.info.INFO_FIELDS`, whole numbers as int.

        Hidden state and energies are those of a simulated cut; 0 for others.
        """
        floats, whole = self._numbers()
        numbers: list[float] = floats.tolist()
        for place in WHOLE:
            numbers[place] = int(whole[place])
        return numbers

    def _numbers(self) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Return the last info's record seen as float64 and as int64; kept: making a view takes as long as a step."""
        if self._views is None:
            record = self.episode["infos"][0]
            self._views = record.view(np.float64), record.view(np.int64)
        return self._views

    def __getstate__(self) -> dict[str, object]:
        return {**self.__dict__, "_views": None}  # those of a copy would refer to the original's record

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
        return self.info()[OUT_OF_RANGE] > 0

    @property
    def time(self) -> float:
        """Time since the start [s]."""
        return float(self.progress["time"][0])

    @property
    def tip(self) -> float:
        """Crack tip as assessed: true, or estimated by the rig [m]."""
        return float(self.progress["tip"][0])

    @property
    def cost(self) -> float:
        """Cost of the last step: by how much the tip's overshoot grew, and the parts of runs beyond 4 mm [mm]."""
        return self.info()[COST]

    @property
    def cost_terms(self) -> dict[str, float]:
        """The cost of the last step by part [mm]."""
        return info_group(self.info(), "cost_terms")

    @property
    def reward_terms(self) -> dict[str, float]:
        """The reward of the last step by term; costs are negative; the sum is the reward."""
        return dict(zip(TERMS, self.terms.tolist(), strict=True))

    @property
    def reward_totals(self) -> dict[str, float]:
        """The reward since the start by term; the sum is the return."""
        return dict(zip(TERMS, self.episode["totals"][0].tolist(), strict=True))

    @property
    def shown_totals(self) -> dict[str, float]:
        """The reward since the start by line of a picture."""
        return self.reward_totals

    @property
    def shown_depth(self) -> ShownDepth | None:
        """Depth as a picture shows it, None where no depth is wanted."""
        return None

    @property
    def shown_path(self) -> ShownPath | None:
        """Path as a picture shows it, None where no line is drawn."""
        return None

    @property
    def force_limit_per_depth(self) -> float:
        """Force per depth of cut above which the task ends [N/m]."""
        return float(self.task[0]["force_limit_per_depth"])


class SimulatedCutting(GentleCutting):
    """An episode on a simulated plant: each step is one compiled call, which stops where the cut ends.

    Parameters
    ----------
    plant : SimulatedPlant
        The tissue and blade to control; the blade stands at the clamp.
    from_truth : bool
        True: the reward is assessed from hidden state. False: from the rig's estimate of the tip.
    start : float
        Length of the cut that is already made [m].
    tissue, weights, limits, friction_per_depth, target_length, deadline, ticks
        See :class:`GentleCutting`.
    """

    plant: SimulatedPlant

    def __init__(
        self,
        plant: SimulatedPlant,
        tissue: TissueDescription,
        weights: RewardWeights,
        limits: Limits,
        *,
        from_truth: bool = True,
        start: float = 0.0,
        friction_per_depth: float,
        target_length: float,
        deadline: float,
        ticks: int,
    ) -> None:
        super().__init__(
            plant,
            tissue,
            weights,
            limits,
            friction_per_depth=friction_per_depth,
            target_length=target_length,
            deadline=deadline,
            ticks=ticks,
        )
        self.from_truth = from_truth
        self._recorded: StructArray = np.zeros((1, ticks), READING)
        self.episode["specimens"]["modulus"] = plant.specimen.modulus
        self.episode["specimens"]["fracture_resistance"] = plant.specimen.fracture_resistance
        if start > 0.0:
            begin_at(plant.states[0], self.progress[0], self.episode["tips"][0, 0], start)

    def step(self, action: NDArray[np.float64]) -> tuple[NDArray[np.float32], float]:
        """Command an action (2 numbers in [-1, 1]) for one decision; return observation, shape (12,), and reward."""
        self.last_action = action
        observation = np.empty((1, len(COMPONENTS)), np.float32)
        reward, self._end = step_one(
            self.plant.cuts, self.episode, self.ticks, self.from_truth, action.reshape(1, 2), observation,
            self._recorded,
        )  # fmt: skip
        self._felt = self._recorded[0]
        return observation[0], reward

    def snapshot(self) -> Cuts:
        """Return copies of everything about the cut, each of shape (1,); hidden truth included."""
        parts = (self.episode[name][0].copy() for name in ("tasks", "progresses", "nominals", "specimens", "tips"))
        return Cuts(*self.plant.snapshot(), *parts)

    def rest(self, angle: float) -> NDArray[np.float32]:
        """Return the observation at the start: the blade at rest, force tared to zero."""
        tell_one(self.plant.cuts, self.episode)
        return super().rest(angle)


def info_group(numbers: list[float], group: str) -> dict[str, float]:
    """Return one group of the fields of :meth:`GentleCutting.info` by name."""
    return dict(zip(_GROUPS[group], numbers[PLACES[group]], strict=True))
