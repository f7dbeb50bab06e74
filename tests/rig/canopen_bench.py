"""A made-up drive with its axis, and what the axis tells."""

from __future__ import annotations

import threading
from collections.abc import Iterator

from made_up_drive import Ear, MadeUpDrive

from cutenv.rig.config.settings import Axis, Bus
from cutenv.rig.devices.canopen.axis import CanopenAxis
from cutenv.rig.devices.canopen.network import CanNetwork
from cutenv.rig.devices.loop import SystemClock


class Bench:
    """One drive, its axis, and what the axis has told."""

    def __init__(self, settings: Axis | None = None, **drive) -> None:
        self.drive = MadeUpDrive(**drive)
        clock = SystemClock()
        self.network = CanNetwork(Bus(interface="virtual", channel=self.drive.channel), clock)
        self.axis = CanopenAxis(self.network, settings or Axis(), clock)
        self.ear = Ear()

    def ready(self) -> Bench:
        self.axis.open(self.ear)
        self.axis.enable()
        return self

    def clear(self) -> None:
        """As a supervisor's reset does."""
        with self.axis.latch.resetting():
            self.axis.clear()

    def close(self) -> None:
        self.axis.close()
        self.drive.close()


def kept_benches() -> Iterator[type[Bench]]:
    """A class whose benches are closed afterwards, and are seen to leave no thread behind."""
    made: list[Bench] = []

    class Kept(Bench):
        def __init__(self, *arguments, **drive) -> None:
            super().__init__(*arguments, **drive)
            made.append(self)

    yield Kept
    for bench in made:
        bench.close()
    assert not [thread.name for thread in threading.enumerate() if thread.name.startswith("cutenv ")]
