"""Haptic handles: pushes only while force and samples are fresh; Inverse3 and devices of Force Dimension, emulated."""

from __future__ import annotations

import importlib.util
import json
import os
import random
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from cutenv.people.play.force_dimension import ForceDimensionLink
from cutenv.people.play.haptics import HandEnergy, HapticDevice, VirtualCoupling
from cutenv.people.play.inverse3 import INVERSE3_COUPLING, Inverse3Link, inverse3_sample
from cutenv.people.play.inverse3_emulator import EmulatedHandle, state_message
from cutenv.people.play.named_devices import emulated_inverse3, named_device
from cutenv.people.play.polled_handle import (
    FIRST_SAMPLE,
    LOST,
    STALE,
    HandleAxes,
    HandleSample,
    PolledHandle,
    checked_sample,
)

pytestmark = pytest.mark.real_time
COUPLING = VirtualCoupling(stiffness=100.0, period=0.005)


class FakeLink:
    """Link to a handle that a test moves; it keeps every force with its time."""

    def __init__(self) -> None:
        self.sample: Any = HandleSample((0.01, 0.0, 0.1))
        self.forces: list[tuple[float, tuple[float, float, float]]] = []
        self.opened = self.closed = 0
        self.lock = threading.Lock()

    def open(self) -> None:
        self.opened += 1

    def exchange(self, force: tuple[float, float, float]) -> HandleSample:
        with self.lock:
            self.forces.append((time.monotonic(), force))
            if isinstance(self.sample, Exception):
                raise self.sample
            return self.sample

    def close(self) -> None:
        self.closed += 1

    def set(self, sample: Any) -> None:
        with self.lock:
            self.sample = sample

    @property
    def now(self) -> float:
        return self.forces[-1][1][0]


def wait_for(true: Callable[[], bool], seconds: float = 2.0) -> None:
    deadline = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < deadline
        time.sleep(0.001)


@pytest.fixture
def link() -> FakeLink:
    return FakeLink()


@pytest.fixture
def enough(monkeypatch: pytest.MonkeyPatch) -> None:
    """Energy enough for every force: what is tried is when a force is sent."""
    monkeypatch.setattr(HandEnergy, "allowed", property(lambda account: 3.3))


@pytest.fixture
def handle(link: FakeLink, enough: None) -> Any:
    made = PolledHandle(link, COUPLING)
    made.open()
    yield made
    made.close()


def test_it_is_a_haptic_device_whose_hand_is_at_the_clamp_when_it_is_opened(
    handle: PolledHandle, link: FakeLink
) -> None:
    assert isinstance(handle, HapticDevice)
    assert handle.read().position == 0.0
    link.set(HandleSample((0.04, 0.01, 0.105), frozenset({"next"})))
    wait_for(lambda: handle.read().position > 0.0)
    stylus = handle.read()
    assert stylus.position == pytest.approx(0.03)
    assert stylus.angle == pytest.approx(3.14159265 * 0.375, abs=1e-6)  # leant by half
    assert stylus.level == pytest.approx(0.005)
    assert stylus.buttons == {"next"}
    handle.open()
    assert handle.read().position == 0.0
    assert link.opened == 1


def test_a_force_against_forward_motion_points_back_along_the_chosen_axis() -> None:
    assert HandleAxes().force(2.0) == (-2.0, 0.0, 0.0)
    turned = HandleAxes.parse("-y,x,z")
    assert turned.force(2.0) == (0.0, 2.0, 0.0)
    assert turned.moved("along", HandleSample((0.0, -0.03, 0.0)), HandleSample((0.0, 0.0, 0.0))) == 0.03


@pytest.mark.parametrize("text", ["x,y", "x,y,y", "x,y,-x", "a,b,c", ""])
def test_axes_that_are_not_three_different_ones_are_refused(text: str) -> None:
    with pytest.raises(ValueError, match=r"axes|along"):
        HandleAxes.parse(text)


def test_a_force_lapses_when_the_session_stalls(handle: PolledHandle, link: FakeLink) -> None:
    for _ in range(20):
        handle.push(1.5)
        time.sleep(0.001)
    wait_for(lambda: any(force[0] == -1.5 for _, force in link.forces))
    pushed = time.monotonic()
    time.sleep(0.05)
    held = [when for when, force in link.forces if force[0] != 0.0]
    assert held[-1] - pushed < COUPLING.period + 0.003
    assert link.now == 0.0


@pytest.mark.parametrize("what", [TimeoutError("late"), ValueError("no JSON")])
def test_a_force_falls_to_zero_when_samples_are_stale_and_comes_back_with_them(
    handle: PolledHandle, link: FakeLink, what: Exception
) -> None:
    good = link.sample
    stop = threading.Event()

    def push() -> None:
        while not stop.is_set():
            handle.push(1.5)
            time.sleep(0.0005)

    pushing = threading.Thread(target=push)
    pushing.start()
    try:
        wait_for(lambda: link.now == -1.5)
        link.set(what)
        silent = time.monotonic()
        wait_for(lambda: link.now == 0.0)
        assert time.monotonic() - silent < STALE + 0.02
        time.sleep(0.03)
        assert link.now == 0.0
        assert handle.stale > 0
        assert handle.unsound > 0
        link.set(good)
        wait_for(lambda: link.now == -1.5)
    finally:
        stop.set()
        pushing.join()


class SlowService:
    """Slack hand (0.2 N s/m, 1 N/m) on a light device behind a service that answers late, on a clock of its own."""

    def __init__(self, exchange: float) -> None:
        self.now, self.lasts = 0.0, exchange
        self.place, self.speed, self.force = 0.0, 0.3, 0.0  # thrown forward at first
        self.returned = 0.0  # [J] work of the force on the device, less that of its friction
        self.returned_most = 0.0

    def open(self) -> None: ...

    def close(self) -> None: ...

    def exchange(self, force: tuple[float, float, float]) -> HandleSample:
        for _ in range(round(1e4 * self.lasts)):
            before = self.place
            self.speed += 1e-4 * (self.force - 0.7 * self.speed - 1.0 * self.place) / 0.1
            self.place += 1e-4 * self.speed
            self.returned += self.force * (self.place - before) - 0.5 * self.speed * (self.place - before)
            self.returned_most = max(self.returned_most, self.returned)
            self.now += 1e-4
        self.force = force[0]
        return HandleSample((self.place, 0.0, 0.1))


def swung(exchange: float) -> SlowService:
    """Hold a blade that stands at 0 for 20 s, with a session that runs every millisecond."""
    coupling = VirtualCoupling(stiffness=150.0, damping=0.1, period=0.005)
    service = SlowService(exchange)
    handle = PolledHandle(service, coupling, clock=lambda: service.now)
    felt = coupling.felt()
    seen = 0.0
    for _ in range(round(20.0 / exchange)):
        for _ in range(max(round(1e3 * exchange), 1)):
            handle.push(felt.update(seen, 0.0))
        handle._exchange(handle._wanted())
        seen = handle._newest[0].position[0] if handle._newest else 0.0
    return service


@pytest.mark.parametrize("exchange", [0.001, 0.002, 0.003, 0.005, 0.008])
def test_a_service_that_answers_late_returns_no_more_energy_than_the_hand_gave(exchange: float) -> None:
    service = swung(exchange)
    assert service.returned_most < 1e-4
    assert abs(service.speed) < 0.01


def test_a_handle_that_stays_silent_or_hangs_up_is_lost_with_a_reason(handle: PolledHandle, link: FakeLink) -> None:
    link.set(TimeoutError())
    time.sleep(LOST + 0.1)
    with pytest.raises(OSError, match=r"sent nothing sound for 1 s\. Check its cable"):
        handle.read()
    link.set(OSError("the service ended the connection"))
    wait_for(lambda: link.closed > 0)
    with pytest.raises(OSError, match=r"is lost: the service ended"):
        handle.read()


def test_closing_sends_zero_last_and_twice_is_once(handle: PolledHandle, link: FakeLink) -> None:
    handle.push(1.0)
    handle.close()
    assert link.now == 0.0
    handle.close()
    count = len(link.forces)
    time.sleep(0.01)
    assert len(link.forces) == count


def test_a_handle_without_a_first_sample_is_refused(link: FakeLink, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cutenv.people.play.polled_handle.FIRST_SAMPLE", 0.1)
    assert FIRST_SAMPLE > 0.1
    link.set(TimeoutError())
    with pytest.raises(OSError, match=r"sent no sample within 0\.1 s"):
        PolledHandle(link, COUPLING).open()
    assert link.closed


def test_a_position_that_no_handle_has_is_no_sample() -> None:
    for value in (float("nan"), float("inf"), 2.0):
        with pytest.raises(ValueError, match="outside 1 m, or no number"):
            checked_sample((value, 0.0, 0.0))


STATE = state_message(EmulatedHandle(lambda now: 0.0), "049D", inventory=False, modern=True, pressed=True)


def pushed_on(device: PolledHandle, seconds: float = 2.5) -> None:
    """Push without an end, as a session does."""
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline:
        device.read()
        device.push(1.0)
        time.sleep(0.001)


@pytest.fixture
def device() -> Iterator[PolledHandle]:
    with emulated_inverse3("--wait", "0.3") as address:
        made = PolledHandle(Inverse3Link(address), INVERSE3_COUPLING)
        made.open()
        yield made
        made.close()


def test_the_hand_is_followed_its_button_seen_and_a_force_holds_it_back(device: PolledHandle, enough: None) -> None:
    start, pressed, held = time.monotonic(), False, []
    while time.monotonic() - start < 2.0:
        stylus = device.read()
        pressed |= "next" in stylus.buttons
        now = time.monotonic() - start
        device.push(2.0 if 1.3 < now < 1.9 else 0.0)
        if 1.0 < now < 1.25 or 1.7 < now < 1.85:
            held.append((now, stylus.position))
        time.sleep(0.001)
    free = [position - 0.0127 * (now - 0.3) for now, position in held if now < 1.25]
    pushed = [position - 0.0127 * (now - 0.3) for now, position in held if now > 1.7]
    assert pressed
    assert sum(pushed) / len(pushed) - sum(free) / len(free) == pytest.approx(-2.0 / 400.0, abs=0.0015)
    assert device.stale == 0


def test_the_older_protocol_is_spoken_to_an_older_service() -> None:
    with emulated_inverse3("--service", "3.1", "--wait", "0") as address:
        link = Inverse3Link(address)
        link.open()
        for _ in range(20):
            sample = link.exchange((-1.0, 0.0, 0.0))
            time.sleep(0.002)
        link.close()
    assert abs(sample.position[0]) < 0.02


@pytest.mark.parametrize(
    ("fault", "said"),
    [
        ("freeze", "sent nothing sound"),
        ("garbage", "sent nothing sound"),
        ("unplugged", "sent nothing sound"),
        ("slow", "sent nothing sound"),
        ("hang up", "is lost: the Inverse Service ended the connection"),
    ],
)
def test_every_fault_of_the_service_lets_go_and_ends_with_a_reason(fault: str, said: str) -> None:
    with emulated_inverse3("--fault", fault, "--after", "0.3") as address:
        device = PolledHandle(Inverse3Link(address), INVERSE3_COUPLING)
        device.open()
        with pytest.raises(OSError, match=said):
            pushed_on(device)
        assert fault == "hang up" or device.stale > 10
        device.close()


def test_no_service_is_refused_with_the_cure() -> None:
    with (
        named_device("inverse3", target=0.08, url="ws://127.0.0.1:9") as device,
        pytest.raises(OSError, match=r"no Inverse Service answers at ws://127\.0\.0\.1:9 .*Start Haply's first"),
    ):
        device.open()
    with pytest.raises(OSError, match="is no Inverse Service"):
        Inverse3Link("http://nonsense").open()


def test_the_sample_of_a_state_is_read_as_it_is() -> None:
    sample = inverse3_sample(STATE, "049D")
    assert sample.position == (0.0, -0.12, 0.15)
    assert sample.buttons == {"next"}
    by_cable = json.loads(STATE) | {"wireless_verse_grip": [], "verse_grip": [{"state": {"button": True}}]}
    assert inverse3_sample(json.dumps(by_cable), "049D").buttons == {"next"}


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"inverse3": []}, "it reports none. Connect the device 049D"),
        ({"inverse3": [{"device_id": "1"}]}, "it reports 1. Connect the device 049D"),
        ({"inverse3": [{"device_id": "049D", "status": {"power_supply": False}}]}, "plug in its power supply"),
        ({"inverse3": [{"device_id": "049D", "status": {"ready": False}}]}, "calibrate it and wait"),
        ({"inverse3": [{"device_id": "049D", "state": {}}]}, "has no cursor_position"),
        ({"inverse3": [{"device_id": "049D", "state": {"cursor_position": {"x": "1"}}}]}, "holds no three numbers"),
        ({"inverse3": [{"device_id": "049D", "state": {"cursor_position": {"x": 5, "y": 0, "z": 0}}}]}, "outside 1 m"),
    ],
)
def test_a_state_that_is_none_says_why(changed: dict[str, object], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        inverse3_sample(json.dumps(json.loads(STATE) | changed), "049D")


def test_a_hundred_thousand_damaged_messages_are_samples_or_refused() -> None:
    rng, text, refused = random.Random(0), STATE.encode(), 0
    odd = [b"1e999", b"-1e999", b"null", b"[]", b"{}", b"NaN", b'"x"', b"9" * 400, b"true", b"\xff", b"[" * 2000]
    for _ in range(100_000):
        start = rng.randrange(len(text))
        stop = start + rng.choice((0, 1, 1, 2, 5, 40, 400))
        damaged = text[:start] + rng.choice((rng.randbytes(rng.randrange(3)), rng.choice(odd), b"")) + text[stop:]
        try:
            sample = inverse3_sample(damaged, "049D")
        except ValueError:
            refused += 1
        else:
            assert all(abs(value) <= 1.0 for value in sample.position)
    assert 50_000 < refused < 100_000


SCRIPT = Path(__file__).parents[3] / "scripts/validation/rig/emulated_force_dimension.py"
PLAYED = """
import json, sys, time
from cutenv.people.play.force_dimension import FORCE_DIMENSION_AXES, FORCE_DIMENSION_COUPLING, ForceDimensionLink
from cutenv.people.play.polled_handle import PolledHandle
device = PolledHandle(ForceDimensionLink(), FORCE_DIMENSION_COUPLING, FORCE_DIMENSION_AXES)
device.open()
start, pressed, free, held, lost = time.monotonic(), False, [], [], None
while (now := time.monotonic() - start) < 3.6 and lost is None:
    try:
        stylus = device.read()
        device.push(2.0 if now > 1.2 else 0.0)
    except OSError as error:
        lost = str(error)
    pressed |= "next" in stylus.buttons
    off = stylus.position - 0.0127 * (now - 0.3)
    (free if 0.9 < now < 1.15 else held if 1.5 < now < 1.75 else []).append(off)
    time.sleep(0.001)
stale = device.stale
device.close()
print(json.dumps([pressed, sum(free) / len(free), sum(held) / len(held), lost, stale]))
"""


def test_without_package_or_library_it_is_refused_with_the_cure(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "forcedimension_core", None)
    with pytest.raises(OSError, match=r"forcedimension_core.* is not installed|libdrd of the Force Dimension SDK"):
        ForceDimensionLink().open()


@pytest.mark.skipif(
    importlib.util.find_spec("forcedimension_core") is None or sys.platform != "linux",
    reason="forcedimension_core wants a Python below 3.13",
)
def test_the_hand_is_followed_a_force_holds_it_back_and_a_silent_device_is_lost(tmp_path: Path) -> None:
    subprocess.run([sys.executable, SCRIPT, "--build", tmp_path], check=True, capture_output=True)
    command = [sys.executable, SCRIPT, "--port", "0", "--wait", "0.3", "--freeze", "1.8"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as emulator:
        assert emulator.stdout is not None
        try:
            there = os.environ | {"FDSDK": str(tmp_path), "DHD_PORT": emulator.stdout.readline().strip()}
            ran = subprocess.run([sys.executable, "-c", PLAYED], env=there, capture_output=True, text=True)
        finally:
            emulator.kill()
    assert ran.returncode == 0, ran.stderr
    pressed, free, held, lost, stale = json.loads(ran.stdout.splitlines()[-1])
    assert pressed
    assert held - free == pytest.approx(-2.0 / 400.0, abs=0.0015)
    assert "sent nothing sound for 1 s" in lost
    assert stale > 10
