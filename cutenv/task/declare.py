"""Declaration of a task.

It says what the task adds to gentle cutting, in one object from which everything else is made.

Every task is gentle cutting, declared in :mod:`cutenv.task.reward`, :mod:`cutenv.task.observation` and
:mod:`cutenv.task.info`, of a blade with some motion.  A :class:`Task` adds an action axis, components of the
observation, costs and an end of the whole cut, and the functions, its hooks, that the compiled steps of
:mod:`cutenv.task.stepper` call.  Gentle cutting itself is the task that adds nothing.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from cutenv._base.arrays import Array, Struct, StructArray
from cutenv._engine.declared import Declaration, Formula, compiled_for, expression, fuse
from cutenv._engine.jit import njit, njit_fused, njit_inline, njit_internal
from cutenv.sim import quantities
from cutenv.sim.cutting.dtypes import DRIVE, LAW, PROFILE, STATE
from cutenv.sim.cutting.motion import NOTHING, STRAIGHT, Motion, Moving
from cutenv.sim.cutting.row import Plain
from cutenv.sim.cutting.sensor import SENSOR, WRAP
from cutenv.sim.quantities import WholeCutTerm
from cutenv.sim.tissue.crack_tip import ASSESSED_TIP
from cutenv.task.assessment import COUNT_ONE
from cutenv.task.info import INFO
from cutenv.task.observation import CLIP, COMPONENTS, DEAD_ZONE, Component
from cutenv.task.reward import ENDS, PROGRESS, SPECIMEN, TASK, TERMS

# Assessment of the whole cut where nothing is asked of it but a success.
WHOLE: np.dtype[Any] = np.dtype((np.record, [("success", "i8")]))
WAYS = 5  # number of measurements at each reading that a task may have beyond those of a straight cut


class Cuts(NamedTuple):
    """Everything about n cuts, as structured arrays of shape (n,)."""

    states: StructArray
    profiles: StructArray
    laws: StructArray
    drives: StructArray
    sensors: StructArray
    motions: StructArray  # records of the motion, record
    shared: StructArray  # record that all cuts share, shape (1,)
    tasks: StructArray
    progresses: StructArray
    nominals: StructArray  # profiles that a rig expects
    specimens: StructArray
    known: StructArray  # knowledge of a rig about a cut, known; unused if the reward is assessed by hidden state
    wholes: StructArray  # assessment of the whole cut, whole

    @classmethod
    def empty(cls, task: Task, count: int) -> Cuts:
        """Return arrays for ``count`` cuts of a task, not yet reset."""
        kinds: list[Any] = [STATE, PROFILE, LAW, DRIVE, SENSOR, task.motion.record, task.motion.shared]
        kinds += [TASK, PROGRESS, PROFILE, SPECIMEN, task.known, task.whole]
        empty = cls(*(np.zeros(count, kind) for kind in kinds))
        return empty._replace(shared=np.zeros(1, task.motion.shared))

    @classmethod
    def together(cls, cuts: Sequence[Cuts]) -> Cuts:
        """Join cuts, each of shape (n,); the first one's shared data stay."""
        parts = zip(*cuts, strict=True)
        return cls(*map(np.concatenate, parts))._replace(shared=cuts[0].shared)

    def repeated(self, counts: Any) -> Cuts:
        """Return copies of cuts, repeated by ``counts``, int or shape (n,)."""
        parts = (np.repeat(part, counts, axis=0) for part in self._replace(shared=self.states))
        return Cuts(*parts)._replace(shared=self.shared)

    def straight(self) -> Cuts:
        """Return views of cuts without motion and whole-cut assessment."""
        nothing = np.zeros(len(self.states), NOTHING)
        return self._replace(
            motions=nothing, shared=np.zeros(1, NOTHING), known=nothing, wholes=np.zeros(len(nothing), WHOLE)
        )


class OneCut(NamedTuple):
    """One cut and its episode: records of shape (1,)."""

    cut: StructArray  # cut
    shared: StructArray  # record that all cuts of the task and tissue share
    episode: StructArray  # episode


class Stepping(NamedTuple):
    """Row of cuts within a step."""

    cuts: Cuts
    row: Struct
    plain: Plain
    moving: Moving
    count: Struct  # accumulators of gentle cutting, COUNT
    step: Struct  # counts that the task adds, counted


@njit_inline
def delayed(known: Struct, sensor: Struct, tick: int, force: float) -> float:
    """Return the measured force across the cut [N], with sensor delay."""
    known.late[tick & WRAP] = force
    return known.late[(tick - sensor.delay) & WRAP]  # type: ignore[no-any-return]


@njit_inline
def in_steps(force: float, resolution: float) -> float:
    """Return a force [N], rounded to any sensor resolution [N]."""
    if resolution == 0.0:
        return force
    return resolution * math.floor(force / resolution + 0.5)


@dataclass(frozen=True, kw_only=True)
class ActionAxis:
    """Action axis that a task adds to speed and angle."""

    name: str
    meaning: str
    command: str  # keyword of a rig's plant that commands it
    scale: float  # command of action 1, in SI units; it is 0 in the dead zone, and linear beyond
    shown: str  # range from -1 to 1, for readers
    unit: str  # unit of that range


# Quantities of such a number: records of the cut, its motion and the whole cut; target length and assessed tip [m].
OF_CUT = ("state", "motion", "whole", "target", "tip")


@dataclass(frozen=True, kw_only=True)
class CutNumber:
    """Whole-cut error or hidden state that a task adds to info."""

    name: str  # name with unit
    meaning: str
    value: Formula  # its value, of quantities of OF_CUT
    on_rig: bool = True  # False: no rig can tell it
    # Title and meaning in the glossary of a report, for a reader who does not know the task.
    glossary: tuple[str, str] | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class Task(Declaration):
    """Declaration of a task.

    Its hooks are compiled by :func:`~cutenv._engine.jit.njit_inline`, or for kernels.

    A hook that is None is not called.

    The whole cut is assessed by a record: settings, sums over the places that the tip has passed, and what
    :func:`whole_fields` gives.
    """

    place: str  # module and name of this object, "package.module:NAME"
    environment: str  # id of the environment
    from_truth: bool = True  # True: the reward is assessed by hidden state; False: by what a rig sees, see seen
    motion: Motion = STRAIGHT
    axis: ActionAxis | None = None
    components: tuple[Component, ...] = ()  # components of the observation that follow those of gentle cutting
    costs: tuple[WholeCutTerm, ...] = ()  # costs of the whole cut
    quantities: tuple[str, ...] = ()
    """Quantities of their formulas: fields of the whole cut's record, and "target"."""
    whole: np.dtype[Any] = WHOLE  # record of the whole cut
    counted: tuple[str, ...] = ("nothing",)  # counts of a step
    expected: np.dtype[Any] = NOTHING  # record of the motion that a rig expects, among what it knows
    measured: tuple[str, ...] = ()  # measurements at each reading that the task adds, by field of a trace
    end: str = ""  # name of a further end for safety
    end_text: str = ""  # when a cut ends so
    # Group of the info that has the errors of the whole cut, and line of a picture that has its costs.
    shown_as: str = ""
    errors: tuple[CutNumber, ...] = ()  # errors of the whole cut
    truth: tuple[CutNumber, ...] = ()  # hidden state that the task adds to the truth in the info
    hidden: tuple[str, ...] = ()  # names of the privileged features that the task adds to those of gentle cutting

    # Return the target length [m] from what is given and a key; None: it is drawn from 60 to 100 mm.
    length: Callable[..., float] | None = None
    # Begin a cut whose records were begun as those of gentle cutting, from what is given and a key.
    begin: Callable[..., None] | None = None
    expect: Callable[..., None] | None = None  # begin what a rig knows of it
    # Fill the components that the task adds at the start; takes cuts, number of the cut, its motion, observation.
    observe_start: Callable[..., None] | None = None
    fetch: Callable[..., None] | None = None  # prefetch records of the next row of cuts
    # Prepare the counts of a step; takes them, number of the lane, and place of the blade's leading end [m].
    begin_step: Callable[..., None] | None = None
    # Count a millisecond: counts, number of the lane, place of the blade, tip [m], force across the cut [N].
    count: Callable[..., None] | None = None
    # Return the force that is charged and limited, from those along and across the cut [N]; None: that along it.
    size: Callable[..., float] | None = None
    # Bring the record of the whole cut up to date: record, motion, counts, number of the lane, tip [m].
    survey: Callable[..., None] | None = None
    # Return whether the cut ends for safety, from the record of the whole cut.
    breached: Callable[..., bool] | None = None
    # Return whether the whole cut is within the tolerances of a success, from its record and target length [m].
    achieved: Callable[..., bool] | None = None
    # Return the energy that an end leaves stored [J], or -1 for that along the cut, and R B at the tip [N].
    left_loaded: Callable[..., tuple[float, float]] | None = None
    left_loaded_seen: Callable[..., tuple[float, float]] | None = None  # the same of a cut that is seen as on a rig
    # Fill the components that the task adds; takes a Stepping, number of the lane, action, observation.
    observe: Callable[..., None] | None = None
    observe_seen: Callable[..., None] | None = None  # the same of a cut that is seen as on a rig
    # Let a simulated rig measure; what it reads are the ``ways`` of what is known.
    measure: Callable[..., None] | None = None
    # Bring the profile that a rig expects up to date, before the tip is estimated.
    expect_at: Callable[..., None] | None = None
    felt_along: Callable[..., float] | None = None
    """Return the force along the cut, by which a rig estimates the tip: what is known, place of the blade [m], and the
    force along the blade [N]; None: that force."""
    learn: Callable[..., None] | None = None  # let what is expected follow an estimated tip
    # Fill the privileged features that the task adds to those of gentle cutting.
    hide: Callable[..., None] | None = None

    def __post_init__(self) -> None:
        if self.costs and not self.shown_as:
            raise ValueError(f"{self.place} has costs of the whole cut: give shown_as, the group of the info for them.")

    @cached_property
    def seen(self) -> Task:
        """Task that assesses by estimates of tip, runs and whole cut."""
        return self if not self.from_truth else replace(self, place=f"{self.place}.seen", from_truth=False)

    @cached_property
    def action_names(self) -> tuple[str, ...]:
        """Names of the numbers of an action."""
        return ("speed", "angle", *(() if self.axis is None else (self.axis.name,)))

    @cached_property
    def all_components(self) -> tuple[Component, ...]:
        """All components of the observation."""
        return (*COMPONENTS, *self.components)

    @cached_property
    def all_terms(self) -> tuple[str, ...]:
        """Names of all terms of the reward."""
        return (*TERMS, *(cost.name for cost in self.costs))

    @cached_property
    def ends(self) -> tuple[str, ...]:
        """Names of the ends by code; code 0: not ended."""
        return (*ENDS, self.end) if self.end else ENDS

    @cached_property
    def known(self) -> np.dtype[Any]:
        """Dtype of a rig's knowledge of a cut; empty with truth."""
        if self.from_truth:
            return NOTHING
        fields = [
            ("tip", ASSESSED_TIP, (1,)),
            ("motion", self.expected, (1,)),
            ("ways", "f8", (WAYS,)),
            ("late", "f8", (WRAP + 1,)),
        ]
        return np.dtype((np.record, fields))

    def counts(self, lanes: int) -> np.dtype[Any]:
        """Return the dtype of a step's counts for all lanes."""
        return np.dtype((np.record, [(name, "f8", (lanes,)) for name in self.counted]))

    @cached_property
    def episode(self) -> np.dtype[Any]:
        """Return the dtype of an episode as one record of (1,) arrays."""
        parts = {
            "tasks": TASK, "progresses": PROGRESS, "nominals": PROFILE, "specimens": SPECIMEN,
            "known": self.known, "wholes": self.whole,
            "infos": INFO,  # of the last step
            "counts": COUNT_ONE, "steps": self.counts(1),  # memory of the calls
        }  # fmt: skip
        totals = ("totals", "f8", (len(TERMS),))  # sum of the reward's terms since reset
        return np.dtype((np.record, [*((name, kind, (1,)) for name, kind in parts.items()), totals]))

    @cached_property
    def numbers(self) -> tuple[CutNumber, ...]:
        """Task's numbers in info: hidden state, then whole-cut errors."""
        return (*self.truth, *self.errors)

    def numbers_of(self, cuts: Cuts) -> tuple[dict[str, Any], dict[str, Any]]:
        """Return n cuts' hidden state and errors by name, each (n,)."""
        if not self.numbers:
            return {}, {}
        values = np.empty((len(self.numbers), len(cuts.states)))
        fill_numbers(self)(cuts.states, cuts.motions, cuts.wholes, cuts.tasks, cuts.progresses, values)
        split = len(self.truth)
        return (
            {one.name: value for one, value in zip(self.truth, values[:split], strict=True)},
            {one.name: value for one, value in zip(self.errors, values[split:], strict=True)},
        )

    def charges(self, wholes: StructArray, prefix: str = "term") -> dict[str, Any]:
        """Return whole-cut costs of the step, or "total", each (n,)."""
        return {cost.name: wholes[f"{prefix}_{cost.name}"] for cost in self.costs}


@compiled_for(njit_fused)
def charge(task: Task) -> Any:
    """Return the function that charges a step's costs by target length."""
    lines = []
    for cost in task.costs:
        value = expression(cost.value, task.quantities, {name: f"whole.{name}" for name in task.quantities[:-1]})
        lines += [
            f"before = whole.total_{cost.name}",
            f"whole.total_{cost.name} = 0.0 - whole.weight_{cost.name} * {value}",
            f"whole.term_{cost.name} = whole.total_{cost.name} - before",
        ]
    return fuse("charge", ["whole", "target"], lines, [quantities, __name__])


@compiled_for(njit_fused)
def terms(task: Task) -> Any:
    """Return the function that sums a step's whole-cut costs."""
    total = " + ".join(f"whole.term_{cost.name}" for cost in task.costs)
    return fuse("terms", ["whole"], [f"return {total}"], [__name__])


@compiled_for(njit_fused)
def compute_numbers(task: Task) -> Any:
    """Return the function that computes cut n's task numbers."""
    lines = [f"values[{k}, n] = {expression(one.value, OF_CUT)}" for k, one in enumerate(task.numbers)]
    return fuse("compute_numbers", [*OF_CUT, "values", "n"], lines, [__name__])


@compiled_for(njit)
def fill_numbers(task: Task) -> Callable[..., None]:
    """Return the function that computes a task's numbers of many cuts."""
    compute = compute_numbers(task)

    def fill_numbers(
        states: StructArray, motions: StructArray, wholes: StructArray, tasks: StructArray, progresses: StructArray,
        values: Array,
    ) -> None:  # fmt: skip
        """Fill ``values``, (numbers, n), with :attr:`Task.numbers` of n cuts."""
        for n in range(len(states)):
            compute(states[n], motions[n], wholes[n], tasks[n].target, progresses[n].tip, values, n)

    return fill_numbers


@compiled_for(njit_internal)
def command_of(task: Task) -> Callable[[float], float]:
    """Return the function that turns a third action, with a dead zone, into a command."""
    scale = 0.0 if task.axis is None else task.axis.scale

    def command(action: float) -> float:
        return scale * ((action - min(max(action, -DEAD_ZONE), DEAD_ZONE)) / (1.0 - DEAD_ZONE))

    return command


def whole_fields(costs: Sequence[WholeCutTerm]) -> list[tuple[str, str]]:
    """Return whole-cut fields: success, step costs, and costs since reset."""
    return [
        ("success", "i8"),
        *((f"term_{cost.name}", "f8") for cost in costs),
        *((f"total_{cost.name}", "f8") for cost in costs),
    ]


def observer(components: Sequence[Component], modules: Collection[str]) -> Any:
    """Return the function that fills a task's components by name."""
    lines = [
        f"observation[{number}] = min(max({one.name} / {one.scale!r}, {-CLIP}), {CLIP})"
        for number, one in enumerate(components, start=len(COMPONENTS))
    ]
    return njit_fused(fuse("fill", [*(one.name for one in components), "observation"], lines, [*modules, __name__]))


def settings_record(dtype: np.dtype[Any], constants: Any) -> StructArray:
    """Return a constants dataclass as a record, shape (1,)."""
    record = np.zeros(1, dtype)
    for name in type(constants).__dataclass_fields__:
        record[name] = getattr(constants, name)
    return record


GENTLE_CUT = Task(place=f"{__name__}:GENTLE_CUT", environment="cutenv/GentleCut-v1")
"""Gentle cutting to a target length."""
