"""Driver "canopen" of a rig's file: an axis on a CiA 402 drive, on the bus that the rig's axes share."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cutenv.rig.config.settings import RigSettings
from cutenv.rig.devices.canopen.network import DRIVE_PATIENCE, CanNetwork
from cutenv.rig.devices.driver_registry import Mounting, rig_driver

if TYPE_CHECKING:
    from cutenv.rig.devices.canopen.axis import CanopenAxis

_EMULATED_BUSES, _HERE = ("socketcand", "virtual"), ("127.0.0.1", "localhost", "::1")


def _emulated(rig: RigSettings, role: str) -> bool:
    return rig.bus.interface in _EMULATED_BUSES and rig.bus.host in _HERE


@rig_driver(needs=("bus.interface", "node", "gear", "lead", "pulses"), emulated=_emulated, patience=DRIVE_PATIENCE)
def mounted_axis(mounting: Mounting) -> CanopenAxis:
    """Drive of the CiA 402 profile over CANopen, such as a Maxon EPOS4."""
    from cutenv.rig.devices.canopen.axis import CanopenAxis  # the simulator, which reads rigs' files, loads no driver

    network = mounting.share("CAN", lambda: CanNetwork(mounting.rig.bus, mounting.clock))
    return CanopenAxis(network, mounting.settings, mounting.clock, name=mounting.role)
