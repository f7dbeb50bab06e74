"""Fake rig without hardware, on a fake clock.

All of the rig's own code runs over a specimen or a recorded cut.

Only the drivers' reports are faked: samples of an axis at every SYNC, force readings at 1 kHz, heartbeats. Every fault
that the rig has to survive can be caused at any instant.
"""

from __future__ import annotations

import functools
import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from cutenv.emulation.fake_benches import DrivenPlant, RecordedPlant, SpecimenPlant
from cutenv.rig.config.mounted_specimen import MountedSpecimen
from cutenv.rig.config.settings import Axis, RigSettings, fake_settings
from cutenv.rig.devices.loop import FakeClock, Repeating
from cutenv.rig.devices.protocols import (
    DriveState,
    Event,
    ForceListener,
    ForceSample,
    Latch,
    MotionListener,
    MotionSample,
)
from cutenv.rig.errors import RigError
from cutenv.rig.plant import RigPlant
from cutenv.rig.spine import Spine
from cutenv.sim.cutting.dtypes import TICK
from cutenv.sim.plant import ReplayPlant
from cutenv.sim.tissue.specimen import Specimen
from cutenv.sim.trace import Trace

_COUNTS = 1e6  # counts of the fake sensor for one newton
_PRIME = 7919  # makes the other axes' counts flicker
_BACK = 4294967296  # sequences are modulo 2**32
_HEARTBEAT = 0.050  # [s]
_ARM = 0.1  # [m] from the blade's lower end up to the sensor, of a rig with a height axis


@dataclass
class CrossFaults:
    """Faults of an axis across the cut.

    Each can be changed at any instant.
    """

    stuck: bool = False  # True if its encoder shows one place
    blocked: bool = False  # True if the blade stands, and its encoder shows it
    one_way: bool = False
    """True if the blade can be lowered, but not raised; or moved to the right, but not to the left."""
    shift: float = 0.0  # difference by which its encoder is wrong [m]
    runaway: float = 0.0  # speed of the blade, whatever is commanded [m/s]; a quick stop does stop it
    silent: bool = False  # True if it sends no samples
    heartbeat_silent: bool = False
    not_homed: bool = False
    quick_stops_lost: int = 0  # number of quick stops that do not reach its drive
    force: float = 0.0  # force added to the tissue's, upwards, or to the right [N]


@dataclass
class Faults:
    """Faults of a fake rig, changeable at any instant."""

    extra_force: float = 0.0  # force added along the cut [N]
    side_force: float = 0.0  # force added across the cut [N]
    ramp: float = 0.0  # rate of a growing force added along the cut [N/s]
    force_nan: bool = False
    force_status: int = 0
    force_frozen: bool = False
    axis_frozen: int | None = None  # index of the one force that stays at its count: 0, 1 or 2
    force_silent: bool = False
    force_late: float = 0.0  # delay of every reading [s]
    lose_every: int = 0  # interval between readings that arrive, the others being lost; 0: all arrive
    motion_silent: bool = False
    motion_doubled: bool = False  # True to send every sample of an axis twice
    heartbeat_silent: bool = False
    stuck: bool = False  # True if the encoder shows one position while the blade moves on
    blocked: bool = False  # True if the blade stands, and its encoder shows it
    slip: float = 0.0  # difference by which the blade is slower than commanded [m/s]
    runaway: float = 0.0  # speed of the blade, whatever is commanded [m/s]; a quick stop does stop it
    quick_stops_lost: int = 0  # number of quick stops that do not reach the blade's drive
    turn_stuck: bool = False  # True if the hinge's encoder shows one angle
    height: CrossFaults = field(default_factory=CrossFaults)
    side: CrossFaults = field(default_factory=CrossFaults)
    power_lost: bool = False
    bus_off: bool = False


class FakeDrive:
    """Axis that reacts at once: a :class:`~cutenv.rig.devices.protocols.MotionDriver`."""

    def __init__(self, name: str, rig: FakeRig) -> None:
        self.name = name
        self._rig = rig
        self.latch = Latch()
        self.state = DriveState.DISABLED
        self.target = 0.0
        self.sent: list[tuple[float, str]] = []  # actions that were to stop the axis, with their times [s]

    def open(self, listener: MotionListener) -> None:
        """Send samples to the listener from now on."""
        self._rig.listen(self.name, listener)

    def enable(self) -> None:
        """Switch the power on; raise RigError in fault or quick stop."""
        if self.latch.closed or self.state in (DriveState.FAULT, DriveState.QUICK_STOP):
            raise RigError(f'the {self.name} drive is in "{self.state.value}": clear it first.')
        self.state, self.target = DriveState.ENABLED, 0.0

    def command(self, speed: float) -> None:
        """Set a speed [m/s or rad/s]; raise RigError with the bus off."""
        self._rig.reach(self.name)
        self._rig.heard(self._rig.clock.now(), self.name, speed)
        if self.state is DriveState.ENABLED:
            self.target = speed

    def quick_stop(self, *, for_good: bool = False) -> None:
        """Stop at once; raises RigError if the bus is off."""
        self.latch.happens(Event.STOP)
        self._rig.reach(self.name)
        self.sent.append((self._rig.clock.now(), "quick stop"))
        faults = self._rig.faults_of(self.name)
        if faults is not None and faults.quick_stops_lost > 0:
            faults.quick_stops_lost -= 1
        elif self.state is DriveState.ENABLED:
            self.state = DriveState.QUICK_STOP

    def withhold_heartbeat(self, why: str) -> None:
        """End the heartbeat: the drive misses it and goes into fault."""
        self.sent.append((self._rig.clock.now(), "abandoned"))
        self.state = DriveState.FAULT

    def disable(self) -> None:
        """Switch the power off."""
        self.state, self.target = DriveState.DISABLED, 0.0

    def clear(self) -> None:
        """Leave quick stop or fault without power; raise RigError with the bus off."""
        self._rig.reach(self.name)
        self.state, self.target = DriveState.DISABLED, 0.0

    def limits(self) -> dict[str, float]:
        """Return the limits as they would have been written."""
        return drive_limits(self._rig.settings.axes[self.name])

    def about(self) -> dict[str, float | str]:
        """Return that the drive is fake, and whether a cross axis was homed."""
        faults = self._rig.faults_of(self.name)
        homed = {"homed": "no" if faults.not_homed else "yes"} if isinstance(faults, CrossFaults) else {}
        return {"kind": "fake drive", **homed}

    def close(self) -> None:
        """Stop sending samples, and switch the power off."""
        self._rig.listen(self.name, None)
        self.disable()


def drive_limits(axis: Axis) -> dict[str, float]:
    """Return the limits a drive with these settings would report."""
    return {name: getattr(axis, name) for name in ("low", "high", "speed", "acceleration", "quick_stop")}


class FakeSensor:
    """Force sensor that reads the force on the bench: a :class:`~cutenv.rig.devices.protocols.ForceDriver`."""

    rate, rate_error, axes = 1000.0, 0.001, "xyz"

    def __init__(self, rig: FakeRig) -> None:
        self._rig = rig
        self.listener: ForceListener | None = None
        self.zero = 0.0
        self.last: deque[float] = deque(maxlen=200)

    def open(self, listener: ForceListener) -> None:
        """Send readings to the listener from now on."""
        self.listener = listener

    def tare(self, samples: int = 200) -> tuple[float, float, float]:
        """Take the mean of the last readings as zero; return it [N]."""
        self.zero += float(np.mean(list(self.last)[-samples:]))
        return (self.zero, 0.0, 0.0)

    def about(self) -> dict[str, float | str]:
        """Return that this is a fake sensor."""
        return {"kind": "fake sensor", "rate_Hz": self.rate}

    def close(self) -> None:
        """Stop sending readings."""
        self.listener = None


class FakeRig:
    """Drives and sensor on a bench, with fake clock and plant.

    ``bench``: makes the bench from the settings, once for every specimen; ``settings``: default: a rig whose angle is
    free, calibrated today; ``follows``: False for a replayed cut.
    """

    def __init__(
        self,
        bench: Callable[[RigSettings], DrivenPlant],
        settings: RigSettings | None = None,
        *,
        follows: bool = True,
        depth: NDArray[np.float64] | None = None,
        clock: FakeClock | None = None,
    ) -> None:
        self.settings = settings or fake_settings()
        self.clock = clock or FakeClock()
        self.faults = Faults()  # faults, which may be changed at any instant
        self._make, self._follows = bench, follows
        self.bench = bench(self.settings)
        self.blade = FakeDrive("blade", self)
        self.angle = FakeDrive("angle", self) if self.settings.angle is not None else None
        self._crossing = self.settings.cross_axes
        self.across = {name: FakeDrive(name, self) for name in self._crossing}
        self.sensor = FakeSensor(self)
        axes = [axis for axis in (self.blade, self.angle, *self.across.values()) if axis is not None]
        # plant, still to be opened
        self.plant = RigPlant(Spine(self.settings, self.clock, axes, self.sensor, follows=follows))
        if depth is not None:
            self.plant.depth = depth
        # called with every command: time [s], axis, speed [m/s or rad/s]
        self.heard: Callable[[float, str, float], None] = lambda time, axis, speed: None
        self._listeners: dict[str, MotionListener | None] = {}
        self._sequence = 0
        self._lost = 0
        self._counts = (0, 0, 0, 0, 0, 0)
        self._held: tuple[float, float, float] = (0.0, 0.0, 0.0)
        self._pending: list[tuple[float, ForceSample]] = []
        self._taken_away = False
        self._ramped = self._stuck_at = self._turn_stuck_at = 0.0
        self._shown_across = dict.fromkeys(self.across, 0.0)
        self._turns: list[Repeating] = [
            self.clock.every(TICK, self._tick, "bench"),
            self.clock.every(self.settings.bus.sync, self._sync, "SYNC"),
            self.clock.every(_HEARTBEAT, self._beat, "heartbeat"),
        ]

    def mount(self, bench: Callable[[RigSettings], DrivenPlant] | None = None) -> None:
        """Lay a new specimen, with the blade at the clamp."""
        self._make = bench or self._make
        self.bench = self._make(self.settings)
        self._ramped = self.sensor.zero = 0.0
        self.sensor.last.clear()
        self._taken_away = False

    def take_away(self) -> None:
        """Remove the specimen at the blade, which then feels nothing of it."""
        self._taken_away = True

    def listen(self, axis: str, listener: MotionListener | None) -> None:
        """Set the listener of an axis."""
        self._listeners[axis] = listener

    def reach(self, axis: str) -> None:
        """Raise RigError if the bus to a drive is off."""
        if self.faults.bus_off:
            raise RigError(f"{axis}: the bus is off; check cable, termination and power.")

    def felt(self) -> float:
        """Return the sensor's force along the cut before taring [N]."""
        return self._tissue_force(self.bench.force) + self.faults.extra_force + self._ramped

    def _tissue_force(self, force: float) -> float:
        return 0.0 if self._taken_away else force

    def report_emergency(self, code: int, meaning: str, axis: str = "blade") -> None:
        """Let the blade's or another drive report an error and stop."""
        drive = self.across.get(axis, self.angle if axis == "angle" else self.blade)
        assert drive is not None
        drive.state = DriveState.FAULT
        if (listener := self._listeners.get(axis)) is not None:
            listener.emergency(axis, code, meaning, self.clock.now())

    def intrude(self, speed: float) -> None:
        """Let another master switch on the blade's drive at a speed [m/s]."""
        self.blade.state, self.blade.target = DriveState.ENABLED, speed
        if (listener := self._listeners.get("blade")) is not None:
            listener.foreign("blade", "RPDO1", self.clock.now())

    def break_bus(self) -> None:
        """Switch the bus off; heartbeat watchdogs stop the drives."""
        self.faults.bus_off = True
        self.blade.state = DriveState.QUICK_STOP
        if (listener := self._listeners.get("blade")) is not None:
            listener.broken("blade", "bus off", self.clock.now())

    def _tick(self, now: float) -> None:
        faults, drive = self.faults, self.blade
        stopping = drive.state is not DriveState.ENABLED or faults.power_lost
        stopping |= not self._follows and self.plant.supervisor.phase == "unready"  # a replayed cut waits to begin
        speed = 0.0 if stopping else drive.target
        if not stopping:
            speed = faults.runaway or speed - math.copysign(faults.slip, speed)
        turn = 0.0 if stopping or self.angle is None else self.angle.target
        for drive_across in self.across.values():
            self._shift(drive_across)
        if faults.blocked:
            self.bench.block()
        else:
            self.bench.step(speed, turn, stopping)
        self._ramped += faults.ramp * TICK
        self._feel(now)

    def faults_of(self, axis: str) -> Faults | CrossFaults | None:
        """Return an axis's faults by name, None for the hinge."""
        across = {"height": self.faults.height, "side": self.faults.side}
        return self.faults if axis == "blade" else across.get(axis)

    def _shift(self, drive: FakeDrive) -> None:
        """Command the bench's motion of the next millisecond across the cut."""
        faults = self.faults_of(drive.name)
        assert isinstance(faults, CrossFaults)
        stopping = drive.state is not DriveState.ENABLED or self.faults.power_lost
        speed = 0.0 if stopping else faults.runaway or drive.target
        blocked = faults.blocked or (faults.one_way and speed > 0.0)
        self.bench.shift(drive.name, speed, stopping=stopping, blocked=blocked)

    def _feel(self, now: float) -> None:
        faults, height = self.faults, self.settings.height
        self._sequence = (self._sequence + 1) % _BACK
        if not faults.force_frozen:
            force = self.felt() - self.sensor.zero
            self.sensor.last.append(force)
            felt = [math.nan if faults.force_nan else force, faults.side_force, 0.0]
            for name, axis in self._crossing.items():
                force = self._tissue_force(self.bench.cross_force(name)) + getattr(faults, name).force
                felt["xyz".index(axis.force_axis)] += axis.force_sign * force
            flicker = self._sequence * _PRIME % 1009
            counts = [round(_COUNTS * force) + flicker % 2, flicker, flicker, flicker, flicker, flicker]
            if faults.axis_frozen is not None:
                felt[faults.axis_frozen] = self._held[faults.axis_frozen]
                counts[faults.axis_frozen] = self._counts[faults.axis_frozen]
            self._held = (felt[0], felt[1], felt[2])
            self._counts = (counts[0], counts[1], counts[2], counts[3], counts[4], counts[5])
        if faults.force_silent:
            return
        if faults.lose_every and self._sequence % faults.lose_every:
            self._lost += 1
            return
        sign = self.settings.sensor.sign
        torque = (0.0, 0.0 if height is None else -_ARM * sign * self._held[0], 0.0)
        sample = ForceSample(
            now, (sign * self._held[0], self._held[1], self._held[2]), self._counts, faults.force_status,
            self._sequence, self._lost, torque,
        )  # fmt: skip
        self._lost = 0
        self._pending.append((now + faults.force_late, sample))
        while self._pending and self._pending[0][0] <= now + 1e-9 and self.sensor.listener is not None:
            _, arrived = self._pending.pop(0)
            self.sensor.listener.force(arrived if arrived.time == now else arrived._replace(time=now))

    def _sync(self, now: float) -> None:
        if self.faults.motion_silent or self.faults.bus_off or self.faults.power_lost:
            return
        for _ in range(2 if self.faults.motion_doubled else 1):
            self._tell(now)

    def _tell(self, now: float) -> None:
        """Send a sample of every axis."""
        position, speed, angle = self.bench.motion
        if self.faults.stuck:
            position, speed = self._stuck_at, 0.0
        self._stuck_at = position
        if (listener := self._listeners.get("blade")) is not None:
            listener.motion("blade", MotionSample(now, position, speed, 0.0, self.blade.state))
        if not self.faults.turn_stuck:
            self._turn_stuck_at = angle
        if self.angle is not None and (listener := self._listeners.get("angle")) is not None:
            angle = self._turn_stuck_at
            listener.motion("angle", MotionSample(now, angle, self.angle.target, 0.0, self.angle.state))
        for drive in self.across.values():
            self._tell_across(now, drive)

    def _tell_across(self, now: float, drive: FakeDrive) -> None:
        faults = self.faults_of(drive.name)
        assert isinstance(faults, CrossFaults)
        place, speed = self.bench.cross_motion(drive.name)
        if faults.stuck:
            place, speed = self._shown_across[drive.name], 0.0
        self._shown_across[drive.name] = place
        if (listener := self._listeners.get(drive.name)) is not None and not faults.silent:
            listener.motion(drive.name, MotionSample(now, place + faults.shift, speed, 0.0, drive.state))

    def _beat(self, now: float) -> None:
        if self.faults.heartbeat_silent or self.faults.bus_off or self.faults.power_lost:
            return
        for axis, listener in self._listeners.items():
            faults = self.faults_of(axis)
            silent = isinstance(faults, CrossFaults) and faults.heartbeat_silent
            if listener is not None and not silent:
                listener.alive(axis, now)


def fake_rig(specimen: Specimen, settings: RigSettings | None = None, *, seed: int = 0) -> FakeRig:
    """Make a fake rig with a specimen, simulated drive and sensor."""
    mounted = MountedSpecimen(specimen=specimen, seed=seed)
    return FakeRig(functools.partial(SpecimenPlant, mounted), settings, depth=specimen.depth)


def replayed_rig(trace: Trace, settings: RigSettings | None = None) -> FakeRig:
    """Make a fake rig that replays a recorded cut."""
    return FakeRig(lambda settings: RecordedPlant(trace), settings, follows=False, depth=ReplayPlant(trace).depth)
