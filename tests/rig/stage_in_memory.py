"""Drivers in memory that a spine's process loads by their name, and a file in which they write what reached them."""

from __future__ import annotations

import json
import os
import time
from pathlib import Path
from typing import Any

from cutenv.rig.config.settings import Axis, RigSettings, SensorCalibration, SensorSettings
from cutenv.rig.devices import DriveState, Event, ForceSample, Latch, MotionSample, Mounting, rig_driver
from cutenv.rig.safety.stop_causes import Cause

TOLD = "CUTENV_TEST_TOLD"
"""Variable with the name of the file."""
HANGS = "CUTENV_TEST_HANGS"
"""Variable with a speed [m/s] from which the blade's driver never returns."""


def tell(what: str, **numbers: float) -> None:
    """Write a line of JSON with the time."""
    with open(os.environ[TOLD], "a") as file:
        file.write(json.dumps({"what": what, "time": time.monotonic(), **numbers}) + "\n")


def told(path: Path) -> list[dict[str, Any]]:
    """Read what was written so far."""
    return [json.loads(line) for line in path.read_text().splitlines()]


@rig_driver(needs=("lead",), emulated=lambda rig, role: True)
class Stage:
    """Axis in memory."""

    def __init__(self, mounting: Mounting) -> None:
        self.name, self.axis, self.clock = mounting.role, mounting.settings, mounting.clock
        self.period, self.state = mounting.rig.bus.sync, DriveState.DISABLED
        self.latch, self.position, self.speed, self.target = Latch(), 0.0, 0.0, 0.0

    def open(self, listener: Any) -> None:
        self.timer = self.clock.every(self.period, lambda now: self.report(listener, now), "stage")

    def report(self, listener: Any, now: float) -> None:
        runs = self.state is DriveState.ENABLED
        most = self.period * (self.axis.acceleration if runs else self.axis.quick_stop)
        self.speed += min(max(self.target * runs - self.speed, -most), most)
        self.position += self.speed * self.period
        listener.motion(self.name, MotionSample(now, self.position, self.speed, 0.0, self.state))
        listener.alive(self.name, now)

    def enable(self) -> None:
        self.target, self.state = 0.0, DriveState.ENABLED

    def command(self, speed: float) -> None:
        tell("command", speed=speed)
        while speed >= float(os.environ.get(HANGS, "inf")):
            time.sleep(1.0)
        self.target = speed

    def quick_stop(self, *, for_good: bool = False) -> None:
        self.latch.happens(Event.STOP)
        self.state = DriveState.QUICK_STOP
        tell("quick stop")

    def disable(self) -> None:
        self.target, self.state = 0.0, DriveState.DISABLED

    clear = disable

    def withhold_heartbeat(self, why: str) -> None:
        self.quick_stop()

    def limits(self) -> dict[str, float]:
        return {}

    def about(self) -> dict[str, float | str]:
        return {"process": os.getpid()}

    def close(self) -> None:
        self.timer.stop()
        tell("closed")


@rig_driver(emulated=lambda rig, role: True)
class Balance:
    """Sensor in memory, of which every reading differs from the last."""

    rate, rate_error, axes = 250.0, 0.2, "xyz"

    def __init__(self, mounting: Mounting) -> None:
        self.clock, self.sequence = mounting.clock, 0

    def open(self, listener: Any) -> None:
        self.timer = self.clock.every(1.0 / self.rate, lambda now: self.read(listener, now), "balance")

    def read(self, listener: Any, now: float) -> None:
        self.sequence += 1
        force = 0.01 * (self.sequence % 2)
        count = self.sequence % 2
        listener.force(ForceSample(now, (force, force, force), (count,) * 6, 0, self.sequence, 0))

    def tare(self, samples: int = 200) -> tuple[float, float, float]:
        return (0.0, 0.0, 0.0)

    def about(self) -> dict[str, float | str]:
        return {}

    def close(self) -> None:
        self.timer.stop()


def settings() -> RigSettings:
    """Settings of a rig of these."""
    return RigSettings(
        name="in memory",
        armed_by="the test",
        angle_mode="fixed",
        blade=Axis(driver="stage_in_memory:Stage"),
        angle=None,
        sensor=SensorSettings(driver="stage_in_memory:Balance", rate=Balance.rate),
        calibration=SensorCalibration(date="2026-01-01"),
        emulated=True,
    )


class Judge:
    """Supervisor that notes for which causes it was to stop the blade."""

    phase, limited, report, angle = "ready", 0, None, 1.5

    def __init__(self) -> None:
        self.tripped: list[Cause] = []

    def trip(self, cause: Cause, detail: str) -> None:
        self.tripped.append(cause)

    def drive(self, speed: float, angle: float, hold: float, **across: float) -> float:
        return angle

    def turn(self, rate: float) -> None:
        """Do nothing."""
