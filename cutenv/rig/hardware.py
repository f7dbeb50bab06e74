"""Rig made from its file: the drivers that it names, under one supervisor."""

from __future__ import annotations

from typing import Any

from cutenv.rig.config.settings import RigSettings
from cutenv.rig.devices.driver_registry import Mounting, mounted
from cutenv.rig.devices.host import Clock, SystemClock
from cutenv.rig.plant import RigPlant


def rig_plant(settings: RigSettings, clock: Clock | None = None) -> RigPlant:
    """Make the plant of a rig, real or emulated, without connecting to it.

    Raises
    ------
    ValueError
        If a driver that its file names does not exist, or refuses its settings.
    """
    clock, shared = clock or SystemClock(), dict[Any, Any]()

    def made(role: str) -> Any:
        return mounted(Mounting(role=role, rig=settings, clock=clock, shared=shared))

    return RigPlant(settings, clock, [made(role) for role in settings.axes], made("sensor"))
