"""What must be known of a rig: bus, axes, sensor, limits, calibration; read from its TOML file.

Inside, SI and radians; in the file every name ends with its unit, see :mod:`cutenv.rig.toml_file`.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass, field
from typing import Literal

from cutenv.parameter import check_parameters, parameter
from cutenv.validation import in_range, one_of


@dataclass(frozen=True, kw_only=True)
class Bus:
    """The CAN bus, as python-can names it; what an interface does not take is ignored."""

    interface: str = "socketcan"
    channel: str = "can0"
    bitrate: int = 1_000_000
    host: str = "127.0.0.1"
    """Of a socketcand gateway."""
    port: int = 29536
    sync: float = parameter(
        0.005, unit="s", low=0.001, high=0.02, provenance="choice", why="four samples of position to a decision"
    )
    node: int = 127
    """Of this computer: the drives listen for its heartbeat."""
    heartbeat: float = parameter(
        0.030, unit="s", low=0.005, high=0.1, provenance="choice", why="three before the drive's 100 ms have passed"
    )

    def __post_init__(self) -> None:
        check_parameters(self)
        in_range("node", self.node, 1, 127, "1", "Nodes of CANopen are 1 to 127.")
        in_range("port", self.port, 1, 65535, "1", "A socketcand gateway's is 29536 unless it was changed.")
        in_range("bitrate", self.bitrate, 10_000, 1_000_000, "bit/s", "CANopen runs at 10 kbit/s to 1 Mbit/s.")


@dataclass(frozen=True, kw_only=True)
class Axis:
    """One drive with motor, gear and what it moves: metres along the cut, or radians of the blade's angle."""

    node: int = 1
    gear: float = parameter(4.4, unit="1", low=1e-3, high=1e5, provenance="choice", why="motor turns per turn of it")
    lead: float = parameter(
        0.002, unit="m or rad", low=1e-5, high=10.0, provenance="choice",
        why="travel for one turn of screw or hinge (one turn of a hinge: 2 pi)",
    )  # fmt: skip
    pulses: int = 1024
    """Of the encoder for one turn of the motor; an increment is a quarter of one."""
    direction: int = 1
    """1 or -1: whether a positive speed of the motor moves the blade away from the clamp."""
    low: float = parameter(
        -0.002,
        unit="m or rad",
        low=-10.0,
        high=10.0,
        provenance="choice",
        why="end of travel: the drive's software limit, before the clamp, to which the blade returns",
    )
    high: float = parameter(0.149, unit="m or rad", low=-10.0, high=10.0, provenance="choice", why="the other end")
    speed: float = parameter(
        0.0381, unit="m/s or rad/s", low=1e-5, high=100.0, provenance="choice", why="the fastest of the thesis's rig"
    )
    acceleration: float = parameter(
        0.1, unit="m/s2 or rad/s2", low=1e-4, high=1000.0, provenance="choice", why="as the simulated rig's"
    )
    quick_stop: float = parameter(
        1.0, unit="m/s2 or rad/s2", low=1e-3, high=1e4, provenance="choice", why="full speed to rest within 40 ms"
    )
    following_error: float = parameter(
        0.002, unit="m or rad", low=1e-6, high=1.0, provenance="choice", why="the drive's own window"
    )
    current_limit: float = parameter(
        2.0, unit="A", low=0.01, high=100.0, provenance="choice", why="the first limiter of force"
    )
    rated_torque: float = parameter(
        0.1, unit="N m", low=1e-5, high=100.0, provenance="choice", why="of the motor, to which torque is told"
    )

    def __post_init__(self) -> None:
        check_parameters(self)
        in_range("node", self.node, 1, 127, "1", "Nodes of CANopen are 1 to 127.")
        in_range("pulses", self.pulses, 1, 10**7, "1", "Give the encoder's pulses for one turn of the motor.")
        one_of("direction", self.direction, (1, -1))
        if not self.low < self.high:
            raise ValueError(f"low = {self.low:g} must be below high = {self.high:g}: the ends of travel.")


@dataclass(frozen=True, kw_only=True)
class Sensor:
    """A Net F/T force sensor, and how the cut lies in its axes."""

    address: str = "192.168.1.1"
    port: int = 49152
    page: str = ""
    """Address of its configuration page; empty: http://ADDRESS/netftapi2.xml."""
    rate: float = parameter(1000.0, unit="Hz", low=100.0, high=7000.0, provenance="choice", why="of the readings")
    cut_axis: Literal["x", "y", "z"] = "x"
    """Of the sensor, along the cut line."""
    sign: int = 1
    """1 or -1: whether the tissue's resistance to forward motion reads positive."""

    def __post_init__(self) -> None:
        check_parameters(self)
        one_of("cut_axis", self.cut_axis, ("x", "y", "z"))
        one_of("sign", self.sign, (1, -1))
        in_range("port", self.port, 1, 65535, "1", "The sensor's UDP port is 49152 unless it was changed.")


@dataclass(frozen=True, kw_only=True)
class Limits:
    """Where the blade is stopped, whatever the policy wants."""

    force: float = parameter(15.0, unit="N", low=0.1, high=1000.0, provenance="choice", why="of each axis")
    force_norm: float = parameter(20.0, unit="N", low=0.1, high=1000.0, provenance="choice", why="of all three")
    force_rise: float = parameter(
        200.0, unit="N/s", low=1.0, high=1e6, provenance="choice",
        why="over 10 ms; tissue at 2.54 cm/s rises by some 15 N/s, a hard stop by thousands",
    )  # fmt: skip
    speed: float = parameter(
        0.0265, unit="m/s", low=1e-4, high=0.5, provenance="choice", why="what actions reach, and 4 % for the loop"
    )
    acceleration: float = parameter(
        1.0, unit="m/s2", low=0.01, high=100.0, provenance="choice", why="ten times what the axis is told"
    )
    low: float = parameter(-0.001, unit="m", low=-0.5, high=0.5, provenance="choice", why="end of travel at the clamp")
    high: float = parameter(0.148, unit="m", low=0.0, high=1.0, provenance="choice", why="far end of travel")
    angle_low: float = parameter(
        math.radians(44.0), unit="rad", low=0.0, high=math.pi, provenance="choice", why="actions reach 45 degrees"
    )
    angle_high: float = parameter(
        math.radians(91.0), unit="rad", low=0.0, high=math.pi, provenance="choice", why="actions reach 90 degrees"
    )
    stale_force: float = parameter(
        0.020, unit="s", low=0.002, high=0.5, provenance="choice", why="without a reading of the force"
    )
    stale_motion: float = parameter(
        0.025, unit="s", low=0.005, high=0.5, provenance="choice", why="without a sample of the axis: five SYNCs"
    )
    heartbeat: float = parameter(
        0.100, unit="s", low=0.02, high=1.0, provenance="choice", why="without a heartbeat of the drive"
    )
    frozen_force: float = parameter(
        0.020, unit="s", low=0.005, high=1.0, provenance="choice", why="of readings equal to the last count"
    )
    late_force: float = parameter(
        0.020, unit="s", low=0.002, high=1.0, provenance="choice", why="that readings come later than they did"
    )
    lost_force: float = parameter(
        0.2, unit="1", low=0.01, high=1.0, provenance="choice", why="share of lost readings over 100 ms"
    )
    following: float = parameter(
        0.0015, unit="m", low=1e-5, high=0.1, provenance="choice", why="between where the blade should be and is"
    )
    overrun: float = parameter(
        1.0, unit="1", low=0.1, high=10.0, provenance="choice",
        why="periods beyond its own for which an action is held while the blade moves",
    )  # fmt: skip

    def __post_init__(self) -> None:
        check_parameters(self)
        if not (self.low < self.high and self.angle_low < self.angle_high):
            raise ValueError("limits: low must be below high, and angle_low below angle_high.")

    def lowered(self, **lower: float | None) -> Limits:
        """The same with some of them lower (None: as it is), from the command line.

        A lower ``force_norm`` lowers ``force`` with it, which would never count otherwise.

        Raises
        ------
        ValueError
            If one would be higher than it is, or is out of range.
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
"""Limits that the command line may lower."""


@dataclass(frozen=True, kw_only=True)
class Identified:
    """What ``cutenv rig identify`` has measured, which the simulator takes for its own; None: not measured."""

    date: str | None = None
    motor_lag: float | None = None
    """Time constant of the velocity loop [s]."""
    dead_time: float | None = None
    """Between a command and the first motion [s]."""
    acceleration: float | None = None
    """Limit [m/s2]."""
    backlash: float | None = None
    """Play of gear and screw [m]."""
    friction: float | None = None
    """Of the empty axis, as a force on the carriage [N]: the rig's own, no part of what the sensor feels."""
    force_noise: float | None = None
    """Standard deviation at rest [N]."""
    force_resolution: float | None = None
    """Least step [N]."""
    force_drift: float | None = None
    """Standard deviation of a random walk after one second [N]."""
    force_still_x: float | None = None
    """Longest time for which the sensor's x force stands at one count by its own noise [s]."""
    force_still_y: float | None = None
    force_still_z: float | None = None


@dataclass(frozen=True, kw_only=True)
class Calibration:
    """When and how the force sensor was last checked."""

    date: str = ""
    """ISO 8601; empty: never, and nothing moves."""
    valid_days: int = 365
    gain: float = parameter(1.0, unit="1", low=0.5, high=2.0, provenance="choice", why="newtons over what it reads")

    def __post_init__(self) -> None:
        check_parameters(self)
        in_range("valid_days", self.valid_days, 1, 3650, "days", "A year is usual.")


@dataclass(frozen=True, kw_only=True)
class RigSettings:
    """All of it.

    Attributes
    ----------
    armed_by : str
        Who answers for it that this rig may move; empty: nothing moves.
    angle_mode : {"fixed", "free"}
        Set by hand, at ``fixed_angle``; or turned by a second axis.
    depth_profile : tuple of (position, depth)
        Measured by caliper before the cut [m].
    """

    name: str = "rig"
    armed_by: str = ""
    angle_mode: Literal["fixed", "free"] = "fixed"
    fixed_angle: float = parameter(
        math.pi / 2, unit="rad", low=math.radians(45.0) - 1e-9, high=math.radians(90.0) + 1e-9, provenance="choice",
        why="upright; measured are 45 to 90 degrees",
    )  # fmt: skip
    bus: Bus = field(default_factory=Bus)
    blade: Axis = field(default_factory=Axis)
    angle: Axis | None = None
    sensor: Sensor = field(default_factory=Sensor)
    limits: Limits = field(default_factory=Limits)
    calibration: Calibration = field(default_factory=Calibration)
    identified: Identified = field(default_factory=Identified)
    depth_profile: tuple[tuple[float, float], ...] = ()
    emulated: bool = False
    """Whether it is an emulator, which needs no operator."""

    def __post_init__(self) -> None:
        one_of("angle_mode", self.angle_mode, ("fixed", "free"))
        check_parameters(self)
        if (self.angle_mode == "free") != (self.angle is not None):
            raise ValueError('angle_mode "free" needs the second axis "angle", and "fixed" has none.')
