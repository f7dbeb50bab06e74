"""One episode of a task on any plant: actions in; observation, reward, end out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cutenv._base.arrays import Array, StructArray
from cutenv._engine.jit import njit
from cutenv.sim.cutting.dtypes import PROFILE, READING
from cutenv.sim.cutting.simulate import Physics
from cutenv.sim.plant.simulator import SimulatedPlant
from cutenv.sim.tissue.crack_tip import believe_mean
from cutenv.sim.tissue.description import TissueDescription
from cutenv.sim.tissue.specimen import Specimen, SurfaceSpread, nominal_tissue
from cutenv.task.assessment import charge_end
from cutenv.task.beginning import begin_at, begin_one, drawn_length, expect, expect_one
from cutenv.task.declare import GENTLE_CUT, WAYS, Cuts, OneCut, Task, command_of
from cutenv.task.info import COST, GROUPS, OUT_OF_RANGE, PLACES, WHOLE_NUMBERS
from cutenv.task.observation import ANGLE_CENTRE, ANGLE_SCALE, commanded_speed
from cutenv.task.reward import ENDS, STOPPED, TERMS, Limits, RewardWeights, task_record
from cutenv.task.stepper import assess_readings, observe_one, step_one, tell_one


def nominal_profile(tissue: TissueDescription, depth: NDArray[np.float64]) -> StructArray:
    """Return a rig's expected profile, (1,): mean tissue, measured depth [m]."""
    profile = np.zeros(1, PROFILE)
    profile["depth"] = depth
    _expect(nominal_tissue(tissue), profile)
    return profile


@njit
def _expect(nominal: StructArray, profiles: StructArray) -> None:
    expect(nominal[0], profiles[0])


@dataclass(frozen=True, kw_only=True)
class Goal:
    """Tissue, target, beginning and assessment of a cut."""

    tissue: TissueDescription
    """Tissue that a rig assumes; gives nominal stiffness and friction."""
    friction_per_depth: float  # friction of the moving blade over the depth of cut, true or nominal [N/m]
    target_length: float  # length to cut [m]
    deadline: float = 30.0  # time limit [s]
    ticks: int = 20  # milliseconds between decisions
    start: float = 0.0  # length of the cut that is already made [m]
    key: tuple[int, int] | None = (0, 0)
    """Seed and episode; None: what the task adds is left as it is before a cut begins."""
    weights: RewardWeights = RewardWeights()  # noqa: RUF009  frozen
    limits: Limits = Limits()  # noqa: RUF009


class TaskOptions:
    """Options that a task takes from an environment's keywords; here none."""

    task: ClassVar[Task] = GENTLE_CUT
    names: ClassVar[tuple[str, ...]] = ()  # names of the keywords
    surface = SurfaceSpread(surface_spread=0.0)
    """Spread of the surface between drawn specimens; none: the depth of cut is the mean liver's."""
    given: dict[str, Any]  # the task's keywords as they were given

    def __init__(self, keywords: dict[str, Any]) -> None:
        self.given = {name: keywords[name] for name in self.names if name in keywords}

    def check_length(self, length: float) -> None:
        """Raise ValueError if a target length [m] does not fit."""

    def drawn_length(self, tissue: TissueDescription, seed: int, episode: int) -> float:
        """Return a key's drawn target length [m]."""
        return float(drawn_length(np.uint64(seed), np.uint64(episode)))

    def whole(self) -> StructArray | None:
        """Return the initial whole-cut record, (1,), or None for zeros."""
        return None

    def motion(self, specimen: Specimen) -> StructArray | None:
        """Return the initial motion record, (1,), or None for zeros."""
        return None

    def shared(self, tissue: TissueDescription) -> StructArray:
        """Return the record shared by a tissue's cuts, shape (1,)."""
        return np.zeros(1, self.task.motion.shared)

    def expected(self, tissue: TissueDescription) -> StructArray | None:
        """Return a rig's expected motion record, (1,), or None for zeros."""
        return None

    def episode(self, plant: Any, goal: Goal, *, from_truth: bool | None = None) -> Episode:
        """Return a new episode of the task, see :class:`Episode`."""
        return Episode(plant, goal, self, from_truth=from_truth)

    def shown_depth(self, cuts: Cuts, number: int) -> ShownDepth | None:
        """Return a copy of a cut's depth for a picture, or None."""
        return None

    def beginning(self, tissue: TissueDescription) -> tuple[Any, ...]:
        """Return the task's arguments for its hook ``begin``."""
        return ()


class Episode:
    """An episode of a task: cut gently from the clamp to a target length.

    On a simulated plant each step is one compiled call, which stops where the cut ends, and ``from_truth`` says whether
    the reward is assessed from hidden state, or from what a rig sees.  On a rig the command goes out, the readings come
    in, and tip, runs and the whole cut are estimates.
    """

    def __init__(
        self, plant: Any, goal: Goal, options: TaskOptions | None = None, *, from_truth: bool | None = None
    ) -> None:
        self.plant, self.goal, self.options = plant, goal, options or TaskOptions({})
        self.simulated = from_truth is not None
        self.task = self.options.task if from_truth else self.options.task.seen
        self._components = len(self.task.all_components)
        self._numbers: tuple[NDArray[np.float64], NDArray[np.int64]]  # the last info's record
        self._cuts: Cuts  # both are views, kept, because making one takes as long as a step
        self.last_action = np.zeros(len(self.task.action_names))
        self.record = np.zeros(1, self.task.episode)  # record of the episode, episode of shape (1,)
        self.record["tasks"] = task_record(
            goal.weights, goal.limits, target=goal.target_length, deadline=goal.deadline,
            friction_per_depth=goal.friction_per_depth, speeds=(goal.tissue.speed_min, goal.tissue.speed_max),
        )  # fmt: skip
        self.record["nominals"] = nominal_profile(goal.tissue, plant.depth)
        _fill(self.record["wholes"], self.options.whole())
        if not self.task.from_truth:
            believe_mean(self.record["known"]["tip"], goal.friction_per_depth)
            _fill(self.record["known"]["motion"][0], self.options.expected(goal.tissue))
        self.shared = self.options.shared(goal.tissue)  # record that all cuts of the task and tissue share, shape (1,)
        self._felt: StructArray | None = None
        self._channels: dict[str, Array] = {}
        self._end = 0
        self._stopped = False
        self._begin()

    def _begin(self) -> None:
        goal = self.goal
        key = None if goal.key is None else (np.uint64(goal.key[0]), np.uint64(goal.key[1]))
        beginning = self.options.beginning(goal.tissue)
        if not self.simulated:
            self._one = OneCut(np.zeros(1, self.task.motion.cut), self.shared, self.record)
            self._view()
            expect_one(self.task)(self._one, beginning, key)
            return
        plant: SimulatedPlant = self.plant
        self._one, self._step = OneCut(plant.cuts, self.shared, self.record), step_one(self.task)
        self._view()
        _fill(plant.cuts["motions"], self.options.motion(plant.specimen))
        plant.shared = self.shared
        readings: StructArray = np.zeros((1, self.ticks), READING)
        self._recorded = readings, np.zeros(self.ticks if self.task.axis is not None else 0)
        self.record["specimens"]["modulus"] = plant.specimen.modulus
        self.record["specimens"]["fracture_resistance"] = plant.specimen.fracture_resistance
        if goal.start > 0.0:
            begin_at(plant.states[0], self.progress[0], goal.start)
        if key is not None:
            begin_one(self.task)(self._one, beginning, key)

    def _view(self) -> None:
        cut, infos = self._one.cut[0], self.record["infos"][0]
        self._numbers = infos.view(np.float64), infos.view(np.int64)
        self._cuts = Cuts(
            **{name: cut[name] for name in Physics._fields if name != "shared"}, shared=self.shared,
            **{name: self.record[name][0] for name in Cuts._fields if name not in Physics._fields},
        )  # fmt: skip

    def step(self, action: NDArray[np.float64]) -> tuple[NDArray[np.float32], float]:
        """Command an action for one decision; return observation, (k,), and reward."""
        self.last_action = action
        if not self.simulated:
            return self._assess(self._advance(*action.tolist()))
        observation = np.empty(self._components, np.float32)
        reward, self._end = self._step(*self._one, self.goal.ticks, action, observation, *self._recorded)
        self._felt = self._recorded[0]
        return observation, reward

    def _advance(self, speed: float, angle: float, third: float = 0.0) -> StructArray:
        """Command an action to a rig for one decision; return readings."""
        axis = self.task.axis
        further = {} if axis is None else {axis.command: float(command_of(self.task)(third))}
        readings: StructArray = self.plant.advance(
            float(commanded_speed(speed)), ANGLE_CENTRE + ANGLE_SCALE * angle, self.ticks, **further
        )
        return readings

    def _measured(self, count: int) -> tuple[dict[str, Array], Array]:
        """Return further measurements, by trace field and as array (count, WAYS)."""
        return {}, np.zeros((count, WAYS))

    def stopped(self, readings: StructArray) -> tuple[NDArray[np.float32], float]:
        """End a cut that rig safety stopped after ``readings``; return as :meth:`step`."""
        observation, reward = self._assess(readings)
        return observation, reward + self.charge_stop()

    def charge_stop(self) -> float:
        """End a cut stopped by rig safety; return its added reward."""
        before = self.terms.copy()
        if not self._end:
            self.progress["end"] = self._end = ENDS.index("force_limit")
            charge_end(self.settings[0], self.progress[0], self.nominal[0], self.record["infos"][0, 0])
            self.record["totals"] += self.terms - before
        self._stopped = True  # whatever end the readings show
        return float(self.terms.sum()) - float(before.sum())

    def _assess(self, readings: StructArray) -> tuple[NDArray[np.float32], float]:
        return self.assess(readings, *self._measured(len(readings)))

    def assess(
        self, readings: StructArray, channels: dict[str, Array], ways: Array
    ) -> tuple[NDArray[np.float32], float]:
        """Assess readings of a rig, and what is measured besides.

        Return observation and reward.

        ``channels`` are by field of a trace, each of shape (n,), and ``ways``, shape (n, WAYS), as the task's hooks
        take them.
        """
        self._felt, self._channels = readings, channels
        observation = np.empty(self._components, np.float32)
        reward, self._end = assess_readings(self.task)(self._one, readings, ways, self.last_action, observation)
        return observation, reward

    def rest(self, angle: float) -> NDArray[np.float32]:
        """Return the start's observation: blade at rest, force tared."""
        last_angle = (angle - ANGLE_CENTRE) / ANGLE_SCALE
        self.last_action = np.array([0.0, last_angle, *np.zeros(len(self.task.action_names) - 2)])
        observation = np.empty(self._components, np.float32)
        if self.simulated:
            tell_one(self._one)
        observe_one(self.task)(self._one, angle, observation)
        return observation

    @property
    def readings(self) -> StructArray | None:
        """Readings since the last decision that count; None before the first."""
        return None if self._felt is None else self._felt.reshape(-1)[: self.updates]

    @property
    def channels(self) -> dict[str, Array]:
        """Further measurements at these readings by trace field; none by default."""
        return {name: values[: self.updates] for name, values in self._channels.items()}

    @property
    def across(self) -> Array:
        """Force across a simulated cut, true or as seen, since the decision [N], (ticks,)."""
        return self._recorded[1]

    @property
    def noted_map(self) -> dict[str, Any]:
        """Simulated record's map notes by metadata key; none by default."""
        return {}

    @property
    def noted(self) -> dict[str, Any]:
        """Facts about the task by key of record metadata."""
        return {"target_length_m": self.target_length}

    @property
    def ticks(self) -> int:
        """Milliseconds between decisions."""
        return self.goal.ticks

    @property
    def target_length(self) -> float:
        """Length to cut [m]."""
        return self.goal.target_length

    @property
    def deadline(self) -> float:
        """Time limit [s]."""
        return self.goal.deadline

    @property
    def updates(self) -> int:
        """Milliseconds of the last decision up to any end."""
        return int(self.progress["updates"][0])

    @property
    def settings(self) -> StructArray:
        """Limits, weights and target of the task, shape (1,)."""
        return self._cuts.tasks

    @property
    def progress(self) -> StructArray:
        """State of the assessment, shape (1,)."""
        return self._cuts.progresses

    @property
    def nominal(self) -> StructArray:
        """The profile that a rig expects, shape (1,)."""
        return self._cuts.nominals

    @property
    def whole(self) -> StructArray:
        """Assessment of the whole cut, :attr:`~cutenv.task.declare.Task.whole`, shape (1,)."""
        return self._cuts.wholes

    @property
    def motion(self) -> StructArray:
        """Blade motion, (1,): hidden truth, or expected on a rig."""
        motion: StructArray = self._cuts.motions if self.task.from_truth else self._cuts.known["motion"][0]
        return motion

    @property
    def terms(self) -> NDArray[np.float64]:
        """Last step's reward by gentle-cutting term, (13,), a view."""
        return self._numbers[0][PLACES["reward_terms"]]

    def info(self) -> list[float]:
        """Return the last step's info fields, :data:`cutenv.task.info.INFO_FIELDS`, counts as int.

        Hidden state and energies are those of a simulated cut; 0 for others.
        """
        floats, whole = self._numbers
        numbers: list[float] = floats.tolist()
        for place in WHOLE_NUMBERS:
            numbers[place] = int(whole[place])
        return numbers

    def __getstate__(self) -> dict[str, object]:
        # A deep copy must not refer to the original's arrays.
        return {name: value for name, value in self.__dict__.items() if name not in ("_numbers", "_cuts", "_step")}

    def __setstate__(self, state: dict[str, object]) -> None:
        self.__dict__.update(state)
        if self.simulated:
            self._one, self._step = OneCut(self.plant.cuts, self.shared, self.record), step_one(self.task)
        self._view()

    @property
    def end(self) -> str:
        """Name of the episode's end, or an empty string."""
        return STOPPED if self._stopped else self.task.ends[self._end]

    @property
    def success(self) -> bool:
        """True if gentle cutting and the whole cut both succeeded."""
        return not self._stopped and bool(self.whole["success"][0])

    @property
    def speed_out_of_range(self) -> bool:
        """True if blade speed left the measured range since the decision."""
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
        """Last step's cost [mm]: overshoot's growth, and runs beyond 4 mm."""
        return self.info()[COST]

    @property
    def cost_terms(self) -> dict[str, float]:
        """The cost of the last step by part [mm]."""
        names = (field.name for field in GROUPS["cost_terms"])
        return dict(zip(names, self.info()[PLACES["cost_terms"]], strict=True))

    @property
    def reward_terms(self) -> dict[str, float]:
        """Last step's reward by term; costs are negative."""
        return dict(zip(TERMS, self.terms.tolist(), strict=True)) | self.whole_terms

    @property
    def whole_terms(self) -> dict[str, float]:
        """The costs of the whole cut in the last step's reward."""
        return {name: float(value[0]) for name, value in self.task.charges(self.whole).items()}

    @property
    def whole_totals(self) -> dict[str, float]:
        """Whole-cut costs in the reward since the start."""
        return {name: float(value[0]) for name, value in self.task.charges(self.whole, "total").items()}

    @property
    def reward_totals(self) -> dict[str, float]:
        """Reward since the start by term; the sum is the return."""
        return dict(zip(TERMS, self.record["totals"][0].tolist(), strict=True)) | self.whole_totals

    @property
    def shown_totals(self) -> dict[str, float]:
        """Reward since the start by a picture's lines, whole-cut costs in one."""
        own, line = self.whole_totals, self.task.shown_as
        gentle = {name: total for name, total in self.reward_totals.items() if name not in own}
        return gentle | ({line: sum(own.values())} if line else {})

    @property
    def errors(self) -> dict[str, float]:
        """Errors of the whole cut by name with unit, if any."""
        return self.truth_and_errors[1]

    @property
    def truth_and_errors(self) -> tuple[dict[str, float], dict[str, float]]:
        """Hidden state added to info by name, and :attr:`errors`."""
        truth, errors = self.task.numbers_of(self._cuts)
        return {name: value.item() for name, value in truth.items()}, {
            name: value.item() for name, value in errors.items()
        }

    @property
    def shown_depth(self) -> ShownDepth | None:
        """Depth for a picture, or None if none is wanted."""
        return None

    @property
    def shown_path(self) -> ShownPath | None:
        """Path for a picture, or None without a line."""
        return None

    @property
    def force_limit_per_depth(self) -> float:
        """Force per depth of cut above which the task ends [N/m]."""
        return float(self.settings[0]["force_limit_per_depth"])

    def snapshot(self) -> Cuts:
        """Return copies of a simulated cut's whole state, each (1,)."""
        return Cuts(*(part.copy() for part in self._cuts))._replace(shared=self.shared)


def _fill(records: StructArray, record: StructArray | None) -> None:
    """Fill records with an optional record's fields of equal names."""
    if record is not None:
        for name in record.dtype.names or ():
            records[name] = record[name]


class ShownDepth(NamedTuple):
    """Depth of a cut for a picture [m], (301,), above a level-0 blade's plane."""

    level: float  # level of the blade's lower end
    surface: Array
    floor: Array  # floor of the cut, hidden; where nothing is cut, the surface
    wanted: Array  # wanted floor, below the true surface
    layer: Array  # upper side of the layer below, hidden


class ShownPath(NamedTuple):
    """Path of a cut for a picture, along and left of the slab's axis [m]."""

    line: Array  # the line, every 0.5 mm, shape (301, 2)
    target: int  # point of the line where the cut is to end
    cut: Array  # the cut from the clamp to its tip, hidden, shape (n, 2)
    tip: Array  # shape (2,), hidden
    blade: Array  # shape (2,)
    heading: Array  # direction in which the blade points, shape (2,)
    aside: float  # distance of the blade to the left of the line
