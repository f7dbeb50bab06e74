"""Emulated rig on a CAN bus, with a Net F/T."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any, Literal, NamedTuple

import numpy as np

from cutenv._base.validation import in_range, one_of
from cutenv.drivers.analogue_sensor import AnalogueCalibration
from cutenv.emulation.can_hub import Frame, Hub
from cutenv.emulation.emulated_axis import EmulatedAxis
from cutenv.emulation.emulated_bench import FAULTS, EmulatedBench
from cutenv.emulation.emulated_drive import Node
from cutenv.emulation.mechanics import ARM, EmulatedTissue, Mechanics, hinge
from cutenv.emulation.sensor_server import BoardServer, SensorServer
from cutenv.rig.config.mounted_specimen import MountedSpecimen
from cutenv.rig.config.settings import Axis, CrossAxis, SafetyLimits
from cutenv.sim.cutting.dtypes import LawParameters
from cutenv.sim.cutting.sensor import SensorParameters
from cutenv.sim.plant.simulator import ANGLE_RANGE, check_angle

BLADE = Axis(low=-0.002, high=0.149)  # axis of the emulated rig's carriage
HINGE = Axis(
    node=2, gear=100.0, lead=2 * math.pi, low=math.radians(43.0), high=math.radians(92.0), speed=math.radians(120.0),
    acceleration=20.0, quick_stop=40.0, following_error=0.05,
)  # fmt: skip
"""Axis that turns the blade of the emulated rig."""


class MechanicalRange(NamedTuple):
    """Travel and speed of an emulated rig.

    Axes as mounted, and the limits of its file.
    """

    blade: Axis
    angle: Axis
    limits: SafetyLimits  # limits at which the blade is stopped


RANGES: Mapping[str, MechanicalRange] = MappingProxyType(
    {
        "task": MechanicalRange(BLADE, HINGE, SafetyLimits()),
        "thesis": MechanicalRange(
            replace(BLADE, high=0.198, speed=0.0397),  # 20 cm, and 4 % for the loop
            replace(HINGE, low=math.radians(-2.0), high=math.radians(182.0)),
            SafetyLimits(speed=0.0397, force_rise=300.0, angle_low=0.0, angle_high=math.pi),
        ),
    }
)
"""Mechanical ranges by name: what a task asks for, and what the thesis's rig could do (3.1).

The thesis's rig turned its blade by 90 degrees either way from upright, which is 0 to 180 degrees here, and went up to
3.81 cm/s. Its cuts, and so the law, are of 45 to 90 degrees and up to 2.54 cm/s.
"""
_SLACK = math.radians(1.0)  # of the hinge and its play
_MAX_SPEED = 0.0265  # [m/s]: 2.54 cm/s, and 4 % for the loop
_OTHER_NOISE = (0.02, 0.02, 0.001, 0.001, 0.001)  # Fy, Fz [N], Tx, Ty, Tz [N m]: enough to make the counts flicker


@dataclass(frozen=True, kw_only=True)
class Options:
    """Construction of the emulated rig."""

    range: Literal["task", "thesis"] = "task"  # mechanical range, one of :data:`RANGES`
    # "free": a second axis turns the blade; "fixed": the blade stays at ``angle``
    angle_mode: Literal["free", "fixed"] = "free"
    angle: float = math.pi / 2  # angle of the blade at the start [rad]
    mounted: MountedSpecimen | None = field(default_factory=MountedSpecimen)  # specimen at the start; None: free air
    force_limit: float = 15.0  # true force whose crossing is recorded as an event [N]
    # axes that raise and lower the blade, "height", and move it to the side, "side", with the mechanics of the blade's
    cross_axes: Mapping[str, CrossAxis] = field(default_factory=dict)
    blade_mechanics: Mechanics = field(default_factory=Mechanics)  # mechanics that the axes of the range move
    hinge_mechanics: Mechanics = field(default_factory=hinge)
    sensor: SensorParameters = field(default_factory=SensorParameters)  # force sensor, as in the simulator
    # calibration of an analogue sensor on a board, which takes the place of the Net F/T: its file, or its name. The
    # converter then has the resolution, and ``sensor`` the noise and delay
    analogue: str | None = None
    law: LawParameters = field(default_factory=LawParameters)  # cutting law, as in the simulator
    host: str = "127.0.0.1"  # address that everything listens on
    can_port: int = 0  # 0 takes a free one, as below
    sensor_port: int = 0
    page_port: int = 0
    control_port: int = 0

    def __post_init__(self) -> None:
        one_of("range", self.range, RANGES)
        one_of("angle_mode", self.angle_mode, ("free", "fixed"))
        check_angle(self.angle)
        in_range("force_limit", self.force_limit, 0.01, 1000.0, "N", "What the rig's own limit is.")

    @property
    def blade_axis(self) -> Axis:
        """Axis of the carriage."""
        return RANGES[self.range].blade

    @property
    def hinge_axis(self) -> Axis:
        """Axis that turns the blade."""
        return RANGES[self.range].angle


class EmulatedRig(EmulatedBench):
    """Emulated rig on CAN: hub, drives, motors, tissue and sensor.

    ``axes`` and ``nodes`` are by name, "blade" and perhaps "angle", "height" and "side".
    """

    faults = FAULTS

    def __init__(self, options: Options | None = None) -> None:
        self.options = options = options or Options()
        felt = options.sensor
        if options.analogue is not None:
            felt = replace(felt, force_resolution=0.0)  # the converter's
        super().__init__(EmulatedTissue(felt, options.law, options.cross_axes), options.force_limit)
        self.axes: dict[str, EmulatedAxis] = {
            "blade": EmulatedAxis("blade", options.blade_axis, options.blade_mechanics, position=0.0, margin=0.003)
        }
        if options.angle_mode == "free":
            self.axes["angle"] = EmulatedAxis(
                "angle", options.hinge_axis, options.hinge_mechanics, position=options.angle, margin=0.05
            )
        for name, axis in options.cross_axes.items():
            self.axes[name] = EmulatedAxis(name, axis, Mechanics(), position=0.0, margin=0.001)
        self.cross_axes = tuple(options.cross_axes)
        if options.mounted is not None:
            self.mount(options.mounted)
        self._noise = np.random.default_rng(0).standard_normal((4096, 5)) * _OTHER_NOISE
        self._noise_rows = [tuple(row) for row in self._noise.tolist()]
        self._ticks = 0
        self._measured = True
        # fault: speeds that another master commands every millisecond, by axis [m/s or rad/s]
        self.intruders: dict[str, float] = {}
        self.nodes = {name: Node(axis, self._send, self.happened) for name, axis in self.axes.items()}
        self.sensor: SensorServer | BoardServer
        if options.analogue is None:
            self.sensor = SensorServer(host=options.host, port=options.sensor_port, page_port=options.page_port)
        else:
            self.sensor = BoardServer(
                AnalogueCalibration.read(options.analogue), host=options.host, port=options.sensor_port
            )
        try:
            self.hub = Hub(self._receive, host=options.host, port=options.can_port)
        except OSError:
            self.sensor.close()
            raise

    @property
    def position(self) -> float:
        """Position of the carriage from the clamp [m]."""
        return float(self.axes["blade"].motor["carriage"])

    @property
    def speed(self) -> float:
        """Speed of the carriage [m/s]."""
        return float(self.axes["blade"].motor["carriage_speed"])

    @property
    def axis_names(self) -> Sequence[str]:
        """Names of the driven axes."""
        return list(self.axes)

    @property
    def angle(self) -> float:
        """Angle of the blade [rad]."""
        return float(self.axes["angle"].motor["carriage"]) if "angle" in self.axes else self.options.angle

    @property
    def places(self) -> dict[str, float]:
        """Blade's height, upwards, and place to the left [m], by axis."""
        return {name: float(self.axes[name].motor["carriage"]) for name in self.cross_axes}

    def _send(self, frame: Frame) -> None:
        self.hub.send(frame)

    def _receive(self, frame: Frame) -> None:
        now = self.now()
        with self.lock:
            self._catch_up(now)  # a drive's answer reflects the present, even if the loop is late
            for node in self.nodes.values():
                node.receive(frame, now)

    def state(self) -> dict[str, Any]:
        """Return the drives' state, and the number of connected programs."""
        return {
            "nodes": [node.about() for node in self.nodes.values()],
            "clients": {"can": self.hub.clients, "sensor": self.sensor.clients},
        }

    def truth(self) -> dict[str, Any]:
        """Return the motor's position, and the blade's height and side place [m]."""
        told = {"motor_position_m": float(self.axes["blade"].motor["position"])}
        return told | self._noted()

    def _noted(self) -> dict[str, Any]:
        return {f"{name}_m": place for name, place in self.places.items()}

    def mount(self, mounted: MountedSpecimen) -> None:
        """Lay a fresh specimen; see :meth:`EmulatedTissue.mount`."""
        self.bench.places = self.places
        super().mount(mounted)

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
            for name in self.cross_axes:
                axis, felt = self.axes[name], self.bench.forces[name]
                axis.turn(felt if name == "height" else -felt)
                speed = max(speed, abs(float(axis.motor["carriage_speed"])))
            self.bench.places = self.places
            reading = self.bench.advance(float(blade.motor["carriage"]), self.angle)
        self._watch(due, before, abs(self.bench.true_force), speed)
        if self.options.range != "task":
            self._flag(due, speed)
        self._ticks += 1
        fy, fz, tx, ty, tz = self._noise_rows[self._ticks % len(self._noise_rows)]
        if self.cross_axes:
            forces = self.bench.forces
            fy, fz, ty = fy + forces.get("side", 0.0), fz + forces.get("height", 0.0), ty - ARM * reading
        self.sensor.send((reading, fy, fz, tx, ty, tz))

    def _flag(self, due: float, speed: float) -> None:
        """Record that the blade leaves the measured range; the nearest values hold."""
        low, high = ANGLE_RANGE
        measured = low - _SLACK <= self.angle <= high + _SLACK and speed <= _MAX_SPEED
        if measured is self._measured:
            return
        self._measured = measured
        self.happened(
            f"{'inside' if measured else 'outside'} the measured range", time=due,
            angle_deg=round(math.degrees(self.angle), 1), speed_cm_s=round(100.0 * speed, 2),
        )  # fmt: skip

    def close(self) -> None:
        """Stop listening; may be called twice."""
        self.stopped.set()
        self.hub.close()
        self.sensor.close()
