"""Devices of a rig, and what a driver of your own needs."""

from cutenv.rig.devices.driver_registry import DriverKind, DriverTraits, Mounting, registered_drivers, rig_driver
from cutenv.rig.devices.loop import Clock, FakeClock, SystemClock
from cutenv.rig.devices.protocols import (
    DriveState,
    Event,
    ForceDriver,
    ForceListener,
    ForceSample,
    Latch,
    MotionDriver,
    MotionListener,
    MotionSample,
)
from cutenv.rig.errors import RigError

__all__ = [
    "Clock",
    "DriveState",
    "DriverKind",
    "DriverTraits",
    "Event",
    "FakeClock",
    "ForceDriver",
    "ForceListener",
    "ForceSample",
    "Latch",
    "MotionDriver",
    "MotionListener",
    "MotionSample",
    "Mounting",
    "RigError",
    "SystemClock",
    "registered_drivers",
    "rig_driver",
]
