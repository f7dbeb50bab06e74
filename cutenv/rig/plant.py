"""Rig as a plant.

It sends the policy's commands at a fixed rate, and returns the measurements at 1 kHz.
"""

from __future__ import annotations

import math
import os
from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cutenv._base.arrays import Array, StructArray
from cutenv._base.validation import array_in_range, in_range
from cutenv.rig.config.settings import RigSettings, SafetyLimits
from cutenv.rig.devices.loop import Clock, Owner
from cutenv.rig.devices.protocols import ForceSample, MotionSample, Observer, interpolated, newest_since
from cutenv.rig.errors import RigError
from cutenv.rig.remote_spine import RemoteSpine
from cutenv.rig.safety.monitors import NOMINAL_LAG, REST_SPEED
from cutenv.rig.safety.oversight import Oversight
from cutenv.rig.safety.stop_causes import WATCH, Cause, StopReport
from cutenv.rig.spine import Spine, mounted_spine
from cutenv.rig.travel import AIMED, SLICE, VALID, Travel
from cutenv.sim.cutting.dtypes import READING, TICK
from cutenv.sim.tissue.drawn_lines import along_line
from cutenv.sim.tissue.lines import CutLine
from cutenv.sim.tissue.specimen import N_POINTS
from cutenv.sim.trace import CHANNELS, COMPONENTS_OF_FORCE

_REMEMBERED = 400  # moments that are remembered: two for each decision


class Heading:
    """Direction of a blade in the plane [rad], positive to the left.

    It is the angle to the axis of the slab. No drive turns the blade about its vertical axis: the two axes lead it
    where it is to point.
    """

    def __init__(self) -> None:
        self.begin(0.0)

    def begin(self, heading: float) -> None:
        """Point in a direction [rad], and forget the turns before."""
        self._moments: deque[tuple[float, float]] = deque([(-math.inf, heading)], maxlen=_REMEMBERED)

    @property
    def now(self) -> float:
        """Direction at the end of the last turn [rad]."""
        return self._moments[-1][1]

    def turn(self, rate: float, start: float, end: float) -> None:
        """Turn at a rate [rad/s] from ``start`` to ``end`` [s]."""
        self._moments += [(start, self.now), (end, self.now + rate * (end - start))]

    def at(self, times: Array) -> Array:
        """Return directions at times [s], shape (n,) [rad], constant beyond turns."""
        moments = np.array(self._moments)
        if not math.isfinite(moments[0, 0]):
            moments[0, 0] = moments[1, 0] if len(moments) > 1 else 0.0
        headings: Array = np.interp(times, moments[:, 0], moments[:, 1])
        return headings

    def speeds(self, speed: float, time: float, *, lead: float) -> tuple[float, float]:
        """Return speeds along the slab and to its left [m/s] at a time [s].

        The blade goes where it points. The direction is that to which it will have turned after ``lead`` [s], the lag
        of the axes' velocity loops.
        """
        heading = self.now
        if len(self._moments) > 1:
            (start, before), (end, heading) = self._moments[-2], self._moments[-1]
            heading += (heading - before) * (min(time, end) + lead - end) / max(end - start, 1e-9)
        return speed * math.cos(heading), speed * math.sin(heading)


_OLDEST = 0.05  # [s] before a period, from which samples are still used
_KEPT = 4.0  # [s] of samples kept
_UNKNOWN = ("true_force", "elastic_force", "tip", "jump")

CHANNEL_READINGS: np.dtype[Any] = np.dtype([(name, "f8") for name in CHANNELS])
"""Measurements of a rig beside a reading, :data:`cutenv.sim.trace.CHANNELS`; 0 where no axis measures them."""


class ReadingGrid:
    """Readings of a cut, one every millisecond from its start.

    ``rate``: readings of the force sensor per second [Hz]; ``heading``: direction of a blade that is also moved to the
    side: forces and speed of its readings are along this direction. ``start``: time of the rig's clock at which the
    cut's time is zero [s]; ``newest``: time of the newest force that :meth:`collect` used [s].
    """

    def __init__(self, settings: RigSettings, rate: float, axes: Iterable[str], heading: Heading) -> None:
        self._cut_axis = "xyz".index(settings.sensor.cut_axis)
        self._sign, self._fixed_angle = settings.sensor.sign, settings.fixed_angle
        self._forces: deque[ForceSample] = deque(maxlen=round(_KEPT * rate))
        kept = round(_KEPT / settings.bus.sync)
        self._motions: dict[str, deque[MotionSample]] = {axis: deque(maxlen=kept) for axis in axes}
        self.start = self.newest = 0.0
        self.ticks = 0  # number of readings collected since then
        self._height, self._side, self._heading = settings.height, settings.side, heading
        # line of which positions are arc lengths; None: they are those of the blade's axis
        self.line: CutLine | None = None
        more = settings.cross_axes or settings.sensor.components == "all"
        # :data:`CHANNEL_READINGS` for the last readings that :meth:`collect` returned; None for a rig that has no axis
        # across the cut and records the force along it alone
        self.channels = np.zeros(0, CHANNEL_READINGS) if more else None

    def force(self, sample: ForceSample) -> None:
        """Keep a reading of the force sensor."""
        self._forces.append(sample)

    def motion(self, axis: str, sample: MotionSample) -> None:
        """Keep a sample of an axis."""
        self._motions[axis].append(sample)

    def strongest_since(self, moment: float) -> float | None:
        """Return the strongest force along the cut [N] since ``moment`` [s], or None."""
        along = [self._sign * sample.force[self._cut_axis] for sample in newest_since(self._forces, moment)]
        return max(along, key=abs, default=None)

    def collect(self, ticks: int) -> StructArray:
        """Return the next ``ticks`` readings: newest force, interpolated motion."""
        readings = np.zeros(ticks, READING)
        for name in _UNKNOWN:
            readings[name] = np.nan
        count = self.ticks + np.arange(1.0, ticks + 1.0)
        time: NDArray[np.float64] = self.start + TICK * count
        readings["time"] = TICK * count
        self.ticks += ticks

        forces = newest_since(self._forces, time[0] - _OLDEST)
        newest = np.zeros(0, np.intp)
        if forces:
            sensed = np.array([sample.time for sample in forces])
            along = self._sign * np.array([sample.force[self._cut_axis] for sample in forces])
            newest = np.maximum(np.searchsorted(sensed, time, side="right") - 1, 0)
            readings["force"] = along[newest]
            self.newest = float(sensed[-1])
        readings["position"], readings["speed"] = self._interpolated("blade", time)
        if self.channels is not None:
            self.channels = self._measured_channels(time, [forces[i] for i in newest.tolist()])
        if self._side is not None:
            self._turn_to_heading(readings, time)
        readings["speed"][np.abs(readings["speed"]) < REST_SPEED] = 0.0
        if "angle" in self._motions:
            readings["angle"], _ = self._interpolated("angle", time)
        else:
            readings["angle"] = self._fixed_angle
        return readings

    def _turn_to_heading(self, readings: StructArray, time: NDArray[np.float64]) -> None:
        """Turn force and speed to the blade's direction, positions to line."""
        assert self.channels is not None
        heading = self._heading.at(time)
        ahead, across = np.cos(heading), np.sin(heading)
        x, (y, to_left) = readings["position"].copy(), self._interpolated("side", time)
        force, push = readings["force"].copy(), self.channels["lateral_force"]
        readings["force"] = ahead * force + across * push
        readings["speed"] = ahead * readings["speed"] + across * to_left
        self.channels["lateral_force"] = ahead * push - across * force
        self.channels["blade_x"], self.channels["blade_y"] = x, y
        if self.line is not None:
            readings["position"] = along_line(self.line, x, y)[0]

    def _measured_channels(self, time: NDArray[np.float64], samples: list[ForceSample]) -> NDArray[np.void]:
        """Return height, cross forces and all six components at times [s]."""
        channels = np.zeros(len(time), CHANNEL_READINGS)
        if self._height is not None:
            channels["height"], _ = self._interpolated("height", time)
        if samples:
            if self._height is not None:
                channels["vertical_force"] = [self._height.felt(sample.force) for sample in samples]
            if self._side is not None:
                channels["lateral_force"] = [self._side.felt(sample.force) for sample in samples]
            six = np.array([(*sample.force, *sample.torque) for sample in samples])
            for number, name in enumerate(COMPONENTS_OF_FORCE):
                channels[name] = six[:, number]
        return channels

    def _interpolated(self, axis: str, time: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        return interpolated(time, newest_since(self._motions[axis], time[0] - _OLDEST))


@dataclass
class Timing:
    """Timing of the control clock since the last :meth:`cutenv.rig.plant.RigPlant.begin`."""

    periods: list[float] = field(default_factory=list)  # times from command to command [s]
    latencies: list[float] = field(default_factory=list)
    """Times from the newest reading that a decision used to its command on the bus [s]."""
    lateness: list[float] = field(default_factory=list)  # delays of commands behind their due time [s]
    overruns: int = 0  # number of commands more than 2 ms late
    skipped: float = 0.0  # time lost to late commands, beyond whole periods [s]
    garbled: int = 0  # number of packets that were not readings


_LATE = 0.002  # [s] after the end of a period, from which a command counts as an overrun
_TURN_GAIN = 16.0  # [1/s] gain of the angle's position loop, closed at every SYNC
_TURN_LAG = 0.040  # [s] lag of the hinge's own loop; this one looks ahead by it, to avoid overshoot
TURN_RATE = math.radians(90.0)  # greatest rate of turn during a cut, equal to the simulated rig's [rad/s]
_APART = 1e-3  # [m] between places that are noted on the blade's way
REST_WITHIN = 2.0  # time allowed for a blade to come to rest after a stop [s]


class RigPlant(Travel):
    """A blade on a motor and a force sensor.

    It is moved through a spine, which alone reaches them and stops the blade. ``note``: file in which the proof of the
    stop button is noted, for later programs of the same day. ``proven``: note of the last proof of the stop button on
    this connection; empty before the first.
    """

    def __init__(self, spine: Spine | RemoteSpine, note: Path | None = None) -> None:
        self.spine, self.settings, self.clock = spine, spine.settings, spine.clock
        self.supervisor: Oversight = spine.supervisor  # safety of the rig, which has to be released before any motion
        self._turns = self.settings.angle is not None
        self.depth = np.zeros(N_POINTS)
        # called with all readings as they are made, to store them on disk
        self.keep: Callable[[StructArray], None] = lambda readings: None
        self._witness: Observer | None = None
        self.timing = Timing()  # timing of the control clock
        self.zero = (0.0, 0.0, 0.0)  # force at the last tare [N], relative to the sensor's own zero
        self.note, self.proven = note, ""
        self.owner = Owner()  # process that has opened the rig; no other may move it
        self._left = False
        self.heading = Heading()  # direction in which a blade points that an axis moves to the side as well
        self._grid = ReadingGrid(self.settings, spine.rate, self.settings.axes, self.heading)
        self._way: list[tuple[float, float]] = []  # [m] places of the blade since the clamp, some apart
        self._due: float | None = None
        self._cutting = False  # outside a cut, readings have no start time
        self._commanded: float | None = None

    @property
    def depth(self) -> NDArray[np.float64]:
        """Measured depth of cut every 0.5 mm, shape (301,) [m]; 0 until set."""
        return self._depth

    @depth.setter
    def depth(self, depth: NDArray[np.float64]) -> None:
        self._depth = array_in_range("depth", depth, 0.0, 0.2, "m", "2 cm is 0.02.")
        if self._depth.shape != (N_POINTS,):
            raise ValueError(f"depth has shape {self._depth.shape}; give {N_POINTS} values, one every 0.5 mm.")

    @property
    def witness(self) -> Observer | None:
        """Receiver of new samples, readings and heartbeats, for measurements, or None."""
        return self._witness

    @witness.setter
    def witness(self, witness: Observer | None) -> None:
        self.spine.hear()  # what was reported before is not for it
        self._witness = witness

    def open(self) -> None:
        """Connect to drives and sensor, see :meth:`cutenv.rig.spine.Spine.open`; nothing moves."""
        self.owner, self._left = Owner(), False
        self.spine.open(self)

    def close(self) -> None:
        """Stop any motion, close all devices; never raises, no effect in a fork."""
        if self.owner.here:
            self.spine.close()
            self._left = True

    def power(self) -> None:
        """Switch the drives on, at rest; :meth:`Supervisor.release` then allows commands."""
        self.spine.power()

    def switch_off(self) -> None:
        """Switch off the power of drives at rest; their samples continue."""
        self.spine.switch_off()

    def lower(self, limits: SafetyLimits) -> None:
        """Adopt each stricter limit, see :meth:`Supervisor.lower`."""
        self.supervisor.lower(limits)
        self.settings = self.supervisor.settings

    def tare(self) -> tuple[float, float, float]:
        """Take the present force as :attr:`zero` [N]; see :meth:`ForceDriver.tare`."""
        self.zero = self.spine.tare()
        return self.zero

    # Reports of drivers, which the spine has judged

    def force(self, sample: ForceSample) -> None:
        """Take a reading of the force sensor."""
        self._grid.force(sample)
        if self._witness is not None:
            self._witness.force(sample)

    def motion(self, axis: str, sample: MotionSample) -> None:
        """Take a sample of an axis."""
        self._grid.motion(axis, sample)
        if self._witness is not None:
            self._witness.motion(axis, sample)

    def alive(self, axis: str, time: float) -> None:
        """Take a heartbeat of a drive."""
        if self._witness is not None:
            self._witness.alive(axis, time)

    def garbled(self, why: str, time: float) -> None:
        """Count a packet that is not a valid reading."""
        self.timing.garbled += 1

    # A cut

    def begin(self, line: CutLine | None = None) -> None:
        """Begin a cut: its time starts with the next command.

        Along a ``line`` the blade points in its direction, and positions of the readings are arc lengths of the line.
        """
        self._due = None
        self.heading.begin(0.0 if line is None else float(line.angle[0]))
        self._grid.line, self._way = line, []
        self._grid.ticks = 0
        self._cutting = True
        self.timing = Timing()

    def advance(
        self, speed: float, angle: float, ticks: int, descent_speed: float = 0.0, turn_rate: float = 0.0
    ) -> StructArray:
        """Command ``speed`` [m/s] and ``angle`` [rad] for ``ticks`` milliseconds; see :class:`~cutenv.sim.plant.Plant`.

        A rig with a height axis takes ``descent_speed`` [m/s], downwards, one with an axis to the side ``turn_rate``
        [rad/s], to the left: ``speed`` is then in the direction of :attr:`heading`. What these axes measure is in
        :attr:`channels`. Raise ValueError if ``ticks`` is not a whole number from 1, or the rig has no axis for what is
        commanded; RigError if the rig is not released; RigStopped if the blade was stopped; it is then at rest, and the
        error holds the readings until that moment.
        """
        self.owner.check()
        if in_range("ticks", ticks, 1, 10**7, "1", "Give a whole number of milliseconds.") % 1.0:
            raise ValueError(f"ticks = {ticks:g} is not a whole number of milliseconds.")
        if descent_speed:
            self.settings.require_height_axis(by="descent_speed")
        if turn_rate:
            self.settings.require_side_axis(by="turn_rate")
        period = ticks * TICK
        now = self.clock.now()
        start = now if self._due is None else self._due
        if self._due is None:
            self._grid.start = start
        self.timing.lateness.append(max(now - start, 0.0))
        if now - start > _LATE:
            self.timing.overruns += 1
            if now - start > period:  # whole periods are lost: restart the clock
                self.timing.skipped += now - start
                self._grid.start += now - start
                start = now
        self._raise_if_stopped()  # perhaps since the last command
        self._due = start + period
        self.heading.turn(turn_rate, start, self._due)
        go = partial(self._go, speed, angle, descent_speed, period)
        turned = go()
        self._note_timing()
        self._wait(self._due, turned, go=go if turn_rate and speed else None)
        self._raise_if_stopped()
        return self._collect(int(ticks))

    def _go(self, speed: float, angle: float, descent_speed: float, period: float) -> float:
        """Command a blade where it points; return its angle [rad].

        That is the angle to turn to until the end of the period. However late in the period it is, the next command may
        be as late as after the first one.
        """
        assert self._due is not None
        now = self.clock.now()
        lag = self.settings.identified.motor_lag or NOMINAL_LAG
        ahead, left = self.heading.speeds(speed, now + 0.5 * self.settings.bus.sync, lead=lag)
        overrun = self.settings.limits.overrun
        hold = (self._due - now + overrun * period) / (1.0 + overrun)
        return self._drive(ahead, angle, hold=hold, height=-descent_speed, side=left)

    def halt(self) -> None:
        """Brake on the ramp, as at a cut's end, and lock the rig."""
        self._cutting = False
        if self.supervisor.phase == "ready":
            deadline = self.clock.now() + REST_WITHIN
            while not self.supervisor.standing and self.supervisor.phase == "ready" and self.clock.now() < deadline:
                try:
                    self.supervisor.drive(0.0, self._angle_now(), hold=VALID)
                    if self._turns:
                        self.supervisor.turn(0.0)
                except RigError:  # stopped at this moment: it comes to rest anyway
                    break
                self.clock.sleep_until(self.clock.now() + SLICE)
            if self.supervisor.phase == "ready" and not self.supervisor.standing:
                self.supervisor.trip(Cause.FOLLOWING, "the blade goes on moving though commanded to rest")
        self.supervisor.lock()

    @property
    def level(self) -> float:
        """Alias of :attr:`height` for :class:`cutenv.sim.plant.DescendingPlant` [m]."""
        return self.height

    @property
    def vertical_force(self) -> NDArray[np.float64]:
        """Upward force of the tissue during the last :meth:`advance`, shape (ticks,) [N].

        Raises ValueError for a rig without a height axis.
        """
        self.settings.require_height_axis(by="vertical_force")
        channels = self.channels
        assert channels is not None
        force: NDArray[np.float64] = channels["vertical_force"]
        return force

    @property
    def channels(self) -> StructArray | None:
        """Further measurements with the last readings.

        They are None for a rig that records none of them.

        Of type :data:`~cutenv.rig.plant.CHANNEL_READINGS`, one for each reading that :meth:`advance` returned.
        """
        return self._grid.channels

    @property
    def began(self) -> float:
        """Rig's clock time at which the cut's readings start from zero [s]."""
        return self._grid.start

    @property
    def angle(self) -> float:
        """Last reported or manually set blade angle [rad]."""
        return self._angle_now()

    def strongest_since(self, moment: float) -> float | None:
        """Return the strongest force along the cut [N] since ``moment`` [s], or None."""
        return self._grid.strongest_since(moment)

    def _note_timing(self) -> None:
        now = self.clock.now()
        if self._commanded is not None and self._grid.ticks:
            self.timing.periods.append(now - self._commanded)
        if self._grid.newest > self._grid.start:
            self.timing.latencies.append(now - self._grid.newest)
        self._commanded = now

    def _wait(
        self, moment: float, angle: float, *, fastest: float = TURN_RATE, go: Callable[[], float] | None = None
    ) -> None:
        """Wait until ``moment`` [s] or stop, controlling angle and heading."""
        now = self.clock.now()
        while now < moment and self.supervisor.phase == "ready":
            if self._turns:
                self.supervisor.turn(self._rate_of_turn(angle, fastest))
            slice = SLICE if not self._turns and go is None else self.settings.bus.sync
            now = self.clock.sleep_until(min(now + slice, moment))
            if go is not None and now < moment and self.supervisor.phase == "ready":
                go()

    def _rate_of_turn(self, wanted: float, fastest: float) -> float:
        sample = self.supervisor.axis("angle")
        if sample is None or abs(wanted - sample.position) < AIMED:
            return 0.0
        off = wanted - (sample.position + _TURN_LAG * sample.speed)
        return min(max(_TURN_GAIN * off, -fastest), fastest)

    def _come_to_rest(self, report: StopReport) -> StructArray:
        """Wait until the blade is at rest.

        Return the readings of the cut until then, none outside a cut.

        A rig that another thread has closed, or whose spine has ended, reports no more, and is not waited for.
        """
        deadline = report.detected + REST_WITHIN  # where no sample shows it, later commands do not wait again
        while report.standstill is None and self.clock.now() < deadline and not self._left and not self.spine.gone:
            self.clock.sleep_until(self.clock.now() + WATCH)
        if not self._cutting:
            return np.zeros(0, READING)
        return self._collect(max(math.floor((self.clock.now() - self._grid.start) / TICK) - self._grid.ticks, 1))

    def _collect(self, ticks: int) -> StructArray:
        readings = self._grid.collect(ticks)
        if self.settings.side is not None:
            place = self.position, self.place("side")
            if self._cutting and math.dist(place, self._way[-1] if self._way else (0.0, 0.0)) > _APART:
                self._way.append(place)
        self.keep(readings)
        return readings


def rig_plant(
    settings: RigSettings, clock: Clock | None = None, *, file: str | os.PathLike[str] | None = None
) -> RigPlant:
    """Make a rig's plant, real or emulated, without connecting.

    Its spine has a process of its own, unless a ``clock`` is given: drivers and safety then run by it, in this process.
    Beside the rig's ``file``, with the ending ``.proven``, the day is noted on which the stop button was proven. In
    this process, raise ValueError if a driver that the rig's file names does not exist, or refuses its settings;
    otherwise they are made, and refused, when it is opened.
    """
    note = None if file is None else Path(file).with_suffix(".proven")
    return RigPlant(RemoteSpine(settings) if clock is None else mounted_spine(settings, clock), note)
