"""Causes of a stop, the longest time to detect each, and the report of a stop."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Any, NamedTuple

from cutenv._base.arrays import StructArray
from cutenv.rig.config.settings import SafetyLimits
from cutenv.rig.errors import RigError
from cutenv.rig.safety.sample_rate_monitor import SURPLUS


class Cause(StrEnum):
    """Cause of a stop."""

    FORCE = "force limit"
    FORCE_RISE = "force rise"
    FORCE_STATUS = "force status"
    FORCE_STALE = "force stale"
    FORCE_FROZEN = "force frozen"
    FORCE_AXIS = "force axis frozen"
    FORCE_LATE = "force late"
    FORCE_LOST = "force lost"
    SPEED = "speed limit"
    ACCELERATION = "acceleration limit"
    TRAVEL = "travel limit"
    ANGLE = "angle limit"
    HEIGHT = "height limit"
    SIDE = "side limit"
    VERTICAL_FORCE = "vertical force limit"
    NOT_RAISED = "cannot be raised"
    FOLLOWING = "following error"
    STUCK = "encoder stuck"
    MOTION_STALE = "motion stale"
    MOTION_DOUBLED = "motion doubled"
    HEARTBEAT = "heartbeat lost"
    DRIVE = "drive fault"
    FOREIGN = "foreign command"
    BUS = "bus broken"
    OVERRUN = "clock overrun"
    NOT_A_NUMBER = "not a number"
    EXCEPTION = "exception"
    INTERRUPTED = "interrupted"
    ORPHANED = "parent death"
    OPERATOR = "operator"


class Breach(NamedTuple):
    """Cause of a stop, with a description of what was found."""

    cause: Cause
    detail: str


BY_PEOPLE = (Cause.INTERRUPTED, Cause.OPERATOR, Cause.ORPHANED)
"""Causes that end the whole session, not only one cut."""
WATCH = 0.002
"""Period at which the watchdog looks for overdue signals [s]."""
STUCK_AFTER = 0.060
"""Time that a blade commanded to move may stand before its encoder counts as stuck [s], on a rig with fast samples."""

STILL = 0.200
"""Time that a force axis may stay at one count while the blade moves, if its own noise is not identified [s]."""


def stuck_after(sync: float) -> float:
    """Return the time that a blade commanded to move may stand [s]: three samples at least, ``sync`` apart [s]."""
    return max(STUCK_AFTER, 3.0 * sync)


def detection_times(limits: SafetyLimits, *, packet: float = 0.001, sync: float = 0.005) -> dict[Cause, float]:
    """Return the longest time from the moment of a fault to the decision to stop [s], for each cause.

    ``packet`` is the period of the force readings [s], ``sync`` that of the motion samples [s]. For a quantity that
    grows (a following error, the share of lost readings) the time counts from the crossing of its limit. The time for
    one frozen force axis applies to a rig that is not identified.
    """
    return {
        Cause.FORCE: packet,
        Cause.FORCE_RISE: packet,
        Cause.FORCE_STATUS: packet,
        Cause.FORCE_STALE: limits.stale_force + WATCH,
        Cause.FORCE_FROZEN: limits.frozen_force + packet,
        Cause.FORCE_AXIS: STILL + packet,
        Cause.FORCE_LATE: packet,
        Cause.FORCE_LOST: packet,
        Cause.SPEED: sync,
        Cause.ACCELERATION: 2 * sync,
        Cause.TRAVEL: sync,
        Cause.ANGLE: sync,
        Cause.HEIGHT: sync,
        Cause.SIDE: sync,
        Cause.VERTICAL_FORCE: packet,
        Cause.NOT_RAISED: stuck_after(sync) + sync,
        Cause.FOLLOWING: sync,
        Cause.STUCK: stuck_after(sync) + sync,
        Cause.MOTION_STALE: limits.stale_motion + WATCH,
        Cause.MOTION_DOUBLED: (SURPLUS + 2.0) * sync,
        Cause.HEARTBEAT: limits.heartbeat + WATCH,
        Cause.DRIVE: sync,
        Cause.FOREIGN: 0.0,
        Cause.BUS: 0.0,
        Cause.OVERRUN: WATCH,
        Cause.NOT_A_NUMBER: 0.0,
        Cause.EXCEPTION: 0.0,
        Cause.INTERRUPTED: 0.0,
        Cause.ORPHANED: WATCH,
        Cause.OPERATOR: 0.0,
    }


@dataclass(kw_only=True)
class StopReport:
    """Report of a stop; times on the rig's clock [s], None for what has not happened yet."""

    cause: Cause
    detail: str
    detected: float
    commanded: float | None = None
    """Time at which the quick stop was put on the bus [s]."""
    standstill: float | None = None
    position: float | None = None
    """Position of the blade at detection [m]."""
    rest_position: float | None = None
    """Position of the blade at rest [m]."""
    peak_force: float = 0.0
    """Greatest norm of the force since detection [N]."""

    @property
    def time_to_standstill(self) -> float | None:
        """Time from detection to standstill [s]."""
        return None if self.standstill is None else self.standstill - self.detected

    @property
    def distance_to_standstill(self) -> float | None:
        """Distance from detection to standstill [m]."""
        if self.rest_position is None or self.position is None:
            return None
        return abs(self.rest_position - self.position)

    def to_dict(self) -> dict[str, Any]:
        """Return a dictionary for JSON; units are in the names."""
        return {
            "cause": self.cause.value,
            "detail": self.detail,
            "time_to_standstill_s": self.time_to_standstill,
            "distance_to_standstill_m": self.distance_to_standstill,
            "peak_force_N": self.peak_force,
        }

    def __str__(self) -> str:
        text = f"{self.cause.value}: {self.detail}"
        if self.time_to_standstill is not None:
            text += f"; at rest after {1e3 * self.time_to_standstill:.0f} ms"
        if self.distance_to_standstill is not None:
            text += f" and {1e3 * self.distance_to_standstill:.2f} mm"
        return text


class RigStopped(RigError):
    """Error for a blade that was stopped, and stays so until the operator resets it.

    Attributes
    ----------
    report : StopReport
        Cause of the stop, and how long it took.
    readings : Records
        Readings since the last command, until the blade was at rest.
    """

    def __init__(self, report: StopReport, readings: StructArray) -> None:
        super().__init__(str(report))
        self.report, self.readings = report, readings
