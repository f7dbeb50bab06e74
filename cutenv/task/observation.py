"""The observation: only quantities that a rig can know, each divided by a documented scale."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cutenv._base.arrays import Struct, StructArray
from cutenv._base.validation import in_range
from cutenv._engine.jit import njit, njit_internal
from cutenv.cutting.law import depth_at

SPEED_SCALE = 0.0254
"""Speed of action 1 [m/s]: the fastest measured."""
ANGLE_CENTRE, ANGLE_SCALE = math.radians(67.5), math.radians(22.5)
"""Angle of action 0, and the half range to 45 and 90 degrees [rad]."""
_FASTEST = 0.5  # [m/s], above which a speed looks like cm/s
CLIP = 10.0
"""Bound to which observations are clipped in either direction."""


@dataclass(frozen=True)
class Component:
    """One component of the observation: (value - offset) / scale, value in ``unit``."""

    name: str
    meaning: str
    unit: str
    scale: float
    offset: float = 0.0


COMPONENTS = (
    Component("force", "force now", "N", 5.0),
    Component("force_mean", "its mean since the last decision", "N", 5.0),
    Component("force_min", "its minimum since the last decision", "N", 5.0),
    Component("force_max", "its maximum since the last decision", "N", 5.0),
    Component("position", "blade, from the clamp", "m", 0.1),
    Component("speed", "of the blade", "m/s", SPEED_SCALE),
    Component("angle", "of the blade; 90 degrees is upright", "rad", ANGLE_SCALE, ANGLE_CENTRE),
    Component("depth", "of cut at the blade, as measured beforehand", "m", 0.02),
    Component("distance", "from blade to target", "m", 0.1),
    Component("time_left", "until the deadline", "s", 30.0),
    Component("last_speed", "last action: target speed", "1", 1.0),
    Component("last_angle", "last action: target angle", "1", 1.0),
)
"""Components of the observation, in order."""

SCALES = np.array([component.scale for component in COMPONENTS])
OFFSETS = np.array([component.offset for component in COMPONENTS])


@njit_internal
def observe(
    task: Struct,
    measured: Struct,
    readings: StructArray,
    time: float,
    last_action: StructArray,
    observation: StructArray,
) -> None:
    """Fill ``observation``, shape (12,) float32, from the readings since the last decision.

    ``measured`` is the profile with the depth measured beforehand; ``time`` is since reset [s].
    """
    low = high = readings[0].force
    total = 0.0
    for i in range(len(readings)):
        total += readings[i].force
        low = min(low, readings[i].force)
        high = max(high, readings[i].force)
    last = readings[len(readings) - 1]
    fill(
        task, measured, last.force, total / len(readings), low, high, last.position, last.speed, last.angle, time,
        last_action[0], last_action[1], observation,
    )  # fmt: skip


@njit_internal
def fill(
    task: Struct,
    measured: Struct,
    force: float,
    mean: float,
    low: float,
    high: float,
    position: float,
    speed: float,
    angle: float,
    time: float,
    last_speed: float,
    last_angle: float,
    observation: StructArray,
) -> None:
    """Fill ``observation`` from values in SI units: scaled, then clipped to :data:`CLIP`."""
    values = (
        force,
        mean,
        low,
        high,
        position,
        speed,
        angle,
        depth_at(measured, position),
        task.target - position,
        task.deadline - time,
        last_speed,
        last_angle,
    )
    for k in range(len(values)):
        observation[k] = min(max((values[k] - OFFSETS[k]) / SCALES[k], -CLIP), CLIP)


@njit
def within_reach(action: StructArray, fixed_angle: float) -> bool:
    """Clip an action, shape (2,), to [-1, 1], or fix its angle [rad] (NaN: free); return False if it has a NaN."""
    for k in range(2):
        if math.isnan(action[k]):
            return False
        action[k] = min(max(action[k], -1.0), 1.0)
    if not math.isnan(fixed_angle):
        action[1] = (fixed_angle - ANGLE_CENTRE) / ANGLE_SCALE
    return True


@njit
def all_within_reach(actions: StructArray, waiting: StructArray, fixed_angle: float) -> int:
    """Clip actions, shape (n, 2), like :func:`within_reach`, not waiting ones; return the first with NaN, or -1."""
    numbers = actions.reshape(-1)
    missing = 0
    for k in range(len(numbers)):  # separate loops, so that they become vector instructions
        missing += 1 if math.isnan(numbers[k]) else 0
    for n in range(len(actions) if missing > 0 else 0):
        if not waiting[n] and (math.isnan(actions[n, 0]) or math.isnan(actions[n, 1])):
            return n
    for k in range(len(numbers)):
        numbers[k] = min(max(numbers[k], -1.0), 1.0)
    if not math.isnan(fixed_angle):
        for n in range(len(actions)):
            actions[n, 1] = (fixed_angle - ANGLE_CENTRE) / ANGLE_SCALE
    return -1


def in_units(observation: ArrayLike) -> dict[str, NDArray[np.float64]]:
    """Return an observation (shape (..., 12)) as named values in SI units, each of shape (...)."""
    values = checked_observation(observation) * SCALES + OFFSETS
    return {component.name: values[..., k] for k, component in enumerate(COMPONENTS)}


def checked_observation(observation: ArrayLike) -> NDArray[np.floating[Any]]:
    """Return an observation, shape (..., 12), float32 if it is; raise ValueError unless shape and numbers are valid."""
    values = np.asarray(observation)
    if values.dtype != np.float32:
        values = np.asarray(observation, dtype=np.float64)
    if values.shape[-1:] != (len(COMPONENTS),):
        raise ValueError(f"observation has shape {values.shape}; its last axis must hold {len(COMPONENTS)} numbers.")
    if not np.isfinite(values).all():
        raise ValueError(f"observation = {values} must be finite; give it as the environment returned it.")
    return values


def to_action(speed: float, angle: float) -> NDArray[np.float32]:
    """Return the action, shape (2,) float32 in [-1, 1], for a speed [m/s] and an angle [rad]; clipped to the range."""
    if not (abs(speed) <= _FASTEST and 0.0 <= angle <= math.pi):
        in_range("speed", speed, -_FASTEST, _FASTEST, "m/s", "Speeds are in m/s: 2.54 cm/s is 0.0254.")
        in_range("angle", angle, 0.0, math.pi, "rad", "Angles are in radians: 90 degrees is 1.5708.")
    action = np.array([speed / SPEED_SCALE, (angle - ANGLE_CENTRE) / ANGLE_SCALE], dtype=np.float32)
    return np.clip(action, -1.0, 1.0)
