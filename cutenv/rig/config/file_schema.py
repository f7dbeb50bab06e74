"""Keys of a rig's file: one table of sections and keys, from which the file is read, written and explained."""

from __future__ import annotations

import dataclasses
import math
import typing
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

from cutenv.rig.config.settings import (
    Axis,
    Bus,
    Identified,
    RigSettings,
    SafetyLimits,
    SensorCalibration,
    SensorSettings,
)


class Unit(NamedTuple):
    """Unit of a key: its size in SI units (or radians), and its sign beside a number."""

    factor: float
    sign: str


FILE_UNITS: Mapping[str, Unit] = MappingProxyType(
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


class FileKey(NamedTuple):
    """One line of the file.

    Attributes
    ----------
    field : str
        Field of the dataclass, in SI.
    unit : str
        A key of :data:`FILE_UNITS`.
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
        factor = FILE_UNITS[self.unit].factor
        parts = round(1.0 / factor)
        return number / parts if factor == 1.0 / parts else number * factor

    def from_si(self, value: float) -> float:
        """Convert from SI to the file's unit, in as few digits as restore the value exactly, and 15 at most."""
        number = value / FILE_UNITS[self.unit].factor
        shorter = (float(f"{number:.{digits}g}") for digits in (6, 12))
        return next((short for short in shorter if self.to_si(short) == value), float(f"{number:.15g}"))


_HINTS = {
    of: typing.get_type_hints(of) for of in (RigSettings, Bus, Axis, SensorSettings, SafetyLimits, SensorCalibration,
    Identified)
}  # fmt: skip


class FileSection(NamedTuple):
    """One table of the file; the one without a name is at the top."""

    name: str
    about: str
    of: type[Any]
    keys: tuple[FileKey, ...]

    def where(self, key: FileKey) -> str:
        """Return the full name of a key, such as ``limits.force_N``."""
        return f"{self.name}.{key.name}" if self.name else key.name

    def limits(self, key: FileKey) -> tuple[float, float] | None:
        """Return least and greatest value in the file's unit; None if the dataclass documents none."""
        about = self._field(key).metadata
        return (key.from_si(about["low"]), key.from_si(about["high"])) if "low" in about else None

    def default(self, key: FileKey) -> Any:
        """Return the dataclass's default, in SI."""
        return self._field(key).default

    def kind(self, key: FileKey) -> type[Any]:
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

    def choices(self, key: FileKey) -> tuple[str, ...]:
        """Return the texts allowed for a key; empty if any is."""
        hint = _HINTS[self.of][key.field]
        return typing.get_args(hint) if typing.get_origin(hint) is typing.Literal else ()

    def _field(self, key: FileKey) -> dataclasses.Field[Any]:
        return {field.name: field for field in dataclasses.fields(self.of)}[key.field]


def _axis_keys(length: str, speed: str, acceleration: str, examples: Mapping[str, str]) -> tuple[FileKey, ...]:
    keys = (
        FileKey("node", "", "Number of the drive on the bus, 1 to 127."),
        FileKey("gear", "", "Turns of the motor for one turn of the screw or hinge.", "4.4"),
        FileKey("lead", length, "Travel for one turn of the screw or hinge."),
        FileKey(
            "pulses", "", "Pulses of the encoder for one turn of the motor; an increment is a quarter of one.", "1024"
        ),
        FileKey("direction", "", "1 or -1: direction of the axis at a positive speed of the motor."),
        FileKey("low", length, "One end of travel: the drive's own software limit."),
        FileKey("high", length, "Other end of travel: the drive's own software limit."),
        FileKey("speed", speed, "Top speed of the drive, whatever is commanded."),
        FileKey("acceleration", acceleration, "Acceleration and deceleration of the drive."),
        FileKey("quick_stop", acceleration, "Deceleration of a quick stop."),
        FileKey("following_error", length, "Following error at which the drive itself stops."),
        FileKey("current_limit", "A", "Current limit of the motor, which bounds the force before anything else."),
        FileKey("rated_torque", "N_m", "Rated torque of the motor, the unit in which the drive reports torque."),
    )
    return tuple(key._replace(example=examples.get(key.field, key.example)) for key in keys)


_TOP = FileSection(
    "",
    "",
    RigSettings,
    (
        FileKey("name", "", "Name of the rig, for records and reports."),
        FileKey("armed_by", "", "Name of the person who answers for this rig's motion. Empty: nothing moves."),
        FileKey("emulated", "", "True for an emulator, which needs no operator. Never true for hardware."),
        FileKey("angle_mode", "", "The blade's angle is set by hand, or turned by a second axis: see [angle]."),
        FileKey("fixed_angle", "deg", "Angle of the blade if it is set by hand; 90 is upright."),
        FileKey(
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
    FileSection(
        "bus",
        "The CAN bus, as python-can names it.",
        Bus,
        (
            FileKey("interface", "", "socketcan, slcan, socketcand, ...", '"socketcan"'),
            FileKey("channel", "", "can0, /dev/ttyACM0, ..."),
            FileKey("bitrate", "bit_s", "Bit rate of the bus; the same in all drives."),
            FileKey("host", "", "Address of a socketcand gateway."),
            FileKey("port", "", "TCP port of a socketcand gateway."),
            FileKey("sync", "ms", "Period of SYNC, at which the axes report their position."),
            FileKey("node", "", "Number of this computer on the bus, whose heartbeat the drives watch."),
            FileKey("heartbeat", "ms", "Period of this computer's heartbeat."),
        ),
    ),
    FileSection("blade", "The axis that moves the blade along the cut.", Axis,
            _axis_keys("mm", "cm_s", "m_s2", {"lead": "2.0"})),
    FileSection("angle", 'The axis that turns the blade: with angle_mode = "free" only.', Axis,
            _axis_keys("deg", "deg_s", "deg_s2", {
                # The defaults are a screw's.
                "lead": "360.0", "node": "2", "low": "44.0", "high": "91.0", "speed": "100.0", "acceleration": "400.0",
                "quick_stop": "2000.0", "following_error": "2.0",
            })),
    FileSection(
        "sensor",
        "The force sensor (Net F/T), and how the cut lies in its axes.",
        SensorSettings,
        (
            FileKey("address", "", "Network address of the sensor.", '"192.168.1.1"'),
            FileKey("port", "", "Its UDP port for RDT."),
            FileKey("page", "", "Address of its configuration page; empty: http://ADDRESS/netftapi2.xml."),
            FileKey("rate", "Hz", "Rate of the readings, as set on its configuration page."),
            FileKey("cut_axis", "", "Axis of the sensor along the cut line."),
            FileKey("sign", "", "1 or -1: sign of the reading when the tissue resists forward motion."),
        ),
    ),
    FileSection(
        "limits",
        "Limits at which the blade is stopped, whatever the policy commands.",
        SafetyLimits,
        (
            FileKey("force", "N", "Force on each axis of the sensor."),
            FileKey("force_norm", "N", "Norm of the force on all three axes."),
            FileKey("force_rise", "N_per_s", "Rise of the force over 10 ms. In tissue at 2.54 cm/s it is some 15 N/s."),
            FileKey("speed", "cm_s", "Speed of the blade. Actions reach 2.54 cm/s."),
            FileKey("acceleration", "m_s2", "Acceleration of the blade."),
            FileKey("low", "mm", "End of travel at the clamp."),
            FileKey("high", "mm", "Far end of travel."),
            FileKey("angle_low", "deg", "Least angle of the blade. Actions reach 45 degrees."),
            FileKey("angle_high", "deg", "Greatest angle of the blade. Actions reach 90 degrees."),
            FileKey("stale_force", "ms", "Time without a reading of the force."),
            FileKey("stale_motion", "ms", "Time without a sample of an axis."),
            FileKey("heartbeat", "ms", "Time without a heartbeat of a drive."),
            FileKey("frozen_force", "ms", "Time during which all readings of the force have the same counts."),
            FileKey("late_force", "ms", "Delay of the readings in addition to the usual one."),
            FileKey("lost_force", "percent", "Share of readings lost over 100 ms."),
            FileKey("following", "mm", "Distance of the blade from where it should be."),
            FileKey("overrun", "periods", "Periods for which an action is held if the next one is late in motion."),
        ),
    ),
    FileSection(
        "calibration",
        "When and how the force sensor was last checked with known weights.",
        SensorCalibration,
        (
            FileKey("date", "", 'Day of the check, such as 2026-03-01. "": never, and nothing moves.', "2026-03-01"),
            FileKey("valid_days", "days", "Time after which it must be checked again."),
            FileKey("gain", "", "True force over the sensor's reading."),
        ),
    ),
    FileSection(
        "identified",
        "What 'cutenv rig identify' has measured, and written here; the simulator adopts it.",
        Identified,
        (
            FileKey("date", "", "Day of the measurement."),
            FileKey("motor_lag", "ms", "Time constant of the velocity loop."),
            FileKey("dead_time", "ms", "Time between a command and the first motion."),
            FileKey("acceleration", "m_s2", "Limit of the axis."),
            FileKey("backlash", "um", "Play of gear and screw."),
            FileKey("friction", "N", "Friction of the empty axis, as a force on the carriage."),
            FileKey("force_noise", "N", "Standard deviation of the force at rest."),
            FileKey("force_resolution", "N", "Least step of the force reading."),
            FileKey("force_drift", "N", "Standard deviation after one second of the force's random walk."),
            FileKey("force_still_x", "ms", "Time for which the sensor's x force may stay at one count by its noise."),
            FileKey("force_still_y", "ms", "The same for its y force."),
            FileKey("force_still_z", "ms", "The same for its z force."),
        ),
    ),
)  # fmt: skip

IDENTIFIED = SECTIONS[-1]
"""Section that the program itself writes."""


def setting_text(settings: RigSettings, field: str) -> str:
    """Return a setting as in the file, such as ``limits.high_mm = 148`` for the field ``"limits.high"``."""
    of, _, name = field.rpartition(".")
    section = next(section for section in SECTIONS if section.name == of)
    key = next(key for key in section.keys if key.field == name)
    value = getattr(getattr(settings, of) if of else settings, name)
    told = f"{key.from_si(value):g}" if section.kind(key) is float else repr(value)
    return f"{section.where(key)} = {told}"
