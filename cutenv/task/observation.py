"""The observation: only what a rig can know, over a documented scale."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cutenv._base.arrays import Array, StructArray
from cutenv._base.validation import in_range
from cutenv._engine.declared import Formula
from cutenv._engine.jit import njit, njit_internal

T = TypeVar("T", float, Array)

SPEED_SCALE = 0.0254
"""Speed of action 1 [m/s]: the fastest measured."""
DEAD_ZONE = 0.1
"""Size of a speed action up to which the blade is to rest, so that noise about 0 does not move it."""
ANGLE_CENTRE, ANGLE_SCALE = math.radians(67.5), math.radians(22.5)
"""Angle of action 0, and the half range to 45 and 90 degrees [rad]."""
_MAX_PLAUSIBLE_SPEED = 0.5  # [m/s], above which a speed looks like cm/s
CLIP = 10.0
"""Bound to which observations are clipped in either direction."""


QUANTITIES = (
    "felt", "updates", "position", "speed", "angle", "depth", "time", "target", "deadline", "last_speed", "last_angle",
)  # fmt: skip
"""Quantities that a component is made of, in SI units: measured force, number of milliseconds of the step; position,
speed and angle of the blade, depth of cut there as measured beforehand; time since reset; target length and deadline of
the task; last action.  Those of a millisecond are in :data:`cutenv.task.reward.OF_MILLISECOND`."""


@dataclass(frozen=True, kw_only=True)
class Component:
    """One component of the observation: (value - offset) / scale, value in ``unit``.

    In its formulas ``total`` is what the milliseconds since the last decision add up to.
    """

    name: str
    meaning: str
    unit: str
    scale: float
    offset: float = 0.0
    value: Formula | None = None
    """Its value in ``unit``; None: the quantity of its name."""
    each: Formula | None = None
    """Summand of every millisecond."""
    fold: Formula | None = None
    """Next ``total`` at every millisecond, for what is not a sum."""
    start: float = 0.0
    """First ``total`` of a step."""


COMPONENTS = (
    Component(name="force", meaning="force now", unit="N", scale=5.0, value=lambda felt: felt),
    Component(
        name="force_mean",
        meaning="its mean since the last decision",
        unit="N",
        scale=5.0,
        each=lambda felt: felt,
        value=lambda total, updates: total / updates,
    ),
    Component(
        name="force_min",
        meaning="its minimum since the last decision",
        unit="N",
        scale=5.0,
        start=math.inf,
        fold=lambda total, felt: min(total, felt),
        value=lambda total: total,
    ),
    Component(
        name="force_max",
        meaning="its maximum since the last decision",
        unit="N",
        scale=5.0,
        start=-math.inf,
        fold=lambda total, felt: max(total, felt),
        value=lambda total: total,
    ),
    Component(name="position", meaning="blade, from the clamp", unit="m", scale=0.1),
    Component(name="speed", meaning="of the blade", unit="m/s", scale=SPEED_SCALE),
    Component(
        name="angle", meaning="of the blade; 90 degrees is upright", unit="rad", scale=ANGLE_SCALE, offset=ANGLE_CENTRE
    ),
    Component(name="depth", meaning="of cut at the blade, as measured beforehand", unit="m", scale=0.02),
    Component(
        name="distance",
        meaning="from blade to target",
        unit="m",
        scale=0.1,
        value=lambda target, position: target - position,
    ),
    Component(
        name="time_left",
        meaning="until the deadline",
        unit="s",
        scale=30.0,
        value=lambda deadline, time: deadline - time,
    ),
    Component(name="last_speed", meaning="last action: target speed", unit="1", scale=1.0),
    Component(name="last_angle", meaning="last action: target angle", unit="1", scale=1.0),
)
"""Components of the observation, in order."""
SCALES = np.array([component.scale for component in COMPONENTS])
OFFSETS = np.array([component.offset for component in COMPONENTS])


@njit_internal
def commanded_speed(action: T) -> T:
    """Return the speed [m/s] of an action, 0 in the dead zone, then linear."""
    speed: T = SPEED_SCALE * ((action - np.minimum(np.maximum(action, -DEAD_ZONE), DEAD_ZONE)) / (1.0 - DEAD_ZONE))
    return speed


@njit_internal
def speed_action(speed: T) -> T:
    """Return the action of a speed [m/s], inverting :func:`commanded_speed`."""
    action: T = np.sign(speed) * DEAD_ZONE + (1.0 - DEAD_ZONE) * (speed / SPEED_SCALE)
    return action


@njit
def within_reach(action: StructArray, fixed_angle: float) -> bool:
    """Clip an action to [-1, 1], set a fixed angle [rad] if any; return False for NaN."""
    for k in range(len(action)):
        if math.isnan(action[k]):
            return False
        action[k] = min(max(action[k], -1.0), 1.0)
    if not math.isnan(fixed_angle):
        action[1] = (fixed_angle - ANGLE_CENTRE) / ANGLE_SCALE
    return True


@njit
def all_within_reach(actions: StructArray, waiting: StructArray, fixed_angle: float) -> int:
    """Clip actions as :func:`within_reach`; return the first NaN of those not waiting, or -1."""
    numbers = actions.reshape(-1)
    missing = 0
    for k in range(len(numbers)):  # separate loops, so that they become vector instructions
        missing += 1 if math.isnan(numbers[k]) else 0
    for n in range(len(actions) if missing > 0 else 0):
        for k in range(actions.shape[1]):
            if not waiting[n] and math.isnan(actions[n, k]):
                return n
    for k in range(len(numbers)):
        numbers[k] = min(max(numbers[k], -1.0), 1.0)
    if not math.isnan(fixed_angle):
        for n in range(len(actions)):
            actions[n, 1] = (fixed_angle - ANGLE_CENTRE) / ANGLE_SCALE
    return -1


def in_units(observation: ArrayLike) -> dict[str, NDArray[np.float64]]:
    """Return observations, (..., 12), as named SI values, each (...)."""
    values = checked_observation(observation) * SCALES + OFFSETS
    return {component.name: values[..., k] for k, component in enumerate(COMPONENTS)}


def checked_observation(observation: ArrayLike) -> NDArray[np.floating[Any]]:
    """Return an observation, (..., 12); raise ValueError if invalid."""
    values = np.asarray(observation)
    if values.dtype != np.float32:
        values = np.asarray(observation, dtype=np.float64)
    if values.shape[-1:] != (len(COMPONENTS),):
        raise ValueError(f"observation has shape {values.shape}; its last axis must hold {len(COMPONENTS)} numbers.")
    if not np.isfinite(values).all():
        raise ValueError(f"observation = {values} must be finite; give it as the environment returned it.")
    return values


def to_action(speed: float, angle: float) -> NDArray[np.float32]:
    """Return a clipped action, (2,), for speed [m/s] and angle [rad]."""
    if not (abs(speed) <= _MAX_PLAUSIBLE_SPEED and 0.0 <= angle <= math.pi):
        in_range(
            "speed",
            speed,
            -_MAX_PLAUSIBLE_SPEED,
            _MAX_PLAUSIBLE_SPEED,
            "m/s",
            "Speeds are in m/s: 2.54 cm/s is 0.0254.",
        )
        in_range("angle", angle, 0.0, math.pi, "rad", "Angles are in radians: 90 degrees is 1.5708.")
    action = np.array([speed_action(speed), (angle - ANGLE_CENTRE) / ANGLE_SCALE], dtype=np.float32)
    return np.clip(action, -1.0, 1.0)
