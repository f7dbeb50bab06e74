"""Recording of an identification: the motions that it plans, and what axis and sensor report meanwhile."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from cutenv._base.arrays import Array
from cutenv.rig.config.settings import RigSettings
from cutenv.rig.devices.drivers import ForceSample, MotionSample
from cutenv.rig.errors import RigError
from cutenv.rig.safety.supervisor import BRAKING, MARGIN

_SHARES = (0.08, 0.16, 0.32, 0.6, 0.8)  # [1] speeds of the steps over the top speed
_FREQUENCIES = (0.5, 1.0, 2.0, 4.0, 8.0)  # [Hz]
_SWING = 0.2  # [1] amplitude of a slow sine over the top speed
_STEEPEST = 0.6  # [1] acceleration of a fast sine over its limit: beyond it the motion would not be a sine
_CYCLES, _LEAST = 4, 2.0  # least number of cycles, of which the first is ignored, and least duration [s] of a sine
_LAG = 0.1  # [s] that an axis may need besides its ramp
_CLEARANCE = 0.002  # [m] besides
_STEP_HOLD = 0.7  # [s] at least


class Sine(NamedTuple):
    """Sinusoidal speed: frequency [Hz] and amplitude [m/s]."""

    frequency: float
    amplitude: float

    @property
    def duration(self) -> float:
        """Duration in whole cycles [s]."""
        return max(_CYCLES, math.ceil(_LEAST * self.frequency)) / self.frequency

    def speed(self, time: float) -> float:
        """Return the commanded speed ``time`` [s] after the beginning [m/s]."""
        return self.amplitude * math.sin(2.0 * math.pi * self.frequency * time)


@dataclass(frozen=True, kw_only=True)
class Plan:
    """Plan of the experiment, in SI.

    Attributes
    ----------
    start : float
        Position from which the blade moves away from the clamp, and to which it returns [m].
    speeds : tuple of float
        Speeds of the steps, one after the other [m/s].
    step_hold : tuple of float
        Duration of each step, and of the rest after it [s].
    sines : tuple of Sine
        Sines, one after the other.
    turn_speed, turn_travel : float
        Speed of the slow reversals [m/s], and distance between two of them [m].
    turns : int
        Number of slow reversals.
    rest : float
        Duration of the sensor's recording at rest [s].
    """

    start: float
    speeds: tuple[float, ...]
    step_hold: tuple[float, ...]
    sines: tuple[Sine, ...]
    turn_speed: float = 0.25e-3
    turn_travel: float = 0.6e-3
    turns: int = 8
    rest: float = 20.0

    @classmethod
    def within(cls, settings: RigSettings, position: float) -> Plan:
        """Return the plan for a blade at ``position`` [m], with the nearest start that its travel allows.

        Raises
        ------
        RigError
            If the travel is too short.
        """
        limits, axis = settings.limits, settings.blade
        top = min(limits.speed / MARGIN, axis.speed)
        speeds = tuple(share * top for share in _SHARES)
        sines = tuple(
            Sine(each, min(_SWING * top, _STEEPEST * axis.acceleration / (2.0 * math.pi * each)))
            for each in _FREQUENCIES
        )
        holds = tuple(max(speed / axis.acceleration + 4.0 * _LAG, _STEP_HOLD) for speed in speeds)
        plan = cls(start=position, speeds=speeds, step_hold=holds, sines=sines)
        # Nearer to an end of travel, commands are reduced.
        clearance = top * (BRAKING + top / (2.0 * axis.acceleration)) + _CLEARANCE
        low, high = max(limits.low, axis.low) + clearance, min(limits.high, axis.high) - clearance - plan.travel
        if low > high:
            raise RigError(
                f"the rig's travel is {1e3 * (low - high):.0f} mm too short for this: widen its limits and travel, or"
                " lower limits.speed, in its file."
            )
        return replace(plan, start=min(max(position, low), high))

    @property
    def travel(self) -> float:
        """Greatest distance from the start [m]."""
        steps = max(speed * hold for speed, hold in zip(self.speeds, self.step_hold, strict=True))
        return max(steps, self.turn_travel, *(sine.amplitude / (math.pi * sine.frequency) for sine in self.sines))

    @property
    def path(self) -> tuple[float, float]:
        """Least and greatest position [m]."""
        swing = self.turn_travel
        return self.start - swing, self.start + self.travel + swing

    @property
    def duration(self) -> float:
        """Approximate duration of the whole experiment [s]."""
        turning = self.turns * self.turn_travel / self.turn_speed
        return self.rest + turning + 4.0 * sum(self.step_hold) + sum(sine.duration + 0.5 for sine in self.sines)


@dataclass(frozen=True, kw_only=True)
class Stretch:
    """Part of the experiment, from rest to rest; times [s] on one clock, samples as they arrived.

    Attributes
    ----------
    command_time, command : array of shape (c,)
        Speeds [m/s] put on the bus; each holds until the next, and before the first the axis rests.
    time, position, torque : array of shape (n,)
        Samples of the axis's position [m], and of its motor's torque over the rated one [1].
    """

    command_time: Array
    command: Array
    time: Array
    position: Array
    torque: Array


class Felt(NamedTuple):
    """Readings of the force along the cut while the axis moves: times [s] and forces [N], each of shape (n,)."""

    time: Array
    force: Array


class Recorder:
    """Listener to an axis and a sensor, besides the supervisor.

    Parameters
    ----------
    cut_axis : int
        Axis of the sensor along the cut: 0, 1 or 2.
    sign : int
        Sign of the reading against a motion forward.
    """

    def __init__(self, cut_axis: int = 0, sign: int = 1) -> None:
        self._cut_axis, self._sign = cut_axis, sign
        self._commands: list[tuple[float, float]] = []
        self._motions: dict[str, list[MotionSample]] = {}
        self._forces: list[ForceSample] = []
        self._beats: dict[str, list[float]] = {}

    def command(self, time: float, speed: float) -> None:
        """Record a speed [m/s] that is put on the bus at ``time`` [s]."""
        self._commands.append((time, speed))

    # A listener of the plant

    def motion(self, axis: str, sample: MotionSample) -> None:
        """Record a sample."""
        self._motions.setdefault(axis, []).append(sample)

    def force(self, sample: ForceSample) -> None:
        """Record a reading."""
        self._forces.append(sample)

    def alive(self, axis: str, time: float) -> None:
        """Record the arrival of a heartbeat."""
        self._beats.setdefault(axis, []).append(time)

    def stretch(self, start: float, end: float) -> Stretch:
        """Return the commands and samples between two times [s]."""
        commands = np.array([each for each in self._commands if start <= each[0] < end]).reshape(-1, 2)
        motions = np.array([each[:4] for each in self._between("blade", start, end)]).reshape(-1, 4)
        return Stretch(
            command_time=commands[:, 0],
            command=commands[:, 1],
            time=motions[:, 0],
            position=motions[:, 1],
            torque=motions[:, 3],
        )

    def forces(self, start: float, end: float) -> list[ForceSample]:
        """Return the readings between two times [s]."""
        return [each for each in self._forces.copy() if start <= each.time < end]

    def force_along(self, start: float, end: float) -> Array:
        """Return the readings along the cut between two times [s], in the sensor's sign [N]."""
        return np.array([each.force[self._cut_axis] for each in self.forces(start, end)])

    def felt(self, start: float, end: float) -> Felt:
        """Return times and forces along the cut between two times [s]; positive: against a motion forward."""
        readings = self.forces(start, end)
        force = [self._sign * each.force[self._cut_axis] for each in readings]
        return Felt(np.array([each.time for each in readings]), np.array(force))

    def force_axes(self, start: float, end: float) -> Array:
        """Return the readings of all three axes of the sensor between two times, shape (n, 3) [N]."""
        return np.array([each.force for each in self.forces(start, end)]).reshape(-1, 3)

    def motion_times(self, axis: str, start: float, end: float) -> Array:
        """Return the arrivals of an axis's samples between two times [s]."""
        return np.array([each.time for each in self._between(axis, start, end)])

    def heartbeats(self, axis: str, start: float, end: float) -> Array:
        """Return the arrivals of an axis's heartbeats between two times [s]."""
        return np.array([each for each in self._beats.get(axis, []) if start <= each < end])

    def _between(self, axis: str, start: float, end: float) -> list[MotionSample]:
        return [each for each in self._motions.get(axis, []).copy() if start <= each.time < end]
