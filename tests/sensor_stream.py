"""What tests of the force sensor share: a listener that keeps, a server that is fed, and waiting with a limit."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable, Iterator

from cutenv.emulation.sensor_server import Loads, SensorServer
from cutenv.rig.config.settings import SensorSettings
from cutenv.rig.devices.loop import Clock, SystemClock
from cutenv.rig.devices.netft_sensor import NetftSensor
from cutenv.rig.devices.protocols import ForceSample

LOADS: Loads = (1.5, -2.25, 3.0, 0.1, -0.2, 0.3)


class Kept:
    """A listener that keeps what it is told."""

    def __init__(self) -> None:
        self.samples: list[ForceSample] = []
        self.complaints: list[str] = []

    def force(self, sample: ForceSample) -> None:
        self.samples.append(sample)

    def garbled(self, why: str, time: float) -> None:
        self.complaints.append(why)


class Feed:
    """Sends the present loads about every millisecond, until it is closed."""

    def __init__(self, server: SensorServer, loads: Loads = LOADS) -> None:
        self.loads = loads
        self._server, self._ended = server, threading.Event()
        self._thread = threading.Thread(target=self._run, name="feed", daemon=True)
        self._thread.start()

    def _run(self) -> None:
        while not self._ended.wait(0.001):
            self._server.send(self.loads)

    def close(self) -> None:
        self._ended.set()
        self._thread.join(timeout=2.0)


def wait_for(what: Callable[[], object], seconds: float = 10.0) -> None:
    """Until ``what()`` is true; the time is a limit for a busy machine, no promise."""
    end = time.monotonic() + seconds
    while not what():
        assert time.monotonic() < end, f"{what} has not become true within {seconds} s"
        time.sleep(0.002)


def settings_of(server: SensorServer) -> SensorSettings:
    return SensorSettings(address=server.host, port=server.port, page=server.page)


@contextlib.contextmanager
def streaming(server: SensorServer, clock: Clock | None = None) -> Iterator[tuple[NetftSensor, Kept]]:
    """An open driver that has had its first reading, and its listener; nothing is fed any more afterwards."""
    sensor, kept = NetftSensor(settings_of(server), clock or SystemClock()), Kept()
    feed = Feed(server)
    try:
        sensor.open(kept)
        feed.close()
        settle(kept)
        yield sensor, kept
    finally:
        feed.close()
        sensor.close()


def settle(kept: Kept) -> None:
    """Until nothing more arrives."""
    before = -1
    while before != len(kept.samples) + len(kept.complaints):
        before = len(kept.samples) + len(kept.complaints)
        time.sleep(0.05)
