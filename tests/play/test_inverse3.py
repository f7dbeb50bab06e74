"""The Inverse3 by its service's WebSocket, against an emulated one in a process of its own; damaged messages."""

from __future__ import annotations

import json
import random
import time
from collections.abc import Iterator

import pytest

from cutenv.play.inverse3 import INVERSE3_COUPLING, Inverse3Link, inverse3_sample
from cutenv.play.inverse3_emulator import EmulatedHandle, state_message
from cutenv.play.named_devices import emulated_inverse3, named_device
from cutenv.play.polled_handle import PolledHandle

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


def test_the_hand_is_followed_its_button_seen_and_a_force_holds_it_back(device: PolledHandle) -> None:
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
        (
            {"inverse3": [{"device_id": "049D", "state": {"cursor_position": {"x": 5, "y": 0, "z": 0}}}]},
            "outside 1 m",
        ),
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
