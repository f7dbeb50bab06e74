"""A driver is tried against what it promises: ours keep all of it, and each broken promise is found as such."""

from __future__ import annotations

import math
import runpy
from pathlib import Path
from typing import Any

import pytest

from cutenv.commands import cli
from cutenv.commands.rig.conform import tried_drivers
from cutenv.drivers.conformance import TriedPromise, conform_force, conform_motion
from cutenv.rig.config.settings import Axis, RigSettings, SensorSettings
from cutenv.rig.devices import FakeClock, ForceSample, Mounting
from cutenv.rig.errors import RigError

# Not as a program: a class that a rig's file names tries nothing and prints nothing when it is imported.
Stage: Any = runpy.run_path(str(Path(__file__).parents[2] / "examples" / "own_driver.py"))["Stage"]
RIG = RigSettings(blade=Axis(driver="x:Y"), sensor=SensorSettings(driver="x:Y"))


class Slack(Stage):
    """Drives on after a quick stop for a while."""

    def quick_stop(self, *, for_good=False):
        self.axis = Axis(quick_stop=0.02)
        super().quick_stop()


class Eager(Stage):
    """Moves when it is opened."""

    def report(self, now):
        super().report(now)
        self.position += 1e-6


class Deaf(Stage):
    """Has no watch of its own."""

    withhold_heartbeat = lambda self, why: None  # noqa: E731


class Careless(Stage):
    """Takes commands in any state."""

    def only(self, right, why):
        if not right and "open" in why:
            raise RigError(why)


class Reversed(Stage):
    """Counts the other way than it moves."""

    def report(self, now):
        before = self.position
        super().report(now)
        self.position = 2 * before - self.position


class Noisy(Stage):
    """Reports after it was closed."""

    def close(self):
        pass


class Forgetful(Stage):
    """Does not keep its set-up."""

    limits = lambda self: {"low": -0.002, "high": 0.149, "speed": 1.0}  # noqa: E731


class Late(Stage):
    """Sends half of its samples."""

    def report(self, now):
        self.odd = not getattr(self, "odd", False)
        if self.odd:
            super().report(now)


def tried(made: Any) -> dict[str, TriedPromise]:
    clock = FakeClock()
    findings = conform_motion(made(Mounting(role="blade", rig=RIG, clock=clock)), RIG, clock)
    return {each.promise: each for each in findings}


def test_the_driver_of_the_example_keeps_every_promise() -> None:
    assert [each for each in tried(Stage).values() if not each.kept] == []


@pytest.mark.parametrize(
    ("made", "broken"),
    [
        (Slack, "a quick stop brings it to rest"),
        (Eager, "open moves nothing"),
        (Deaf, "a drive that hears nothing stops by itself"),
        (Careless, "a stopped axis takes no command"),
        (Careless, "a speed that is none, or too high, is refused"),
        (Reversed, "speed from position matches the command"),
        (Noisy, "after close nothing is reported"),
        (Forgetful, "limits are read back from the drive"),
        (Late, "samples come every bus.sync"),
    ],
)
def test_a_broken_promise_of_an_axis_is_found(made: Any, broken: str) -> None:
    found = tried(made)
    assert not found[broken].kept, found[broken]


class Cell:
    """Load cell in memory along x, which can be told to break one promise."""

    rate, rate_error, axes = 100.0, 0.01, "x"

    def __init__(self, clock: FakeClock, broken: str = "") -> None:
        self.clock, self.broken, self.listener, self.sequence = clock, broken, None, 0
        self.timers: list[Any] = []

    def open(self, listener: Any) -> None:
        if self.listener is not None and self.broken != "opens twice":
            raise RigError("open already")
        self.listener = listener
        self.timers.append(self.clock.every(1.0 / (80.0 if self.broken == "rate" else self.rate), self.read, "cell"))

    def read(self, now: float) -> None:
        self.sequence += 2 if self.broken == "losses" else 1
        count = 0 if self.broken == "still" else self.sequence % 3
        force = math.nan if self.broken == "nan" else 0.3 if self.broken == "tare" else 1e-4 * count
        sideways = 0.1 if self.broken == "sideways" else 0.0
        at = now - 0.5 * (self.sequence % 2) if self.broken == "times" else now
        self.listener.force(
            ForceSample(at, (force, sideways, 0.0), (count, 0, 0, 0, 0, 0), self.broken == "status", self.sequence, 0)
        )

    def tare(self, samples: int = 200) -> tuple[float, float, float]:
        self.clock.sleep_until(self.clock.now() + samples / self.rate)
        return (0.0, 0.0, 0.0)

    def about(self) -> dict[str, float | str]:
        return {}

    def close(self) -> None:
        while self.timers:
            self.timers.pop().stop()
        self.listener = None


@pytest.mark.parametrize(
    ("broken", "promise"),
    [
        ("rate", "readings come at its rate"),
        ("losses", "numbers count readings and losses"),
        ("still", "counts of each axis flicker"),
        ("nan", "forces are numbers"),
        ("tare", "after a tare it reads 0"),
        ("sideways", "other axes read 0"),
        ("times", "times are the clock's, and never go back"),
        ("status", "status at rest is healthy"),
        ("opens twice", "a second open is refused"),
    ],
)
def test_a_broken_promise_of_a_sensor_is_found(broken: str, promise: str) -> None:
    clock = FakeClock()
    rig = RigSettings(sensor=SensorSettings(driver="x:Y", rate=100.0), limits=RIG.limits.__class__(stale_force=0.05))
    sound = {each.promise: each for each in conform_force(Cell(clock), rig, clock)}
    assert [each for each in sound.values() if not each.kept] == []
    found = {each.promise: each for each in conform_force(Cell(clock, broken), rig, clock)}
    assert not found[promise].kept


def test_a_sensor_without_readings_is_found() -> None:
    clock = FakeClock()
    silent = Cell(clock)
    silent.read = lambda now: None  # type: ignore[method-assign]
    silent.tare = lambda samples: (0.0, 0.0, 0.0)  # type: ignore[method-assign]
    assert not conform_force(silent, RIG, clock)[0].kept


def test_a_driver_by_its_name_alone_is_tried_and_its_table_printed(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["rig", "conform", "no_such_module:Stage"]) == 2
    assert "cannot be imported" in capsys.readouterr().err
    assert cli.main(["rig", "conform", "serial_stage"]) == 2
    assert "Did you mean 'serial'" in capsys.readouterr().err
    with pytest.raises(ValueError, match="no drivers to try"):
        tried_drivers("fake")
    with pytest.raises(FileNotFoundError, match=r"gone.toml"):
        tried_drivers("gone.toml")


@pytest.mark.parametrize("rig", ["serial", "emulator"])
def test_ours_keep_every_promise_in_real_time(rig: str) -> None:
    missed: list[Any] = []
    for _ in range(3):  # on a busy machine once more
        try:
            missed = [each for _, findings in tried_drivers(rig).values() for each in findings if not each.kept]
        except RigError as error:
            missed = [error]
        if not missed:
            break
    assert missed == []
