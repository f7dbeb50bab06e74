"""Rig made from its file: drives on CANopen and a Net F/T sensor."""

from __future__ import annotations

from cutenv.rig.canopen import CanNetwork, CanopenAxis
from cutenv.rig.clock import Clock, SystemClock
from cutenv.rig.netft.sensor import NetftSensor
from cutenv.rig.plant import RigPlant
from cutenv.rig.settings import RigSettings


def rig_plant(settings: RigSettings, clock: Clock | None = None) -> RigPlant:
    """Make the plant of a rig, real or emulated, without connecting to it."""
    clock = clock or SystemClock()
    network = CanNetwork(settings.bus, clock)
    angle = None if settings.angle is None else CanopenAxis(network, settings.angle, clock, name="angle")
    return RigPlant(
        settings,
        clock,
        CanopenAxis(network, settings.blade, clock, name="blade"),
        NetftSensor(settings.sensor, clock),
        angle=angle,
    )
