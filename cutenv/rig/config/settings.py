"""Settings of a rig, read from its TOML file.

Bus, axes, sensor, limits, calibration.

Values are in SI and radians here; in the file every name ends with its unit, see :mod:`cutenv.rig.toml_file`. The
meaning of a field is the comment above its line in the file.
"""

from __future__ import annotations

import dataclasses
import hashlib
import math
from dataclasses import dataclass, field
from datetime import date, datetime
from typing import Any, ClassVar, Literal, NamedTuple

from cutenv._base.unit_table import NAMED_UNITS
from cutenv._base.validation import check_parameters, in_range, one_of

_Pair = str | tuple[str, str]


def setting(
    default: Any,
    unit: _Pair,
    meaning: str,
    low: float | None = None,
    high: float | None = None,
    *,
    why: str = "",
    example: _Pair = "",
) -> Any:
    """Declare a field that is one line of the file.

    ``default``: default in SI; ``unit``: name in :data:`cutenv._base.unit_table.NAMED_UNITS` of the unit in the file;
    "1": a count, a ratio, a text. Of a pair the first is for a screw, the second for a hinge; ``meaning``: explanation
    for the comment above the line; ``low``, ``high``: admissible range in SI; ``why``: reason for the default, for the
    message; the meaning if it needs none; ``example``: plausible value, in the file, of a key that a person has to
    supply and that has no default.
    """
    units = (unit,) if isinstance(unit, str) else unit
    metadata: dict[str, Any] = {"units": units, "meaning": meaning}
    metadata["examples"] = (example,) if isinstance(example, str) else example
    if low is not None:
        metadata |= {"unit": " or ".join(NAMED_UNITS[each].si for each in units), "low": low, "high": high}
        metadata["source"] = why or meaning
    return field(default=default, metadata=metadata)


DRIVER = "Driver: a name that 'cutenv rig drivers' lists, or module:Class. Its own keys are in the table 'options'."
"""Comment above the key that names a driver."""
_WAY, _SPEED, _ACCELERATION = ("mm", "deg"), ("cm_s", "deg_s"), ("m_s2", "deg_s2")


@dataclass(frozen=True, kw_only=True)
class Axis:
    """One drive with its motor, gear and load.

    Metres along the cut, or radians of the blade's angle.

    The defaults are a screw's: the examples tell a hinge's.
    """

    driver: str = setting("canopen", "1", DRIVER)
    options: Any = None
    node: int = setting(1, "1", "Number of the drive on the bus, 1 to 127.", example=("", "2"))
    gear: float = setting(4.4, "1", "Turns of the motor for one turn of the screw or hinge.", 1e-3, 1e5, example="4.4")
    lead: float = setting(
        0.002, _WAY, "Travel for one turn of the screw or hinge.", 1e-5, 10.0,
        why="travel for one turn of screw or hinge (one turn of a hinge: 2 pi)", example=("2.0", "360.0"),
    )  # fmt: skip
    pulses: int = setting(
        1024, "1", "Pulses of the encoder for one turn of the motor; an increment is a quarter of one.", example="1024"
    )
    direction: int = setting(1, "1", "1 or -1: direction of the axis at a positive speed of the motor.")
    low: float = setting(
        -0.002, _WAY, "One end of travel: the drive's own software limit.", -10.0, 10.0,
        why="the drive's software limit, before the clamp, to which the blade returns", example=("", "44.0"),
    )  # fmt: skip
    high: float = setting(
        0.149, _WAY, "Other end of travel: the drive's own software limit.", -10.0, 10.0, example=("", "91.0")
    )
    speed: float = setting(
        0.0381, _SPEED, "Top speed of the drive, whatever is commanded.", 1e-5, 100.0,
        why="the fastest of the thesis's rig", example=("", "100.0"),
    )  # fmt: skip
    acceleration: float = setting(
        0.1, _ACCELERATION, "Acceleration and deceleration of the drive.", 1e-4, 1000.0,
        why="as the simulated rig's", example=("", "400.0"),
    )  # fmt: skip
    quick_stop: float = setting(
        1.0, _ACCELERATION, "Deceleration of a quick stop.", 1e-3, 1e4,
        why="full speed to rest within 40 ms", example=("", "2000.0"),
    )  # fmt: skip
    following_error: float = setting(
        0.002, _WAY, "Following error at which the drive itself stops.", 1e-6, 1.0, example=("", "2.0")
    )
    current_limit: float = setting(
        2.0, "A", "Current limit of the motor, which bounds the force before anything else.", 0.01, 100.0
    )
    rated_torque: float = setting(
        0.1, "N_m", "Rated torque of the motor, the unit in which the drive reports torque.", 1e-5, 100.0
    )

    def __post_init__(self) -> None:
        check_parameters(self)
        in_range("node", self.node, 1, 127, "1", "Nodes of CANopen are 1 to 127.")
        in_range("pulses", self.pulses, 1, 10**7, "1", "Give the encoder's pulses for one turn of the motor.")
        one_of("direction", self.direction, (1, -1))
        if not self.low < self.high:
            raise ValueError(f"low = {self.low:g} must be below high = {self.high:g}: the ends of travel.")


@dataclass(frozen=True, kw_only=True)
class CrossAxis(Axis):
    """Drive that moves the blade straight across the cut, with limits."""

    ends: ClassVar[tuple[str, str]]  # names of the fields for the two ends of travel at which the blade is stopped
    to: ClassVar[tuple[str, str]]  # words for the ways of a positive and of a negative speed
    fastest: float = setting(
        0.0265, "cm_s", "Speed either way at which the blade is stopped. Commands reach 96 % of it.", 1e-4, 0.5,
        why="2.54 cm/s, and 4 % for the loop",
    )  # fmt: skip
    most_acceleration: float = setting(
        1.0, "m_s2", "Acceleration either way at which the blade is stopped.", 0.01, 100.0,
        why="ten times what the axis is told",
    )  # fmt: skip
    following: float = setting(
        0.0015, "mm", "Distance from where the blade should be, at which it is stopped.", 1e-5, 0.1
    )
    homing: Literal["checked", "trusted"] = setting(
        "checked", "1", "Whether the drive has to report that it was homed (bit 15 of its statusword), or is trusted: "
        "for a drive without that bit. Homing is the drive's own function."
    )  # fmt: skip
    force_axis: Literal["x", "y", "z"] = setting("y", "1", "Axis of the sensor along this motion.")
    force_sign: int = setting(1, "1", "1 or -1: sign of the reading.")

    def __post_init__(self) -> None:
        super().__post_init__()
        one_of("homing", self.homing, ("checked", "trusted"))
        one_of("force_axis", self.force_axis, ("x", "y", "z"))
        one_of("force_sign", self.force_sign, (1, -1))
        low, high = self.bounds
        if not low < high:
            raise ValueError(f"{self.ends[0]} = {low:g} must be below {self.ends[1]} = {high:g}.")

    @property
    def bounds(self) -> tuple[float, float]:
        """Ends of travel at which the blade is stopped [m]."""
        low, high = (float(getattr(self, name)) for name in self.ends)
        return low, high

    def felt(self, force: tuple[float, float, float]) -> float:
        """Return the tissue's force along this axis [N], signed by ``force_sign``."""
        return self.force_sign * force["xyz".index(self.force_axis)]


@dataclass(frozen=True, kw_only=True)
class HeightAxis(CrossAxis):
    """Drive that raises and lowers the blade, and its limits.

    Heights are of the blade's lower end, upwards.

    Height 0 is the height at which a cut begins. Below it the blade cuts deeper.
    """

    ends: ClassVar[tuple[str, str]] = ("lowest", "highest")
    to: ClassVar[tuple[str, str]] = ("up", "down")
    node: int = setting(3, "1", "Number of the drive on the bus, 1 to 127.", example="3")
    direction: int = setting(1, "1", "1 or -1: 1 if a positive speed of the motor raises the blade.")
    low: float = setting(
        -0.021, "mm", "Lower end of travel: the drive's own software limit.", -1.0, 1.0, example="-21.0"
    )
    high: float = setting(
        0.026, "mm", "Upper end of travel: the drive's own software limit.", -1.0, 1.0, example="26.0"
    )
    lowest: float = setting(
        -0.020, "mm", "Height below which the blade is stopped: the greatest depth beyond that of the start.", -1.0, 0.0
    )
    highest: float = setting(0.025, "mm", "Height above which the blade is stopped.", 0.0, 1.0)
    raised: float = setting(
        0.020, "mm", "Height to which the blade is raised, slowly, before it returns to the clamp.", 0.0, 1.0
    )
    fastest: float = setting(
        0.0106, "cm_s", "Speed up or down at which the blade is stopped. Commands reach 96 % of it.", 1e-4, 0.5,
        why="1 cm/s, and 4 % for the loop",
    )  # fmt: skip
    following: float = setting(
        0.001, "mm", "Distance from the height where the blade should be, at which it is stopped.", 1e-5, 0.1
    )
    vertical_force: float = setting(
        10.0, "N", "Vertical force, either way, at which the blade is stopped.", 0.1, 1000.0
    )
    force_axis: Literal["x", "y", "z"] = setting("z", "1", "Axis of the sensor along the height.")
    force_sign: int = setting(1, "1", "1 or -1: sign of the reading when the tissue pushes the blade up.")


@dataclass(frozen=True, kw_only=True)
class SideAxis(CrossAxis):
    """Drive that moves the blade to the side; places are left of the middle."""

    ends: ClassVar[tuple[str, str]] = ("rightmost", "leftmost")
    to: ClassVar[tuple[str, str]] = ("to the left", "to the right")
    node: int = setting(4, "1", "Number of the drive on the bus, 1 to 127.", example="4")
    direction: int = setting(
        1, "1", "1 or -1: 1 if a positive speed of the motor moves the blade to the left, seen from the clamp."
    )
    low: float = setting(
        -0.039, "mm", "Right end of travel: the drive's own software limit.", -1.0, 1.0, example="-39.0"
    )
    high: float = setting(0.039, "mm", "Left end of travel: the drive's own software limit.", -1.0, 1.0, example="39.0")
    rightmost: float = setting(-0.038, "mm", "Place on the right beyond which the blade is stopped.", -1.0, 0.0)
    leftmost: float = setting(0.038, "mm", "Place on the left beyond which the blade is stopped.", 0.0, 1.0)
    force_axis: Literal["x", "y", "z"] = setting("y", "1", "Axis of the sensor across the cut.")
    force_sign: int = setting(1, "1", "1 or -1: sign of the reading when the tissue pushes the blade to the right.")


@dataclass(frozen=True, kw_only=True)
class Bus:
    """Settings of the CAN bus, in python-can's terms; unused ones are ignored."""

    interface: str = setting("socketcan", "1", "socketcan, slcan, socketcand, ...", example='"socketcan"')
    channel: str = setting("can0", "1", "can0, /dev/ttyACM0, ...")
    bitrate: int = setting(1_000_000, "bit_s", "Bit rate of the bus; the same in all drives.")
    host: str = setting("127.0.0.1", "1", "Address of a socketcand gateway.")
    port: int = setting(29536, "1", "TCP port of a socketcand gateway.")
    sync: float = setting(
        0.005, "ms", "Period at which the axes report their position: that of SYNC on a CAN bus, 20 ms there at most.",
        0.001, 0.25, why="four samples of position to a decision",
    )  # fmt: skip
    node: int = setting(127, "1", "Number of this computer on the bus, whose heartbeat the drives watch.")
    heartbeat: float = setting(
        0.030, "ms", "Period of this computer's heartbeat.", 0.005, 0.1,
        why="three before the drive's 100 ms have passed",
    )  # fmt: skip

    def __post_init__(self) -> None:
        check_parameters(self)
        in_range("node", self.node, 1, 127, "1", "Nodes of CANopen are 1 to 127.")
        in_range("port", self.port, 1, 65535, "1", "A socketcand gateway's is 29536 unless it was changed.")
        in_range("bitrate", self.bitrate, 10_000, 1_000_000, "bit/s", "CANopen runs at 10 kbit/s to 1 Mbit/s.")


@dataclass(frozen=True, kw_only=True)
class PositionControl:
    """PD control of the blade's position by its drive.

    Gains and motor, referred to the carriage.

    The drive turns a commanded speed into a wanted position, whose error and error's derivative command the motor.
    """

    proportional_gain: float = setting(
        750e3, "N_per_m", "Force of the motor for an error of position, at the carriage.", 100.0, 1e8,
        why="a bandwidth of 10 Hz",
    )  # fmt: skip
    derivative_gain: float = setting(
        24e3, "Ns_per_m", "Force of the motor for an error of speed, at the carriage.", 1.0, 1e7, why="critical damping"
    )
    moved_mass: float = setting(
        190.0, "kg", "Mass that the motor moves: mostly its rotor, times (2 pi gear / lead)^2.", 0.1, 1e5,
        why="a rotor of 1e-6 kg m2, a gear of 4.4, a screw of 2 mm",
    )  # fmt: skip
    drag: float = setting(300.0, "Ns_per_m", "Viscous friction of motor, gear and screw, at the carriage.", 0.0, 1e6)

    def __post_init__(self) -> None:
        check_parameters(self)


@dataclass(frozen=True, kw_only=True)
class SensorSettings:
    """Settings of a force sensor, with the cut's direction."""

    driver: str = setting("netft", "1", DRIVER)
    options: Any = None
    address: str = setting("192.168.1.1", "1", "Network address of a Net F/T.", example='"192.168.1.1"')
    port: int = setting(49152, "1", "Its UDP port for RDT.")
    page: str = setting("", "1", "Address of its configuration page; empty: http://ADDRESS/netftapi2.xml.")
    rate: float = setting(1000.0, "Hz", "Rate of the readings, as set in the sensor.", 5.0, 7000.0)
    cut_axis: Literal["x", "y", "z"] = setting("x", "1", "Axis of the sensor along the cut line.")
    sign: int = setting(1, "1", "1 or -1: sign of the reading when the tissue resists forward motion.")
    components: Literal["along", "all"] = setting(
        "along", "1", "Components in a record: the force along the cut, or all six beside it. A rig with an axis "
        "across the cut always records all."
    )  # fmt: skip

    def __post_init__(self) -> None:
        check_parameters(self)
        one_of("components", self.components, ("along", "all"))
        one_of("cut_axis", self.cut_axis, ("x", "y", "z"))
        one_of("sign", self.sign, (1, -1))
        in_range("port", self.port, 1, 65535, "1", "The sensor's UDP port is 49152 unless it was changed.")


MOST_BLIND = 0.005
"""Way that the limits of a rig's file may let its blade go before a fault is seen [m]."""
_DECISION = 0.020  # [s] usual period of the commands


@dataclass(frozen=True, kw_only=True)
class SafetyLimits:
    """Limits at which the blade is stopped, whatever the policy commands."""

    force: float = setting(15.0, "N", "Force on each axis of the sensor.", 0.1, 100.0)
    force_norm: float = setting(20.0, "N", "Norm of the force on all three axes.", 0.1, 150.0)
    torque: float = setting(
        3.0, "N_m", "Torque on all three axes of the sensor, which breaks by torque first.", 0.01, 30.0,
        why="20 N at 0.15 m below the sensor",
    )  # fmt: skip
    force_rise: float = setting(
        200.0, "N_per_s", "Rise of the force over 10 ms. In tissue at 2.54 cm/s it is some 15 N/s.", 1.0, 5000.0,
        why="over 10 ms; tissue at 2.54 cm/s rises by some 15 N/s, a hard stop by thousands",
    )  # fmt: skip
    speed: float = setting(
        0.0265, "cm_s", "Speed of the blade. Actions reach 2.54 cm/s.", 1e-4, 0.5,
        why="what actions reach, and 4 % for the loop",
    )  # fmt: skip
    acceleration: float = setting(
        1.0, "m_s2", "Acceleration of the blade.", 0.01, 100.0, why="ten times what the axis is told"
    )
    low: float = setting(-0.001, "mm", "End of travel at the clamp.", -0.5, 0.5)
    high: float = setting(0.148, "mm", "Far end of travel.", 0.0, 1.0)
    angle_low: float = setting(
        math.radians(44.0), "deg", "Least angle of the blade. Actions reach 45 degrees.", 0.0, math.pi
    )
    angle_high: float = setting(
        math.radians(91.0), "deg", "Greatest angle of the blade. Actions reach 90 degrees.", 0.0, math.pi
    )
    stale_force: float = setting(0.020, "ms", "Time without a reading of the force.", 0.002, 0.5)
    stale_motion: float = setting(0.025, "ms", "Time without a sample of an axis.", 0.005, 0.5, why="five SYNCs")
    heartbeat: float = setting(0.100, "ms", "Time without a heartbeat of a drive.", 0.02, 1.0)
    frozen_force: float = setting(
        0.020, "ms", "Time during which all readings of the force have the same counts.", 0.005, 1.0
    )
    late_force: float = setting(0.020, "ms", "Delay of the readings in addition to the usual one.", 0.002, 1.0)
    lost_force: float = setting(0.2, "percent", "Share of readings lost over 100 ms.", 0.01, 0.5)
    following: float = setting(0.0015, "mm", "Distance of the blade from where it should be.", 1e-5, 0.01)
    overrun: float = setting(
        1.0, "periods", "Periods for which an action is held if the next one is late in motion.", 0.1, 10.0
    )

    def __post_init__(self) -> None:
        check_parameters(self)
        if not (self.low < self.high and self.angle_low < self.angle_high):
            raise ValueError("limits: low must be below high, and angle_low below angle_high.")
        if not self.blind_way <= MOST_BLIND:
            name, longest = max(self._blind_times.items(), key=lambda each: each[1])
            raise ValueError(
                f"limits: with {name} the blade may go {1e3 * self.blind_way:.1f} mm at {1e2 * self.speed:g} cm/s "
                f"before a fault is seen, {1e3 * MOST_BLIND:g} mm allowed. Lower {name} ({1e3 * longest:.0f} ms) or "
                "speed."
            )

    @property
    def _blind_times(self) -> dict[str, float]:
        """Longest times of unseen faults [s], by limit."""
        names = ("stale_force", "late_force", "frozen_force", "stale_motion", "heartbeat")
        return {name: getattr(self, name) for name in names} | {"overrun": (1.0 + self.overrun) * _DECISION}

    @property
    def blind_way(self) -> float:
        """Distance at top speed while a fault is unseen [m]."""
        return self.speed * max(self._blind_times.values())

    @property
    def fingerprint(self) -> str:
        """Hash of all limits, for records; equal for equal limits only."""
        text = "\n".join(f"{name} = {value!r}" for name, value in dataclasses.asdict(self).items())
        return hashlib.sha256(text.encode()).hexdigest()[:16]

    def strictest(self, other: SafetyLimits) -> SafetyLimits:
        """Return the stricter of each limit of both."""
        pairs = {each.name: (getattr(self, each.name), getattr(other, each.name)) for each in dataclasses.fields(self)}
        inward = ("low", "angle_low")
        return SafetyLimits(**{name: max(pair) if name in inward else min(pair) for name, pair in pairs.items()})

    def lowered(self, **lower: float | None) -> SafetyLimits:
        """Return limits, some lowered; None leaves one unchanged.

        A lower ``force_norm`` also lowers ``force``, which would otherwise have no effect. Raise ValueError if a value
        is above the present one, or out of range.
        """
        chosen = {name: value for name, value in lower.items() if value is not None}
        for name, value in chosen.items():
            one_of("limit", name, LOWERED)
            if value > getattr(self, name):
                raise ValueError(
                    f"{name} = {value:g} is above {getattr(self, name):g} of the rig's file. On the command line limits"
                    " may only be lower; to raise one, change the file."
                )
        if "force_norm" in chosen:
            chosen["force"] = min(chosen.get("force", self.force), chosen["force_norm"])
        return dataclasses.replace(self, **chosen)


LOWERED = ("force", "force_norm", "torque", "force_rise", "speed", "high")
"""Names of the limits that the command line may lower."""


@dataclass(frozen=True, kw_only=True)
class Identified:
    """Properties measured by ``cutenv rig identify``, in SI, None if not measured.

    The simulator adopts them. The axis's friction is a property of the rig that the force sensor does not see.
    """

    date: str | None = setting(None, "1", "Day of the measurement.")
    motor_lag: float | None = setting(None, "ms", "Time constant of the velocity loop.")
    dead_time: float | None = setting(None, "ms", "Time between a command and the first motion.")
    acceleration: float | None = setting(None, "m_s2", "Limit of the axis.")
    backlash: float | None = setting(None, "um", "Play of gear and screw.")
    friction: float | None = setting(None, "N", "Friction of the empty axis, as a force on the carriage.")
    force_noise: float | None = setting(None, "N", "Standard deviation of the force at rest.")
    force_resolution: float | None = setting(None, "N", "Least step of the force reading.")
    force_drift: float | None = setting(None, "N", "Standard deviation after one second of the force's random walk.")
    force_delay: float | None = setting(None, "ms", "Delay of the force behind the position.")
    force_still_x: float | None = setting(
        None, "ms", "Time for which the sensor's x force may stay at one count by its noise."
    )
    force_still_y: float | None = setting(None, "ms", "The same for its y force.")
    force_still_z: float | None = setting(None, "ms", "The same for its z force.")


@dataclass(frozen=True, kw_only=True)
class SensorCalibration:
    """Last check of the force sensor with known weights."""

    date: str = setting(
        "", "1", 'Day of the check, such as 2026-03-01. "": never, and nothing moves.', example="2026-03-01"
    )
    valid_days: int = setting(365, "days", "Time after which it must be checked again.")
    gain: float = setting(1.0, "1", "True force over the sensor's reading.", 0.5, 2.0)

    def __post_init__(self) -> None:
        check_parameters(self)
        in_range("valid_days", self.valid_days, 1, 3650, "days", "A year is usual.")


@dataclass(frozen=True, kw_only=True)
class CameraSettings:
    """Camera that films the blade, and the blade's mark."""

    driver: str = setting("opencv", "1", DRIVER)
    options: Any = None
    source: str = setting(
        "0", "1", "Number of the camera, address of its stream, or a video file that is played in its place.",
        example='"0"',
    )  # fmt: skip
    calibration: str = setting(
        "cam.json", "1", "File that 'cutenv depth --calibrate' has written.", example='"cam.json"'
    )
    travel: Literal["right", "left"] = setting("right", "1", "Way in which the blade goes in the images when it cuts.")
    total: float = setting(0.0425, "mm", "Centre of strip or tag to the blade's end.", 0.005, 0.2)
    strip: float = setting(0.004, "mm", "Strip along the blade, or side of the tag.", 0.0005, 0.1)
    width: float = setting(0.008, "mm", "Blade, across.", 0.001, 0.05)
    tag: int = setting(-1, "1", "Number of the ArUco tag (4X4_50) that the blade has in place of a strip; -1: a strip.")

    def __post_init__(self) -> None:
        check_parameters(self)
        one_of("travel", self.travel, ("right", "left"))
        in_range("tag", self.tag, -1, 49, "1", "-1 is a strip.")


class Reach(NamedTuple):
    """Limits of a straight axis, at which the blade is stopped."""

    low: float  # ends of travel [m]
    high: float
    speed: float  # either way [m/s]
    acceleration: float  # [m/s2]
    following: float  # distance from where the blade should be [m]
    axis: Axis  # the drive


@dataclass(frozen=True, kw_only=True)
class RigSettings:
    """All settings of a rig, in the order of its file.

    The depth of cut, measured by caliper before the cut, is given as pairs of position and depth [m].
    """

    name: str = setting("rig", "1", "Name of the rig, for records and reports.")
    armed_by: str = setting("", "1", "Name of the person who answers for this rig's motion. Empty: nothing moves.")
    emulated: bool = setting(False, "1", "True for an emulator, which needs no operator. Never true for hardware.")
    angle_mode: Literal["fixed", "free"] = setting(
        "fixed", "1", "The blade's angle is set by hand, or turned by a second axis: see [angle]."
    )
    fixed_angle: float = setting(
        math.pi / 2, "deg", "Angle of the blade if it is set by hand; 90 is upright.", math.radians(45.0) - 1e-9,
        math.radians(90.0) + 1e-9, why="upright; measured are 45 to 90 degrees",
    )  # fmt: skip
    depth_profile: tuple[tuple[float, float], ...] = setting(
        (), "mm", "Depth of cut, measured by caliper on this specimen: [position_mm, depth_mm] from the clamp on, the "
        "first within 1 mm of it, depths 1 to 60 mm.", example="[[0.0, 8.1], [5.0, 12.4], [20.0, 17.0], [150.0, 17.5]]",
    )  # fmt: skip
    bus: Bus = field(default_factory=Bus)
    blade: Axis = field(default_factory=Axis)
    angle: Axis | None = None
    height: HeightAxis | None = None
    side: SideAxis | None = None
    position_control: PositionControl | None = None
    sensor: SensorSettings = field(default_factory=SensorSettings)
    limits: SafetyLimits = field(default_factory=SafetyLimits)
    calibration: SensorCalibration = field(default_factory=SensorCalibration)
    camera: CameraSettings | None = None
    identified: Identified = field(default_factory=Identified)

    def __post_init__(self) -> None:
        one_of("angle_mode", self.angle_mode, ("fixed", "free"))
        check_parameters(self)
        if (self.angle_mode == "free") != (self.angle is not None):
            raise ValueError('angle_mode "free" needs the second axis "angle", and "fixed" has none.')

    @property
    def axes(self) -> dict[str, Axis]:
        """Driven axes by name: blade, and any "angle", "height", "side"."""
        driven = {"blade": self.blade, "angle": self.angle, **self.cross_axes}
        return {name: axis for name, axis in driven.items() if axis is not None}

    @property
    def cross_axes(self) -> dict[str, CrossAxis]:
        """Axes across the cut by name: any "height" and "side"."""
        return {name: axis for name, axis in (("height", self.height), ("side", self.side)) if axis is not None}

    @property
    def reaches(self) -> dict[str, Reach]:
        """Limits of every straight axis by name."""
        limits, crossing = self.limits, self.cross_axes.items()
        along = Reach(limits.low, limits.high, limits.speed, limits.acceleration, limits.following, self.blade)
        return {"blade": along} | {
            name: Reach(*axis.bounds, axis.fastest, axis.most_acceleration, axis.following, axis)
            for name, axis in crossing
        }

    def require_height_axis(self, *, by: str) -> HeightAxis:
        """Return the height axis; raise ValueError, naming ``by``, without one."""
        if self.height is None:
            raise ValueError(self._lacks(by, "height", "raises and lowers the blade", "at constant height"))
        return self.height

    def require_side_axis(self, *, by: str) -> SideAxis:
        """Return the side axis; raise ValueError, naming ``by``, without one."""
        if self.side is None:
            raise ValueError(self._lacks(by, "side", "moves the blade to the side", "along a straight line"))
        return self.side

    def _lacks(self, by: str, name: str, moves: str, without: str) -> str:
        return (
            f"{by} {moves}, and rig {self.name!r} has no {name} axis. Use a rig that has one, described in its file "
            f"under [{name}] ('cutenv rig init' writes the section, commented out), or a task {without}: "
            "cutenv/RigCut-v1."
        )


def day_of(text: str) -> date:
    """Return the day of an ISO 8601 text, such as ``2026-03-01T14:05:00``.

    Raise ValueError if the text is not a date.
    """
    try:
        return datetime.fromisoformat(text).date()
    except ValueError:
        raise ValueError(f"{text!r} is not a date. Write it as 2026-03-01.") from None


def expired(calibration: SensorCalibration, today: date) -> str | None:
    """Return why a calibration is invalid (missing, future, too old), or None."""
    cure = "Hang known weights on the sensor, and write the day as calibration.date into the rig's file."
    if not calibration.date:
        return f"the force sensor was never checked. {cure}"
    try:
        day = day_of(calibration.date)
    except ValueError as error:
        return f"calibration.date = {error}"
    age = (today - day).days
    if age < 0:
        return f"calibration.date = {day} is in the future: today is {today}. Correct it, or this computer's clock."
    if age > calibration.valid_days:
        return f"the force sensor was checked {age} days ago, on {day}, which counts {calibration.valid_days}. {cure}"
    return None


FAKE = "fake"
"""Name of a rig in memory, on its own clock."""
EMULATOR, SERIAL, GRBL = EMULATED = "emulator", "serial", "grbl"
"""Names of emulated rigs in a process of their own."""
RIG_NAMES = (FAKE, *EMULATED)
"""Names that are not files."""
HEIGHT = HeightAxis()
"""Height axis of a fake and of an emulated rig."""
SIDE = SideAxis()
"""Axis to the side of a fake and of an emulated rig."""


def across(*names: str) -> dict[str, CrossAxis]:
    """Return the named cross axes, "height" and "side", as settings arguments."""
    return {name: axis for name, axis in (("height", HEIGHT), ("side", SIDE)) if name in names}


def fake_settings(**changes: object) -> RigSettings:
    """Return settings without hardware: angle free, calibrated today, armed; across(...) adds axes."""
    hinge = Axis(
        node=2, gear=100.0, lead=2.0 * math.pi, low=math.radians(44.0), high=math.radians(91.0),
        speed=math.radians(90.0), acceleration=100.0, quick_stop=100.0, following_error=0.1,
    )  # fmt: skip
    plain = RigSettings(
        name="fake", armed_by="nobody: it is a fake", angle_mode="free", angle=hinge, emulated=True,
        calibration=SensorCalibration(date=date.today().isoformat()),
    )  # fmt: skip
    return dataclasses.replace(plain, **changes)  # type: ignore[arg-type]
