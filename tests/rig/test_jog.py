"""The blade moves while a key is held, and rests soon after it is released; the supervisor watches all along."""

from __future__ import annotations

import os
import pty
import re
import select
import subprocess
import sys
import termios
import time
from collections.abc import Callable
from datetime import date
from typing import Any

import pytest

from cutenv.commands import cli
from cutenv.commands.rig.jog import TerminalKeys, terminal_keys
from cutenv.emulation.fake_benches import AirPlant
from cutenv.emulation.fake_rig import FakeRig
from cutenv.rig.config.settings import HEIGHT, SIDE, fake_settings
from cutenv.rig.operation.jogging import (
    HELD,
    JOG_TURN_RATE,
    SPEED,
    STOPS_WITHIN,
    TOP_SPEED,
    Jog,
    JogKey,
    KeyDecoder,
    jog,
)
from cutenv.rig.operation.operator import AutomaticOperator
from cutenv.rig.operation.preflight import SETTLE, prepare
from cutenv.rig.safety.stop_causes import Cause, RigStopped

REPEAT = 0.033  # [s] between two of a held key


class Fingers:
    """A keyboard on a fake clock: keys are held from when to when, repeated as a terminal does."""

    def __init__(self, rig: FakeRig, *held: tuple[JogKey, float, float], pause: float = 0.3) -> None:
        self.rig, self.start = rig, rig.clock.now()
        self.due = sorted((moment, key) for key, begin, end in held for moment in self._repeats(begin, end, pause))
        self.seen: list[tuple[float, float, float]] = []  # time, position, speed
        self.then: Callable[[float], None] = lambda now: None

    @staticmethod
    def _repeats(begin: float, end: float, pause: float) -> list[float]:
        count = max(int((end - begin - pause) / REPEAT) + 1, 0)
        return [begin] + [begin + pause + k * REPEAT for k in range(count)]

    def read(self) -> list[JogKey]:
        now = self.rig.clock.now() - self.start
        blade = self.rig.plant.supervisor.blade
        assert blade is not None
        self.seen.append((now, blade.position, blade.speed))
        self.then(now)
        keys = [key for moment, key in self.due if moment <= now]
        self.due = self.due[len(keys) :]
        return keys

    def position(self, moment: float) -> float:
        return min(self.seen, key=lambda each: abs(each[0] - moment))[1]


def prepared(**axes: Any) -> FakeRig:
    rig = FakeRig(AirPlant, fake_settings(**axes))
    rig.plant.open()
    rig.clock.sleep_until(rig.clock.now() + SETTLE)
    prepare(rig.plant, AutomaticOperator(rig.settings), today=date.today())
    return rig


@pytest.fixture
def rig() -> FakeRig:
    return prepared()


def jogged(rig: FakeRig, *held: tuple[JogKey, float, float], speed: float = SPEED) -> tuple[Fingers, list[str]]:
    fingers, shown = Fingers(rig, *held, (JogKey.QUIT, 4.0, 4.0)), []
    jog(rig.plant, fingers, Jog(speed, turns=True), shown.append)
    return fingers, shown


@pytest.mark.parametrize(("key", "sign"), [(JogKey.FORWARD, 1), (JogKey.BACK, -1)])
@pytest.mark.parametrize("speed", [SPEED, TOP_SPEED])
def test_a_held_arrow_moves_the_blade_and_a_released_one_lets_it_rest(
    rig: FakeRig, key: JogKey, sign: int, speed: float
) -> None:
    fingers, _ = jogged(rig, (key, 0.5, 2.5), speed=speed)
    moved = sign * (fingers.position(2.5) - fingers.position(0.4))
    assert moved == pytest.approx(speed * (2.0 - 0.3 + HELD), abs=speed * 0.1 + 0.2e-3)
    after = abs(fingers.position(3.9) - fingers.position(2.5))
    ramp = speed * 0.04 + speed**2 / (2.0 * rig.settings.blade.acceleration)
    assert after <= speed * STOPS_WITHIN + ramp
    resting = [abs(v) for moment, _, v in fingers.seen if moment > 2.5 + STOPS_WITHIN + 0.5]
    assert max(resting) < 1e-4


def test_a_tapped_arrow_moves_the_blade_as_little_as_the_bound_says(rig: FakeRig) -> None:
    fingers, _ = jogged(rig, (JogKey.FORWARD, 0.5, 0.5))
    moved = fingers.position(3.9) - fingers.position(0.4)
    assert 0.5 * SPEED * HELD < moved <= SPEED * (STOPS_WITHIN + 0.04) + 0.05e-3


def test_any_other_key_stops_a_held_one_at_once(rig: FakeRig) -> None:
    fingers, _ = jogged(rig, (JogKey.FORWARD, 0.5, 1.5), (JogKey.OTHER, 1.5, 1.5))
    assert fingers.position(3.9) - fingers.position(1.5) < SPEED * (0.05 + 0.1)


def test_up_and_down_turn_the_blade(rig: FakeRig) -> None:
    jogged(rig, (JogKey.SLANT, 0.5, 2.5))
    turned = rig.plant.angle
    assert rig.settings.fixed_angle - turned == pytest.approx(JOG_TURN_RATE * (2.0 - 0.3 + HELD), rel=0.25)


def test_u_and_d_raise_and_lower_a_blade_that_has_the_axis() -> None:
    rig = prepared(height=HEIGHT)
    start, position = rig.plant.height, rig.plant.position
    fingers, shown = Fingers(rig, (JogKey.RAISE, 0.5, 2.5), (JogKey.QUIT, 4.0, 4.0)), []
    jog(rig.plant, fingers, Jog(turns=True, lifts=True), shown.append)
    assert rig.plant.height - start == pytest.approx(SPEED * (2.0 - 0.3 + HELD), rel=0.2)
    assert abs(rig.plant.position - position) < 1e-6
    assert "height   +4.0" in shown[-1]
    assert KeyDecoder().feed(b"uDq") == [JogKey.RAISE, JogKey.LOWER, JogKey.QUIT]


def test_l_and_r_move_a_blade_to_the_side_that_has_the_axis() -> None:
    rig = prepared(side=SIDE)
    way = SPEED * (2.0 - 0.3 + HELD)
    keys = (JogKey.TO_LEFT, 0.5, 2.5), (JogKey.FORWARD, 3.0, 5.0), (JogKey.TO_RIGHT, 5.5, 7.5), (JogKey.QUIT, 9.0, 9.0)
    places, shown = {}, []
    fingers = Fingers(rig, *keys)
    fingers.then = lambda now: places.setdefault(int(now), (rig.plant.position, rig.plant.place("side")))
    position, middle = rig.plant.position, rig.plant.place("side")
    jog(rig.plant, fingers, Jog(turns=True, sideways=True), shown.append)
    assert places[3] == pytest.approx((position, middle + way), abs=0.2 * way)
    assert abs(places[3][0] - position) < 1e-5
    assert places[5][0] - position > 0.5 * way
    assert abs(places[5][1] - places[3][1]) < 1e-5
    assert rig.plant.place("side") - middle == pytest.approx(0.0, abs=0.2 * way)
    assert re.search(r"left +[+-]0\.\d\d mm", shown[-1])
    assert KeyDecoder().feed(b"lR") == [JogKey.TO_LEFT, JogKey.TO_RIGHT]


@pytest.mark.parametrize("key", [JogKey.RAISE, JogKey.SLANT, JogKey.TO_LEFT])
def test_without_its_axis_a_key_stops_as_any_other(key: JogKey) -> None:
    controls = Jog()
    controls.press([JogKey.FORWARD, key], 1.0)
    assert not any(controls.command(1.01))


def test_the_end_of_travel_is_not_passed(rig: FakeRig) -> None:
    rig.plant.travel(rig.settings.limits.high - 0.006, speed=0.02)
    fingers, _ = jogged(rig, (JogKey.FORWARD, 0.1, 3.5), speed=TOP_SPEED)
    assert fingers.position(3.9) < rig.settings.limits.high
    assert rig.plant.supervisor.report is None


def test_a_fault_stops_the_blade_though_the_key_is_held(rig: FakeRig) -> None:
    fingers = Fingers(rig, (JogKey.FORWARD, 0.2, 3.0), (JogKey.QUIT, 4.0, 4.0))

    def push(now: float) -> None:
        if now > 1.0:
            rig.faults.extra_force = 30.0

    fingers.then = push
    with pytest.raises(RigStopped) as stop:
        jog(rig.plant, fingers, Jog(), lambda line: None)
    assert stop.value.report.cause in (Cause.FORCE, Cause.FORCE_RISE)
    assert rig.plant.supervisor.standing


def test_the_rig_is_locked_after_quitting(rig: FakeRig) -> None:
    _, shown = jogged(rig)
    assert rig.plant.supervisor.phase == "unready"
    assert shown[-1].endswith("unready, operation enabled")
    assert "mm/s" in shown[0]
    assert " N  ready" in shown[0]


@pytest.mark.parametrize("speed", [0.0, 0.011, float("nan")])
def test_a_speed_that_is_not_slow_is_refused(speed: float) -> None:
    with pytest.raises(ValueError, match="Jogging is slow"):
        Jog(speed)


@pytest.mark.parametrize("whole", [True, False])
def test_arrows_are_read_however_their_bytes_come(whole: bool) -> None:
    data, decoder = b"\x1b[C\x1bOD\x1b[A\x1b[Bxq", KeyDecoder()
    parts = [data] if whole else [data[k : k + 1] for k in range(len(data))]
    keys = [key for part in parts for key in decoder.feed(part)]
    assert keys == [JogKey.FORWARD, JogKey.BACK, JogKey.UPRIGHT, JogKey.SLANT, JogKey.OTHER, JogKey.QUIT]


def test_the_terminal_is_as_before_whatever_happens() -> None:
    keyboard, terminal = pty.openpty()
    with os.fdopen(terminal) as source:
        before = termios.tcgetattr(source)

        def fails_in_the_middle() -> None:
            with terminal_keys(source) as keys:
                assert termios.tcgetattr(source) != before
                os.write(keyboard, b"\x1b[C")
                assert select.select([source], [], [], 10.0)[0]
                assert keys.read() == [JogKey.FORWARD]
                raise RuntimeError("in the middle")

        with pytest.raises(RuntimeError, match="in the middle"):
            fails_in_the_middle()
        assert termios.tcgetattr(source) == before
    os.close(keyboard)


def test_a_terminal_that_is_gone_says_quit() -> None:
    keyboard, terminal = pty.openpty()
    os.close(keyboard)
    assert TerminalKeys(terminal).read() == [JogKey.QUIT]
    os.close(terminal)


def test_without_a_terminal_nothing_is_jogged(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["rig", "jog", "fake"]) == 1
    assert "jogging needs a terminal" in capsys.readouterr().err


def _until(keyboard: int, wanted: bytes, within: float = 120.0) -> bytes:
    """What the terminal shows until something like ``wanted``."""
    shown, deadline = b"", time.monotonic() + within
    while not re.search(wanted, shown):
        assert select.select([keyboard], [], [], max(deadline - time.monotonic(), 0.0))[0], shown
        shown += os.read(keyboard, 4096)
    return shown


def test_the_command_jogs_a_rig_at_a_terminal() -> None:
    keyboard, terminal = pty.openpty()
    before = termios.tcgetattr(terminal)
    command = [sys.executable, "-m", "cutenv", "rig", "jog", "fake", "--speed", "5"]
    process = subprocess.Popen(command, stdin=terminal, stdout=terminal, stderr=terminal)
    try:
        _until(keyboard, b"q ends")
        _until(keyboard, b"ready, operation enabled")
        os.write(keyboard, b"\x1b[C")
        shown = _until(keyboard, rb"\+[1-5]\.\d\d mm/s", 20.0)
        assert b"\r\x1b[K" in shown
        os.write(keyboard, b"q")
        _until(keyboard, b"unready")
        assert process.wait(30.0) == 0
        assert termios.tcgetattr(terminal) == before
    finally:
        if process.poll() is None:
            process.kill()
            process.wait(10.0)
        os.close(keyboard)
        os.close(terminal)
