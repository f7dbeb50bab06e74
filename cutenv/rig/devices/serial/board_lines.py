"""Lines that computer and board exchange: ``TEXT*CRC``, the CRC-16 of the text in four hexadecimal digits."""

from __future__ import annotations

import binascii
from enum import IntEnum, IntFlag
from typing import NamedTuple

LINE_LENGTH = 72
"""Bytes of a line at most, with its CRC."""
BOARD_PROTOCOL = 1
"""Version of the protocol, which the board reports."""
_START = 0xFFFF  # CRC-16/CCITT-FALSE


class BoardState(IntEnum):
    """State of the stepper, as the board reports it."""

    OFF = 0
    ENABLED = 1
    STOPPED = 2
    FAULT = 3


class BoardFlag(IntFlag):
    """Flags of the board: of its pins at this moment, and of what has stopped it until it is cleared."""

    ZEROED = 1
    AT_LOW = 2
    AT_HIGH = 4
    STOP_OPEN = 8
    SILENT = 16
    SOFT_END = 32
    UNSET = 64


class LineError(ValueError):
    """Error for a line that is damaged or says nothing that is known; the message names the fault."""


class MotionReport(NamedTuple):
    """Report of the motion: number, state, flags, position [steps], rate [steps/s], lines that it did not take."""

    sequence: int
    state: BoardState
    flags: BoardFlag
    steps: int
    rate: int
    bad: int


class ForceReport(NamedTuple):
    """Reading of the load cell: number, status (0: healthy, 1: at the end of the range), counts."""

    sequence: int
    status: int
    counts: int


class BoardIdentity(NamedTuple):
    """Identity of the board: version of the protocol, converter, its rate [Hz]."""

    protocol: int
    converter: str
    rate: int


class StepperSetup(NamedTuple):
    """Set-up of the stepper: acceleration, that of a quick stop [steps/s2], top rate [steps/s], ends [steps]."""

    acceleration: int
    quick_stop: int
    fastest: int
    low: int
    high: int


Report = MotionReport | ForceReport | BoardIdentity | StepperSetup


def board_line(text: str) -> bytes:
    """Return a text as a line with its CRC."""
    raw = text.encode("ascii")
    return b"%s*%s\n" % (raw, _crc(raw))


def board_report(line: bytes) -> Report:
    """Return what a line from the board says.

    Parameters
    ----------
    line : bytes
        Line without its end.

    Raises
    ------
    LineError
        If it is damaged, or nothing that a board of this protocol sends.
    """
    text, star, crc = line.strip().rpartition(b"*")
    if not star or len(line) > LINE_LENGTH:
        raise LineError(f"no line of the board: {_shown(line)}. Is the baud rate that of the sketch?")
    if crc != _crc(text):
        raise LineError(f"a damaged line: {_shown(line)}")
    kind, *fields = text.decode("ascii", "replace").split(" ")
    try:
        if kind == "A":
            name, version, converter, hertz = fields
            if name != "cutenv-board":
                raise ValueError
            return BoardIdentity(int(version), converter, int(hertz))
        numbers = [int(field) for field in fields]
        if kind == "F":
            return ForceReport(*numbers)
        if kind == "P":
            return StepperSetup(*numbers)
        if kind == "M":
            sequence, state, flags, steps, rate, bad = numbers
            return MotionReport(sequence, BoardState(state), BoardFlag(flags), steps, rate, bad)
    except (TypeError, ValueError):
        pass
    raise LineError(f"an unknown line: {_shown(line)}. Has the board the sketch of this version?")


def _crc(text: bytes) -> bytes:
    return b"%04X" % binascii.crc_hqx(text, _START)


def _shown(line: bytes) -> str:
    return repr(line[:40])[1:]
