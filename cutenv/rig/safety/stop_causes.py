"""Causes of a stop, its report, and repeated quick stops.

Each cause has a longest time to detect it. Quick stops are repeated until the drives obey.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from enum import StrEnum
from functools import partial
from typing import Any, NamedTuple

from cutenv._base.arrays import StructArray
from cutenv.rig.config.settings import SafetyLimits
from cutenv.rig.devices.loop import Attempt
from cutenv.rig.devices.protocols import DriveState, MotionDriver, MotionSample
from cutenv.rig.errors import RigError

SURPLUS = 4.0  # surplus of samples over SYNCs from which it is no jitter
_STALLED = 0.25  # [s] of samples that may come at once, after this computer has stalled
_MEMORY = 20.0  # SYNCs after which a surplus or a lack is forgotten


class SampleRateMonitor:
    """Counter of the samples of one axis against the time.

    They come once with every SYNC, not doubled by the bus or requested by another master. ``sync`` is the time between
    samples [s].
    """

    def __init__(self, sync: float) -> None:
        self._sync = sync
        self._last: float | None = None
        self.surplus = 0.0

        """Surplus of samples over SYNCs; negative if some were lost or are late."""

    def count(self, time: float) -> None:
        """Count a sample at ``time`` [s]."""
        last, self._last = self._last, time
        if last is not None:
            syncs = max(time - last, 0.0) / self._sync
            surplus = self.surplus * math.exp(-syncs / _MEMORY) + 1.0 - syncs
            self.surplus = min(max(surplus, -_STALLED / self._sync), 1.5 * SURPLUS)


class Cause(StrEnum):
    """Cause of a stop."""

    FORCE = "force limit"
    TORQUE = "torque limit"
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
    SPINE = "spine ended"


class Breach(NamedTuple):
    """Cause of a stop, with a description of what was found."""

    cause: Cause
    detail: str


ENDS_SESSION = (Cause.INTERRUPTED, Cause.OPERATOR, Cause.ORPHANED, Cause.SPINE)
"""Causes that end the whole session, not only one cut."""
WATCH = 0.002  # period at which the watchdog looks for overdue signals [s]
# time that a blade commanded to move may stand before its encoder counts as stuck [s], on a rig with fast samples
STUCK_AFTER = 0.060

# time that a force axis may stay at one count while the blade moves, if its own noise is not identified [s]
STILL = 0.200


def stuck_after(sync: float) -> float:
    """Return the time that a blade commanded to move may stand [s]: three samples at least, ``sync`` apart [s]."""
    return max(STUCK_AFTER, 3.0 * sync)


def detection_times(limits: SafetyLimits, *, packet: float = 0.001, sync: float = 0.005) -> dict[Cause, float]:
    """Return the longest time from the moment of a fault to the decision to stop [s], for each cause.

    ``packet`` is the period of the force readings [s], ``sync`` that of the motion samples [s]. For a quantity that
    grows (a following error, the share of lost readings) the time counts from the crossing of its limit. The time for
    one frozen force axis applies to a rig that is not identified. The spine's loop looks for signals, and for stops
    that the program asks for. What bus or sensor report counts from its arrival: the loop reads it within
    :data:`~cutenv.rig.devices.loop.READ_EVERY`.
    """
    return {
        Cause.FORCE: packet,
        Cause.TORQUE: packet,
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
        Cause.EXCEPTION: WATCH,
        Cause.INTERRUPTED: WATCH,
        Cause.ORPHANED: WATCH,
        Cause.OPERATOR: WATCH,
        Cause.SPINE: 0.0,
    }


@dataclass(kw_only=True)
class StopReport:
    """Report of a stop. Times on the rig's clock [s], None for what has not happened yet."""

    cause: Cause
    detail: str
    detected: float
    commanded: float | None = None  # time at which the quick stop was put on the bus [s]
    standstill: float | None = None
    position: float | None = None  # position of the blade at detection [m]
    rest_position: float | None = None  # position of the blade at rest [m]
    peak_force: float = 0.0  # greatest norm of the force since detection [N]

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

    ``readings`` are those since the last command, until the blade was at rest.
    """

    def __init__(self, report: StopReport, readings: StructArray) -> None:
        super().__init__(str(report))
        self.report, self.readings = report, readings


STOP_PERIOD = 0.005  # period of the timer that repeats quick stops [s]
# time after a quick stop [s] from which it is repeated, every period, to a drive that is not seen to obey
RESEND_STOP_AFTER = 0.010
# time of repeated quick stops that a drive ignores, after which our heartbeat ends: its own watchdog stops it [s]
WITHHOLD_HEARTBEAT_AFTER = 0.040
# time for a driver to return from its first quick stop [s]; those of the other axes are sent meanwhile
RETURNS_WITHIN = 0.050
_OFTEN = 0.0005  # [s] between two answers to another master's frames: no more bus load than theirs


class QuickStops:
    """Sender of quick stops to the axes of a stopped rig.

    Call it without a lock, and only while the rig is stopped.

    A single frame may be lost, or undone by another master: they are repeated until every drive is seen to obey. Each
    is sent from a thread of its own: a driver that does not return, or raises, keeps no other axis from its stop.
    ``axes`` and ``newest`` samples are by name; ``fresh``: greatest age at which a sample still shows the state of its
    drive [s].
    """

    def __init__(self, axes: Mapping[str, MotionDriver], newest: Mapping[str, MotionSample], *, fresh: float) -> None:
        self._axes, self._newest, self._fresh = axes, newest, fresh
        self._deaf_since: dict[str, float] = {}
        self._contested: dict[str, float] = {}  # time of the last answer [s]
        self._attempts: dict[str, Attempt] = {}

    def begin(self) -> list[str]:
        """Send the first quick stop to every axis; return the axes that could not be reached, each with the reason."""
        self.forget()
        self._contested.clear()
        sent = {name: self._attempt(name) for name in self._axes}
        unreached, ends = [], time.monotonic() + RETURNS_WITHIN
        for name, attempt in sent.items():
            if not attempt.ends(max(ends - time.monotonic(), 0.0)):
                unreached.append(f"{name}: its driver does not return from the quick stop")
            elif attempt.error is not None:
                unreached.append(f"{name}: {attempt.error}")
        return unreached

    def forget(self) -> None:
        """Judge anew from here on whether drives obey: a reset gives them our heartbeat back, even one that fails."""
        self._deaf_since.clear()

    def again(self, report: StopReport, now: float) -> None:
        """Repeat the quick stop to drives not seen to obey, even if SYNC, samples or the heartbeat have ended."""
        if now - (report.commanded or report.detected) < RESEND_STOP_AFTER:
            return
        for name in self._axes:
            sample = self._newest.get(name)
            seen = sample is not None and now - sample.time <= self._fresh
            if sample is not None and seen and sample.state is not DriveState.ENABLED:
                continue
            if not (hangs := name in self._attempts and self._attempts[name].under_way):
                self._attempt(name).ends(RETURNS_WITHIN)
            # The time counts from the first sample seen after the stop: a drive whose bus is off hears nothing, and may
            # come back late. A driver that hangs is known since the stop, which has waited for it.
            since = self._deaf_since.setdefault(name, report.detected if hangs else now)
            if (seen or hangs) and now - since >= WITHHOLD_HEARTBEAT_AFTER:
                self._deaf_since[name] = math.inf  # once
                report.detail += f" (the {name} drive ignores the quick stop: our heartbeat ends)"
                self._fall_silent(name)

    def answer(self, name: str, now: float) -> None:
        """Answer a command of another master with a quick stop; from the first on, with one that no command undoes."""
        if now - self._contested.get(name, -1.0) >= _OFTEN:
            self._contested[name] = now
            self.send(name)

    def send(self, name: str) -> None:
        """Send a quick stop from this thread, to a driver that has just reported or returned."""
        with suppress(Exception):  # the bus is off, or the driver fails: the drive's own heartbeat watchdog stops it
            self._axes[name].quick_stop(for_good=name in self._contested)

    def _attempt(self, name: str) -> Attempt:
        stop = partial(self._axes[name].quick_stop, for_good=name in self._contested)
        self._attempts[name] = attempt = Attempt(stop, f"rig stop {name}")
        return attempt

    def _fall_silent(self, name: str) -> None:
        """End our heartbeat to a drive that ignores quick stops, whatever its driver does."""
        withhold = partial(self._axes[name].withhold_heartbeat, "it ignores the quick stop")
        Attempt(withhold, f"rig silence {name}").ends(RETURNS_WITHIN)
