"""Driver "netft" of a rig's file: a Net F/T force sensor."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cutenv.rig.config.settings import RigSettings
from cutenv.rig.devices.driver_registry import Mounting, rig_driver

if TYPE_CHECKING:
    from cutenv.rig.devices.netft.netft_sensor import NetftSensor

_HERE = ("127.0.0.1", "localhost", "::1")


def _emulated(rig: RigSettings, role: str) -> bool:
    return rig.sensor.address in _HERE


@rig_driver(needs=("address",), emulated=_emulated)
def mounted_sensor(mounting: Mounting) -> NetftSensor:
    """ATI Net F/T, or another force sensor that speaks RDT over UDP."""
    from cutenv.rig.devices.netft.netft_sensor import NetftSensor  # the simulator, which reads rigs' files, loads none

    return NetftSensor(mounting.settings, mounting.clock)
