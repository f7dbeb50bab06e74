"""Milliseconds of a cut that a hand leads, compiled for Python and browser."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np

from cutenv._base.arrays import Array, Struct, StructArray
from cutenv._engine.declared import Declaration, compiled_for
from cutenv._engine.jit import njit, njit_inline
from cutenv.envs.depth_cut import DepthCutEnv
from cutenv.envs.path_cut import PathCutEnv
from cutenv.people.play.hand_led_cut import HandLedCut
from cutenv.people.play.hand_model import PLAYED_HAND, descent_toward, speed_over, steered_toward
from cutenv.records.scoring.cut_map import LINE_KEY
from cutenv.sim.cutting.drive import Hand
from cutenv.sim.cutting.dtypes import READING, TICK
from cutenv.sim.cutting.motion import NOTHING
from cutenv.sim.plant.protocol import recorded_trace
from cutenv.sim.tissue.drawn_lines import kind_of
from cutenv.sim.tissue.slab import SLAB
from cutenv.sim.trace import Trace
from cutenv.task.declare import GENTLE_CUT, OneCut, Task
from cutenv.task.depth import DEPTH_CUT
from cutenv.task.observation import ANGLE_CENTRE, ANGLE_SCALE, SPEED_SCALE, speed_action
from cutenv.task.path import PATH_CUT, TURN_SCALE
from cutenv.task.stepper import step_one

_LATERAL = [each.name for each in PATH_CUT.all_components].index("lateral")
_NEWTONS = PATH_CUT.all_components[_LATERAL].scale


class LeadingHand(NamedTuple):
    """Constants of the hand that leads a cut."""

    lag: float
    """[s]."""
    acceleration: float
    """[m/s2]."""
    start: float
    """Level of the blade at the start [m]."""


@njit_inline
def lead_along(cut: Struct, stylus: Array, hand: LeadingHand, actions: Array) -> None:
    """Fill an action with that of a hand along the cut."""
    actions[0] = speed_action(speed_over(stylus[0] - cut.states[0].hand, hand.lag, hand.acceleration))


@njit_inline
def lead_deep(cut: Struct, stylus: Array, hand: LeadingHand, actions: Array) -> None:
    """Fill an action with the hand's, including the blade's level [m]."""
    lead_along(cut, stylus, hand, actions)
    actions[2] = descent_toward(cut.motions[0].level, hand.start + stylus[2])


@njit_inline
def lead_in_plane(cut: Struct, stylus: Array, hand: LeadingHand, actions: Array) -> None:
    """Fill an action with that of a hand over the slab."""
    speed, turn = steered_toward(cut.states[0], cut.motions[0], (stylus[0], stylus[2]), hand.lag, hand.acceleration)
    actions[0], actions[2] = speed_action(speed), speed_action(turn * (SPEED_SCALE / TURN_SCALE))


@njit_inline
def note_level(cut: Struct, across: float, observation: StructArray, channels: Array, i: int) -> None:
    """Note level of the blade [m] and vertical force [N]."""
    channels[0, i], channels[1, i] = cut.motions[0].level, across


@njit_inline
def note_place(cut: Struct, across: float, observation: StructArray, channels: Array, i: int) -> None:
    """Note the blade's place [m] and measured lateral force [N]."""
    channels[0, i], channels[1, i] = cut.states[0].blade + cut.motions[0].east, cut.motions[0].north
    channels[2, i] = _NEWTONS * float(observation[_LATERAL])


@dataclass(frozen=True, kw_only=True, eq=False)
class LedTask(Declaration):
    """A task that a hand leads."""

    place: str
    """Module and name of this object, "package.module:NAME"."""
    task: Task
    lead: Callable[..., None]
    """Fill speed and third action: takes the cut, numbers of the stylus, the hand, an action."""
    note: Callable[..., None] | None = None
    """Note further channels of a record at a reading."""


LED_ALONG = LedTask(place=f"{__name__}:LED_ALONG", task=GENTLE_CUT, lead=lead_along)
LED_DEEP = LedTask(place=f"{__name__}:LED_DEEP", task=DEPTH_CUT, lead=lead_deep, note=note_level)
LED_IN_PLANE = LedTask(place=f"{__name__}:LED_IN_PLANE", task=PATH_CUT, lead=lead_in_plane, note=note_place)


@compiled_for(njit)
def follow_hand(led: LedTask) -> Callable[..., int]:
    """Return the function that advances a cut under a hand."""
    step, lead, note, numbers = step_one(led.task), led.lead, led.note, len(led.task.action_names)

    def follow_hand(
        one: OneCut,
        stylus: Array,
        hand: LeadingHand,
        memory: tuple[Array, StructArray, Array],
        filled: tuple[StructArray, Array, Array],
    ) -> int:
        """Advance one cut a millisecond per stylus row; return their number.

        A row of ``stylus`` is the wanted position of the hand [m], angle of the blade [rad], level above ``start`` or
        place across [m]. The memory is that of the calls: action, observation, force across the cut. Filled up to the
        end are readings, further channels of a record, and the outcome: index of the end in
        :attr:`~cutenv.task.declare.Task.ends`, 0 before it; 1 for a success.
        """
        actions, observations, across = memory
        readings, channels, outcome = filled
        done = end = 0
        ticks = np.int64(1)  # as Python gives it: the step would be compiled again for a number that is known
        for i in range(len(stylus)):
            lead(one.cut[0], stylus[i], hand, actions[0])
            actions[0, 1] = (stylus[i, 1] - ANGLE_CENTRE) / ANGLE_SCALE
            for k in range(numbers):  # an action is of single precision, as an agent's
                actions[0, k] = min(max(float(np.float32(actions[0, k])), -1.0), 1.0)
            done = i + 1
            end = step(one.cut, one.shared, one.episode, ticks, actions[0], observations[0], readings[i:done], across)[
                1
            ]
            if note is not None:
                note(one.cut[0], across[0], observations[0], channels, i)
            if end != 0:
                break
        outcome[0] = end
        outcome[1] = 1.0 if end != 0 and one.episode[0].wholes[0].success == 1 else 0.0
        return done

    return follow_hand


class HandCut(HandLedCut):
    """Cut by a given hand motion, in Python, as the page simulates.

    It is the cut of :class:`cutenv.people.play.PlayedCut` with the same key, without its window's needs.

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

    led: ClassVar[LedTask] = LED_ALONG
    """Its task, and how the hand leads it."""
    channel_fields: ClassVar[tuple[str, ...]] = ()
    """Fields of a trace that its law fills besides the readings."""
    shared: ClassVar[np.dtype[Any]] = NOTHING
    """Part of what all cuts of the task share that its law needs."""

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
        numbers, components = len(self.led.task.action_names), len(self.led.task.all_components)
        self._memory = np.zeros((1, numbers)), np.zeros((1, components), np.float32), np.zeros(1)
        self._channels: list[Array] = []

    @property
    def cuts(self) -> StructArray:
        """State of tissue, blade, drive and sensor, :attr:`~cutenv.sim.cutting.motion.Motion.cut`, shape (1,)."""
        return self._env.plant.cuts

    @property
    def episodes(self) -> StructArray:
        """State of the task, :attr:`~cutenv.task.declare.Task.episode`, shape (1,)."""
        return self._env.cutting.record

    @property
    def records(self) -> dict[str, StructArray]:
        """State records by name in the law's order, each of shape (1,)."""
        return {"cut": self.cuts, "episode": self.episodes}

    @property
    def facts(self) -> dict[str, Any]:
        """Record metadata known at the start: wanted depth or line."""
        return {}

    @property
    def channels(self) -> Array:
        """Trace fields of :attr:`channel_fields` at every reading, shape (k, n)."""
        return np.concatenate([np.zeros((len(self.channel_fields), 0)), *self._channels], axis=1)

    @property
    def measured_depth(self) -> Array:
        """Depth of cut measured beforehand along the line [m], shape (301,)."""
        return self._env.plant.depth

    @property
    def noted(self) -> dict[str, Any]:
        """Record metadata of tasks other than gentle cutting: environment, errors, map."""
        noted: dict[str, Any] = self.cutting.noted_map
        return noted and {"environment": self.led.task.environment, **noted}

    def follow(self, stylus: Any) -> StructArray:
        """Advance a millisecond per ``stylus`` row until the end; return readings.

        Parameters
        ----------
        stylus : array_like, shape (n, 2)
            Wanted position of the hand, from the clamp [m], and angle of the blade [rad].
        """
        # A copy, for an array that cannot be written to would have the step compiled again.
        places = np.array(stylus, np.float64, order="C").reshape(-1, len(self.led.task.action_names))
        readings, outcome = np.zeros((len(places), 1), READING), np.zeros(2)
        if self.end:
            return readings[:0, 0]
        channels = np.zeros((len(self.channel_fields), len(places)))
        done: int = follow_hand(self.led)(
            OneCut(self.cuts, self.cutting.shared, self.episodes), places,
            LeadingHand(self.hand.motor_lag, self.hand.acceleration, self._start), self._memory,
            (readings, channels, outcome),
        )  # fmt: skip
        self._channels.append(channels[:, :done])
        self.end, self.success = self.led.task.ends[int(outcome[0])], bool(outcome[1])
        return readings[:done, 0]

    def trace(self, readings: StructArray, **metadata: object) -> Trace:
        """Return all readings of this cut as a rig's trace, shape (n,).

        Raises ValueError if there are fewer than two.
        """
        trace = recorded_trace(readings, self.measured_depth, **metadata)
        channels = zip(self.channel_fields, self.channels.copy(), strict=True)
        return dataclasses.replace(trace, **dict(channels))


class HandDepthCut(HandCut):
    """Cut by a person's hand along a wanted depth.

    Its third number is the level above that at the start [m].
    """

    environment = DepthCutEnv
    led = LED_DEEP
    shared = np.dtype((np.record, [("slab", [(name, SLAB[name]) for name in ("ratio", "share")], (1,))]))
    channel_fields = ("height", "vertical_force")
    third = "level"

    def __init__(self, **keywords: Any) -> None:
        super().__init__(**keywords)
        self._start = self.level

    @property
    def facts(self) -> dict[str, Any]:
        """Wanted depth and layer below, by key of a record's metadata."""
        facts: dict[str, Any] = self.cutting.given_depth
        return facts


class HandPathCut(HandCut):
    """Cut by a person's hand along a drawn line.

    Its third number is the place across, to the left [m]. The line is a kind, as of
    :class:`~cutenv.envs.path_cut.PathCutEnv`.
    """

    environment = PathCutEnv
    led = LED_IN_PLANE
    channel_fields = ("blade_x", "blade_y", "lateral_force")
    third = "across"

    def __init__(self, *, line: str = "mixed", **keywords: Any) -> None:
        super().__init__(line=line, **keywords)

    @property
    def facts(self) -> dict[str, Any]:
        """Line to cut along, by key of a record's metadata."""
        return {LINE_KEY: self.cutting.noted_map[LINE_KEY]}

    @property
    def noted(self) -> dict[str, Any]:
        """Record metadata of this cut: environment, kind of line, errors, map."""
        line = kind_of(int(self.cutting.whole["line"][0]))
        return {"environment": PATH_CUT.environment, "line": line, **self.cutting.noted_map}
