"""Drivers of an emulated rig for attacks, loaded by the spine's process: each misbehaves as it is ordered to."""

from __future__ import annotations

import ctypes
import math
import mmap
import os
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

from cutenv.rig.devices.canopen.axis import CanopenAxis
from cutenv.rig.devices.canopen.network import DRIVE_PATIENCE, CanNetwork
from cutenv.rig.devices.driver_registry import Mounting, rig_driver
from cutenv.rig.devices.netft_sensor import NetftSensor
from cutenv.rig.devices.protocols import ForceListener, ForceSample, MotionSample

ORDERS = "CUTENV_ATTACK"  # variable with the name of the file of Orders
_LENGTH = 64  # [bytes] of an order
_HANGS = 3.0  # [s] for which a call does not return


class Orders:
    """Memory, shared through a file, in which an attack writes how the drivers misbehave."""

    def __init__(self, file: Path) -> None:
        file.touch()
        os.truncate(file, _LENGTH)
        with file.open("r+b") as opened:
            self._memory = mmap.mmap(opened.fileno(), _LENGTH)

    def give(self, order: str) -> None:
        """Write an order; an empty one ends all that does not last by itself."""
        self._memory[:] = order.encode().ljust(_LENGTH, b"\0")

    @property
    def given(self) -> str:
        """The present order."""
        return self._memory[:].rstrip(b"\0").decode()


def _orders() -> Orders:
    return Orders(Path(os.environ[ORDERS]))


class AttackedAxis(CanopenAxis):
    """Axis of the emulated rig whose calls hang or raise, and which ends what its process needs."""

    def __init__(self, *arguments: Any, **named: Any) -> None:
        super().__init__(*arguments, **named)
        self._orders, self._done = _orders(), ""

    def command(self, speed: float) -> None:
        """Send a speed, unless it is to hang or raise."""
        self._misbehave("command")
        super().command(speed)

    def quick_stop(self, *, for_good: bool = False) -> None:
        """Send a quick stop, unless it is to hang or raise."""
        self._misbehave("quick stop")
        super().quick_stop(for_good=for_good)

    def _misbehave(self, call: str) -> None:
        order = self._orders.given
        if order == f"{call} hangs":
            threading.Event().wait(_HANGS)
        elif order == f"{call} raises":
            raise OSError("the line has no time limit")

    def _measured(self, data: bytes, time: float) -> None:
        order, listener = self._orders.given, self._listener
        once: dict[str, Callable[[], object]] = {
            "bus is closed": lambda: self._network._bus._socket.close(),  # type: ignore[union-attr]
            "watchdog ends": lambda: listener.timers[0].stop(),  # type: ignore[union-attr]
            "reading hangs": lambda: threading.Event().wait(_HANGS),
            "interpreter is held": lambda: ctypes.PyDLL(None).usleep(200_000),
            "place is no number": lambda: listener.motion(  # type: ignore[union-attr]
                self.name, MotionSample(time, math.nan, self._speed, 0.0, self._state)
            ),
        }
        if order in once and order != self._done:
            self._done = order
            once[order]()
        super()._measured(data, time)


class AttackedSensor(NetftSensor):
    """Sensor of the emulated rig that lies about its readings, or falls silent."""

    def open(self, listener: ForceListener) -> None:
        """Open it, for a listener that is lied to."""
        super().open(_Lied(listener, _orders()))


class _Lied:
    """Listener of a sensor that lies."""

    def __init__(self, listener: ForceListener, orders: Orders) -> None:
        self._listener, self._orders, self._done = listener, orders, ""
        self.garbled = listener.garbled

    def force(self, sample: ForceSample) -> None:
        """Pass on a reading as it is ordered: once with a wrong time, and then none; or always wrong."""
        order = self._orders.given
        times = {"time ahead": 1.7e9, "time is no number": math.nan}
        if order in times or order == "watchdog ends":
            if order in times and order != self._done:
                self._listener.force(sample._replace(time=times[order]))
            self._done = order
            return
        if order == "force is no number":
            sample = sample._replace(force=(math.nan, 0.0, 0.0))
        elif order == "numbers go back":
            sample = sample._replace(sequence=sample.sequence - 1000)
        self._listener.force(sample)


@rig_driver(emulated=lambda rig, role: True, patience=DRIVE_PATIENCE)
def attacked_axis(mounting: Mounting) -> AttackedAxis:
    """Return the driver of an axis."""
    network = mounting.share("CAN", lambda: CanNetwork(mounting.rig.bus, mounting.clock))
    return AttackedAxis(network, mounting.settings, mounting.clock, name=mounting.role)


@rig_driver(emulated=lambda rig, role: True)
def attacked_sensor(mounting: Mounting) -> AttackedSensor:
    """Return the driver of the sensor."""
    return AttackedSensor(mounting.settings, mounting.clock)
