"""Fixtures of several test files of a rig."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import pytest
from made_ready import ready_rig

from cutenv.emulation.fake_rig import FakeRig
from cutenv.rig.config.settings import HEIGHT


@pytest.fixture
def rig() -> FakeRig:
    """A fake rig with a specimen, released at the clamp."""
    return ready_rig()


@pytest.fixture
def drive() -> Iterator[Any]:
    """A made-up drive alone; what it needs is an extra, which not every test of a rig needs."""
    from made_up_drive import MadeUpDrive

    drive = MadeUpDrive()
    yield drive
    drive.close()


@pytest.fixture
def benches() -> Iterator[Any]:
    from canopen_bench import kept_benches

    yield from kept_benches()


@pytest.fixture
def bench(benches: Any) -> Any:
    """A made-up drive and its axis, not open."""
    return benches()


@pytest.fixture
def opened(bench: Any) -> None:
    bench.axis.open(bench.ear)


@pytest.fixture
def ready(bench: Any) -> None:
    bench.ready()


@pytest.fixture(scope="module")
def quick_return() -> Iterator[None]:
    """Let blades return to the clamp quickly, and hardly raised.

    At their slow pace, and by 20 mm up and down, a short cut is mostly the way back.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("cutenv.rig.operation.session.RETURN_SPEED", 0.025)
        patch.setattr("cutenv.rig.config.settings.HEIGHT", replace(HEIGHT, raised=0.003))
        yield


@pytest.fixture(autouse=True, scope="module")
def no_loop_left() -> Iterator[None]:
    """Fail the last test of a file after which a rig's loop goes on: a clock or a driver was not stopped."""
    before = set(threading.enumerate())
    yield
    ends, left = time.monotonic() + 2.0, True
    while left and time.monotonic() < ends:
        left = [each for each in threading.enumerate() if each.name == "rig loop" and each not in before]
        time.sleep(0.002 if left else 0.0)
    assert not left, "a rig's loop goes on after the tests of this file"
