"""What the drivers tell: one sample of an axis, one of the force sensor; SI and radians, in the clock's time."""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple


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
