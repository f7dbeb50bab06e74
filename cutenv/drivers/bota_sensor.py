"""Driver "bota" of a force sensor.

Bota Systems' SensONE, Rokubi and others with a serial line (RS-422, USB).

Source: Bota Systems' driver for ROS, ``rokubimini_serial``, and its examples in C++ and Python: frames of 37 bytes
(header 0xAA, status, six floats, time, temperature, CRC-16/X-25) at 460 800 baud; commands C, c, f, R.
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass
from enum import IntFlag

from cutenv._base.validation import check_parameters
from cutenv.drivers.framed_sensor import (
    FramedSensor,
    FrameError,
    FrameFormat,
    SensorFrame,
    SensorLine,
    crc16,
    crc_table,
)
from cutenv.rig.config.settings import RigSettings, setting
from cutenv.rig.devices.driver_registry import Mounting, rig_driver
from cutenv.rig.devices.serial.board_drivers import on_pseudo_terminal
from cutenv.rig.errors import RigError

SINC_LENGTHS = {100.0: 512, 200.0: 256, 400.0: 128, 800.0: 64}
"""Length of the sensor's filter for each rate [Hz]: 51 200 over it."""
_RATE_ERROR = 0.02  # [1] assumed
_NEWTONS, _NEWTON_METRES = 1e-4, 1e-6  # of a count: the sensor sends floats, far coarser than that; choice
_FRAME = struct.Struct("<BH6fIfH")
_HEADER = 0xAA
_GREATEST = 1e4  # [N], [N m]: no sensor of theirs reads that
_COLDEST, _HOTTEST = -40.0, 125.0  # [C]: what its converters stand
_CALIBRATED_BINARY = b"c,0,1,0,4"  # no compensation of temperature, calibration matrix, binary, 460 800 baud
_ANSWER, _BOOT = 0.5, 6.0  # [s]
_TABLE = crc_table(0x8408)


class BotaStatus(IntFlag):
    """Bits of the status; a healthy sensor sends 0."""

    TOOK_TOO_LONG = 1
    OVERRANGE = 2
    INVALID = 4
    RAW = 8


_MEANINGS = {
    BotaStatus.TOOK_TOO_LONG: "its program took too long",
    BotaStatus.OVERRANGE: "force or torque out of range",
    BotaStatus.INVALID: "a gauge is saturated, shorted or broken",
    BotaStatus.RAW: "raw gauges instead of forces",
}


def x25_crc(data: bytes) -> int:
    """Return the CRC-16/X-25."""
    return crc16(data, _TABLE) ^ 0xFFFF


def bota_frame(frame: bytes) -> SensorFrame:
    """Parse a frame of the stream.

    Its CRC is over all between header and CRC. Raise FrameError if header or CRC are wrong, or a value cannot be:
    reserved bits, a force that is no number, a temperature.
    """
    header, status, *loads, stamp, temperature, crc = _FRAME.unpack(frame)
    if header != _HEADER or crc != x25_crc(frame[1:-2]):
        raise FrameError(f"a damaged frame: {frame.hex(' ')}")
    sound = all(math.isfinite(load) and abs(load) < _GREATEST for load in loads)
    if not sound or status >= 16 or not _COLDEST <= temperature <= _HOTTEST:
        raise FrameError(f"a frame that says what cannot be: {frame.hex(' ')}")
    fx, fy, fz = (round(load / _NEWTONS) for load in loads[:3])
    tx, ty, tz = (round(load / _NEWTON_METRES) for load in loads[3:])
    return SensorFrame((fx, fy, fz, tx, ty, tz), status, stamp)


class _Bota:
    name, baud = "Bota sensor", 460_800
    form = FrameFormat(bytes((_HEADER,)), _FRAME.size, bota_frame)
    newtons, newton_metres = _NEWTONS, _NEWTON_METRES

    def __init__(self, *, chopped: bool, fast: bool) -> None:
        self._filter = (int(chopped), int(fast), 1)

    def begin(self, line: SensorLine, rate: float) -> dict[str, float | str]:
        # A sensor that starts when its port is opened, or its cable put in, hears nothing at first.
        if not any(self._done(line, b"C") for _ in range(round(_BOOT / _ANSWER))):
            raise RigError(
                f"no Bota sensor answers at {line.port} and {self.baud} baud. Has it power, is this its port, and has "
                "it a serial line? Its versions with EtherCAT and Ethernet do not speak this protocol."
            )
        length = SINC_LENGTHS[rate]
        filtered = "f,{},{},{},{}".format(length, *self._filter).encode()
        for command in (_CALIBRATED_BINARY, filtered, b"R"):
            if not self._done(line, command):
                raise RigError(
                    f"the Bota sensor at {line.port} does not take {command.decode()!r}: is it of this kind?"
                )
        return {"filter_length": length}

    def end(self, line: SensorLine) -> None:
        """Do nothing: the sensor may keep streaming."""

    def meaning(self, status: int) -> str:
        told = [text for bit, text in _MEANINGS.items() if status & bit]
        return ", ".join(told) or f"status {status}"

    def _done(self, line: SensorLine, command: bytes) -> bool:
        line.send(command)
        return line.answer(b"r,0,%c,0" % command[0], _ANSWER) is not None


@dataclass(frozen=True, kw_only=True)
class BotaOptions:
    """Options of a Bota sensor."""

    port: str = setting(
        "", "1", "Serial port of the sensor; a name below /dev/serial/by-id stays the same.",
        example='"/dev/serial/by-id/usb-..."',
    )  # fmt: skip
    chopped: bool = setting(False, "1", "Chop the gauges' supply: less drift, a slower answer.")
    fast: bool = setting(False, "1", "Fast settling: a quicker answer with two to three times the noise.")
    delay: float = setting(
        0.004, "ms", "Time until a force is in the readings; assumed: three readings at 800 Hz.", 0.0, 1.0
    )

    def __post_init__(self) -> None:
        check_parameters(self)


def _check(rig: RigSettings, role: str) -> None:
    if rig.sensor.rate not in SINC_LENGTHS:
        raise ValueError(
            f"sensor.rate_Hz = {rig.sensor.rate:g}: a Bota sensor makes "
            f"{', '.join(f'{rate:g}' for rate in SINC_LENGTHS)} readings a second. Write one of these; 800 is usual."
        )


@rig_driver(options=BotaOptions, check=_check, emulated=on_pseudo_terminal)
def bota_sensor(mounting: Mounting) -> FramedSensor:
    """Bota Systems sensor with a serial line (SensONE, Rokubi, MiniONE, ...)."""
    options: BotaOptions = mounting.options
    return FramedSensor(mounting, _Bota(chopped=options.chopped, fast=options.fast), rate_error=_RATE_ERROR)
