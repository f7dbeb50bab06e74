"""Driven axes of a rig: the blade's, the hinge's, and those across the cut, up and down and sideways."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Literal

from cutenv._base.validation import check_parameters, in_range, one_of
from cutenv.rig.config.setting import setting

DRIVER = "Driver: a name that 'cutenv rig drivers' lists, or module:Class. Its own keys are in the table 'options'."
"""Comment above the key that names a driver."""
_WAY, _SPEED, _ACCELERATION = ("mm", "deg"), ("cm_s", "deg_s"), ("m_s2", "deg_s2")


@dataclass(frozen=True, kw_only=True)
class Axis:
    """One drive with its motor, gear and load: metres along the cut, or radians of the blade's angle.

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
    """Drive that moves the blade across the cut in a straight line, with its own limits."""

    ends: ClassVar[tuple[str, str]]
    """Names of the fields for the two ends of travel at which the blade is stopped."""
    to: ClassVar[tuple[str, str]]
    """Words for the ways of a positive and of a negative speed."""
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
        """Return the force of the tissue along this axis [N], in the sense of ``force_sign``, from the sensor's [N]."""
        return self.force_sign * force["xyz".index(self.force_axis)]


@dataclass(frozen=True, kw_only=True)
class HeightAxis(CrossAxis):
    """Drive that raises and lowers the blade, and its limits; heights are of the blade's lower end, upwards.

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
    """Drive that moves the blade to the side, and its limits; places are to the left of the middle of the clamp."""

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
