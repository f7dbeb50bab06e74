"""Faults of the emulated rig: each by name, with its parameters, and the functions that start and end it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

from cutenv._base.validation import in_range, one_of
from cutenv.rig.emulator.node import Emergency

if TYPE_CHECKING:
    from cutenv.rig.emulator.board_server import BoardServer
    from cutenv.rig.emulator.emulated_axis import EmulatedAxis
    from cutenv.rig.emulator.emulated_tissue import EmulatedTissue
    from cutenv.rig.emulator.node import Node
from cutenv.rig.emulator.sensor_server import SensorServer

Parameters = dict[str, Any]


class FaultyRig(Protocol):
    """Parts of an emulated rig that a fault changes."""

    nodes: dict[str, Node]
    axes: dict[str, EmulatedAxis]
    sensor: SensorServer | BoardServer
    bench: EmulatedTissue
    intruders: dict[str, float]

    def now(self) -> float:
        """Return the time on the emulated rig's clock [s]."""
        ...


class Range(NamedTuple):
    """Range of a fault's numerical parameter."""

    default: float
    low: float
    high: float
    unit: str


@dataclass(frozen=True, kw_only=True)
class InjectedFault:
    """Fault that can be started and ended.

    Faults with ``of_axis`` take the parameter ``axis``, "blade", "angle", "height" or "side", besides their own.
    """

    summary: str
    begin: Callable[[Any, Parameters], None]
    end: Callable[[Any, Parameters], None]
    parameters: dict[str, Range] = field(default_factory=dict)
    of_axis: bool = False

    def checked(self, name: str, given: Parameters, axes: list[str]) -> Parameters:
        """Return all parameters, with defaults for those not given.

        Raises
        ------
        ValueError, TypeError
            For an unknown parameter or a value out of range.
        """
        known = [*self.parameters, *(["axis"] if self.of_axis else [])]
        if unknown := [key for key in given if key not in known]:
            listed = ", ".join(known) or "none"
            raise ValueError(f"fault {name!r} has no parameter {unknown[0]!r}; it has: {listed}.")
        checked: Parameters = {}
        for key, (default, low, high, unit) in self.parameters.items():
            checked[key] = in_range(f"{name} {key}", given.get(key, default), low, high, unit, self.summary)
        if self.of_axis:
            checked["axis"] = one_of("axis", given.get("axis", "blade"), axes)
        return checked


def _of_node(attribute: str, summary: str) -> InjectedFault:
    return InjectedFault(
        summary=summary,
        of_axis=True,
        begin=lambda rig, p: setattr(rig.nodes[p["axis"]], attribute, True),
        end=lambda rig, p: setattr(rig.nodes[p["axis"]], attribute, False),
    )


def _of_motor(entry: str, summary: str, value: float | str, healthy: float, **parameters: Range) -> InjectedFault:
    """Make a fault that is one number of the motor's record: ``value``, or the parameter of that name."""

    def begin(rig: FaultyRig, given: Parameters) -> None:
        rig.axes[given["axis"]].motor[entry] = given[value] if isinstance(value, str) else value

    def end(rig: FaultyRig, given: Parameters) -> None:
        rig.axes[given["axis"]].motor[entry] = healthy

    return InjectedFault(summary=summary, of_axis=True, parameters=parameters, begin=begin, end=end)


def _of_sensor(attribute: str, summary: str, value: Any, healthy: Any, **parameters: Range) -> InjectedFault:
    """Make a fault of the sensor: ``value``, or the parameter of that name."""

    def begin(rig: FaultyRig, given: Parameters) -> None:
        wanted = given[value] if isinstance(value, str) else value
        setattr(rig.sensor.faults, attribute, type(healthy)(wanted))

    def end(rig: FaultyRig, given: Parameters) -> None:
        setattr(rig.sensor.faults, attribute, healthy)

    return InjectedFault(summary=summary, parameters=parameters, begin=begin, end=end)


def _fail(rig: FaultyRig, given: Parameters) -> None:
    rig.nodes[given["axis"]].failure = int(given["code"])


def _mend(rig: FaultyRig, given: Parameters) -> None:
    rig.nodes[given["axis"]].failure = 0


def _power(on: bool) -> Callable[[FaultyRig, Parameters], None]:
    return lambda rig, given: rig.nodes[given["axis"]].power(on, rig.now())


FAULTS: dict[str, InjectedFault] = {
    "heartbeat_lost": _of_node("heartbeat_lost", "the drive sends no heartbeats; all else goes on"),
    "bus_off": _of_node("bus_off", "the drive neither sends nor receives frames; its motor goes on"),
    "doubled_frames": _of_node("doubles", "every frame to and from the drive comes twice"),
    "stuck_encoder": InjectedFault(
        summary="position and velocity stand still while the motor turns",
        of_axis=True,
        begin=lambda rig, p: rig.axes[p["axis"]].stick(True),
        end=lambda rig, p: rig.axes[p["axis"]].stick(False),
    ),
    "following_error": _of_motor("blocked", "the motor is blocked, and the encoder behind its demand", 1, 0),
    "cannot_be_raised": _of_motor("blocked", "the axis moves down or back, but not up or on", 2, 0),
    "wrong_position": InjectedFault(
        summary="the encoder suddenly counts from another zero", of_axis=True,
        parameters={"shift": Range(0.002, -0.1, 0.1, "m or rad")},
        begin=lambda rig, p: rig.axes[p["axis"]].shift(p["shift"]),
        end=lambda rig, p: rig.axes[p["axis"]].shift(-p["shift"]),
    ),
    "deaf": _of_node("deaf", "the drive does not obey a quick stop; all else goes on"),
    "slip": _of_motor(
        "slip", "a share of the motor's motion does not reach the carriage", "share", 0.0,
        share=Range(1.0, 0.0, 1.0, "1"),
    ),
    "runaway": _of_motor(
        "runaway", "the drive takes a speed of its own instead of the target; it still obeys a stop",
        "speed", float("nan"), speed=Range(0.05, -0.2, 0.2, "m/s or rad/s"),
    ),
    "drive_fault": InjectedFault(
        summary="the drive finds something wrong and takes its torque away at once (0x2310: over-current)",
        of_axis=True, begin=_fail, end=_mend, parameters={"code": Range(Emergency.OVER_CURRENT, 1, 0xFFFF, "1")},
    ),
    "second_master": InjectedFault(
        summary="another master enables the drive and commands a speed, every millisecond",
        of_axis=True, parameters={"speed": Range(0.03, -0.2, 0.2, "m/s or rad/s")},
        begin=lambda rig, p: rig.intruders.update({p["axis"]: p["speed"]}),
        end=lambda rig, p: rig.intruders.clear(),
    ),
    "power_loss": InjectedFault(
        summary="the drive is silent and the motor coasts; at the end it restarts",
        of_axis=True, begin=_power(False), end=_power(True),
    ),
    "over_force": InjectedFault(
        summary="a force is added to the tissue's",
        begin=lambda rig, p: rig.bench.add_force(p["force_N"]),
        end=lambda rig, p: rig.bench.add_force(0.0),
        parameters={"force_N": Range(25.0, -190.0, 190.0, "N")},
    ),
    "over_lift": InjectedFault(
        summary="a force is added to the vertical one, on a rig with a height axis",
        begin=lambda rig, p: rig.bench.add_across("height", p["force_N"]),
        end=lambda rig, p: rig.bench.add_across("height", 0.0),
        parameters={"force_N": Range(-14.0, -190.0, 190.0, "N")},
    ),
    "side_push": InjectedFault(
        summary="a force to the right is added to that across the cut, on a rig with an axis to the side",
        begin=lambda rig, p: rig.bench.add_across("side", p["force_N"]),
        end=lambda rig, p: rig.bench.add_across("side", 0.0),
        parameters={"force_N": Range(25.0, -190.0, 190.0, "N")},
    ),
    "sensor_freeze": _of_sensor("frozen", "the counts stay as they are", True, False),
    "axis_freeze": _of_sensor(
        "frozen_axis", "one force stays as it is (0: x, 1: y, 2: z); the others and the torques go on", "number", -1,
        number=Range(0, 0, 2, "1"),
    ),
    "sensor_silent": _of_sensor("silent", "the sensor sends nothing", True, False),
    "bad_status": _of_sensor(
        "status", "readings carry a status that is not healthy", "status", 0,
        status=Range(0x80010000, 1, 0xFFFFFFFF, "1"),
    ),
    "packet_loss": _of_sensor(
        "loss", "a share of the readings is lost", "share", 0.0, share=Range(0.5, 0.0, 1.0, "1")
    ),
    "reordering": _of_sensor("reorder", "readings overtake each other", True, False),
    "latency": _of_sensor("latency", "readings come late", "delay_s", 0.0, delay_s=Range(0.05, 0.0, 2.0, "s")),
    "saturation": _of_sensor("saturated", "forces stand at the end of the sensor's range", True, False),
}  # fmt: skip
"""Every fault, by name."""


def parsed_fault(text: str, faults: Mapping[str, InjectedFault] = FAULTS) -> tuple[str, Parameters, float]:
    """Parse ``NAME@SECONDS`` or ``NAME:KEY=VALUE,KEY=VALUE@SECONDS`` into name, parameters and time [s].

    Raises
    ------
    ValueError
        If it has another form.
    """
    what, at, seconds = text.rpartition("@")
    name, _, listed = what.partition(":")
    try:
        if not at:
            raise ValueError
        moment = in_range("seconds", float(seconds), 0.0, 1e6, "s")
        pairs = [pair.split("=") for pair in listed.split(",") if pair]
        given: Parameters = {key: value if key == "axis" else float(value) for key, value in pairs}
    except ValueError:
        raise ValueError(f"fault {text!r}: write NAME@SECONDS, or NAME:KEY=VALUE,KEY=VALUE@SECONDS.") from None
    one_of("fault", name, faults)
    return name, given, moment
