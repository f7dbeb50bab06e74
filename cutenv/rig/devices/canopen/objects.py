"""Numbers defined by CiA 301, CiA 402 and the EPOS4, and units."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Literal

from cutenv._base.validation import in_range
from cutenv.rig.config.settings import Axis
from cutenv.rig.devices.protocols import DriveState


@dataclass(frozen=True)
class Entry:
    """One value in a drive's object dictionary."""

    index: int  # address of the value
    sub: int
    kind: str  # format code of :mod:`struct`, little endian; "s" for a text
    name: str  # name in the standard
    access: Literal["rw", "ro"] = "rw"  # whether it may be written
    default: int | str = 0  # value after power on, until another is stored
    low: int | None = None  # limits of what may be written; None: those of the kind
    high: int | None = None
    choices: tuple[int, ...] = ()  # values that may be written; empty: all
    mappable: str = ""  # PDOs that it may be mapped to: "R" received, "T" transmitted by the drive

    @property
    def bits(self) -> int:
        """Size of the value [bit]."""
        return 8 * struct.calcsize(f"<{self.kind}")

    @property
    def mapping(self) -> int:
        """Entry of a PDO mapping: index, sub-index and size."""
        return self.index << 16 | self.sub << 8 | self.bits

    def __str__(self) -> str:
        return f"0x{self.index:04X}:{self.sub:02X} ({self.name})"


SERVO_402 = 0x0002_0192  # device type of a servo drive that follows CiA 402
MAXON = 0x0000_00FB  # vendor number of maxon motor
# value of 0x605A: down the quick-stop ramp, then stay in "quick stop active", which a command can leave
STOP_AND_STAY = 6
# value of 0x605A: down the quick-stop ramp, during which commands have no effect, and then without power
STOP_AND_RELEASE = 2
# value of 0x60A9: revolutions (0xB4) per minute (0x47); its first byte is a power of ten, two's complement
WHOLE_RPM = 0x00B4_4700
MILLI_RPM = 0xFD00_0000 | WHOLE_RPM

# What the rig reads and writes by name. An emulated drive has these same entries, and those that no name is needed for.
DEVICE_TYPE = Entry(0x1000, 0, "I", "device type", "ro", SERVO_402)
VENDOR = Entry(0x1018, 1, "I", "vendor", "ro", MAXON)
CONSUMER_HEARTBEAT = Entry(0x1016, 1, "I", "consumer heartbeat time", high=0x7FFFFF)
PRODUCER_HEARTBEAT = Entry(0x1017, 0, "H", "producer heartbeat time")  # [ms]
CURRENT_LIMIT = Entry(0x3001, 2, "I", "output current limit", default=5440, high=30000)  # [mA]
GEAR_NUMERATOR = Entry(0x3003, 1, "I", "gear reduction numerator", default=1, low=1)
GEAR_DENOMINATOR = Entry(0x3003, 2, "I", "gear reduction denominator", default=1, low=1)
ENCODER_PULSES = Entry(0x3010, 1, "I", "encoder pulses per turn", default=500, low=16, high=2500000)
ABORT_CONNECTION = Entry(0x6007, 0, "h", "abort connection option", default=1, low=0, high=3)
CONTROLWORD = Entry(0x6040, 0, "H", "controlword", mappable="RT")
STATUSWORD = Entry(0x6041, 0, "H", "statusword", "ro", mappable="T")
QUICK_STOP_OPTION = Entry(0x605A, 0, "h", "quick stop option", default=2, choices=(STOP_AND_RELEASE, STOP_AND_STAY))
FAULT_REACTION = Entry(0x605E, 0, "h", "fault reaction option", default=2, low=-1, high=2)
MODE = Entry(0x6060, 0, "b", "mode of operation", choices=(0, 3, 6, 9), mappable="RT")
MODE_SHOWN = Entry(0x6061, 0, "b", "mode of operation display", "ro", mappable="T")
POSITION = Entry(0x6064, 0, "i", "position actual value", "ro", mappable="T")  # [increments]
FOLLOWING_WINDOW = Entry(0x6065, 0, "I", "following error window", default=2000)  # [increments]
VELOCITY = Entry(0x606C, 0, "i", "velocity actual value", "ro", mappable="T")  # [velocity units]
TORQUE = Entry(0x6077, 0, "h", "torque actual value", "ro", mappable="T")  # [per mille of the rated torque]
LOW_LIMIT = Entry(0x607D, 1, "i", "software position limit, minimum", default=-(2**31))  # [increments]
HIGH_LIMIT = Entry(0x607D, 2, "i", "software position limit, maximum", default=2**31 - 1)  # [increments]
PROFILE_SPEED_LIMIT = Entry(0x607F, 0, "I", "max profile velocity", default=50000)  # [velocity units]
# [rpm] in CiA 402, whatever the velocity unit
MOTOR_SPEED_LIMIT = Entry(0x6080, 0, "I", "max motor speed", default=50000)
PROFILE_ACCELERATION = Entry(0x6083, 0, "I", "profile acceleration", default=10000, low=1)  # [rpm/s]
PROFILE_DECELERATION = Entry(0x6084, 0, "I", "profile deceleration", default=10000, low=1)  # [rpm/s]
QUICK_STOP_DECELERATION = Entry(0x6085, 0, "I", "quick stop deceleration", default=10000, low=1)  # [rpm/s]
VELOCITY_UNIT = Entry(0x60A9, 0, "I", "SI unit velocity", default=WHOLE_RPM, choices=(WHOLE_RPM, MILLI_RPM))
TARGET_VELOCITY = Entry(0x60FF, 0, "i", "target velocity", mappable="RT")  # [velocity units]
NAMED = tuple(entry for entry in tuple(vars().values()) if isinstance(entry, Entry))  # all of the above

# Controlwords (CiA 402)
DISABLE_VOLTAGE = 0x00
SHUTDOWN = 0x06
SWITCH_ON = 0x07
ENABLE_OPERATION = 0x0F
QUICK_STOP = 0x0B
FAULT_RESET = 0x80

PROFILE_VELOCITY = 3  # mode in which the drive ramps to a target velocity by its own acceleration
ABORT_BY_QUICK_STOP = 3  # value of 0x6007: a drive that loses this computer's heartbeat makes a quick stop
FAULT_BY_QUICK_STOP = 2  # value of 0x605E: a fault that allows it ends in a stop down the quick-stop ramp

VELOCITY_STEPS: dict[int, int] = {WHOLE_RPM | (-power & 0xFF) << 24: 10**power for power in range(7)}
"""Steps in one rpm for each value of 0x60A9 that counts revolutions a minute."""

NMT_OPERATIONAL = 0x05  # state in a heartbeat; 0x00 is the boot-up message
NMT_BOOT_UP = 0x00
NMT_START = 0x01  # command to start a node
NMT_PRE_OPERATIONAL = 0x80  # command to make a node pre-operational

# Frame numbers; the node's own number is added (CiA 301, pre-defined connection set).
NMT_FRAME = 0x000
SYNC_FRAME = 0x080
EMERGENCY_FRAME = 0x080
SDO_REQUEST_FRAME = 0x600
SDO_RESPONSE_FRAME = 0x580
HEARTBEAT_FRAME = 0x700

EMERGENCY = struct.Struct("<HB5s")  # layout of an emergency: error code, error register, bytes of the maker's own


@dataclass(frozen=True)
class Pdo:
    """Frame of process data."""

    frame: int
    set_up_at: int
    mapped_at: int
    transmission: int
    entries: tuple[Entry, ...]

    @property
    def layout(self) -> struct.Struct:
        """Layout of the frame's data."""
        return struct.Struct("<" + "".join(entry.kind for entry in self.entries))

    @property
    def number(self) -> Entry:
        """Object with the frame's number and disabling bit."""
        return Entry(self.set_up_at, 1, "I", "COB-ID of a PDO")

    @property
    def type(self) -> Entry:
        """Object with the transmission type of the PDO."""
        return Entry(self.set_up_at, 2, "B", "transmission type of a PDO")

    @property
    def count(self) -> Entry:
        """Object with the number of mapped objects."""
        return Entry(self.mapped_at, 0, "B", "number of objects in a PDO")

    def slot(self, place: int) -> Entry:
        """Return the entry for mapped object ``place``, from 1."""
        return Entry(self.mapped_at, place, "I", "object mapped to a PDO")


_AT_ONCE, _EVERY_SYNC = 255, 1
_EXPEDITED_2 = 0x2B  # command of an SDO with two bytes of data
_RPDOS = 4  # of the pre-defined connection set
COMMAND_PDO = Pdo(0x200, 0x1400, 0x1600, _AT_ONCE, (CONTROLWORD, TARGET_VELOCITY, MODE))  # commands to the drive, RPDO1
# TPDO1, on every SYNC; its number is the lower, so it is on the bus before TPDO2
STATUS_PDO = Pdo(0x180, 0x1800, 0x1A00, _EVERY_SYNC, (STATUSWORD, VELOCITY, MODE_SHOWN))
MEASURED_PDO = Pdo(0x280, 0x1801, 0x1A01, _EVERY_SYNC, (POSITION, TORQUE))  # TPDO2, on every SYNC

PDO_UNUSED = 1 << 31  # bit in a PDO's number: disabled, so that it may be changed
PDO_NO_REQUEST = 1 << 30  # bit in a PDO's number: may not be requested by a remote frame; a drive may insist on it

# Statuswords (CiA 402): mask, value, and the state that they mean.
_STATES = (
    (0x4F, 0x00, DriveState.NOT_READY),
    (0x4F, 0x40, DriveState.DISABLED),
    (0x6F, 0x21, DriveState.READY),
    (0x6F, 0x23, DriveState.SWITCHED_ON),
    (0x6F, 0x27, DriveState.ENABLED),
    (0x6F, 0x07, DriveState.QUICK_STOP),
    (0x4F, 0x0F, DriveState.REACTING),
    (0x4F, 0x08, DriveState.FAULT),
)


# bit of an EPOS4's statusword: the position is referenced to home. The standard leaves this bit to the maker
HOMED = 0x8000


# code, of those that the standard leaves to makers, under which a drive is reported that does not obey
HINDERED = 0xFF01
# bits of a statusword: the drive obeys the bus; its power stage has voltage; a limit of its own holds it back
REMOTE, VOLTAGE, INTERNAL_LIMIT = 0x0200, 0x0010, 0x0800


def drive_state(statusword: int) -> DriveState:
    """Return the state in a statusword; raise ValueError if the standard defines no such state."""
    for mask, value, state in _STATES:
        if statusword & mask == value:
            return state
    raise ValueError(f"statusword 0x{statusword:04X} is none of CiA 402's states.")


_ERRORS = {
    0x2310: "over-current",
    0x3210: "supply voltage too high",
    0x3220: "supply voltage too low",
    0x4210: "drive too hot",
    0x7320: "position sensor",
    0x8130: "heartbeat of the computer lost",
    0x8250: "no command in time (RPDO time-out)",
    0x8611: "following error",
    0x8A80: "negative limit switch",
    0x8A81: "positive limit switch",
    0x8A82: "software position limit",
    0x8A88: "safe torque off",
}
# Kinds of error (CiA 301, table of emergency error codes), by the first digit.
_KINDS = {
    0x1: "generic error",
    0x2: "current",
    0x3: "voltage",
    0x4: "temperature",
    0x5: "hardware of the drive",
    0x6: "software of the drive",
    0x7: "additional modules",
    0x8: "monitoring",
    0x9: "external error",
    0xF: "additional functions or the maker's own",
}


def error_meaning(code: int) -> str:
    """Return an emergency code's meaning; if unlisted, its kind in the standard."""
    if code >> 8 == 0:
        return "no error"
    return _ERRORS.get(code) or _KINDS.get(code >> 12, "not of the standard")


def quick_stop_option_frame(node: int, option: int) -> tuple[int, bytes]:
    """Return the SDO frame of a quick-stop option; its answer is not read."""
    entry = QUICK_STOP_OPTION
    return SDO_REQUEST_FRAME + node, struct.pack("<BHBhxx", _EXPEDITED_2, entry.index, entry.sub, option)


def command_of_another(number: int, data: bytes, node: int, master: int) -> str | None:
    """Describe a foreign command to ``node`` of ``master``, or None.

    A CAN controller does not receive its own frames: whatever arrives under these numbers is from another master.
    """
    if number == NMT_FRAME:
        return f"network command {data.hex(' ')}" if data[1:2] in (b"\0", bytes((node,))) else None
    if number == SDO_REQUEST_FRAME + node:
        return f"SDO request {data.hex(' ')}"
    if number in (COMMAND_PDO.frame + node + 0x100 * place for place in range(_RPDOS)):
        return f"RPDO{1 + (number - COMMAND_PDO.frame >> 8)} {data.hex(' ')}"
    if number == HEARTBEAT_FRAME + master:
        return f"heartbeat of a master that is node {master} too"
    return None


def command_frame(node: int, controlword: int, velocity: int = 0) -> tuple[int, bytes]:
    """Return the RPDO1 frame of a command; velocity in drive units."""
    return COMMAND_PDO.frame + node, COMMAND_PDO.layout.pack(controlword, velocity, PROFILE_VELOCITY)


_INT32 = 2**31 - 1
_EDGES = 4  # increments in one pulse of the encoder
_STEPS_TO_TOP = 100  # least number of velocity units up to the top speed: fewer are too coarse


@dataclass(frozen=True, kw_only=True)
class AxisUnits:
    """Conversion between an axis in SI and its drive's integers.

    They count the motor's shaft. "Length" below is metres, or radians of an axis that turns. Raise ValueError if the
    axis exceeds what the drive can count, or the velocity unit is too coarse.
    """

    axis: Axis  # encoder, gear, lead and direction
    steps: int  # steps of the drive's velocity unit in one rpm: 1000 for milli-rpm, 1 for whole rpm

    def __post_init__(self) -> None:
        axis = self.axis
        for name, end in (("low", axis.low), ("high", axis.high)):
            self._count(
                name, self._increments(end), "increments", "Check pulses, gear and lead, or shorten the travel."
            )
        self._count("speed", axis.speed * self._per_speed, f"1/{self.steps} rpm", "Check gear and lead.")
        for name in ("acceleration", "quick_stop"):
            self._count(name, getattr(axis, name) * self._rpm, "rpm/s", "Check gear and lead.")
        self._count("following_error", abs(self._increments(axis.following_error)), "increments", "Check pulses.")
        if axis.speed * self._per_speed < _STEPS_TO_TOP:
            raise ValueError(
                f"speed = {axis.speed:g} is only {axis.speed * self._per_speed:.1f} of the drive's velocity units"
                f" (1/{self.steps} rpm), too coarse to be controlled by. Let the drive count milli-rpm (object 0x60A9;"
                " its firmware may need an update), or check gear and lead."
            )

    def increments(self, position: float) -> int:
        """Return a position [length] in drive increments, rounded."""
        return round(self._increments(position))

    def position(self, increments: int) -> float:
        """Return the position of so many increments [length]."""
        return increments / self._per_length

    def velocity(self, speed: float) -> int:
        """Return a speed [length/s] in drive units, rounded.

        Raise TypeError, ValueError if it is not a number, or beyond the axis's top speed.
        """
        top = self.axis.speed * (1.0 + 1e-9)  # a product in the caller may be off in its last digit
        in_range("speed", speed, -top, top, "m/s or rad/s", "Raise the axis's speed in the rig's file, or go slower.")
        return round(self.axis.direction * speed * self._per_speed)

    def speed(self, velocity: int) -> float:
        """Return the speed of so many velocity units [length/s]."""
        return self.axis.direction * velocity / self._per_speed

    def ramp(self, acceleration: float) -> int:
        """Return an acceleration [length/s2] in [rpm/s], rounded, at least 1."""
        return max(round(acceleration * self._rpm), 1)

    def acceleration(self, ramp: int) -> float:
        """Return the acceleration of so many rpm/s [length/s2]."""
        return ramp / self._rpm

    @property
    def _rpm(self) -> float:
        """Speed of the motor at one length a second [rpm]."""
        return 60.0 * self.axis.gear / self.axis.lead

    @property
    def _per_speed(self) -> float:
        return self.steps * self._rpm

    @property
    def _per_length(self) -> float:
        return self.axis.direction * _EDGES * self.axis.pulses * self.axis.gear / self.axis.lead

    def _increments(self, position: float) -> float:
        return position * self._per_length

    @staticmethod
    def _count(name: str, value: float, unit: str, cure: str) -> None:
        in_range(f"{name}, as the drive counts it,", value, -_INT32, _INT32, unit, cure)
