"""Demonstrations: cuts decision by decision, and infos of tasks.

A demonstration is by a policy in the simulator, or by a person as recorded.

A person commands no speed.  The action is then the motion of the blade until the next decision: its mean speed and its
angle at the end, which a rig that holds position can be commanded.  The reward is the one computed on a rig, from
estimates of the tip.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import gymnasium
import numpy as np

from cutenv.agents.policy import Policy, PrivilegedPolicy
from cutenv.sim.cutting.dtypes import TICK
from cutenv.sim.plant import ReplayPlant
from cutenv.sim.tissue.description import measured_liver
from cutenv.sim.tissue.grid import depth_below
from cutenv.sim.trace import Trace
from cutenv.task.episode import Episode, Goal
from cutenv.task.observation import COMPONENTS, SPEED_SCALE, to_action
from cutenv.task.registry import task_made_as


class AddedInfos(NamedTuple):
    """Infos that the data sets of one task add."""

    felt: Mapping[str, str]  # meaning of what is observed, by name with unit
    shown: tuple[str, ...]  # components of the observation that these are, in order
    hidden: Mapping[str, str]  # meaning of what only the simulator knows, by its name in ``info["truth"]``

    @property
    def meanings(self) -> dict[str, str]:
        """All meanings by name."""
        return {**self.felt, **self.hidden}


DEPTH_INFOS = AddedInfos(
    felt={
        "vertical_force_N": "measured vertical force at the decision, upwards",
        "blade_depth_m": "blade's lower end below the surface, as measured before the cut",
        "wanted_depth_m": "wanted depth at the blade",
    },
    shown=("vertical", "blade_depth", "wanted"),
    hidden={"floor_depth_m": "depth of the cut at the tip", "layer_m": "depth of the layer below"},
)
"""Added infos of cuts along a wanted depth."""
PATH_INFOS = AddedInfos(
    felt={
        "lateral_force_N": "measured force on the blade to its right, at the decision",
        "line_aside_m": "line to the left of the blade",
        "line_direction": "sine of the turn from blade to line, to the left",
        "line_bend_1_m": "curvature of the line at the blade, to the left",
    },
    shown=("lateral", "aside", "direction", "bend"),
    hidden={
        "blade_x_m": "place of the blade along the slab",
        "blade_y_m": "place of the blade across the slab, to the left",
        "tip_x_m": "place of the crack tip along the slab",
        "tip_y_m": "place of the crack tip across the slab, to the left",
        "aside_m": "distance of the tip to the left of the line, where the crack last turned",
    },
)
"""Added infos of cuts along a line."""
_NONE = AddedInfos(felt={}, shown=(), hidden={})


def infos_of(environment: str) -> AddedInfos:
    """Return the infos that an environment's data sets add, if any."""
    return task_made_as(environment).infos or _NONE


def added_infos(environment: str, observation: np.ndarray, info: Mapping[str, Any]) -> dict[str, float]:
    """Return the added infos of one decision, if any."""
    added, components = infos_of(environment), task_made_as(environment).task.all_components
    if added is _NONE:
        return {}
    seen = {one.name: value * one.scale for one, value in zip(components, observation.tolist(), strict=True)}
    felt = zip(added.felt, added.shown, strict=True)
    assert not {one.name for one in COMPONENTS}.intersection(added.shown), "an offset would be missing"
    return {name: seen[component] for name, component in felt} | {name: info["truth"][name] for name in added.hidden}


_REST = 1e-6  # [m/s], below which a recorded blade rests: its noise must not become an action beyond the dead zone

FELT = {
    "time_s": "time since the cut began",
    "force_N": "measured force at the decision",
    "force_mean_N": "mean force since the last decision",
    "force_min_N": "least force since the last decision",
    "force_max_N": "greatest force since the last decision",
    "position_m": "position of the blade, from the clamp",
    "speed_m_s": "speed of the blade",
    "angle_deg": "angle of the blade; 90 is upright",
    "depth_m": "depth of cut at the blade, measured before the cut",
    "is_success": "1 where the cut has ended with success",
}
"""Infos of every data set, at every observation, the first included."""
HIDDEN = {
    "tip_m": "crack tip, which only the simulator knows",
    "true_force_N": "force on the blade at the decision, without noise, resolution and delay of the sensor",
}
"""Further infos of a simulated cut."""
INTERVENED = {"is_intervention": "1 where a person led the blade since the last decision"}
"""Further infos of a cut under :class:`cutenv.envs.SharedControl`."""
ESTIMATED = {"tip_estimate_m": "crack tip, as a rig estimates it from the force"}  # further infos of a recorded cut


@dataclass(frozen=True, kw_only=True)
class Demonstration:
    """A cut of n decisions."""

    observations: np.ndarray  # observations as the environment returned them, or would have, shape (n + 1, 12)
    actions: np.ndarray  # actions in [-1, 1], shape (n, 2)
    rewards: np.ndarray  # rewards of the decisions, shape (n,)
    terminated: bool  # True if the cut reached one of the task's ends; False if the record ended before
    infos: dict[str, np.ndarray]  # :data:`FELT` and :data:`HIDDEN` or :data:`ESTIMATED`, shape (n + 1,)
    seed: int | None  # seed with which the environment's ``reset`` draws the same specimen; None for a recorded cut
    about: dict[str, Any]  # facts about this cut: target length, and the record's metadata


class _Steps:
    """Decisions of a cut so far, with initial observation and infos."""

    def __init__(self, observation: np.ndarray, info: dict[str, float]) -> None:
        self._observations, self._infos = [observation], [info]
        self.actions: list[np.ndarray] = []
        self._rewards: list[float] = []

    def add(self, action: np.ndarray, reward: float, observation: np.ndarray, info: dict[str, float]) -> None:
        """Add a decision, and what came of it."""
        self.actions.append(action)
        self._rewards.append(reward)
        self._observations.append(observation)
        self._infos.append(info)

    def mark_led(self, times: list[tuple[float, float]], seconds: float) -> None:
        """Mark decisions, each of ``seconds``, in which a person led."""
        for k, info in enumerate(self._infos):
            begins, ends = (k - 1) * seconds, k * seconds
            info["is_intervention"] = float(k > 0 and any(since < ends and until > begins for since, until in times))

    def joined(self, *, terminated: bool, about: dict[str, Any], seed: int | None = None) -> Demonstration:
        """Return the cut."""
        infos = self._infos
        return Demonstration(
            observations=np.stack(self._observations),
            actions=np.stack(self.actions),
            rewards=np.array(self._rewards),
            terminated=terminated,
            infos={name: np.array([info[name] for info in infos], dtype=np.float64) for name in infos[0]},
            seed=seed,
            about=about,
        )


def simulated(env: gymnasium.Env[Any, Any], policy: Policy, seed: int) -> Demonstration:
    """Let a policy cut the specimen of ``seed``.

    Under shared control the actions are those carried out.
    """
    observation, info = env.reset(seed=seed)
    policy.reset(np.random.default_rng(seed))
    cutting = env.unwrapped.cutting  # type: ignore[attr-defined]
    if isinstance(policy, PrivilegedPolicy):
        policy.set_state(cutting)
    tip = {"tip_m": info["truth"]["tip_m"], "true_force_N": 0.0}
    start = felt_at_rest(cutting, env.unwrapped.start_angle)  # type: ignore[attr-defined]
    task = "" if env.spec is None else env.spec.id
    steps = _Steps(observation, start | tip | added_infos(task, observation, info) | _intervened(info))
    ended = False
    while not ended:
        action = policy(observation)
        observation, reward, ended, _, info = env.step(action)
        tip = {"tip_m": info["truth"]["tip_m"], "true_force_N": cutting.readings["true_force"][-1]}
        seen = felt_now(cutting) | tip | added_infos(task, observation, info) | _intervened(info)
        steps.add(info.get("action", action), float(reward), observation, seen)
    target = info["truth"]["target_length_m"]
    return steps.joined(terminated=True, seed=seed, about={"target_length_m": target})


def _intervened(info: dict[str, Any]) -> dict[str, float]:
    """Return :data:`INTERVENED`; nothing without shared control."""
    return {"is_intervention": float(info["is_intervention"])} if "is_intervention" in info else {}


def recorded(
    trace: Trace, *, control_hz: int, target_length: float | None = None, deadline: float = 30.0
) -> Demonstration:
    """Make a demonstration of a record, noting who led if shared.

    The record has force in newtons, position, angle and depth, from the clamp on; ``control_hz`` divides 1000;
    ``target_length`` [m] is for one without ``target_length_m``; ``deadline`` is in seconds.

    Raises ValueError if the record lacks a field for the observation (the message names it), has too few readings, or
    has no target.
    """
    plant = ReplayPlant(trace)
    ticks, readings = round(1.0 / (TICK * control_hz)), plant.readings
    if trace.sample_rate < control_hz:
        raise ValueError(
            f"control_hz = {control_hz} is more than the record's {trace.sample_rate:.0f} readings a second. "
            "Give fewer decisions."
        )
    cutting = _task(plant, trace.metadata.get("target_length_m", target_length), deadline, ticks)
    start = float(readings["angle"][0])
    steps = _Steps(cutting.rest(start), felt_at_rest(cutting, start) | {"tip_estimate_m": 0.0})
    beyond = 0
    while not cutting.end and plant.left >= ticks:
        done = len(steps.actions) * ticks
        last = readings[done + ticks - 1]
        speed = float(last["position"] - readings["position"][max(done - 1, 0)]) / (ticks * TICK)
        beyond += abs(speed) > SPEED_SCALE
        speed = 0.0 if abs(speed) < _REST else speed
        action = to_action(min(max(speed, -SPEED_SCALE), SPEED_SCALE), float(last["angle"]))
        observation, reward = cutting.step(action.astype(np.float64))
        steps.add(action, reward, observation, felt_now(cutting) | {"tip_estimate_m": cutting.tip})
    if not steps.actions:
        raise ValueError(f"the record lasts {trace.duration:g} s, less than a decision. Give more decisions a second.")
    if "person_led_s" in trace.metadata:
        steps.mark_led(_times_led(trace.metadata["person_led_s"]), ticks * TICK)
    about = {key: value for key, value in trace.metadata.items() if isinstance(value, (str, int, float, bool))}
    about |= {"target_length_m": cutting.target_length, "faster_than_reach": beyond / len(steps.actions)}
    return steps.joined(terminated=bool(cutting.end), about=about)


def _task(plant: ReplayPlant, target_length: float | None, deadline: float, ticks: int) -> Episode:
    """Make the environment's task with ``reward_from="estimate"``, on a record."""
    if target_length is None:
        raise ValueError("the record has no target_length_m, which observation and reward need. Give --target-length.")
    tissue = measured_liver()
    goal = Goal(
        tissue=tissue,
        friction_per_depth=tissue.nominal_friction_per_depth,
        target_length=float(target_length),
        deadline=deadline,
        ticks=ticks,
    )
    return Episode(plant, goal)


def _times_led(told: Any) -> list[tuple[float, float]]:
    """Return the times in which a person led [s] from metadata."""
    try:
        return [(float(since), float(until)) for since, until in told]
    except (TypeError, ValueError):
        raise ValueError(
            f"the record's person_led_s = {told!r} must be a list of pairs of seconds, such as [[1.0, 2.5]]."
        ) from None


def felt_at_rest(cutting: Episode, angle: float) -> dict[str, float]:
    """Return infos of :data:`FELT` at rest at the clamp, force tared."""
    return dict.fromkeys(FELT, 0.0) | {"angle_deg": math.degrees(angle), "depth_m": float(cutting.plant.depth[0])}


def felt_now(cutting: Episode) -> dict[str, float]:
    """Return the infos of :data:`FELT` after a decision."""
    readings = cutting.readings
    assert readings is not None  # a decision was made
    force, last = readings["force"], readings[-1]
    values = (
        cutting.time,
        last["force"],
        force.mean(),
        force.min(),
        force.max(),
        last["position"],
        last["speed"],
        math.degrees(last["angle"]),
        depth_below(cutting.plant.depth, last["position"]),
        bool(cutting.end) and cutting.success,
    )
    return dict(zip(FELT, map(float, values), strict=True))
