"""Dry run: every command of a fake rig, shown as the frame that a CANopen drive would receive."""

from __future__ import annotations

import math
from collections.abc import Callable

from cutenv.rig.config.settings import RigSettings
from cutenv.rig.devices.canopen.objects import ENABLE_OPERATION, command_frame
from cutenv.rig.devices.canopen.units import AxisUnits
from cutenv.rig.devices.driver_registry import axes_driven_by

_STEPS = 1000  # milli-rpm, which the axis asks its drive for


class Transcript:
    """Listing of commands, one a line: time, axis, speed, CAN frame if it has one. Repetitions are only counted.

    Parameters
    ----------
    settings : RigSettings
        Gear, lead, encoder and node of each axis.
    start : float
        Time shown as zero [s].
    write : callable
        Called with each line.
    """

    def __init__(self, settings: RigSettings, start: float, write: Callable[[str], None]) -> None:
        self._axes = settings.axes
        canopen = axes_driven_by(settings, "canopen")  # other drivers have no frame to show
        self._units = {name: AxisUnits(axis=axis, steps=_STEPS) for name, axis in canopen.items()}
        self._start, self._write = start, write
        self._last: dict[str, tuple[float, int]] = {}

    def heard(self, time: float, axis: str, speed: float) -> None:
        """Take a command at ``time`` [s] to an axis, speed in m/s or rad/s."""
        last, count = self._last.get(axis, (math.nan, 0))
        if speed == last:
            self._last[axis] = last, count + 1
            return
        self._last[axis] = speed, 1
        frame = ""
        if axis in self._units:
            number, data = command_frame(self._axes[axis].node, ENABLE_OPERATION, self._units[axis].velocity(speed))
            frame = f"  {number:03X}#{data.hex(' ').upper()}"
        shown = f"{1e3 * speed:+8.3f} mm/s" if axis != "angle" else f"{math.degrees(speed):+8.2f} deg/s"
        again = f"   (the one before {count} times)" if count > 1 else ""
        self._write(f"{time - self._start:8.3f} s  {axis:<6}{shown}{frame}{again}")

    def note(self, text: str) -> None:
        """Write a line of text."""
        self._write(f"-- {text}")
