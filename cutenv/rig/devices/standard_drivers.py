"""Drivers "canopen" and "netft" of a rig's file.

An axis on a CiA 402 drive, on the bus that the rig's axes share, and a Net F/T force sensor.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from cutenv.rig.config.settings import RigSettings
from cutenv.rig.devices.canopen.network import DRIVE_PATIENCE, CanNetwork
from cutenv.rig.devices.driver_registry import Mounting, rig_driver

if TYPE_CHECKING:
    from cutenv.rig.devices.canopen.axis import CanopenAxis
    from cutenv.rig.devices.netft_sensor import NetftSensor


_EMULATED_BUSES, _THIS_HOST = ("socketcand", "virtual"), ("127.0.0.1", "localhost", "::1")


def _is_emulated_axis(rig: RigSettings, role: str) -> bool:
    return rig.bus.interface in _EMULATED_BUSES and rig.bus.host in _THIS_HOST


@rig_driver(
    needs=("bus.interface", "node", "gear", "lead", "pulses"), emulated=_is_emulated_axis, patience=DRIVE_PATIENCE
)
def mounted_axis(mounting: Mounting) -> CanopenAxis:
    """CiA 402 drive over CANopen, such as a Maxon EPOS4."""
    from cutenv.rig.devices.canopen.axis import CanopenAxis  # the simulator, which reads rigs' files, loads no driver

    network = mounting.share("CAN", lambda: CanNetwork(mounting.rig.bus, mounting.clock))
    return CanopenAxis(network, mounting.settings, mounting.clock, name=mounting.role)


def _is_emulated_sensor(rig: RigSettings, role: str) -> bool:
    return rig.sensor.address in _THIS_HOST


@rig_driver(needs=("address",), emulated=_is_emulated_sensor)
def mounted_sensor(mounting: Mounting) -> NetftSensor:
    """ATI Net F/T, or another force sensor with RDT over UDP."""
    from cutenv.rig.devices.netft_sensor import NetftSensor  # the simulator, which reads rigs' files, loads none

    return NetftSensor(mounting.settings, mounting.clock)
