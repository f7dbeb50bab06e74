"""Assembly of the emulated rig, and the loop that advances all of it by a millisecond at a time."""

from __future__ import annotations

import math
import threading
import time
from collections import deque
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np

from cutenv._base.validation import in_range, one_of
from cutenv.cutting.dtypes import TICK
from cutenv.cutting.parameters import LawParameters
from cutenv.cutting.sensor import SensorParameters
from cutenv.plant.simulator import check_angle
from cutenv.rig.config.settings import Axis, HeightAxis
from cutenv.rig.devices.analogue.sensor_calibration_file import AnalogueCalibration
from cutenv.rig.emulator.board_server import BoardServer
from cutenv.rig.emulator.emulated_axis import EmulatedAxis
from cutenv.rig.emulator.emulated_tissue import EmulatedTissue, Laid
from cutenv.rig.emulator.faults import FAULTS
from cutenv.rig.emulator.hub import Frame, Hub
from cutenv.rig.emulator.layered_tissue import ARM, LayeredTissue
from cutenv.rig.emulator.motor import Mechanics, hinge
from cutenv.rig.emulator.node import Node
from cutenv.rig.emulator.sensor_server import SensorServer
from cutenv.rig.errors import RigError

BLADE = Axis(low=-0.002, high=0.149)
"""Axis of the emulated rig's carriage."""
HINGE = Axis(
    node=2, gear=100.0, lead=2 * math.pi, low=math.radians(43.0), high=math.radians(92.0), speed=math.radians(120.0),
    acceleration=20.0, quick_stop=40.0, following_error=0.05,
)  # fmt: skip
"""Axis that turns the blade of the emulated rig."""
STALL = 0.005
"""Delay of the loop from which it is counted as a stall [s]."""

_FORGIVEN = 0.25  # [s] of delay that is caught up; more is skipped
_STILL = 1e-4  # [m/s] below which the carriage is at rest
_STANDS_AFTER = 5  # ticks
_OTHER_NOISE = (0.02, 0.02, 0.001, 0.001, 0.001)  # Fy, Fz [N], Tx, Ty, Tz [N m]: enough to make the counts flicker
_KEPT_EVENTS = 10_000


@dataclass(frozen=True, kw_only=True)
class Options:
    """Construction of the emulated rig.

    Attributes
    ----------
    angle_mode : {"free", "fixed"}
        "free": a second axis turns the blade; "fixed": the blade stays at ``angle``.
    angle : float
        Angle of the blade at the start [rad].
    laid : Laid, optional
        Specimen at the start; None: free air.
    force_limit : float
        True force whose crossing is recorded as an event [N].
    blade_axis, hinge_axis : Axis
        Axes as mounted; blade_mechanics, hinge_mechanics: the mechanics that they move.
    height_axis : HeightAxis, optional
        Axis that raises and lowers the blade, with the mechanics of the blade's; None: the blade stays at one height.
    sensor : SensorParameters
        Force sensor, as in the simulator.
    analogue : AnalogueCalibration, optional
        Analogue sensor on a board, which takes the place of the Net F/T: its converter then has the resolution, and
        ``sensor`` the noise and delay.
    law : LawParameters
        Cutting law, as in the simulator.
    host : str
        Address that everything listens on.
    can_port, sensor_port, page_port, control_port : int
        Ports; 0 takes free ones.
    """

    angle_mode: Literal["free", "fixed"] = "free"
    angle: float = math.pi / 2
    laid: Laid | None = field(default_factory=Laid)
    force_limit: float = 15.0
    blade_axis: Axis = BLADE
    hinge_axis: Axis = HINGE
    height_axis: HeightAxis | None = None
    blade_mechanics: Mechanics = field(default_factory=Mechanics)
    hinge_mechanics: Mechanics = field(default_factory=hinge)
    sensor: SensorParameters = field(default_factory=SensorParameters)
    analogue: AnalogueCalibration | None = None
    law: LawParameters = field(default_factory=LawParameters)
    host: str = "127.0.0.1"
    can_port: int = 0
    sensor_port: int = 0
    page_port: int = 0
    control_port: int = 0

    def __post_init__(self) -> None:
        one_of("angle_mode", self.angle_mode, ("free", "fixed"))
        check_angle(self.angle)
        in_range("force_limit", self.force_limit, 0.01, 1000.0, "N", "What the rig's own limit is.")


class EmulatedRig:
    """Emulated rig: hub, drives, motors, tissue and sensor; :meth:`run` advances the time.

    Attributes
    ----------
    axes, nodes : dict
        Axes and nodes by name, "blade" and perhaps "angle" and "height".
    stalls, worst_stall : int, float
        Number of delays of the loop beyond :data:`STALL`, and the longest [s].
    real_time : bool
        True if it has priority over other processes.
    intruders : dict
        Fault: speeds that another master commands every millisecond, by axis [m/s or rad/s].
    stopped : threading.Event
        Set it to end :meth:`run`.
    """

    def __init__(self, options: Options | None = None) -> None:
        self.options = options or Options()
        self.lock = threading.RLock()
        self.stopped = threading.Event()
        self.stalls, self.worst_stall = 0, 0.0
        self.real_time = False
        self.force_limit = self.options.force_limit
        self.active: dict[tuple[str, str], dict[str, Any]] = {}
        self._events: deque[dict[str, Any]] = deque(maxlen=_KEPT_EVENTS)
        self._counted = 0
        self._due: float | None = None  # end of the next millisecond; None: time stands still
        self._still = _STANDS_AFTER
        self._planned: list[tuple[float, str, dict[str, Any]]] = []
        felt = self.options.sensor
        if self.options.analogue is not None:
            felt = replace(felt, force_resolution=0.0)
        self.bench = EmulatedTissue(felt, self.options.law)
        self._layered: LayeredTissue | None = None
        if self.options.height_axis is not None:
            self.bench = self._layered = LayeredTissue(felt, self.options.law)
        self.axes: dict[str, EmulatedAxis] = {
            "blade": EmulatedAxis(
                "blade", self.options.blade_axis, self.options.blade_mechanics, position=0.0, margin=0.003
            )
        }
        if self.options.angle_mode == "free":
            self.axes["angle"] = EmulatedAxis(
                "angle", self.options.hinge_axis, self.options.hinge_mechanics, position=self.options.angle, margin=0.05
            )
        if self.options.height_axis is not None:
            self.axes["height"] = EmulatedAxis(
                "height", self.options.height_axis, Mechanics(), position=0.0, margin=0.001
            )
        if self.options.laid is not None:
            self.mount(self.options.laid)
        self._noise = np.random.default_rng(0).standard_normal((4096, 5)) * _OTHER_NOISE
        self._noise_rows = [tuple(row) for row in self._noise.tolist()]
        self._ticks = 0
        self.intruders: dict[str, float] = {}
        self.nodes = {name: Node(axis, self._send, self.happened) for name, axis in self.axes.items()}
        self.sensor: SensorServer | BoardServer
        if self.options.analogue is None:
            self.sensor = SensorServer(
                host=self.options.host, port=self.options.sensor_port, page_port=self.options.page_port
            )
        else:
            self.sensor = BoardServer(self.options.analogue, host=self.options.host, port=self.options.sensor_port)
        try:
            self.hub = Hub(self._receive, host=self.options.host, port=self.options.can_port)
        except OSError:
            self.sensor.close()
            raise

    def now(self) -> float:
        """Return the time of the machine's monotonic clock [s]."""
        return time.monotonic()

    @property
    def angle(self) -> float:
        """Angle of the blade [rad]."""
        return float(self.axes["angle"].motor["carriage"]) if "angle" in self.axes else self.options.angle

    @property
    def height(self) -> float:
        """Height of the blade's lower end [m], upwards; 0 without a height axis."""
        return float(self.axes["height"].motor["carriage"]) if "height" in self.axes else 0.0

    def _send(self, frame: Frame) -> None:
        self.hub.send(frame)

    def _receive(self, frame: Frame) -> None:
        now = self.now()
        with self.lock:
            self._catch_up(now)  # a drive's answer reflects the present, even if the loop is late
            for node in self.nodes.values():
                node.receive(frame, now)

    # Requests of the control port.

    def mount(self, laid: Laid) -> None:
        """Lay a fresh specimen; see :meth:`Bench.lay`."""
        specimen = laid.drawn()
        with self.lock:
            if self._layered is not None:
                self._layered.check_height(self.height)
            self.bench.mount(specimen, laid, position=float(self.axes["blade"].motor["carriage"]), angle=self.angle)

    def inject(self, name: str, given: dict[str, Any]) -> dict[str, Any]:
        """Start a fault now; return its parameters.

        Raises
        ------
        ValueError, TypeError
            For an unknown fault or parameter, or a value out of range.
        """
        fault = FAULTS[one_of("fault", name, FAULTS)]
        parameters = fault.checked(name, given, list(self.axes))
        with self.lock:
            fault.begin(self, parameters)
            self.active[name, parameters.get("axis", "")] = parameters
            self.happened("fault injected", fault=name, **parameters)
        return parameters

    def inject_later(self, name: str, given: dict[str, Any], seconds: float) -> None:
        """Start a fault ``seconds`` after :meth:`run` has begun; see :meth:`inject`."""
        fault = FAULTS[one_of("fault", name, FAULTS)]
        fault.checked(name, given, list(self.axes))
        self._planned.append((seconds, name, given))
        self._planned.sort(key=lambda planned: planned[0])

    def clear(self, name: str | None = None) -> list[str]:
        """End one fault, or all; return their names.

        Raises
        ------
        RigError
            If that fault is not active.
        """
        with self.lock:
            found = [key for key in self.active if name in (None, key[0])]
            if name is not None and not found:
                listed = ", ".join(sorted({key[0] for key in self.active})) or "none"
                raise RigError(f"no fault {name!r} to clear; active: {listed}.")
            for key in found:
                FAULTS[key[0]].end(self, self.active.pop(key))
                self.happened("fault cleared", fault=key[0])
            return [key[0] for key in found]

    def happened(self, what: str, *, time: float | None = None, **details: Any) -> None:
        """Record an event, now or at a ``time`` of the monotonic clock [s], with the position of the carriage."""
        moment = self.now() if time is None else time
        with self.lock:
            position = float(self.axes["blade"].motor["carriage"])
            self._events.append(
                {"index": self._counted, "time_s": moment, "what": what, "position_m": position, **details}
            )
            if "height" in self.axes:
                self._events[-1]["height_m"] = self.height
            self._counted += 1

    def events(self, since: int = 0) -> list[dict[str, Any]]:
        """Return the events from index ``since`` on."""
        with self.lock:
            return [event for event in self._events if event["index"] >= since]

    # Time.

    def run(self) -> None:
        """Advance by a millisecond every millisecond, until :attr:`stopped` is set; late ones are caught up."""
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
        """Advance by all milliseconds that are due, none before :meth:`run`; return the end of the next one [s]."""
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

    def step(self, due: float) -> None:
        """Advance by one millisecond, that of time ``due`` [s]."""
        blade = self.axes["blade"]
        with self.lock:
            for name, speed in self.intruders.items():
                frame = self.nodes[name].command(speed)
                self.hub.send(frame)
                self.nodes[name].receive(frame, due)
            for node in self.nodes.values():
                node.tick(due)
            blade.turn(-self.bench.true_force)
            if "angle" in self.axes:
                self.axes["angle"].turn(0.0)
            before = abs(self.bench.true_force)
            speed = abs(float(blade.motor["carriage_speed"]))
            if self._layered is not None:
                lift = self.axes["height"]
                lift.turn(self._layered.vertical_force)
                speed = max(speed, abs(float(lift.motor["carriage_speed"])))
                self._layered.height = self.height
            reading = self.bench.advance(float(blade.motor["carriage"]), self.angle)
        self._watch(due, before, abs(self.bench.true_force), speed)
        self._ticks += 1
        fy, fz, tx, ty, tz = self._noise_rows[self._ticks % len(self._noise_rows)]
        if self._layered is not None:
            fz, ty = fz + self._layered.vertical_force, ty - ARM * reading
        self.sensor.send((reading, fy, fz, tx, ty, tz))

    def _watch(self, due: float, before: float, force: float, speed: float) -> None:
        if before < self.force_limit <= force:
            self.happened("force limit crossed", time=due, force_N=force)
        self._still = self._still + 1 if speed < _STILL else 0
        if self._still == _STANDS_AFTER:
            self.happened("standstill", time=due - _STANDS_AFTER * TICK)

    def close(self) -> None:
        """Stop listening; may be called twice."""
        self.stopped.set()
        self.hub.close()
        self.sensor.close()
