"""Lines of GRBL 1.1, as a machine with its firmware as it is sends them: status reports, answers, alarms."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import NamedTuple

JOG_CANCEL, SOFT_RESET, STATUS = b"\x85", b"\x18", b"?"
"""Commands of one byte, which GRBL obeys at once, whatever it is doing."""
MARK = 5000.0
"""Coordinate at the clamp [mm] that ``cutenv rig zero`` gives the machine, in its memory only: proof of it."""
GRBL_AXES = ("X", "Y", "Z")
"""Letters of the axes."""


class GrblStatus(NamedTuple):
    """Status report.

    Attributes
    ----------
    state : str
        "Idle", "Jog", "Run", "Hold", "Alarm", "Door", "Check", "Home" or "Sleep".
    position : tuple of float
        Machine position of each axis [mm].
    feed : float
        Present feed [mm/min].
    pins : str
        Letters of inputs that are triggered.
    """

    state: str
    position: tuple[float, ...]
    feed: float
    pins: str


_STATUS = re.compile(rb"<([A-Za-z]+)(?::\d+)?\|MPos:(-?\d+\.\d+(?:,-?\d+\.\d+)*)((?:\|[^|<>]*)*)>")
_FEED = re.compile(rb"\|FS?:(\d+(?:\.\d+)?)")
_PINS = re.compile(rb"\|Pn:([A-Z]+)")


def grbl_status(line: bytes) -> GrblStatus | None:
    """Return what a status report says; None if the line is none, or is damaged."""
    match = _STATUS.fullmatch(line.strip())
    if match is None:
        return None
    feed, pins = _FEED.search(match[3]), _PINS.search(match[3])
    position = tuple(float(number) for number in match[2].split(b","))
    if len(position) < len(GRBL_AXES) or feed is None:
        return None
    return GrblStatus(match[1].decode(), position, float(feed[1]), pins[1].decode() if pins else "")


def jog_line(letter: str, way: float, feed: float) -> bytes:
    """Return the command that jogs an axis by ``way`` [mm] at ``feed`` [mm/min], relative to where it will be."""
    return f"$J=G91G21{letter}{way:.4f}F{feed:.2f}\n".encode("ascii")


def grbl_setting(line: str) -> tuple[int, float] | None:
    """Return number and value of a setting such as ``$120=100.000``; None if the line is none."""
    match = re.fullmatch(r"\$(\d+)=(-?\d+(?:\.\d+)?)", line)
    return None if match is None else (int(match[1]), float(match[2]))


def offsets_of(line: str, name: str) -> tuple[float, ...] | None:
    """Return the offsets that a line such as ``[G92:0.000,0.000,0.000]`` tells; None if it is another."""
    match = re.fullmatch(rf"\[{name}:(-?[\d.]+(?:,-?[\d.]+)*)\]", line)
    return None if match is None else tuple(float(number) for number in match[1].split(","))


def grbl_zero(lines: Iterable[str], number: int) -> float | None:
    """Return the machine position [mm] of the clamp, which the answer to ``$#`` tells; None if nobody has set it.

    ``number`` is the place of the axis among the machine's own.
    """
    found = {name: offsets[number] for line in lines for name in ("G54", "G92") if (offsets := offsets_of(line, name))}
    if abs(found.get("G92", 0.0)) <= 0.5 * MARK:
        return None
    return found.get("G54", 0.0) + found["G92"] + MARK
