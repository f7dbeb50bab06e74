"""Readings at 1 kHz, resampled from what sensor and drives report; and the heading of a blade that two axes lead."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cutenv._base.arrays import Array, StructArray
from cutenv.cutting.dtypes import READING, TICK
from cutenv.rig.config.settings import RigSettings
from cutenv.rig.devices.drivers import ForceSample, MotionSample, interpolated, newest_since
from cutenv.rig.safety.motion_monitor import REST_SPEED
from cutenv.tissue.expected_cut import along_line
from cutenv.tissue.lines import CutLine
from cutenv.trace import BESIDE, COMPONENTS_OF_FORCE

_REMEMBERED = 400  # moments that are remembered: two for each decision


class Heading:
    """Direction of a blade in the plane, as angle to the axis of the slab [rad], positive to the left.

    No drive turns the blade about its vertical axis: the two axes lead it where it is to point.
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
        """Turn at a rate [rad/s] from a time ``start`` to ``end`` [s]."""
        self._moments += [(start, self.now), (end, self.now + rate * (end - start))]

    def at(self, times: Array) -> Array:
        """Return the directions at times [s], shape (n,) [rad]; before the first turn and after the last they stay."""
        moments = np.array(self._moments)
        if not math.isfinite(moments[0, 0]):
            moments[0, 0] = moments[1, 0] if len(moments) > 1 else 0.0
        headings: Array = np.interp(times, moments[:, 0], moments[:, 1])
        return headings

    def speeds(self, speed: float, time: float, *, lead: float) -> tuple[float, float]:
        """Return the speeds along the slab and to its left [m/s] of a blade that goes where it points at a time [s].

        The direction is that to which it will have turned after ``lead`` [s], the lag of the axes' velocity loops.
        """
        heading = self.now
        if len(self._moments) > 1:
            (start, before), (end, heading) = self._moments[-2], self._moments[-1]
            heading += (heading - before) * (min(time, end) + lead - end) / max(end - start, 1e-9)
        return speed * math.cos(heading), speed * math.sin(heading)


_OLDEST = 0.05  # [s] before a period, from which samples are still used
_KEPT = 4.0  # [s] of samples kept
_UNKNOWN = ("true_force", "elastic_force", "tip", "jump")

BESIDE_READINGS: np.dtype[Any] = np.dtype([(name, "f8") for name in BESIDE])
"""Measurements of a rig beside a reading, :data:`cutenv.trace.BESIDE`; 0 where no axis measures them."""


class ReadingGrid:
    """Readings of a cut, one every millisecond from its start.

    Parameters
    ----------
    settings : RigSettings
        Axis and sign of the force, rates, the angle of a blade that no drive turns.
    rate : float
        Readings of the force sensor per second [Hz].
    axes : iterable of str
        Names of the driven axes.
    heading : Heading
        Direction of a blade that is also moved to the side: forces and speed of its readings are along this direction.

    Attributes
    ----------
    start : float
        Time of the rig's clock at which the cut's time is zero [s].
    ticks : int
        Number of readings collected since then.
    newest : float
        Time of the newest force that :meth:`collect` used [s].
    beside : Records or None
        :data:`BESIDE_READINGS` for the last readings that :meth:`collect` returned; None for a rig that
        has no axis across the cut and records the force along it alone.
    line : CutLine or None
        Line of which positions are arc lengths; None: they are those of the blade's axis.
    """

    def __init__(self, settings: RigSettings, rate: float, axes: Iterable[str], heading: Heading) -> None:
        self._cut_axis = "xyz".index(settings.sensor.cut_axis)
        self._sign, self._fixed_angle = settings.sensor.sign, settings.fixed_angle
        self._forces: deque[ForceSample] = deque(maxlen=round(_KEPT * rate))
        kept = round(_KEPT / settings.bus.sync)
        self._motions: dict[str, deque[MotionSample]] = {axis: deque(maxlen=kept) for axis in axes}
        self.start = self.newest = 0.0
        self.ticks = 0
        self._height, self._side, self._heading = settings.height, settings.side, heading
        self.line: CutLine | None = None
        more = settings.cross_axes or settings.sensor.components == "all"
        self.beside = np.zeros(0, BESIDE_READINGS) if more else None

    def force(self, sample: ForceSample) -> None:
        """Keep a reading of the force sensor."""
        self._forces.append(sample)

    def motion(self, axis: str, sample: MotionSample) -> None:
        """Keep a sample of an axis."""
        self._motions[axis].append(sample)

    def strongest_since(self, moment: float) -> float | None:
        """Return the force along the cut that was farthest from zero since ``moment`` [s], in N; None without any."""
        along = [self._sign * sample.force[self._cut_axis] for sample in newest_since(self._forces, moment)]
        return max(along, key=abs, default=None)

    def collect(self, ticks: int) -> StructArray:
        """Return the next ``ticks`` readings: the newest force at each, the motion interpolated between samples."""
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
        if self.beside is not None:
            self.beside = self._measured_beside(time, [forces[i] for i in newest.tolist()])
        if self._side is not None:
            self._turn_to_heading(readings, time)
        readings["speed"][np.abs(readings["speed"]) < REST_SPEED] = 0.0
        if "angle" in self._motions:
            readings["angle"], _ = self._interpolated("angle", time)
        else:
            readings["angle"] = self._fixed_angle
        return readings

    def _turn_to_heading(self, readings: StructArray, time: NDArray[np.float64]) -> None:
        """Turn force and speed into the direction of the blade; tell positions along the line."""
        assert self.beside is not None
        heading = self._heading.at(time)
        ahead, across = np.cos(heading), np.sin(heading)
        x, (y, to_left) = readings["position"].copy(), self._interpolated("side", time)
        force, push = readings["force"].copy(), self.beside["lateral_force"]
        readings["force"] = ahead * force + across * push
        readings["speed"] = ahead * readings["speed"] + across * to_left
        self.beside["lateral_force"] = ahead * push - across * force
        self.beside["blade_x"], self.beside["blade_y"] = x, y
        if self.line is not None:
            readings["position"] = along_line(self.line, x, y)[0]

    def _measured_beside(self, time: NDArray[np.float64], samples: list[ForceSample]) -> NDArray[np.void]:
        """Return height, forces across the cut and all six components at times [s], of the force sample of each."""
        beside = np.zeros(len(time), BESIDE_READINGS)
        if self._height is not None:
            beside["height"], _ = self._interpolated("height", time)
        if samples:
            if self._height is not None:
                beside["vertical_force"] = [self._height.felt(sample.force) for sample in samples]
            if self._side is not None:
                beside["lateral_force"] = [self._side.felt(sample.force) for sample in samples]
            six = np.array([(*sample.force, *sample.torque) for sample in samples])
            for number, name in enumerate(COMPONENTS_OF_FORCE):
                beside[name] = six[:, number]
        return beside

    def _interpolated(self, axis: str, time: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        return interpolated(time, newest_since(self._motions[axis], time[0] - _OLDEST))
