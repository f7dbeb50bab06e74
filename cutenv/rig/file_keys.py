"""Keys of a rig's file: one table of sections and keys, from which the file is read, written and explained."""

from __future__ import annotations

import dataclasses
import math
import typing
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

from cutenv.rig.settings import Axis, Bus, Calibration, Identified, Limits, RigSettings, Sensor


class Unit(NamedTuple):
    """Unit of a key: its size in SI units (or radians), and its sign beside a number."""

    factor: float
    sign: str


UNITS: Mapping[str, Unit] = MappingProxyType(
    {
        "": Unit(1.0, ""),
        "mm": Unit(1e-3, "mm"),
        "um": Unit(1e-6, "um"),
        "cm_s": Unit(1e-2, "cm/s"),
        "m_s2": Unit(1.0, "m/s2"),
        "deg": Unit(math.pi / 180.0, "deg"),
        "deg_s": Unit(math.pi / 180.0, "deg/s"),
        "deg_s2": Unit(math.pi / 180.0, "deg/s2"),
        "ms": Unit(1e-3, "ms"),
        "days": Unit(1.0, "days"),
        "Hz": Unit(1.0, "Hz"),
        "N": Unit(1.0, "N"),
        "N_per_s": Unit(1.0, "N/s"),
        "N_m": Unit(1.0, "N m"),
        "A": Unit(1.0, "A"),
        "bit_s": Unit(1.0, "bit/s"),
        "percent": Unit(1e-2, "%"),
        "periods": Unit(1.0, "periods"),
    }
)
"""Unit for each ending of a name in the file; a count, a ratio or a text has none."""


class Key(NamedTuple):
    """One line of the file.

    Attributes
    ----------
    field : str
        Field of the dataclass, in SI.
    unit : str
        A key of :data:`UNITS`.
    meaning : str
        Explanation for the comment above the line.
    example : str
        Plausible value of a key that a person has to supply and that has no default.
    """

    field: str
    unit: str
    meaning: str
    example: str = ""

    @property
    def name(self) -> str:
        """Name in the file: field and unit."""
        if self.field.endswith(self.unit) or self.field == "depth_profile":  # valid_days; a list of pairs, both mm
            return self.field
        return f"{self.field}_{self.unit}"

    def to_si(self, number: float) -> float:
        """Convert from the file's unit to SI, exactly where possible: 3.81 cm are 0.0381 m."""
        factor = UNITS[self.unit].factor
        parts = round(1.0 / factor)
        return number / parts if factor == 1.0 / parts else number * factor

    def from_si(self, value: float) -> float:
        """Convert from SI to the file's unit, in as few digits as restore the value exactly, and 15 at most."""
        number = value / UNITS[self.unit].factor
        shorter = (float(f"{number:.{digits}g}") for digits in (6, 12))
        return next((short for short in shorter if self.to_si(short) == value), float(f"{number:.15g}"))


_HINTS = {
    of: typing.get_type_hints(of) for of in (RigSettings, Bus, Axis, Sensor, Limits, Calibration, Identified)
}  # fmt: skip


class Section(NamedTuple):
    """One table of the file; the one without a name is at the top."""

    name: str
    about: str
    of: type[Any]
    keys: tuple[Key, ...]

    def where(self, key: Key) -> str:
        """Return the full name of a key, such as ``limits.force_N``."""
        return f"{self.name}.{key.name}" if self.name else key.name

    def limits(self, key: Key) -> tuple[float, float] | None:
        """Return least and greatest value in the file's unit; None if the dataclass documents none."""
        about = self._field(key).metadata
        return (key.from_si(about["low"]), key.from_si(about["high"])) if "low" in about else None

    def default(self, key: Key) -> Any:
        """Return the dataclass's default, in SI."""
        return self._field(key).default

    def kind(self, key: Key) -> type[Any]:
        """Return the type of the value: bool, int, float, str or tuple; for an optional one, its type if given."""
        hint = _HINTS[self.of][key.field]
        inner = [each for each in typing.get_args(hint) if each is not type(None)]
        if self.choices(key):
            return str
        if typing.get_origin(hint) is tuple:
            return tuple
        kind = inner[0] if inner else hint
        assert isinstance(kind, type), f"{self.of.__name__}.{key.field} is of a kind that no file holds: {hint}"
        return kind

    def choices(self, key: Key) -> tuple[str, ...]:
        """Return the texts allowed for a key; empty if any is."""
        hint = _HINTS[self.of][key.field]
        return typing.get_args(hint) if typing.get_origin(hint) is typing.Literal else ()

    def _field(self, key: Key) -> dataclasses.Field[Any]:
        return {field.name: field for field in dataclasses.fields(self.of)}[key.field]


def _axis_keys(length: str, speed: str, acceleration: str, examples: Mapping[str, str]) -> tuple[Key, ...]:
    keys = (
        Key("node", "", "Number of the drive on the bus, 1 to 127."),
        Key("gear", "", "Turns of the motor for one turn of the screw or hinge.", "4.4"),
        Key("lead", length, "Travel for one turn of the screw or hinge."),
        Key("pulses", "", "Pulses of the encoder for one turn of the motor; an increment is a quarter of one.", "1024"),
        Key("direction", "", "1 or -1: direction of the axis at a positive speed of the motor."),
        Key("low", length, "One end of travel: the drive's own software limit."),
        Key("high", length, "Other end of travel: the drive's own software limit."),
        Key("speed", speed, "Top speed of the drive, whatever is commanded."),
        Key("acceleration", acceleration, "Acceleration and deceleration of the drive."),
        Key("quick_stop", acceleration, "Deceleration of a quick stop."),
        Key("following_error", length, "Following error at which the drive itself stops."),
        Key("current_limit", "A", "Current limit of the motor, which bounds the force before anything else."),
        Key("rated_torque", "N_m", "Rated torque of the motor, the unit in which the drive reports torque."),
    )
    return tuple(key._replace(example=examples.get(key.field, key.example)) for key in keys)


_TOP = Section(
    "",
    "",
    RigSettings,
    (
        Key("name", "", "Name of the rig, for records and reports."),
        Key("armed_by", "", "Name of the person who answers for this rig's motion. Empty: nothing moves."),
        Key("emulated", "", "True for an emulator, which needs no operator. Never true for hardware."),
        Key("angle_mode", "", "The blade's angle is set by hand, or turned by a second axis: see [angle]."),
        Key("fixed_angle", "deg", "Angle of the blade if it is set by hand; 90 is upright."),
        Key(
            "depth_profile",
            "mm",
            "Depth of cut, measured by caliper on this specimen: [position_mm, depth_mm] from the clamp on, the first"
            " within 1 mm of it, depths 1 to 60 mm.",
            "[[0.0, 8.1], [5.0, 12.4], [20.0, 17.0], [150.0, 17.5]]",
        ),
    ),
)

SECTIONS = (
    _TOP,
    Section(
        "bus",
        "The CAN bus, as python-can names it.",
        Bus,
        (
            Key("interface", "", "socketcan, slcan, socketcand, ...", '"socketcan"'),
            Key("channel", "", "can0, /dev/ttyACM0, ..."),
            Key("bitrate", "bit_s", "Bit rate of the bus; the same in all drives."),
            Key("host", "", "Address of a socketcand gateway."),
            Key("port", "", "TCP port of a socketcand gateway."),
            Key("sync", "ms", "Period of SYNC, at which the axes report their position."),
            Key("node", "", "Number of this computer on the bus, whose heartbeat the drives watch."),
            Key("heartbeat", "ms", "Period of this computer's heartbeat."),
        ),
    ),
    Section("blade", "The axis that moves the blade along the cut.", Axis,
            _axis_keys("mm", "cm_s", "m_s2", {"lead": "2.0"})),
    Section("angle", 'The axis that turns the blade: with angle_mode = "free" only.', Axis,
            _axis_keys("deg", "deg_s", "deg_s2", {
                # The defaults are a screw's.
                "lead": "360.0", "node": "2", "low": "44.0", "high": "91.0", "speed": "100.0", "acceleration": "400.0",
                "quick_stop": "2000.0", "following_error": "2.0",
            })),
    Section(
        "sensor",
        "The force sensor (Net F/T), and how the cut lies in its axes.",
        Sensor,
        (
            Key("address", "", "Network address of the sensor.", '"192.168.1.1"'),
            Key("port", "", "Its UDP port for RDT."),
            Key("page", "", "Address of its configuration page; empty: http://ADDRESS/netftapi2.xml."),
            Key("rate", "Hz", "Rate of the readings, as set on its configuration page."),
            Key("cut_axis", "", "Axis of the sensor along the cut line."),
            Key("sign", "", "1 or -1: sign of the reading when the tissue resists forward motion."),
        ),
    ),
    Section(
        "limits",
        "Limits at which the blade is stopped, whatever the policy commands.",
        Limits,
        (
            Key("force", "N", "Force on each axis of the sensor."),
            Key("force_norm", "N", "Norm of the force on all three axes."),
            Key("force_rise", "N_per_s", "Rise of the force over 10 ms. In tissue at 2.54 cm/s it is some 15 N/s."),
            Key("speed", "cm_s", "Speed of the blade. Actions reach 2.54 cm/s."),
            Key("acceleration", "m_s2", "Acceleration of the blade."),
            Key("low", "mm", "End of travel at the clamp."),
            Key("high", "mm", "Far end of travel."),
            Key("angle_low", "deg", "Least angle of the blade. Actions reach 45 degrees."),
            Key("angle_high", "deg", "Greatest angle of the blade. Actions reach 90 degrees."),
            Key("stale_force", "ms", "Time without a reading of the force."),
            Key("stale_motion", "ms", "Time without a sample of an axis."),
            Key("heartbeat", "ms", "Time without a heartbeat of a drive."),
            Key("frozen_force", "ms", "Time during which all readings of the force have the same counts."),
            Key("late_force", "ms", "Delay of the readings in addition to the usual one."),
            Key("lost_force", "percent", "Share of readings lost over 100 ms."),
            Key("following", "mm", "Distance of the blade from where it should be."),
            Key("overrun", "periods", "Periods for which an action is held if the next one is late in motion."),
        ),
    ),
    Section(
        "calibration",
        "When and how the force sensor was last checked with known weights.",
        Calibration,
        (
            Key("date", "", 'Day of the check, such as 2026-03-01. "": never, and nothing moves.', "2026-03-01"),
            Key("valid_days", "days", "Time after which it must be checked again."),
            Key("gain", "", "True force over the sensor's reading."),
        ),
    ),
    Section(
        "identified",
        "What 'cutenv rig identify' has measured, and written here; the simulator adopts it.",
        Identified,
        (
            Key("date", "", "Day of the measurement."),
            Key("motor_lag", "ms", "Time constant of the velocity loop."),
            Key("dead_time", "ms", "Time between a command and the first motion."),
            Key("acceleration", "m_s2", "Limit of the axis."),
            Key("backlash", "um", "Play of gear and screw."),
            Key("friction", "N", "Friction of the empty axis, as a force on the carriage."),
            Key("force_noise", "N", "Standard deviation of the force at rest."),
            Key("force_resolution", "N", "Least step of the force reading."),
            Key("force_drift", "N", "Standard deviation after one second of the force's random walk."),
            Key("force_still_x", "ms", "Time for which the sensor's x force may stay at one count by its noise."),
            Key("force_still_y", "ms", "The same for its y force."),
            Key("force_still_z", "ms", "The same for its z force."),
        ),
    ),
)  # fmt: skip

IDENTIFIED = SECTIONS[-1]
"""Section that the program itself writes."""


def shown(settings: RigSettings, field: str) -> str:
    """Return a setting as in the file, such as ``limits.high_mm = 148`` for the field ``"limits.high"``."""
    of, _, name = field.rpartition(".")
    section = next(section for section in SECTIONS if section.name == of)
    key = next(key for key in section.keys if key.field == name)
    value = getattr(getattr(settings, of) if of else settings, name)
    told = f"{key.from_si(value):g}" if section.kind(key) is float else repr(value)
    return f"{section.where(key)} = {told}"
