"""Base of every emulated rig: its loop, events and faults."""

from __future__ import annotations

import threading
import time
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from operator import attrgetter
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, Protocol

from cutenv._base.validation import in_range, one_of
from cutenv.emulation.emulated_drive import Emergency
from cutenv.emulation.mechanics import EmulatedTissue
from cutenv.emulation.sensor_server import SensorServer
from cutenv.rig.config.mounted_specimen import MountedSpecimen
from cutenv.rig.errors import RigError
from cutenv.sim.cutting.dtypes import TICK

if TYPE_CHECKING:
    from cutenv.emulation.emulated_axis import EmulatedAxis
    from cutenv.emulation.emulated_drive import Node
    from cutenv.emulation.sensor_server import BoardServer


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

        Raise ValueError, TypeError for an unknown parameter or a value out of range.
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


Act = Callable[[Any, Parameters, Any], None]  # change of a rig, from its parameters and a value


def switched(
    act: Act, summary: str, on: Any = True, off: Any = False, *, of_axis: bool = False, **parameters: Range
) -> InjectedFault:
    """Make a fault that acts by ``on`` (value or parameter), and ends by ``off``."""

    def begin(rig: Any, given: Parameters) -> None:
        act(rig, given, type(off)(given[on] if isinstance(on, str) else on))

    return InjectedFault(
        summary=summary, of_axis=of_axis, parameters=parameters, begin=begin, end=lambda rig, p: act(rig, p, off)
    )


def attribute(name: str, of: str = "") -> Act:
    """Set an attribute of a rig part, such as "sensor.faults"; "" is the rig."""
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

    Raise ValueError if it has another form.
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


STALL = 0.005  # delay of the loop from which it is counted as a stall [s]
_FORGIVEN = 0.25  # [s] of delay that is caught up; more is skipped
_STILL = 1e-4  # [m/s] below which the carriage is at rest
_KEPT_EVENTS = 10_000


class EmulatedBench(ABC):
    """Emulated rig of any kind; :meth:`run` advances the time.

    ``force_limit``: true force whose crossing is recorded as an event [N]. ``stalls``, ``worst_stall``: number of
    delays of the loop beyond :data:`STALL`, and the longest [s].
    """

    faults: ClassVar[Mapping[str, InjectedFault]]  # faults that it knows, by name
    stands_after: ClassVar[int] = 5  # milliseconds without motion after which the carriage has come to rest
    cross_axes: tuple[str, ...] = ()  # names of the axes across the cut, "height" and "side"

    def __init__(self, bench: EmulatedTissue, force_limit: float) -> None:
        self.bench = bench
        self.lock = threading.RLock()
        self.stopped = threading.Event()  # set it to end :meth:`run`
        self.stalls, self.worst_stall = 0, 0.0
        self.real_time = False  # True if it has priority over other processes
        self.force_limit = force_limit
        self.active: dict[tuple[str, str], dict[str, Any]] = {}
        self._events: deque[dict[str, Any]] = deque(maxlen=_KEPT_EVENTS)
        self._counted = 0
        self._due: float | None = None  # end of the next millisecond; None: time stands still
        self._still = self.stands_after
        self._planned: list[tuple[float, str, dict[str, Any]]] = []

    def now(self) -> float:
        """Return the time of the machine's monotonic clock [s]."""
        return time.monotonic()

    @property
    @abstractmethod
    def position(self) -> float:
        """Position of the carriage from the clamp [m]."""

    @property
    @abstractmethod
    def speed(self) -> float:
        """Speed of the carriage [m/s]."""

    @property
    @abstractmethod
    def angle(self) -> float:
        """Angle of the blade [rad]."""

    @property
    @abstractmethod
    def axis_names(self) -> Sequence[str]:
        """Names of the driven axes."""

    @abstractmethod
    def state(self) -> dict[str, Any]:
        """Return the devices' state for JSON, with "nodes" and "clients"."""

    @abstractmethod
    def truth(self) -> dict[str, Any]:
        """Return more of what only an emulator knows, for JSON."""

    @abstractmethod
    def step(self, due: float) -> None:
        """Advance by one millisecond, that of time ``due`` [s]."""

    @abstractmethod
    def close(self) -> None:
        """Stop listening; may be called twice."""

    # Requests of the control port.

    def mount(self, mounted: MountedSpecimen) -> None:
        """Lay a fresh specimen; see :meth:`EmulatedTissue.mount`."""
        specimen = mounted.drawn()
        with self.lock:
            self.bench.mount(specimen, mounted, position=self.position, angle=self.angle)

    def inject(self, name: str, given: dict[str, Any]) -> dict[str, Any]:
        """Start a fault now; return its parameters.

        Raise ValueError, TypeError for an unknown fault or parameter, or a value out of range.
        """
        fault = self.faults[one_of("fault", name, self.faults)]
        parameters = fault.checked(name, given, list(self.axis_names))
        with self.lock:
            fault.begin(self, parameters)
            self.active[name, parameters.get("axis", "")] = parameters
            self.happened("fault injected", fault=name, **parameters)
        return parameters

    def inject_later(self, name: str, given: dict[str, Any], seconds: float) -> None:
        """Start a fault ``seconds`` after :meth:`run` has begun; see :meth:`inject`."""
        fault = self.faults[one_of("fault", name, self.faults)]
        fault.checked(name, given, list(self.axis_names))
        self._planned.append((seconds, name, given))
        self._planned.sort(key=lambda planned: planned[0])

    def clear(self, name: str | None = None) -> list[str]:
        """End one fault, or all; return their names; raise RigError if that fault is not active."""
        with self.lock:
            found = [key for key in self.active if name in (None, key[0])]
            if name is not None and not found:
                listed = ", ".join(sorted({key[0] for key in self.active})) or "none"
                raise RigError(f"no fault {name!r} to clear; active: {listed}.")
            for key in found:
                self.faults[key[0]].end(self, self.active.pop(key))
                self.happened("fault cleared", fault=key[0])
            return [key[0] for key in found]

    def happened(self, what: str, *, time: float | None = None, **details: Any) -> None:
        """Record an event, now or at monotonic ``time`` [s], with the carriage's position."""
        moment = self.now() if time is None else time
        with self.lock:
            position = self.position
            self._events.append(
                {"index": self._counted, "time_s": moment, "what": what, "position_m": position, **details}
            )
            self._events[-1].update(self._noted())
            self._counted += 1

    def _noted(self) -> dict[str, Any]:
        """Return more that is recorded with every event."""
        return {}

    def events(self, since: int = 0) -> list[dict[str, Any]]:
        """Return the events from index ``since`` on."""
        with self.lock:
            return [event for event in self._events if event["index"] >= since]

    # Time.

    def run(self) -> None:
        """Advance every millisecond until :attr:`stopped`, catching up late ones."""
        begun = self.now()
        with self.lock:
            self._due = begun
        while not self.stopped.is_set():
            while self._planned and self.now() - begun >= self._planned[0][0]:
                _, name, given = self._planned.pop(0)
                self.inject(name, given)
            due = self._catch_up(self.now())
            if (left := due - self.now()) > 0.0:
                time.sleep(left)

    def _catch_up(self, now: float) -> float:
        """Advance by due milliseconds, none before :meth:`run`; return the next's end [s]."""
        with self.lock:
            if self._due is None:
                return now
            late = now - self._due
            if late > STALL:
                self.stalls += 1
                self.worst_stall = max(self.worst_stall, late)
                self.happened("stall", late_s=late)
                if late > _FORGIVEN:
                    self._due = now
            while self._due <= now:
                self.step(self._due)
                self._due += TICK
            return self._due

    def _watch(self, due: float, before: float, force: float, speed: float) -> None:
        if before < self.force_limit <= force:
            self.happened("force limit crossed", time=due, force_N=force)
        self._still = self._still + 1 if speed < _STILL else 0
        if self._still == self.stands_after:
            self.happened("standstill", time=due - self.stands_after * TICK)
