"""Emulated axis: the drive's state machine (CiA 402) and objects.

Its objects command the motor and report its state. The object dictionary is that of an EPOS4: every object that the
rig's master uses, with type, range and default.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Iterable, Iterator
from enum import IntEnum
from fractions import Fraction

import numpy as np
from canopen import SdoAbortedError

from cutenv.emulation.mechanics import (
    MODE_OFF,
    MODE_RAMP,
    MODE_VELOCITY,
    MOTOR,
    Mechanics,
    force_per_ampere,
    motor_record,
    turn_motor,
)
from cutenv.rig.config.settings import Axis, CrossAxis
from cutenv.rig.devices.canopen import objects as o
from cutenv.rig.devices.canopen.objects import WHOLE_RPM, Entry
from cutenv.rig.devices.protocols import DriveState

_MAX_SPEED = 2**32 - 1


class Abort(IntEnum):
    """Reason for refusing an SDO transfer (CiA 301)."""

    READ_ONLY = 0x06010002
    NO_OBJECT = 0x06020000
    NOT_MAPPABLE = 0x06040041
    PDO_LENGTH = 0x06040042
    LENGTH = 0x06070010
    NO_SUBINDEX = 0x06090011
    VALUE = 0x06090030
    TOO_HIGH = 0x06090031
    TOO_LOW = 0x06090032
    DEVICE_STATE = 0x08000022


def _range(entry: Entry) -> tuple[int, int]:
    """Return the least and the greatest number of an entry's kind."""
    signed = entry.kind.islower()
    return -(1 << entry.bits - 1) if signed else 0, (1 << entry.bits - signed) - 1


def _check(entry: Entry, value: int) -> None:
    """Raise SdoAbortedError for a value out of range."""
    low, high = _range(entry)
    if value > (high if entry.high is None else entry.high):
        raise SdoAbortedError(Abort.TOO_HIGH)
    if value < (low if entry.low is None else entry.low):
        raise SdoAbortedError(Abort.TOO_LOW)
    if entry.choices and value not in entry.choices:
        raise SdoAbortedError(Abort.VALUE)


class ObjectDictionary:
    """Objects of one node, with their values.

    canopen's SDO server reads and writes it by :meth:`get_data` and :meth:`set_data`, which have its names.
    ``written``: called as ``written(entry, value)`` before a master's value is stored; raises ``SdoAbortedError`` to
    refuse it.
    """

    object_dictionary = None  # of canopen's own kind, which its server keeps for a client's use

    def __init__(
        self, entries: Iterable[Entry], written: Callable[[Entry, int], None] = lambda entry, value: None
    ) -> None:
        self.entries = {(entry.index, entry.sub): entry for entry in entries}
        self._indices = {index for index, _ in self.entries}
        self._ranges = {place: _range(entry) for place, entry in self.entries.items()}
        self._written = written
        self._values: dict[tuple[int, int], int | str] = {place: e.default for place, e in self.entries.items()}
        self.keep()

    def keep(self) -> None:
        """Store the present values as those after power on."""
        self._kept = dict(self._values)

    def restore(self) -> None:
        """Restore every stored value, as after power on."""
        self._values = dict(self._kept)

    def entry(self, index: int, sub: int) -> Entry:
        """Return the sub-object; raises ``SdoAbortedError`` if there is none."""
        if (found := self.entries.get((index, sub))) is None:
            raise SdoAbortedError(Abort.NO_SUBINDEX if index in self._indices else Abort.NO_OBJECT)
        return found

    def __getitem__(self, place: tuple[int, int] | int) -> int:
        """Return the number; a plain index means sub-index 0."""
        value = self._values[(place, 0) if isinstance(place, int) else place]
        assert isinstance(value, int)
        return value

    def __setitem__(self, place: tuple[int, int] | int, value: int) -> None:
        """Set a value from the drive, clipped to its range."""
        where = (place, 0) if isinstance(place, int) else place
        low, high = self._ranges[where]
        self._values[where] = min(max(value, low), high)

    def get_data(self, index: int, sub: int, check_readable: bool = False) -> bytes:
        """Return the value in its form on the bus."""
        kind, value = self.entry(index, sub).kind, self._values[index, sub]
        return value.encode() if isinstance(value, str) else struct.pack(f"<{kind}", value)

    def set_data(self, index: int, sub: int, data: bytes, check_writable: bool = True) -> None:
        """Write the bytes from an SDO client or an RPDO."""
        entry = self.entry(index, sub)
        if entry.access == "ro":
            raise SdoAbortedError(Abort.READ_ONLY)
        if 8 * len(data) != entry.bits:
            raise SdoAbortedError(Abort.LENGTH)
        value: int = struct.unpack(f"<{entry.kind}", data)[0]
        _check(entry, value)
        self._written(entry, value)
        if index != 0x1010:  # a store command has no value
            self._values[index, sub] = value


def epos4(node: int) -> list[Entry]:
    """Return an EPOS4 50/15's objects; defaults from its device file, to be confirmed."""
    entries = [*o.NAMED, *_process_data(node), *_others(node)]
    given = {(entry.index, entry.sub) for entry in entries}
    highest = {index: sub for index, sub in sorted(given)}
    return entries + [
        Entry(index, 0, "B", "highest sub-index", "ro", sub)
        for index, sub in highest.items()
        if (index, 0) not in given
    ]


def _process_data(node: int) -> Iterator[Entry]:
    for number in range(4):
        for settings, mapping, cob, mapped in (
            (0x1400 + number, 0x1600 + number, 0x200, o.CONTROLWORD),
            (0x1800 + number, 0x1A00 + number, o.PDO_NO_REQUEST | 0x180, o.STATUSWORD),
        ):
            unused = o.PDO_UNUSED if number else 0
            yield Entry(settings, 1, "I", "COB-ID", default=unused | cob + 0x100 * number + node)
            yield Entry(settings, 2, "B", "transmission type", default=255, choices=(*range(241), 254, 255))
            if settings >= 0x1800:
                yield Entry(settings, 3, "H", "inhibit time [0.1 ms]", default=10)
                yield Entry(settings, 5, "H", "event timer [ms]")
            yield Entry(mapping, 0, "B", "mapped objects", default=0 if number else 1, high=8)
            for sub in range(1, 9):
                yield Entry(mapping, sub, "I", "mapped object", default=mapped.mapping if number < sub == 1 else 0)


def _others(node: int) -> Iterator[Entry]:
    yield Entry(0x1001, 0, "B", "error register", "ro", mappable="T")
    yield Entry(0x1003, 0, "B", "errors in history", high=0)
    for sub in range(1, 6):
        yield Entry(0x1003, sub, "I", "error", "ro")
        yield Entry(0x3000, sub, "I", "axis configuration")
    yield Entry(0x1005, 0, "I", "COB-ID of SYNC", default=0x80, low=0x80, high=0x80)
    yield Entry(0x1008, 0, "s", "device name", "ro", "EPOS4")
    yield Entry(0x100A, 0, "s", "software version", "ro", "0170h (emulated)")
    yield Entry(0x1010, 1, "I", "store all parameters", default=1)
    yield Entry(0x1014, 0, "I", "COB-ID of emergencies", "ro", 0x80 + node)
    yield Entry(0x1018, 2, "I", "product", "ro", 0x63500000)  # EPOS4 50/15
    yield Entry(0x1018, 3, "I", "revision", "ro", 0x01700000)
    yield Entry(0x1018, 4, "I", "serial number", "ro", 0x1000 + node)
    yield Entry(0x1200, 1, "I", "SDO from the client", "ro", 0x600 + node)
    yield Entry(0x1200, 2, "I", "SDO to the client", "ro", 0x580 + node)
    yield Entry(0x2000, 0, "B", "node number", "ro", node)
    yield Entry(0x3001, 1, "I", "nominal current [mA]", default=2720)
    yield Entry(0x3001, 3, "B", "pole pairs", default=1, low=1)
    yield Entry(0x3001, 4, "H", "thermal time constant [0.1 s]", default=40)
    yield Entry(0x3001, 5, "I", "torque constant [uN m/A]", default=20000)
    yield Entry(0x3003, 3, "I", "fastest input speed [rpm]", default=100000)
    yield Entry(0x3010, 2, "H", "encoder type", default=1)
    yield Entry(0x603F, 0, "H", "error code", "ro", mappable="T")
    yield Entry(0x605B, 0, "h", "shutdown option", default=0, low=0, high=1)
    yield Entry(0x605C, 0, "h", "disable operation option", default=1, low=0, high=1)
    yield Entry(0x6062, 0, "i", "position demanded [increments]", "ro", mappable="T")
    yield Entry(0x606B, 0, "i", "velocity demanded", "ro", mappable="T")
    yield Entry(0x606D, 0, "H", "velocity window", default=50)
    yield Entry(0x6076, 0, "I", "rated torque [uN m]", default=100000, low=1)
    yield Entry(0x607C, 0, "i", "home offset [increments]")
    yield Entry(0x6081, 0, "I", "profile velocity", default=1000)
    yield Entry(0x6086, 0, "h", "profile type", choices=(0,))
    yield Entry(0x6098, 0, "b", "homing method", default=37, choices=(35, 37))
    yield Entry(0x60C2, 1, "B", "interpolation time", default=1)
    yield Entry(0x60C2, 2, "b", "interpolation time, power of ten", default=-3, low=-6, high=0)
    yield Entry(0x60C5, 0, "I", "greatest acceleration [rpm/s]", default=_MAX_SPEED, low=1)
    yield Entry(0x60C6, 0, "I", "greatest deceleration [rpm/s]", default=_MAX_SPEED, low=1)
    yield Entry(0x60F4, 0, "i", "following error [increments]", "ro", mappable="T")
    yield Entry(0x60FD, 0, "I", "digital inputs", "ro", mappable="T")
    yield Entry(0x6502, 0, "I", "supported modes", "ro", 0x124)


S = DriveState

STATUSWORDS = {
    S.NOT_READY: 0x0000,
    S.DISABLED: 0x0040,
    S.READY: 0x0021,
    S.SWITCHED_ON: 0x0033,
    S.ENABLED: 0x0037,
    S.QUICK_STOP: 0x0017,
    S.REACTING: 0x001F,
    S.FAULT: 0x0008,
}
"""Bits 0 to 6 of the statusword (6041), the power stage's voltage (bit 4) among them: masked by 0x6F, CiA 402's."""

POWERED = frozenset({S.ENABLED, S.QUICK_STOP, S.REACTING})  # states in which the motor has torque


class StatusBit(IntEnum):
    """Other bits of the statusword."""

    REMOTE = 0x0200
    TARGET_REACHED = 0x0400
    INTERNAL_LIMIT = 0x0800
    AT_REST = 0x1000  # bit set at rest in profile velocity mode, or, in homing mode, when home is found
    FOLLOWING_ERROR = 0x2000
    HOMED = 0x8000


class DriveCommand(IntEnum):
    """Command in a controlword's low byte (6040), masked as in CiA 402."""

    DISABLE_VOLTAGE = 0
    QUICK_STOP = 1
    SHUTDOWN = 2
    SWITCH_ON = 3
    ENABLE = 4


FAULT_RESET_BIT = 0x80
HALT = 0x100


def command(controlword: int) -> DriveCommand:
    """Return the command in a controlword, without its fault reset."""
    if not controlword & 0x02:
        return DriveCommand.DISABLE_VOLTAGE
    if not controlword & 0x04:
        return DriveCommand.QUICK_STOP
    if not controlword & 0x01:
        return DriveCommand.SHUTDOWN
    return DriveCommand.ENABLE if controlword & 0x08 else DriveCommand.SWITCH_ON


_NEXT = {
    (S.DISABLED, DriveCommand.SHUTDOWN): S.READY,
    (S.READY, DriveCommand.SWITCH_ON): S.SWITCHED_ON,
    (S.READY, DriveCommand.ENABLE): S.ENABLED,  # by way of switched on
    (S.READY, DriveCommand.DISABLE_VOLTAGE): S.DISABLED,
    (S.READY, DriveCommand.QUICK_STOP): S.DISABLED,
    (S.SWITCHED_ON, DriveCommand.ENABLE): S.ENABLED,
    (S.SWITCHED_ON, DriveCommand.SHUTDOWN): S.READY,
    (S.SWITCHED_ON, DriveCommand.DISABLE_VOLTAGE): S.DISABLED,
    (S.SWITCHED_ON, DriveCommand.QUICK_STOP): S.DISABLED,
    (S.ENABLED, DriveCommand.SWITCH_ON): S.SWITCHED_ON,
    (S.ENABLED, DriveCommand.SHUTDOWN): S.READY,
    (S.ENABLED, DriveCommand.DISABLE_VOLTAGE): S.DISABLED,
    (S.ENABLED, DriveCommand.QUICK_STOP): S.QUICK_STOP,
    (S.QUICK_STOP, DriveCommand.DISABLE_VOLTAGE): S.DISABLED,
}


def after(state: DriveState, controlword: int, before: int, *, quick_stop_option: int) -> DriveState:
    """Return the state after a controlword.

    ``before`` is the controlword before: a rising edge of bit 7 resets a fault; ``quick_stop_option``: value of object
    605A: from 5 on the drive stays in quick stop, and may be enabled again.
    """
    if state is S.FAULT:
        return S.DISABLED if controlword & FAULT_RESET_BIT and not before & FAULT_RESET_BIT else S.FAULT
    asked = command(controlword)
    if state is S.QUICK_STOP and asked is DriveCommand.ENABLE and quick_stop_option >= 5:
        return S.ENABLED
    return _NEXT.get((state, asked), state)


_DISABLED = 0xFFFFFFFF  # a following-error window that is switched off
_HOMING, _NEW_TASK = 6, 0x10  # mode; bit of the controlword that starts homing
_FURTHEST_AHEAD = 0.002  # [s]
_SLOW = 1e-4  # [m/s or rad/s] below which an axis is at rest


class EmulatedAxis:
    """Motor and mechanics of one axis, as its drive sees them.

    ``position``: position at the start [m or rad]; the encoder is referenced: 0 increments are 0; ``margin``: distance
    from the ends of its travel to the mechanical ends [m or rad]. ``homed``: True if the drive reports that its
    position is referenced to home; only axes across the cut are asked for it; ``encoder_stuck``: fault: position and
    velocity stay constant; the loop goes on by the motor's own commutation.
    """

    def __init__(self, name: str, settings: Axis, mechanics: Mechanics, *, position: float, margin: float) -> None:
        self.name = name
        self.settings = settings
        self.encoder_stuck, self.homed = False, isinstance(settings, CrossAxis)
        self._motors = motor_record(settings, mechanics, position=position, margin=margin)
        # A plain void on the same memory: its fields are read ten times faster than a record's attributes.
        self.motor = self._motors.view(np.dtype((np.void, MOTOR)))[0]
        self._mechanics = mechanics
        self._increment = settings.direction * settings.lead / (settings.gear * 4 * settings.pulses)
        self._force_per_ampere = force_per_ampere(settings, mechanics)
        self._torque_per_force = settings.direction * mechanics.torque_constant / self._force_per_ampere
        self._shift = 0  # offset of the encoder's zero, set by homing
        self._homed = False
        self._stuck_at = 0

    def commission(self, dictionary: ObjectDictionary) -> None:
        """Enter motor, gear and encoder, as when mounting the drive."""
        gear = Fraction(self.settings.gear).limit_denominator(10000)
        dictionary[0x3003, 1], dictionary[0x3003, 2] = gear.numerator, gear.denominator
        dictionary[0x3010, 1] = self.settings.pulses
        dictionary[0x3001, 5] = round(1e6 * self._mechanics.torque_constant)

    # Units of the drive.

    def _revolution(self, dictionary: ObjectDictionary) -> float:
        """Return travel per motor turn, known to the drive [m or rad]."""
        return self._increment * 4 * dictionary[0x3010, 1]

    def _velocity(self, dictionary: ObjectDictionary) -> float:
        """Return one velocity unit of the drive [m/s or rad/s]."""
        return self._revolution(dictionary) / (60.0 if dictionary[0x60A9] == WHOLE_RPM else 60000.0)

    def units(self, dictionary: ObjectDictionary, speed: float) -> int:
        """Return a speed [m/s or rad/s] in the drive's velocity units."""
        return round(speed / self._velocity(dictionary))

    def increments(self, ahead: float = 0.0) -> int:
        """Return the encoder's count, ``ahead`` [s] of the last millisecond."""
        if self.encoder_stuck:
            return self._stuck_at
        position = float(self.motor["position"]) + ahead * float(self.motor["speed"])
        return math.floor(position / self._increment + 0.5) + self._shift

    def _demanded(self) -> int:
        return math.floor(float(self.motor["demand_position"]) / self._increment + 0.5) + self._shift

    def stick(self, stuck: bool) -> None:
        """Freeze the encoder at its present count, or release it."""
        self._stuck_at = self.increments()
        self.encoder_stuck = stuck

    def shift(self, way: float) -> None:
        """Shift the encoder's zero by ``way`` [m or rad]."""
        self._shift += round(way / self._increment)

    # Commands of the drive to the motor.

    def release(self) -> None:
        """Switch off the torque."""
        self.motor["mode"] = MODE_OFF

    def drive(self, dictionary: ObjectDictionary, state: DriveState, controlword: int, *, stopping: bool) -> None:
        """Set the motor's task by state, mode and target, within limits."""
        motor = self.motor
        unit, per_rpm = self._velocity(dictionary), abs(self._revolution(dictionary)) / 60.0
        motor["strongest"] = 1e-3 * dictionary[0x3001, 2] * self._force_per_ampere
        motor["fastest"] = min(dictionary[0x607F] * abs(unit), dictionary[0x6080] * per_rpm)
        slower = 0x6084 if stopping or (state is DriveState.REACTING and dictionary[0x605E] == 1) else 0x6085
        motor["ramp"] = dictionary[slower] * per_rpm
        mode = dictionary[0x6060]
        up, down = (0x60C5, 0x60C6) if mode == 9 else (0x6083, 0x6084)
        motor["acceleration"], motor["deceleration"] = dictionary[up] * per_rpm, dictionary[down] * per_rpm
        moves = state is DriveState.ENABLED and mode in (3, 9) and not controlword & HALT
        motor["target"] = dictionary[0x60FF] * unit if moves else 0.0
        if state not in POWERED:
            motor["mode"] = MODE_OFF
        elif state is DriveState.ENABLED and not stopping:
            motor["mode"] = MODE_VELOCITY
        else:
            motor["mode"] = MODE_RAMP

    def controlled(self, dictionary: ObjectDictionary, state: DriveState, controlword: int, before: int) -> None:
        """Apply a controlword's mode bits; homing sets position to home offset."""
        starts = controlword & _NEW_TASK and not before & _NEW_TASK
        if state is DriveState.ENABLED and dictionary[0x6060] == _HOMING and starts:
            self._shift += dictionary[0x607C] - self.increments()
            self._homed = True

    def turn(self, load: float) -> None:
        """Advance a millisecond under ``load`` [N or N m], negative toward the clamp."""
        turn_motor(self._motors, load)

    # State of the motor, as the drive reports it.

    def tell(self, dictionary: ObjectDictionary, state: DriveState, operational: bool, *, ahead: float = 0.0) -> None:
        """Set the state's objects, ``ahead`` [s] of the last millisecond.

        A drive latches its encoder when SYNC arrives. Reported as of the last millisecond, a constant speed would seem
        to change by a fifth from one SYNC to the next.
        """
        motor, unit = self.motor, self._velocity(dictionary)
        position, demanded = self.increments(min(max(ahead, 0.0), _FURTHEST_AHEAD)), self._demanded()
        speed = 0 if self.encoder_stuck else round(motor["speed"] / unit)
        dictionary[0x6061] = dictionary[0x6060]
        dictionary[0x6064], dictionary[0x6062] = position, demanded
        dictionary[0x60F4] = demanded - position
        dictionary[0x606C], dictionary[0x606B] = speed, round(motor["demand"] / unit)
        dictionary[0x6077] = round(1e9 * motor["force"] * self._torque_per_force / dictionary[0x6076])
        switches = [motor["carriage"] <= motor["low"], motor["carriage"] >= motor["high"]]
        if self.settings.direction < 0:
            switches.reverse()
        dictionary[0x60FD] = switches[0] | switches[1] << 1 | (abs(motor["carriage"]) < 5e-4) << 2
        word = STATUSWORDS[state] | (StatusBit.REMOTE if operational else 0)
        if dictionary[0x6061] == _HOMING:
            word |= (StatusBit.AT_REST | StatusBit.TARGET_REACHED) if self._homed else 0
        elif state in POWERED:
            reached = abs(motor["target"] - motor["speed"]) <= dictionary[0x606D] * abs(unit)
            word |= StatusBit.TARGET_REACHED if reached else 0
            word |= StatusBit.AT_REST if speed == 0 else 0
            word |= StatusBit.INTERNAL_LIMIT if abs(motor["target"]) > motor["fastest"] else 0
        if self.lags_too_far(dictionary):
            word |= StatusBit.FOLLOWING_ERROR
        if self.homed:
            word |= StatusBit.HOMED
        dictionary[0x6041] = word

    def rests(self) -> bool:
        """Return whether the axis is and should be at rest."""
        return bool(self.motor["demand"] == 0.0 and abs(self.motor["speed"]) < _SLOW)

    def lags_too_far(self, dictionary: ObjectDictionary) -> bool:
        """Return whether the following error exceeds object 6065."""
        window = dictionary[0x6065]
        return window != _DISABLED and abs(self._demanded() - self.increments()) > window

    def leaves_travel(self, dictionary: ObjectDictionary) -> bool:
        """Return whether the axis moves out beyond software limits (607D)."""
        low, high = dictionary[0x607D, 1], dictionary[0x607D, 2]
        if low >= high:
            return False  # off
        outward = self.motor["demand"] / self._increment
        position = self.increments()
        return (position > high and outward > 0.0) or (position < low and outward < 0.0)
