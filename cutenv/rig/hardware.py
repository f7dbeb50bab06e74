"""Rig made from its file: drives on CANopen and a Net F/T sensor."""

from __future__ import annotations

from cutenv.rig.config.settings import RigSettings
from cutenv.rig.devices.canopen.axis import CanopenAxis
from cutenv.rig.devices.canopen.network import CanNetwork
from cutenv.rig.devices.clock import Clock, SystemClock
from cutenv.rig.devices.netft.netft_sensor import NetftSensor
from cutenv.rig.plant import RigPlant


def rig_plant(settings: RigSettings, clock: Clock | None = None) -> RigPlant:
    """Make the plant of a rig, real or emulated, without connecting to it."""
    clock = clock or SystemClock()
    network = CanNetwork(settings.bus, clock)
    height = None if settings.height is None else CanopenAxis(network, settings.height, clock, name="height")
    angle = None if settings.angle is None else CanopenAxis(network, settings.angle, clock, name="angle")
    return RigPlant(
        settings,
        clock,
        CanopenAxis(network, settings.blade, clock, name="blade"),
        NetftSensor(settings.sensor, clock),
        angle=angle,
        height=height,
    )
