"""Plan of an identification: the motions that it makes, within a rig's travel."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

from cutenv.rig.config.settings import RigSettings
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
