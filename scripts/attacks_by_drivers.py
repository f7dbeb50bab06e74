"""Attacks on a rig by its own drivers and guard: each fails as a driver of others may, or as a thread may end."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from typing import Any

from attack_scene import Scene

_HANGS = 3.0  # [s] for which a call does not return


def _hung(*arguments: Any, **named: Any) -> None:
    threading.Event().wait(_HANGS)


def _refused(*arguments: Any, **named: Any) -> None:
    raise OSError("the line has no time limit")


def _over(scene: Scene) -> None:
    """Let the sensor read 30 N once, beyond the limit."""
    plant = scene.rig.plant
    newest = plant.supervisor.newest_force
    assert newest is not None
    plant.supervisor.force(newest._replace(force=(30.0, 0.0, 0.0), sequence=newest.sequence + 1, lost=0))


def _axis(scene: Scene) -> Any:
    return scene.rig.plant.spine.axes[0]


def command_hangs(scene: Scene) -> None:
    """Let the blade's driver not return from a command, and the force be too strong."""
    _axis(scene).command = _hung
    threading.Event().wait(0.03)
    _over(scene)


def quick_stop_hangs(scene: Scene) -> None:
    """Let the blade's driver not return from a quick stop; the drive has to stop by its own watch."""
    _axis(scene).quick_stop = _hung
    _over(scene)


def quick_stop_raises(scene: Scene) -> None:
    """Let the blade's driver raise OSError at every quick stop; the drive has to stop by its own watch."""
    _axis(scene).quick_stop = _refused
    _over(scene)


def command_raises(scene: Scene) -> None:
    """Let the blade's driver raise OSError at a command."""
    _axis(scene).command = _refused


def _lied(scene: Scene, time: float) -> None:
    """Stamp what the sensor sends with a time, and let it fall silent then."""
    plant, sensor = scene.rig.plant, scene.rig.plant.spine.sensor
    newest = plant.supervisor.newest_force
    assert newest is not None
    sensor._listener = None  # type: ignore[attr-defined]
    plant.spine.force(newest._replace(time=time, sequence=newest.sequence + 1))


def times_in_the_future(scene: Scene) -> None:
    """Stamp a reading of the sensor with the time of day, and let it fall silent."""
    _lied(scene, 1.7e9)


def times_that_are_none(scene: Scene) -> None:
    """Stamp a reading of the sensor with no number, and let it fall silent."""
    _lied(scene, math.nan)


def watchdog_ended(scene: Scene) -> None:
    """End the watchdog, and let the sensor fall silent: the drive's own watch, or a command, has to stop it."""
    scene.rig.plant.spine.timers[0].stop()
    scene.rig.plant.spine.sensor._listener = None  # type: ignore[attr-defined]


STOPPED: tuple[Callable[[Scene], None], ...] = (
    command_hangs, quick_stop_hangs, quick_stop_raises, command_raises, times_in_the_future, times_that_are_none,
    watchdog_ended,
)  # fmt: skip
IGNORED: tuple[Callable[[Scene], None], ...] = ()
EITHER: tuple[Callable[[Scene], None], ...] = ()
