"""Readings of a rig at work, published on this machine for people who watch; nothing ever comes back to the rig."""

from __future__ import annotations

import json
import math
import socket
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

from cutenv.rig.devices.host import SystemClock
from cutenv.rig.plant import RigPlant

PUBLISHED_EVERY = 0.04
"""Period at which a rig's state is published [s]."""
LIVE_SCHEMA = "cutenv-live/1"
"""Name of the messages' form, which each of them carries."""


@contextmanager
def published(plant: RigPlant, port: int) -> Iterator[None]:
    """Send the state of a rig to a port of this machine for the time of the block, and once more at its end.

    A thread of its own looks at the rig and sends one datagram; the threads that watch and move the rig do nothing for
    it. The socket never waits and is never read: datagrams that nobody takes are dropped by the operating system, so a
    viewer that is slow, gone or malicious changes nothing on the rig.
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
    """Return what may be seen of a rig now; units are in the names, None for what is not known yet.

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
