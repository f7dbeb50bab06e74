"""Object dictionary of a drive by SDO, and its set-up."""

from __future__ import annotations

import contextlib
import logging
import math
import struct
import threading
from typing import Any

from cutenv.rig.config.settings import Axis, Bus
from cutenv.rig.devices.canopen import objects as o
from cutenv.rig.devices.canopen.network import DRIVE_PATIENCE, CanNetwork
from cutenv.rig.devices.canopen.objects import SDO_REQUEST_FRAME, SDO_RESPONSE_FRAME, AxisUnits, Entry
from cutenv.rig.errors import RigError

_ANSWER_LIMIT = 0.5  # [s]; a drive takes a millisecond, unless it writes to its memory


class Unanswered(RigError):
    """Error for a drive's missing, late or wrong answer."""


class SdoRefused(RigError):
    """Error for a drive's answer with an abort code."""


class SdoChannel:
    """Values that a drive keeps by index and sub-index.

    Every method raises :class:`Unanswered` after half a second without an answer, :class:`SdoRefused` if the drive
    aborts, and :class:`RigError` if the bus is broken; the messages name axis, node and object.
    """

    def __init__(self, network: CanNetwork, node: int, name: str) -> None:
        from canopen.objectdictionary import ObjectDictionary
        from canopen.sdo.client import SdoClient

        self._network, self._node, self._name = network, node, name
        self._one_at_a_time = threading.Lock()
        client_class: Any = SdoClient  # canopen's classes are typed in part
        dictionary_class: Any = ObjectDictionary
        client = client_class(SDO_REQUEST_FRAME + node, SDO_RESPONSE_FRAME + node, dictionary_class())
        client.RESPONSE_TIMEOUT = _ANSWER_LIMIT
        client.network = network
        self._client = client
        # canopen also logs as an error what it raises, and a first question is repeated.
        logging.getLogger("canopen.sdo.client").setLevel(logging.CRITICAL)
        network.listen(SDO_RESPONSE_FRAME + node, self._answer)

    def close(self) -> None:
        """Stop listening to answers."""
        self._network.ignore(SDO_RESPONSE_FRAME + self._node)

    def read(self, entry: Entry) -> int:
        """Return the value of an entry."""
        data: bytes = self._ask("read", entry, self._client.upload, entry.index, entry.sub)
        layout = struct.Struct(f"<{entry.kind}")
        if len(data) != layout.size:
            raise Unanswered(
                f"{self._where} answers {len(data)} bytes for {entry}, which has {layout.size}. Is it an EPOS4?"
            )
        value: int = layout.unpack(data)[0]
        return value

    def put(self, entry: Entry, value: int) -> None:
        """Write a value that cannot be read back, such as a controlword."""
        try:
            data = struct.pack(f"<{entry.kind}", value)
        except struct.error as error:
            raise RigError(f"{self._where}: {value} does not fit {entry}: {error}. Check the rig's file.") from error
        self._ask(f"take {value} as", entry, self._client.download, entry.index, entry.sub, data)

    def write(self, entry: Entry, value: int) -> None:
        """Write a value, and check that the drive keeps it."""
        self.put(entry, value)
        there = self.read(entry)
        if there != value:
            raise RigError(
                f"{self._where} keeps {there} (0x{there & 0xFFFFFFFF:X}) in {entry}, where {value}"
                f" (0x{value & 0xFFFFFFFF:X}) was written. Another program or the maker's tool may be connected:"
                " close it."
            )

    def _ask(self, verb: str, entry: Entry, question: Any, *arguments: Any) -> Any:
        from canopen.sdo.exceptions import SdoAbortedError, SdoCommunicationError

        with self._one_at_a_time:
            try:
                return question(*arguments)
            except SdoAbortedError as error:
                raise SdoRefused(f"{self._where} does not {verb} {entry}: {error}.") from error
            except SdoCommunicationError as error:
                raise Unanswered(f"{self._where} does not {verb} {entry}: {error}.") from error

    def _answer(self, data: bytes, time: float) -> None:
        if len(data) == 8:  # canopen would fail on a shorter one
            self._client.on_response(SDO_RESPONSE_FRAME + self._node, data, time)

    @property
    def _where(self) -> str:
        return f"{self._name}: node {self._node}"


PRODUCER_PERIOD = 0.050  # period of a drive's heartbeat [s]
_FIRST_QUESTIONS = 4  # times the answer limit of an SDO: a drive that was just switched on is booting


def check_identity(dictionary: SdoChannel, name: str, axis: Axis, bus: Bus) -> None:
    """Check that the node exists and is a maxon drive.

    Raise RigError, with what was found and expected, if it is not.
    """
    for left in reversed(range(_FIRST_QUESTIONS)):
        try:
            device = dictionary.read(o.DEVICE_TYPE)
            break
        except Unanswered as error:
            if not left:
                raise RigError(
                    f"{name}: node {axis.node} does not answer on {bus.interface} {bus.channel}. Is the drive powered,"
                    f" is its node number {axis.node} and its bit rate {bus.bitrate} bit/s, is the bus terminated by"
                    " 120 ohm at both ends?"
                ) from error
    vendor = dictionary.read(o.VENDOR)
    for entry, found, expected in ((o.DEVICE_TYPE, device, o.SERVO_402), (o.VENDOR, vendor, o.MAXON)):
        if found != expected:
            raise RigError(
                f"{name}: node {axis.node} is not the drive expected: {entry} is 0x{found:08X}, expected"
                f" 0x{expected:08X}. Check the node number in the rig's file."
            )


def configure(dictionary: SdoChannel, name: str, axis: Axis, bus: Bus) -> AxisUnits:
    """Write the set-up to a drive without power, in PRE-OPERATIONAL.

    Return its units. Raise RigError if gear or encoder differ from the settings, or the drive does not keep a value,
    with the object's name.
    """
    _check_mechanics(dictionary, name, axis)
    try:
        units = AxisUnits(axis=axis, steps=_velocity_steps(dictionary, name))
    except ValueError as error:
        raise RigError(f"{name}: {error}") from error
    for entry, value in set_up(axis, units).items():
        dictionary.write(entry, value)
    for pdo in (o.COMMAND_PDO, o.STATUS_PDO, o.MEASURED_PDO):
        _map(dictionary, pdo, axis.node)
    # Last: a drive whose set-up fails half way does not go into fault when this computer ends.
    dictionary.write(o.CONSUMER_HEARTBEAT, bus.node << 16 | round(1e3 * DRIVE_PATIENCE))
    return units


def set_up(axis: Axis, units: AxisUnits) -> dict[o.Entry, int]:
    """Return motion and limit objects to write, in order, with values."""
    ends = sorted((units.increments(axis.low), units.increments(axis.high)))
    return {
        o.PRODUCER_HEARTBEAT: round(1e3 * PRODUCER_PERIOD),
        o.ABORT_CONNECTION: o.ABORT_BY_QUICK_STOP,
        o.QUICK_STOP_OPTION: o.STOP_AND_STAY,
        o.FAULT_REACTION: o.FAULT_BY_QUICK_STOP,
        o.MODE: o.PROFILE_VELOCITY,
        o.CURRENT_LIMIT: round(1e3 * axis.current_limit),
        o.FOLLOWING_WINDOW: abs(units.increments(axis.following_error)),
        o.LOW_LIMIT: ends[0],
        o.HIGH_LIMIT: ends[1],
        o.MOTOR_SPEED_LIMIT: math.ceil(abs(units.velocity(axis.speed)) / units.steps),
        o.PROFILE_SPEED_LIMIT: abs(units.velocity(axis.speed)),
        o.PROFILE_ACCELERATION: units.ramp(axis.acceleration),
        o.PROFILE_DECELERATION: units.ramp(axis.acceleration),
        o.QUICK_STOP_DECELERATION: units.ramp(axis.quick_stop),
    }


def read_limits(dictionary: SdoChannel, units: AxisUnits) -> dict[str, float]:
    """Return the drive's travel, speed, acceleration and deceleration limits, in SI."""
    low, high = sorted(units.position(dictionary.read(entry)) for entry in (o.LOW_LIMIT, o.HIGH_LIMIT))
    return {
        "low": low,
        "high": high,
        "speed": abs(units.speed(dictionary.read(o.PROFILE_SPEED_LIMIT))),
        "acceleration": units.acceleration(dictionary.read(o.PROFILE_ACCELERATION)),
        "quick_stop": units.acceleration(dictionary.read(o.QUICK_STOP_DECELERATION)),
    }


def read_identity(dictionary: SdoChannel, units: AxisUnits) -> dict[str, float | str]:
    """Return the data a drive reports about itself."""
    return {
        "device_type": f"0x{dictionary.read(o.DEVICE_TYPE):08X}",
        "vendor": f"0x{dictionary.read(o.VENDOR):08X}",
        "gear": f"{dictionary.read(o.GEAR_NUMERATOR)}/{dictionary.read(o.GEAR_DENOMINATOR)}",
        "encoder_pulses": dictionary.read(o.ENCODER_PULSES),
        "velocity_unit_rpm": 1.0 / units.steps,
        "current_limit_A": 1e-3 * dictionary.read(o.CURRENT_LIMIT),
        "following_window_increments": dictionary.read(o.FOLLOWING_WINDOW),
        "producer_heartbeat_ms": dictionary.read(o.PRODUCER_HEARTBEAT),
    }


def _check_mechanics(dictionary: SdoChannel, name: str, axis: Axis) -> None:
    numerator, denominator = dictionary.read(o.GEAR_NUMERATOR), dictionary.read(o.GEAR_DENOMINATOR)
    if not denominator or not math.isclose(numerator / denominator, axis.gear, rel_tol=1e-6):
        raise RigError(
            f"{name}: the drive is set to a gear of {numerator}/{denominator} ({o.GEAR_NUMERATOR}), the rig's file has"
            f" gear = {axis.gear:g}. Correct the one that is wrong: every length and speed depends on it."
        )
    pulses = dictionary.read(o.ENCODER_PULSES)
    if pulses != axis.pulses:
        raise RigError(
            f"{name}: the drive is set to {pulses} pulses ({o.ENCODER_PULSES}), the rig's file has pulses ="
            f" {axis.pulses}. Correct the one that is wrong: every length and speed depends on it."
        )


def _velocity_steps(dictionary: SdoChannel, name: str) -> int:
    """Request milli-rpm; return the steps per rpm kept (whole rpm in old firmware)."""
    with contextlib.suppress(SdoRefused):  # the kept value is read below
        dictionary.put(o.VELOCITY_UNIT, o.MILLI_RPM)
    try:
        unit = dictionary.read(o.VELOCITY_UNIT)
    except SdoRefused:
        return o.VELOCITY_STEPS[o.WHOLE_RPM]
    if unit not in o.VELOCITY_STEPS:
        raise RigError(
            f"{name}: the drive counts speed in the unit 0x{unit:08X} ({o.VELOCITY_UNIT}), which is not a revolution a"
            f" minute or decimal part of one. Set it to 0x{o.MILLI_RPM:08X} (milli-rpm) with the maker's tool."
        )
    return o.VELOCITY_STEPS[unit]


def _map(dictionary: SdoChannel, pdo: o.Pdo, node: int) -> None:
    """Map a PDO as in CiA 301: disable, empty, fill, enable."""
    number = dictionary.read(pdo.number) & o.PDO_NO_REQUEST | pdo.frame + node
    dictionary.write(pdo.number, number | o.PDO_UNUSED)
    dictionary.write(pdo.type, pdo.transmission)
    dictionary.write(pdo.count, 0)
    for place, entry in enumerate(pdo.entries, start=1):
        dictionary.write(pdo.slot(place), entry.mapping)
    dictionary.write(pdo.count, len(pdo.entries))
    dictionary.write(pdo.number, number)
