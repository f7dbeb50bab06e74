"""Faults of the emulated rig: each by name, with its parameters, and the functions that start and end it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from operator import attrgetter
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


Act = Callable[[Any, Parameters, Any], None]
"""Change of a rig, from its parameters and a value."""


def switched(
    act: Act, summary: str, on: Any = True, off: Any = False, *, of_axis: bool = False, **parameters: Range
) -> InjectedFault:
    """Make a fault that acts with ``on``, or the parameter of that name, and at its end with ``off``."""

    def begin(rig: Any, given: Parameters) -> None:
        act(rig, given, type(off)(given[on] if isinstance(on, str) else on))

    return InjectedFault(
        summary=summary, of_axis=of_axis, parameters=parameters, begin=begin, end=lambda rig, p: act(rig, p, off)
    )


def attribute(name: str, of: str = "") -> Act:
    """Set an attribute of a part of the rig, such as "sensor.faults"; "": of the rig itself."""
    return lambda rig, p, value: setattr(attrgetter(of)(rig) if of else rig, name, value)


def force_fault(summary: str, act: Act, force: float) -> InjectedFault:
    """Make a fault that is an added force [N]."""
    return switched(act, summary, "force_N", 0.0, force_N=Range(force, -190.0, 190.0, "N"))


OVER_FORCE = force_fault("a force is added to the tissue's", lambda rig, p, force: rig.bench.add_force(force), 25.0)
"""Fault of every rig: a force along the cut."""


def _of_node(name: str, summary: str) -> InjectedFault:
    return switched(lambda rig, p, value: setattr(rig.nodes[p["axis"]], name, value), summary, of_axis=True)


def _of_motor(entry: str, summary: str, on: float | str, off: float, **parameters: Range) -> InjectedFault:
    def act(rig: FaultyRig, given: Parameters, value: float) -> None:
        rig.axes[given["axis"]].motor[entry] = value

    return switched(act, summary, on, off, of_axis=True, **parameters)


def _of_sensor(name: str, summary: str, on: Any = True, off: Any = False, **parameters: Range) -> InjectedFault:
    return switched(attribute(name, "sensor.faults"), summary, on, off, of_axis=False, **parameters)


FAULTS: dict[str, InjectedFault] = {
    "heartbeat_lost": _of_node("heartbeat_lost", "the drive sends no heartbeats; all else goes on"),
    "bus_off": _of_node("bus_off", "the drive neither sends nor receives frames; its motor goes on"),
    "doubled_frames": _of_node("doubles", "every frame to and from the drive comes twice"),
    "stuck_encoder": switched(
        lambda rig, p, stuck: rig.axes[p["axis"]].stick(stuck),
        "position and velocity stand still while the motor turns", of_axis=True,
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
    "drive_fault": switched(
        lambda rig, p, code: setattr(rig.nodes[p["axis"]], "failure", code),
        "the drive finds something wrong and takes its torque away at once (0x2310: over-current)", "code", 0,
        of_axis=True, code=Range(Emergency.OVER_CURRENT, 1, 0xFFFF, "1"),
    ),
    "second_master": InjectedFault(
        summary="another master enables the drive and commands a speed, every millisecond",
        of_axis=True, parameters={"speed": Range(0.03, -0.2, 0.2, "m/s or rad/s")},
        begin=lambda rig, p: rig.intruders.update({p["axis"]: p["speed"]}),
        end=lambda rig, p: rig.intruders.clear(),
    ),
    "power_loss": switched(
        lambda rig, p, lost: rig.nodes[p["axis"]].power(not lost, rig.now()),
        "the drive is silent and the motor coasts; at the end it restarts", of_axis=True,
    ),
    "over_force": OVER_FORCE,
    "over_lift": force_fault(
        "a force is added to the vertical one, on a rig with a height axis",
        lambda rig, p, force: rig.bench.add_across("height", force), -14.0,
    ),
    "side_push": force_fault(
        "a force to the right is added to that across the cut, on a rig with an axis to the side",
        lambda rig, p, force: rig.bench.add_across("side", force), 25.0,
    ),
    "sensor_freeze": _of_sensor("frozen", "the counts stay as they are"),
    "axis_freeze": _of_sensor(
        "frozen_axis", "one force stays as it is (0: x, 1: y, 2: z); the others and the torques go on", "number", -1,
        number=Range(0, 0, 2, "1"),
    ),
    "sensor_silent": _of_sensor("silent", "the sensor sends nothing"),
    "bad_status": _of_sensor(
        "status", "readings carry a status that is not healthy", "status", 0,
        status=Range(0x80010000, 1, 0xFFFFFFFF, "1"),
    ),
    "packet_loss": _of_sensor(
        "loss", "a share of the readings is lost", "share", 0.0, share=Range(0.5, 0.0, 1.0, "1")
    ),
    "reordering": _of_sensor("reorder", "readings overtake each other"),
    "latency": _of_sensor("latency", "readings come late", "delay_s", 0.0, delay_s=Range(0.05, 0.0, 2.0, "s")),
    "saturation": _of_sensor("saturated", "forces stand at the end of the sensor's range"),
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
