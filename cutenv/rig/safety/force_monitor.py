"""Checks of the force, from each packet and the few before it."""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple

from cutenv.rig.config.axes import HeightAxis
from cutenv.rig.config.settings import Identified, SafetyLimits
from cutenv.rig.devices.drivers import ForceSample
from cutenv.rig.devices.reading_stream import LEAK, SEQUENCES, SampleClock
from cutenv.rig.safety.stop_causes import STILL, Breach, Cause

RISE_OVER = 0.010
"""Window over which a rise of force is measured, longer than noise lasts [s]."""
_LOSS_OVER = 0.100  # [s] window for the share of lost readings
_HARDER = 0.5  # [N] beyond the least vertical force since the blade is raised to be relieved, at which it is stopped


class ForceReadings(NamedTuple):
    """Readings that a force sensor sends.

    Attributes
    ----------
    rate : float
        Rate of the readings [Hz].
    rate_error : float
        Greatest relative error of the rate [1].
    axes : str
        Axes that the sensor measures; the others stand at 0.
    """

    rate: float
    rate_error: float = LEAK
    axes: str = "xyz"


class ForceMonitor:
    """Monitor that checks every force reading against the limits.

    Parameters
    ----------
    limits : Limits
        Limits of force, rise, losses and delay.
    readings : ForceReadings
        Readings that the sensor sends.
    identified : Identified, optional
        Identified properties of the rig: the time that each force axis stays at one count through its own noise.
    height : HeightAxis, optional
        Height axis of the rig, with the limit of the vertical force.

    Attributes
    ----------
    newest : ForceSample or None
        Last reading; None before the first.
    """

    def __init__(
        self,
        limits: SafetyLimits,
        readings: ForceReadings,
        identified: Identified | None = None,
        height: HeightAxis | None = None,
    ) -> None:
        self._limits, self._rate, self._height = limits, readings.rate, height
        self._leak = max(readings.rate_error, LEAK)
        self._live = ["xyz".index(axis) for axis in readings.axes]
        self._over = max(RISE_OVER, 1.0 / readings.rate)  # [s] a slow sensor's window is one period
        known = identified or Identified()
        still = (known.force_still_x, known.force_still_y, known.force_still_z)
        self._identified = tuple(each is not None for each in still)
        self._still = tuple(max(STILL if each is None else each, limits.frozen_force) for each in still)  # [s]
        self.newest: ForceSample | None = None
        self.restart()

    def restart(self) -> None:
        """Clear the history, except for the newest reading."""
        self._forces: deque[tuple[float, float, float]] = deque(maxlen=max(round(RISE_OVER * self._rate), 1) + 1)
        self._losses: deque[int] = deque(maxlen=max(round(_LOSS_OVER * self._rate), 2))
        self._lost = 0
        self._equal = 0  # consecutive readings equal to the one before
        self._stood = [0, 0, 0]  # the same for each force axis, while the blade moves
        self._arrivals = SampleClock(self._rate, self._leak)
        self._relieved: float | None = None  # [N] least vertical force since the blade is raised to be relieved

    def adopt(self, limits: SafetyLimits) -> None:
        """Check against other limits from now on."""
        self._limits = limits

    @property
    def pressed(self) -> str | None:
        """Vertical force beyond its limit, from a blade that presses on the tissue, as a text; None if it is within."""
        height, newest = self._height, self.newest
        if height is None or newest is None or height.felt(newest.force) <= height.vertical_force:
            return None
        up = height.felt(newest.force)
        return f"the blade presses on the tissue with {up:.1f} N, {height.vertical_force:g} N allowed"

    def let_relieve(self) -> None:
        """Allow a vertical force that is beyond its limit now, as long as it falls, until it is within."""
        if self._height is not None and self.newest is not None and self.pressed is not None:
            self._relieved = self._height.felt(self.newest.force)

    @property
    def relieving(self) -> bool:
        """True while a blade is raised to be relieved."""
        return self._relieved is not None

    def _lifted_too_much(self, height: HeightAxis, force: tuple[float, float, float]) -> bool:
        up = height.felt(force)
        if self._relieved is not None:
            self._relieved = min(self._relieved, up)
            if self._relieved > 0.9 * height.vertical_force:  # less: readings that flicker about the limit
                return up > self._relieved + _HARDER
            self._relieved = None
        return not abs(up) <= height.vertical_force

    def check(self, sample: ForceSample, *, moving: bool = False) -> Breach | None:
        """Check a reading of a blade that is commanded to move or to rest; return the breach found, or None."""
        last, self.newest = self.newest, sample
        norm = math.hypot(*sample.force)
        self._forces.append(sample.force)
        self._equal = self._equal + 1 if last is not None and last.counts == sample.counts else 0
        for axis in self._live:
            same = last is not None and last.counts[axis] == sample.counts[axis]
            self._stood[axis] = self._stood[axis] + moving if same else 0  # a pause of the blade does not reset it
        if len(self._losses) == self._losses.maxlen:
            self._lost -= self._losses[0]
        self._losses.append(sample.lost)
        self._lost += sample.lost
        lateness = self._arrivals.sensed(sample.sequence, sample.time)[1]

        limits = self._limits
        rise = _rise(self._forces[0], sample.force) if len(self._forces) == self._forces.maxlen else 0.0
        twist = math.hypot(*sample.torque)
        # One loss among the first few readings is not a large share.
        share = self._lost / max(self._lost + len(self._losses), _LOSS_OVER * self._rate)
        # Each comparison is written so that what is no number is a breach.
        if not (math.isfinite(norm) and math.isfinite(twist)):
            return Breach(Cause.NOT_A_NUMBER, f"the sensor reads {sample.force} N, {sample.torque} N m")
        if sample.status:
            return Breach(Cause.FORCE_STATUS, f"the sensor's status is 0x{sample.status:08X}")
        if last is not None and (sample.sequence - last.sequence - 1 - sample.lost) % SEQUENCES:
            counts = f"{sample.sequence} comes after {last.sequence}"
            return Breach(Cause.FORCE_STATUS, f"the sensor was restarted, its zero may be gone: reading {counts}")
        if not max(map(abs, sample.force)) <= limits.force:
            return Breach(Cause.FORCE, f"{_newtons(sample)} beyond {limits.force:g} N in an axis")
        if (height := self._height) is not None and self._lifted_too_much(height, sample.force):
            up = f"{height.felt(sample.force):+.2f} N upwards"
            return Breach(Cause.VERTICAL_FORCE, f"{up}, beyond {height.vertical_force:g} N")
        if not norm <= limits.force_norm:
            return Breach(Cause.FORCE, f"{norm:.2f} N in all, beyond {limits.force_norm:g} N")
        if not twist <= limits.torque:
            return Breach(Cause.TORQUE, f"{twist:.2f} N m, beyond {limits.torque:g} N m")
        if not rise <= limits.force_rise * self._over:
            return Breach(Cause.FORCE_RISE, f"the force changed by {rise:.2f} N within {1e3 * self._over:g} ms")
        if self._equal >= limits.frozen_force * self._rate:
            return Breach(Cause.FORCE_FROZEN, f"{self._equal + 1} consecutive readings have the same counts")
        for number, still in enumerate(self._still):
            if self._stood[number] >= still * self._rate:
                return Breach(Cause.FORCE_AXIS, self._stands(number))
        if not share <= limits.lost_force:
            return Breach(Cause.FORCE_LOST, f"{share:.0%} of the last readings were lost")
        if not lateness <= limits.late_force:
            return Breach(Cause.FORCE_LATE, f"readings arrive {1e3 * lateness:.0f} ms later than before")
        return None

    def _stands(self, axis: int) -> str:
        """Describe an axis that stays at one count; a quiet sensor may do so if its noise was never identified."""
        text = f"the {'xyz'[axis]} force stays at one count for {1e3 * self._still[axis]:.0f} ms while the blade moves"
        if self._identified[axis]:
            return text
        return text + "; if the sensor works, measure its noise: cutenv rig identify --write"


def _rise(before: tuple[float, float, float], now: tuple[float, float, float]) -> float:
    """Return by how much a force has grown or turned [N]: its distance from every fall of the one before.

    A fall is no breach, because the force falls when a crack runs; one that swings to the other side is.
    """
    (x, y, z), (now_x, now_y, now_z) = before, now  # written out: it is asked at each reading
    squared = x * x + y * y + z * z
    along = x * now_x + y * now_y + z * now_z
    left = min(max(along / squared, 0.0), 1.0) if squared > 0.0 else 0.0
    return math.hypot(now_x - left * x, now_y - left * y, now_z - left * z)


def _newtons(sample: ForceSample) -> str:
    return "(" + ", ".join(f"{value:.2f}" for value in sample.force) + ") N"
