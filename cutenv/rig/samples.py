"""What the drivers tell: one sample of an axis, one of the force sensor; SI and radians, in the clock's time."""

from __future__ import annotations

from collections import deque
from enum import Enum
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray


class DriveState(Enum):
    """State of a CiA 402 drive, as its statusword tells it."""

    NOT_READY = "not ready to switch on"
    DISABLED = "switch on disabled"
    READY = "ready to switch on"
    SWITCHED_ON = "switched on"
    ENABLED = "operation enabled"
    QUICK_STOP = "quick stop active"
    REACTING = "fault reaction active"
    FAULT = "fault"


class MotionSample(NamedTuple):
    """One axis at one instant.

    Attributes
    ----------
    time : float
        Of the clock, when it arrived [s].
    position, speed : float
        Of the blade along the cut from the clamp on [m], [m/s]; of the angle axis [rad], [rad/s].
    torque : float
        Of the motor, over its rated torque [1].
    state : DriveState
        Of the drive.
    """

    time: float
    position: float
    speed: float
    torque: float
    state: DriveState


class ForceSample(NamedTuple):
    """One reading of the six-axis sensor.

    Attributes
    ----------
    time : float
        Of the clock, when it arrived [s].
    force : tuple of 3 float
        In the sensor's axes, after tare [N].
    counts : tuple of 6 int
        As the sensor sent them: forces and torques.
    status : int
        Of the sensor; 0 is healthy.
    sequence : int
        Of the packet, counted by the sensor, modulo 2**32.
    lost : int
        Packets that are missing since the last sample.
    """

    time: float
    force: tuple[float, float, float]
    counts: tuple[int, int, int, int, int, int]
    status: int
    sequence: int
    lost: int


_Sample = TypeVar("_Sample", ForceSample, MotionSample)


def newest_since(samples: deque[_Sample], moment: float) -> list[_Sample]:
    """The newest of the samples, back to ``moment`` [s] and one more."""
    kept: list[_Sample] = []
    for sample in reversed(samples.copy()):  # a thread may add to it
        kept.append(sample)
        if sample.time < moment:
            break
    return kept[::-1]


def interpolated(
    time: NDArray[np.float64], samples: list[MotionSample]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Position and speed at times [s]: between samples on a line, beyond the last one at its speed."""
    if not samples:
        return np.zeros_like(time), np.zeros_like(time)
    times = np.array([sample.time for sample in samples])
    speed = np.interp(time, times, [sample.speed for sample in samples])
    position = np.interp(time, times, [sample.position for sample in samples])
    return position + samples[-1].speed * np.maximum(time - times[-1], 0.0), speed
