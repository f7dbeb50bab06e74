"""Settings of a rig, read from its TOML file: bus, axes, sensor, limits, calibration.

Values are in SI and radians here; in the file every name ends with its unit, see :mod:`cutenv.rig.toml_file`.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass, field
from typing import Literal

from cutenv._base.parameter import check_parameters, parameter
from cutenv._base.validation import in_range, one_of


@dataclass(frozen=True, kw_only=True)
class Bus:
    """Settings of the CAN bus, in python-can's terms; settings that an interface does not use are ignored."""

    interface: str = "socketcan"
    channel: str = "can0"
    bitrate: int = 1_000_000
    host: str = "127.0.0.1"
    """Address of a socketcand gateway."""
    port: int = 29536
    sync: float = parameter(
        0.005, unit="s", low=0.001, high=0.02, provenance="choice", source="four samples of position to a decision"
    )
    node: int = 127
    """Node number of this computer, for whose heartbeat the drives listen."""
    heartbeat: float = parameter(
        0.030, unit="s", low=0.005, high=0.1, provenance="choice", source="three before the drive's 100 ms have passed"
    )

    def __post_init__(self) -> None:
        check_parameters(self)
        in_range("node", self.node, 1, 127, "1", "Nodes of CANopen are 1 to 127.")
        in_range("port", self.port, 1, 65535, "1", "A socketcand gateway's is 29536 unless it was changed.")
        in_range("bitrate", self.bitrate, 10_000, 1_000_000, "bit/s", "CANopen runs at 10 kbit/s to 1 Mbit/s.")


@dataclass(frozen=True, kw_only=True)
class Axis:
    """One drive with its motor, gear and load: metres along the cut, or radians of the blade's angle."""

    node: int = 1
    gear: float = parameter(4.4, unit="1", low=1e-3, high=1e5, provenance="choice", source="motor turns per turn of it")
    lead: float = parameter(
        0.002, unit="m or rad", low=1e-5, high=10.0, provenance="choice",
        source="travel for one turn of screw or hinge (one turn of a hinge: 2 pi)",
    )  # fmt: skip
    pulses: int = 1024
    """Pulses of the encoder for one turn of the motor; an increment is a quarter of one."""
    direction: int = 1
    """Sign, 1 or -1, of a motor speed that moves the blade away from the clamp."""
    low: float = parameter(
        -0.002,
        unit="m or rad",
        low=-10.0,
        high=10.0,
        provenance="choice",
        source="end of travel: the drive's software limit, before the clamp, to which the blade returns",
    )
    high: float = parameter(0.149, unit="m or rad", low=-10.0, high=10.0, provenance="choice", source="the other end")
    speed: float = parameter(
        0.0381, unit="m/s or rad/s", low=1e-5, high=100.0, provenance="choice", source="the fastest of the thesis's rig"
    )
    acceleration: float = parameter(
        0.1, unit="m/s2 or rad/s2", low=1e-4, high=1000.0, provenance="choice", source="as the simulated rig's"
    )
    quick_stop: float = parameter(
        1.0, unit="m/s2 or rad/s2", low=1e-3, high=1e4, provenance="choice", source="full speed to rest within 40 ms"
    )
    following_error: float = parameter(
        0.002, unit="m or rad", low=1e-6, high=1.0, provenance="choice", source="the drive's own window"
    )
    current_limit: float = parameter(
        2.0, unit="A", low=0.01, high=100.0, provenance="choice", source="the first limiter of force"
    )
    rated_torque: float = parameter(
        0.1, unit="N m", low=1e-5, high=100.0, provenance="choice", source="of the motor, to which torque is told"
    )

    def __post_init__(self) -> None:
        check_parameters(self)
        in_range("node", self.node, 1, 127, "1", "Nodes of CANopen are 1 to 127.")
        in_range("pulses", self.pulses, 1, 10**7, "1", "Give the encoder's pulses for one turn of the motor.")
        one_of("direction", self.direction, (1, -1))
        if not self.low < self.high:
            raise ValueError(f"low = {self.low:g} must be below high = {self.high:g}: the ends of travel.")


@dataclass(frozen=True, kw_only=True)
class SensorSettings:
    """Settings of a Net F/T force sensor, and the direction of the cut in its axes."""

    address: str = "192.168.1.1"
    port: int = 49152
    page: str = ""
    """Address of the sensor's configuration page; empty: http://ADDRESS/netftapi2.xml."""
    rate: float = parameter(1000.0, unit="Hz", low=100.0, high=7000.0, provenance="choice", source="of the readings")
    cut_axis: Literal["x", "y", "z"] = "x"
    """Axis of the sensor along the cut line."""
    sign: int = 1
    """Sign, 1 or -1, of the reading when the tissue resists forward motion."""

    def __post_init__(self) -> None:
        check_parameters(self)
        one_of("cut_axis", self.cut_axis, ("x", "y", "z"))
        one_of("sign", self.sign, (1, -1))
        in_range("port", self.port, 1, 65535, "1", "The sensor's UDP port is 49152 unless it was changed.")


@dataclass(frozen=True, kw_only=True)
class SafetyLimits:
    """Limits at which the blade is stopped, whatever the policy commands."""

    force: float = parameter(15.0, unit="N", low=0.1, high=1000.0, provenance="choice", source="of each axis")
    force_norm: float = parameter(20.0, unit="N", low=0.1, high=1000.0, provenance="choice", source="of all three")
    force_rise: float = parameter(
        200.0, unit="N/s", low=1.0, high=1e6, provenance="choice",
        source="over 10 ms; tissue at 2.54 cm/s rises by some 15 N/s, a hard stop by thousands",
    )  # fmt: skip
    speed: float = parameter(
        0.0265, unit="m/s", low=1e-4, high=0.5, provenance="choice", source="what actions reach, and 4 % for the loop"
    )
    acceleration: float = parameter(
        1.0, unit="m/s2", low=0.01, high=100.0, provenance="choice", source="ten times what the axis is told"
    )
    low: float = parameter(
        -0.001, unit="m", low=-0.5, high=0.5, provenance="choice", source="end of travel at the clamp"
    )
    high: float = parameter(0.148, unit="m", low=0.0, high=1.0, provenance="choice", source="far end of travel")
    angle_low: float = parameter(
        math.radians(44.0), unit="rad", low=0.0, high=math.pi, provenance="choice", source="actions reach 45 degrees"
    )
    angle_high: float = parameter(
        math.radians(91.0), unit="rad", low=0.0, high=math.pi, provenance="choice", source="actions reach 90 degrees"
    )
    stale_force: float = parameter(
        0.020, unit="s", low=0.002, high=0.5, provenance="choice", source="without a reading of the force"
    )
    stale_motion: float = parameter(
        0.025, unit="s", low=0.005, high=0.5, provenance="choice", source="without a sample of the axis: five SYNCs"
    )
    heartbeat: float = parameter(
        0.100, unit="s", low=0.02, high=1.0, provenance="choice", source="without a heartbeat of the drive"
    )
    frozen_force: float = parameter(
        0.020, unit="s", low=0.005, high=1.0, provenance="choice", source="of readings equal to the last count"
    )
    late_force: float = parameter(
        0.020, unit="s", low=0.002, high=1.0, provenance="choice", source="that readings come later than they did"
    )
    lost_force: float = parameter(
        0.2, unit="1", low=0.01, high=1.0, provenance="choice", source="share of lost readings over 100 ms"
    )
    following: float = parameter(
        0.0015, unit="m", low=1e-5, high=0.1, provenance="choice", source="between where the blade should be and is"
    )
    overrun: float = parameter(
        1.0, unit="1", low=0.1, high=10.0, provenance="choice",
        source="periods beyond its own for which an action is held while the blade moves",
    )  # fmt: skip

    def __post_init__(self) -> None:
        check_parameters(self)
        if not (self.low < self.high and self.angle_low < self.angle_high):
            raise ValueError("limits: low must be below high, and angle_low below angle_high.")

    def lowered(self, **lower: float | None) -> SafetyLimits:
        """Return limits with some of them lowered (None: unchanged), as from the command line.

        A lower ``force_norm`` also lowers ``force``, which would otherwise have no effect.

        Raises
        ------
        ValueError
            If a value is above the present one, or out of range.
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


LOWERED = ("force", "force_norm", "force_rise", "speed", "high")
"""Names of the limits that the command line may lower."""


@dataclass(frozen=True, kw_only=True)
class Identified:
    """Properties measured by ``cutenv rig identify``, which the simulator adopts; None: not measured."""

    date: str | None = None
    motor_lag: float | None = None
    """Time constant of the velocity loop [s]."""
    dead_time: float | None = None
    """Time between a command and the first motion [s]."""
    acceleration: float | None = None
    """Acceleration limit of the axis [m/s2]."""
    backlash: float | None = None
    """Play of gear and screw [m]."""
    friction: float | None = None
    """Friction of the empty axis, as a force on the carriage [N]: a property of the rig, not seen by the sensor."""
    force_noise: float | None = None
    """Standard deviation of the force at rest [N]."""
    force_resolution: float | None = None
    """Least step of the force reading [N]."""
    force_drift: float | None = None
    """Standard deviation after one second of the force's random walk [N]."""
    force_still_x: float | None = None
    """Longest time for which the sensor's x force stays at one count through its own noise [s]."""
    force_still_y: float | None = None
    force_still_z: float | None = None


@dataclass(frozen=True, kw_only=True)
class SensorCalibration:
    """Last check of the force sensor with known weights."""

    date: str = ""
    """Date of the check, ISO 8601; empty: never checked, and nothing moves."""
    valid_days: int = 365
    gain: float = parameter(1.0, unit="1", low=0.5, high=2.0, provenance="choice", source="newtons over what it reads")

    def __post_init__(self) -> None:
        check_parameters(self)
        in_range("valid_days", self.valid_days, 1, 3650, "days", "A year is usual.")


@dataclass(frozen=True, kw_only=True)
class RigSettings:
    """All settings of a rig.

    Attributes
    ----------
    armed_by : str
        Name of the person who answers for this rig; empty: nothing moves.
    angle_mode : {"fixed", "free"}
        "fixed": the angle is set by hand, to ``fixed_angle``; "free": a second axis turns the blade.
    depth_profile : tuple of (position, depth)
        Depth of the specimen, measured by caliper before the cut [m].
    """

    name: str = "rig"
    armed_by: str = ""
    angle_mode: Literal["fixed", "free"] = "fixed"
    fixed_angle: float = parameter(
        math.pi / 2, unit="rad", low=math.radians(45.0) - 1e-9, high=math.radians(90.0) + 1e-9, provenance="choice",
        source="upright; measured are 45 to 90 degrees",
    )  # fmt: skip
    bus: Bus = field(default_factory=Bus)
    blade: Axis = field(default_factory=Axis)
    angle: Axis | None = None
    sensor: SensorSettings = field(default_factory=SensorSettings)
    limits: SafetyLimits = field(default_factory=SafetyLimits)
    calibration: SensorCalibration = field(default_factory=SensorCalibration)
    identified: Identified = field(default_factory=Identified)
    depth_profile: tuple[tuple[float, float], ...] = ()
    emulated: bool = False
    """True for an emulator, which needs no operator."""

    def __post_init__(self) -> None:
        one_of("angle_mode", self.angle_mode, ("fixed", "free"))
        check_parameters(self)
        if (self.angle_mode == "free") != (self.angle is not None):
            raise ValueError('angle_mode "free" needs the second axis "angle", and "fixed" has none.')
