"""Driver "robotiq" of a force sensor.

Robotiq FT 300 and FT 300-S, by their stream of 100 readings a second.

Source: Robotiq's manual of the FT 300, "Control over USB and RS-485" (registers 410, 500, 510; stream of 16 bytes), and
the driver that Robotiq published for ROS, ``robotiq_ft_sensor``. The stream has no number and no status: a reading that
never left the sensor shows as a gap in time alone, and a load beyond the range by its size.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

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

ROBOTIQ_RATE = 100.0  # rate of the stream [Hz], of the manual
ROBOTIQ_RANGE = 300.0  # greatest force on any axis [N], of the manual
BEYOND_RANGE = 1  # status of a reading with a force or torque at the end of the range: the stream itself has no status
_RATE_ERROR = 0.03  # [1] assumed
_TORQUE_RANGE = 30.0  # [N m], of the manual
_NEWTONS, _NEWTON_METRES = 0.01, 0.001  # of a count, of the manual
_FRAME = struct.Struct("<2s6hH")
_HEADER = b"\x20\x4e"
_DEVICE = 9  # address on Modbus, as delivered
_READ_REGISTERS, _WRITE_REGISTERS = 3, 16  # functions of Modbus
_OUTPUT, _STREAMED = 410, 0x0200
_FIRMWARE, _SERIAL = 500, 510
_JAM = b"\xff" * 50  # ends a stream
_ANSWER, _TRIES = 0.5, 4  # [s]
_TABLE = crc_table(0xA001)


def modbus_crc(data: bytes) -> int:
    """Return the CRC-16 of Modbus RTU."""
    return crc16(data, _TABLE)


def _request(function: int, register: int, *rest: int) -> bytes:
    raw = struct.pack(">BBH", _DEVICE, function, register) + bytes(rest)
    return raw + struct.pack("<H", modbus_crc(raw))


def robotiq_frame(frame: bytes) -> SensorFrame:
    """Parse a frame of the stream; raise FrameError if header or CRC are wrong."""
    header, *counts, crc = _FRAME.unpack(frame)
    if header != _HEADER or crc != modbus_crc(frame[:-2]):
        raise FrameError(f"a damaged frame: {frame.hex(' ')}")
    fx, fy, fz, tx, ty, tz = counts
    ended = max(abs(fx), abs(fy), abs(fz)) * _NEWTONS >= ROBOTIQ_RANGE
    ended |= max(abs(tx), abs(ty), abs(tz)) * _NEWTON_METRES >= _TORQUE_RANGE
    return SensorFrame((fx, fy, fz, tx, ty, tz), BEYOND_RANGE if ended else 0)


class _Robotiq:
    name, baud = "Robotiq FT 300", 19200
    form = FrameFormat(_HEADER, _FRAME.size, robotiq_frame)
    newtons, newton_metres = _NEWTONS, _NEWTON_METRES

    def begin(self, line: SensorLine, rate: float) -> dict[str, float | str]:
        self.end(line)
        firmware = self._registers(line, _FIRMWARE, 3)
        if not firmware.startswith(b"F"):
            raise RigError(
                f"the device at {line.port} is no FT 300: it calls its firmware {firmware!r}. Is this the sensor's "
                "port, and not that of a gripper?"
            )
        told = f"{firmware[:3].decode('ascii', 'replace')}-{firmware[3]}.{firmware[4]}.{firmware[5]}"
        serial = self._registers(line, _SERIAL, 4)
        # Answered by its own first six bytes; where that answer is lost, the stream says that it was heard.
        line.send(_request(_WRITE_REGISTERS, _OUTPUT, 0, 1, 2, *divmod(_STREAMED, 256)))
        return {"firmware": told, "serial": f"{serial[:3].decode('ascii', 'replace')}-{_serial_number(serial):04d}"}

    def end(self, line: SensorLine) -> None:
        line.send(_JAM)
        line.quiet(1.0)

    def meaning(self, status: int) -> str:
        return "a force or torque at the end of the range" if status == BEYOND_RANGE else f"status {status}"

    def _registers(self, line: SensorLine, register: int, count: int) -> bytes:
        """Return the bytes of registers, high byte first."""
        begins = bytes((_DEVICE, _READ_REGISTERS, 2 * count))
        for _ in range(_TRIES):
            line.send(_request(_READ_REGISTERS, register, 0, count))
            heard = line.answer(begins, _ANSWER, beyond=2 * count + 2)
            if heard is not None and modbus_crc(heard[:-2]) == int.from_bytes(heard[-2:], "little"):
                return heard[len(begins) : -2]
        raise RigError(
            f"no FT 300 answers at {line.port} and {self.baud} baud. Has it its 24 V, is this its port, and does no "
            "other program read it?"
        )


def _serial_number(serial: bytes) -> int:
    return int.from_bytes(serial[6:8] + serial[4:6], "big")


@dataclass(frozen=True, kw_only=True)
class RobotiqOptions:
    """Options of a Robotiq FT 300."""

    port: str = setting(
        "", "1", "Serial port of the sensor; a name below /dev/serial/by-id stays the same.",
        example='"/dev/serial/by-id/usb-..."',
    )  # fmt: skip
    delay: float = setting(
        0.020, "ms", "Time until a force is in the readings; assumed: a period, and 8.3 ms for a frame.", 0.0, 1.0
    )

    def __post_init__(self) -> None:
        check_parameters(self)


def _check(rig: RigSettings, role: str) -> None:
    if rig.sensor.rate != ROBOTIQ_RATE:
        raise ValueError(
            f"sensor.rate_Hz = {rig.sensor.rate:g}: an FT 300 streams {ROBOTIQ_RATE:g} readings a second, and no other "
            f"number. Write {ROBOTIQ_RATE:g}."
        )
    if rig.limits.force >= ROBOTIQ_RANGE:
        raise ValueError(
            f"limits.force_N = {rig.limits.force:g} is not within the range of an FT 300, {ROBOTIQ_RANGE:g} N: a force "
            "above that is not seen. Lower the limit."
        )


@rig_driver(options=RobotiqOptions, check=_check, emulated=on_pseudo_terminal)
def robotiq_sensor(mounting: Mounting) -> FramedSensor:
    """Robotiq FT 300 or FT 300-S on USB or RS-485."""
    return FramedSensor(mounting, _Robotiq(), rate_error=_RATE_ERROR)
