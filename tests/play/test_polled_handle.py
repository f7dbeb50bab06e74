"""A haptic handle pushes only while force and samples are fresh; one that is lost ends the session with a reason."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any

import pytest

from cutenv.play.haptics import HapticDevice, VirtualCoupling
from cutenv.play.polled_handle import FIRST_SAMPLE, LOST, STALE, HandleAxes, HandleSample, PolledHandle, checked_sample

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
def handle(link: FakeLink) -> Any:
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
    monkeypatch.setattr("cutenv.play.polled_handle.FIRST_SAMPLE", 0.1)
    assert FIRST_SAMPLE > 0.1
    link.set(TimeoutError())
    with pytest.raises(OSError, match=r"sent no sample within 0\.1 s"):
        PolledHandle(link, COUPLING).open()
    assert link.closed


def test_a_position_that_no_handle_has_is_no_sample() -> None:
    for value in (float("nan"), float("inf"), 2.0):
        with pytest.raises(ValueError, match="outside 1 m, or no number"):
            checked_sample((value, 0.0, 0.0))
