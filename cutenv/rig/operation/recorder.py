"""Readings of a rig at work, recorded and published.

What axis and sensor report, and what is commanded, is recorded for an inspection or an experiment. It is published on
this machine for people who watch; nothing ever comes back to the rig.
"""

from __future__ import annotations

import json
import math
import socket
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from cutenv._base.arrays import Array
from cutenv.rig.devices.loop import SystemClock
from cutenv.rig.devices.protocols import ForceSample, MotionSample
from cutenv.rig.plant import RigPlant


@dataclass(frozen=True, kw_only=True)
class Stretch:
    """Part of the experiment, from rest to rest.

    Times [s] on one clock, samples as they arrived.
    """

    command_time: Array  # speeds [m/s] put on the bus; each holds until the next, and before the first the axis rests
    command: Array
    time: Array  # samples of the axis's position [m], and of its motor's torque over the rated one [1]
    position: Array
    torque: Array


class Felt(NamedTuple):
    """Readings of the force along the cut while the axis moves.

    Times [s] and forces [N], each of shape (n,).
    """

    time: Array
    force: Array


class Recorder:
    """Listener to an axis and a sensor, besides the supervisor.

    ``cut_axis``: axis of the sensor along the cut: 0, 1 or 2; ``sign``: sign of the reading against a motion forward.
    """

    def __init__(self, cut_axis: int = 0, sign: int = 1) -> None:
        self._cut_axis, self._sign = cut_axis, sign
        self._commands: list[tuple[float, float]] = []
        self._motions: dict[str, list[MotionSample]] = {}
        self._forces: list[ForceSample] = []
        self._beats: dict[str, list[float]] = {}

    def command(self, time: float, speed: float) -> None:
        """Record a speed [m/s] on the bus at ``time`` [s]."""
        self._commands.append((time, speed))

    # A listener of the plant

    def motion(self, axis: str, sample: MotionSample) -> None:
        """Record a sample."""
        self._motions.setdefault(axis, []).append(sample)

    def force(self, sample: ForceSample) -> None:
        """Record a reading."""
        self._forces.append(sample)

    def alive(self, axis: str, time: float) -> None:
        """Record the arrival of a heartbeat."""
        self._beats.setdefault(axis, []).append(time)

    def stretch(self, start: float, end: float) -> Stretch:
        """Return the commands and samples between two times [s]."""
        commands = np.array([each for each in self._commands if start <= each[0] < end]).reshape(-1, 2)
        motions = np.array([each[:4] for each in self._between("blade", start, end)]).reshape(-1, 4)
        return Stretch(
            command_time=commands[:, 0],
            command=commands[:, 1],
            time=motions[:, 0],
            position=motions[:, 1],
            torque=motions[:, 3],
        )

    def forces(self, start: float, end: float) -> list[ForceSample]:
        """Return the readings between two times [s]."""
        return [each for each in self._forces.copy() if start <= each.time < end]

    def force_along(self, start: float, end: float) -> Array:
        """Return forces along the cut between times [s], sensor's sign [N]."""
        return np.array([each.force[self._cut_axis] for each in self.forces(start, end)])

    def felt(self, start: float, end: float) -> Felt:
        """Return times and forces against forward motion, between times [s]."""
        readings = self.forces(start, end)
        force = [self._sign * each.force[self._cut_axis] for each in readings]
        return Felt(np.array([each.time for each in readings]), np.array(force))

    def force_axes(self, start: float, end: float) -> Array:
        """Return all three force axes between times, shape (n, 3) [N]."""
        return np.array([each.force for each in self.forces(start, end)]).reshape(-1, 3)

    def motion_times(self, axis: str, start: float, end: float) -> Array:
        """Return the arrivals of an axis's samples between two times [s]."""
        return np.array([each.time for each in self._between(axis, start, end)])

    def heartbeats(self, axis: str, start: float, end: float) -> Array:
        """Return the arrivals of an axis's heartbeats between two times [s]."""
        return np.array([each for each in self._beats.get(axis, []) if start <= each < end])

    def _between(self, axis: str, start: float, end: float) -> list[MotionSample]:
        return [each for each in self._motions.get(axis, []).copy() if start <= each.time < end]


PUBLISHED_EVERY = 0.04  # period at which a rig's state is published [s]
LIVE_SCHEMA = "cutenv-live/1"  # name of the messages' form, which each of them carries


@contextmanager
def published(plant: RigPlant, port: int) -> Iterator[None]:
    """Send the rig's state to a local port during the block.

    It is sent once more at its end. A thread of its own looks at the rig and sends one datagram; the spine
    that watches the rig does nothing for it. The socket never waits and is never read: datagrams that are not taken are
    dropped by the operating system, so a viewer that is slow, gone or malicious changes nothing on the rig.
    """

    def publish(now: float) -> None:
        message = json.dumps({"schema": LIVE_SCHEMA} | live_state(plant, now))
        with suppress(OSError):  # nobody listens, or nobody takes what has been sent
            sending.sendto(message.encode(), ("127.0.0.1", port))

    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sending:
        sending.setblocking(False)
        clock = SystemClock() if isinstance(plant.clock, SystemClock) else plant.clock  # a loop beside the rig's
        repeating = clock.every(PUBLISHED_EVERY, publish, "rig live readings")
        try:
            yield
        finally:
            repeating.stop()
            publish(plant.clock.now())


def live_state(plant: RigPlant, now: float) -> dict[str, Any]:
    """Return what may be seen of a rig now.

    Units are in the names, None for what is not known yet.

    The force is the one along the cut that was farthest from zero since the last time.
    """
    supervisor, limits = plant.supervisor, plant.settings.limits
    blade, report = supervisor.blade, supervisor.report if supervisor.phase == "stopped" else None
    force = plant.strongest_since(now - PUBLISHED_EVERY)
    return {
        "rig": plant.settings.name[:80],
        "time_s": round(now, 3),
        "phase": str(supervisor.phase),
        "force_N": None if force is None else round(force, 3),
        "position_mm": None if blade is None else round(1e3 * blade.position, 3),
        "speed_mm_s": None if blade is None else round(1e3 * blade.speed, 3),
        "angle_deg": None if blade is None else round(math.degrees(plant.angle), 2),
        "force_limit_N": limits.force,
        "low_mm": round(1e3 * limits.low, 3),
        "high_mm": round(1e3 * limits.high, 3),
        "stop": None if report is None else str(report)[:400],
    }
