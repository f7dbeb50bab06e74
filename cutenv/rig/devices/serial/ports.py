"""Serial ports of this computer.

Opened for one program alone, and listed where one is missing.
"""

from __future__ import annotations

import os
import select
import stat
import time
from typing import Any

from cutenv.rig.errors import RigError


def open_port(port: str, baud: int, *, read_limit: float) -> Any:
    """Open a serial port for this program alone.

    ``port`` is such as ``/dev/ttyACM0``; a read waits ``read_limit`` [s]. Raise RigError if it is missing, may not be
    opened, or another program has it.
    """
    import serial

    try:
        line = serial.Serial(port, baud, timeout=read_limit, exclusive=True)
    except (serial.SerialException, OSError, ValueError) as error:
        raise RigError(f"the serial port {port} cannot be opened: {_why(port, error)}") from error
    line.reset_input_buffer()
    return line


def write_line(line: Any, data: bytes, limit: float) -> None:
    """Write bytes to a port, waiting at most ``limit`` [s].

    Not by pyserial's own ``write``: with a time limit that takes a late computer for a full buffer, and without one it
    waits for ever. Raise OSError if the port is gone, or its buffer stays full.
    """
    number, ends = line.fileno(), time.monotonic() + limit
    while data:
        try:
            data = data[os.write(number, data) :]
            continue
        except BlockingIOError:
            pass
        left = ends - time.monotonic()
        if left <= 0.0 or not select.select([], [number], [], left)[1]:
            raise TimeoutError("the port takes no more bytes")


def _why(port: str, error: Exception) -> str:
    number = getattr(error, "errno", None)
    if not os.path.exists(port):
        found = ", ".join(present_ports()) or "none"
        return (
            f"there is no such device. Present are: {found}. Is its cable in? A name below /dev/serial/by-id stays the "
            "same when the cable is put in again."
        )
    if number == 13:
        return "this user may not. Add the user to the group of the device (dialout, uucp), and log in again."
    if number == 11 or "lock" in str(error).lower():
        return "another program has it. End that one first; nothing was sent to the board."
    return f"{error}."


def present_ports() -> list[str]:
    """Return this computer's serial ports, by stable names if any."""
    from serial.tools import list_ports

    by_id = "/dev/serial/by-id"
    stable = {os.path.realpath(f"{by_id}/{name}"): f"{by_id}/{name}" for name in _names(by_id)}
    return sorted(stable.get(each.device, each.device) for each in list_ports.comports())


def _names(folder: str) -> list[str]:
    try:
        return os.listdir(folder)
    except OSError:
        return []


def is_pseudo_terminal(port: str) -> bool:
    """Return whether a port is a pseudo-terminal, where a local program plays devices."""
    real = os.path.realpath(port)
    try:
        return real.startswith("/dev/pts/") and stat.S_ISCHR(os.stat(real).st_mode)
    except OSError:
        return False
