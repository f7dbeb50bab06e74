"""Actual and desired speed at constant speed (thesis, section 3.3.1).

The thesis monitored the blade's actual speed while it cut, Figure 3.2, and took its agreement with the desired one as
evidence that the machine, far stiffer than tissue, does not yield to the force.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cutenv._base.arrays import Array
from cutenv._base.validation import in_range
from cutenv.sim.trace import Trace

STEADY_FROM = 0.98  # share of the desired speed from which the blade counts as moving steadily
_MIN_READINGS = 20  # readings of a steady motion
_NAME = "speed_tracking"


@dataclass(frozen=True, kw_only=True)
class SpeedTracking:
    """Actual and desired speed of a constant-speed cut, in SI.

    The steady part lasts from the first reading of :data:`STEADY_FROM` times the desired speed to the last; what
    happens between them, however slow, counts.

    Attributes
    ----------
    time, actual, desired, force : array of shape (n,)
        Time [s], actual and desired speed [m/s], and force [N], of the whole record. The desired speed is zero before
        the blade moves, and NaN, unknown, after the steady part.
    speed : float
        Desired speed [m/s].
    mean, rms_error, worst_error : float
        Of the steady part: mean actual speed [m/s], root mean square and greatest absolute deviation from the desired
        speed [m/s].
    worst_at : float
        Position of the blade at the greatest deviation [m].
    """

    time: Array
    actual: Array
    desired: Array
    force: Array
    speed: float
    steady: slice
    mean: float
    rms_error: float
    worst_error: float
    worst_at: float

    @property
    def lines(self) -> list[str]:
        """Result in words: one line for each number."""
        span = self.time[self.steady]
        return [
            f"desired speed       {100 * self.speed:.4g} cm/s",
            f"mean actual speed   {100 * self.mean:.4g} cm/s over {span[-1] - span[0]:.2f} s",
            f"rms deviation       {100 * self.rms_error:.2g} cm/s, {100 * self.rms_error / self.speed:.2g} %",
            f"greatest deviation  {100 * self.worst_error:.2g} cm/s, {100 * self.worst_error / self.speed:.2g} %, "
            f"at {1e3 * self.worst_at:.1f} mm",
        ]


def speed_tracking(trace: Trace, speed: float) -> SpeedTracking:
    """Compare a constant-speed cut's actual speed with the desired one.

    Parameters
    ----------
    trace : Trace
        Record of the cut, with position; its speed is the actual one, that of the positions if there is none.
    speed : float
        Desired speed [m/s], above zero.

    Raises
    ------
    ValueError
        If the record has no position, or the blade never reaches :data:`STEADY_FROM` of the desired speed.
    """
    in_range("speed", speed, 1e-5, 0.5, "m/s", "Speeds are in m/s: 2.54 cm/s is 0.0254.")
    (position,) = trace.require("position", by=_NAME)
    actual = trace.blade_speed if trace.speed is None else trace.speed
    reached = np.flatnonzero(actual >= STEADY_FROM * speed)
    if len(reached) < _MIN_READINGS:
        raise ValueError(
            f"the blade reached {100 * STEADY_FROM:g} % of the desired {100 * speed:.4g} cm/s in {len(reached)} "
            f"readings only; its greatest speed is {100 * actual.max():.4g} cm/s. Give the speed that was commanded."
        )
    steady = slice(int(reached[0]), int(reached[-1]) + 1)
    moving = np.flatnonzero(actual[: steady.start] <= 0.0)
    begun = int(moving[-1]) + 1 if len(moving) else 0
    desired = np.zeros(len(actual))
    desired[steady.stop :] = np.nan
    desired[begun : steady.stop] = speed
    off = actual[steady] - speed
    worst = int(np.abs(off).argmax())
    return SpeedTracking(
        time=trace.time,
        actual=actual,
        desired=desired,
        force=trace.force,
        speed=speed,
        steady=steady,
        mean=float(actual[steady].mean()),
        rms_error=float(np.sqrt(np.mean(off**2))),
        worst_error=float(abs(off[worst])),
        worst_at=float(position[steady][worst]),
    )
