"""Samples that the drivers report: one of an axis, one of the force sensor; SI and radians, in the clock's time."""

from __future__ import annotations

from collections import deque
from enum import Enum
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray


class DriveState(Enum):
    """State of a CiA 402 drive, as in its statusword."""

    NOT_READY = "not ready to switch on"
    DISABLED = "switch on disabled"
    READY = "ready to switch on"
    SWITCHED_ON = "switched on"
    ENABLED = "operation enabled"
    QUICK_STOP = "quick stop active"
    REACTING = "fault reaction active"
    FAULT = "fault"


class MotionSample(NamedTuple):
    """State of one axis at one instant.

    Attributes
    ----------
    time : float
        Arrival on the clock [s].
    position, speed : float
        Position from the clamp [m] and speed [m/s] of the blade along the cut; of the angle axis [rad], [rad/s]; of the
        height axis [m], [m/s], upwards; of that to the side, to the left.
    torque : float
        Torque of the motor over its rated torque [1].
    state : DriveState
        State of the drive.
    """

    time: float
    position: float
    speed: float
    torque: float
    state: DriveState


class ForceSample(NamedTuple):
    """Reading of the six-axis sensor.

    Attributes
    ----------
    time : float
        Arrival on the clock [s].
    force : tuple of 3 float
        Force in the sensor's axes, after tare [N].
    counts : tuple of 6 int
        Forces and torques as the sensor sent them.
    status : int
        Status of the sensor; 0 is healthy.
    sequence : int
        Number of the packet, counted by the sensor modulo 2**32.
    lost : int
        Number of packets missing since the last sample.
    torque : tuple of 3 float
        Torque in the sensor's axes, after tare [N m].
    """

    time: float
    force: tuple[float, float, float]
    counts: tuple[int, int, int, int, int, int]
    status: int
    sequence: int
    lost: int
    torque: tuple[float, float, float] = (0.0, 0.0, 0.0)


_Sample = TypeVar("_Sample", ForceSample, MotionSample)


def newest_since(samples: deque[_Sample], moment: float) -> list[_Sample]:
    """Return the samples from the last one before ``moment`` [s] to the newest."""
    kept: list[_Sample] = []
    for sample in reversed(samples.copy()):  # a thread may add to it meanwhile
        kept.append(sample)
        if sample.time < moment:
            break
    return kept[::-1]


def interpolated(
    time: NDArray[np.float64], samples: list[MotionSample]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return position and speed at times [s]: linear between samples, at constant speed after the last one."""
    if not samples:
        return np.zeros_like(time), np.zeros_like(time)
    times = np.array([sample.time for sample in samples])
    speed = np.interp(time, times, [sample.speed for sample in samples])
    position = np.interp(time, times, [sample.position for sample in samples])
    return position + samples[-1].speed * np.maximum(time - times[-1], 0.0), speed
