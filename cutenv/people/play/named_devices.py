"""Devices of the command line by name."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

from cutenv._base.validation import one_of
from cutenv.people.play.devices import MouseDevice
from cutenv.people.play.force_dimension import FORCE_DIMENSION_AXES, FORCE_DIMENSION_COUPLING, ForceDimensionLink
from cutenv.people.play.haptics import HapticDevice
from cutenv.people.play.inverse3 import INVERSE3_COUPLING, INVERSE3_URL, Inverse3Link
from cutenv.people.play.polled_handle import HandleAxes, PolledHandle

DEVICES = ("mouse", "inverse3", "force-dimension", "emulated-inverse3")
"""Names of the devices."""
_ENDS_WITHIN = 5.0  # [s]


@contextmanager
def named_device(
    name: str, *, target: float, url: str = INVERSE3_URL, axes: HandleAxes | None = None, shares: bool = False
) -> Iterator[HapticDevice]:
    """Make a device for the time of the block.

    An emulated one ends with it. The hand of an emulated device aims at ``target`` [m], and takes the blade from an
    agent for 2 s if it ``shares``. Raises ValueError if there is no such device. Raises OSError if the emulator does
    not start.
    """
    one_of("--device", name, DEVICES)
    if name == "mouse":
        yield MouseDevice()
    elif name == "inverse3":
        yield PolledHandle(Inverse3Link(url), INVERSE3_COUPLING, axes)
    elif name == "force-dimension":
        yield PolledHandle(ForceDimensionLink(), FORCE_DIMENSION_COUPLING, axes or FORCE_DIMENSION_AXES)
    else:
        takes = ("--takes-over", "6", "8", "--wait", "6") if shares else ()
        with emulated_inverse3(*takes, target=target) as address:
            yield PolledHandle(Inverse3Link(address), INVERSE3_COUPLING, axes)


@contextmanager
def emulated_inverse3(*options: str, target: float = 0.08) -> Iterator[str]:
    """Run an emulated Inverse3 process during a block; yield its address.

    ``options`` are those of ``python -m cutenv.people.play.inverse3_emulator``.
    """
    program = [sys.executable, "-m", "cutenv.people.play.inverse3_emulator", "--port=0"]
    command = [*program, f"--target-mm={1e3 * target}", *options]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    try:
        address = process.stdout.readline().strip()
        if not address:
            raise OSError("the emulated Inverse3 did not start; its message is above.")
        yield address
    finally:
        process.terminate()
        try:
            process.wait(_ENDS_WITHIN)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        process.stdout.close()
