"""Quick stops, repeated until every drive is seen to obey: a single frame may be lost, or undone by another master."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress

from cutenv.rig.devices.drivers import MotionDriver
from cutenv.rig.devices.samples import DriveState, MotionSample
from cutenv.rig.errors import RigError
from cutenv.rig.safety.stop_causes import StopReport

AGAIN = 0.005
"""Period of the timer that repeats quick stops [s]."""
RESEND_STOP_AFTER = 0.010
"""Time after a quick stop [s] from which it is repeated, every period, to a drive that is not seen to obey."""
WITHHOLD_HEARTBEAT_AFTER = 0.040
"""Time of repeated quick stops that a drive ignores, after which our heartbeat ends: its own watchdog stops it [s]."""
_OFTEN = 0.0005  # [s] between two answers to another master's frames: no more bus load than theirs


class QuickStops:
    """Sender of quick stops to the axes of a stopped rig; call it under one lock, and only while the rig is stopped.

    Parameters
    ----------
    axes : mapping of str to MotionDriver
        Drivers of the axes, by name.
    newest : mapping of str to MotionSample
        Last sample of each axis, by name.
    fresh : float
        Greatest age at which a sample still shows the state of its drive [s].
    """

    def __init__(self, axes: Mapping[str, MotionDriver], newest: Mapping[str, MotionSample], *, fresh: float) -> None:
        self._axes, self._newest, self._fresh = axes, newest, fresh
        self._deaf_since: dict[str, float] = {}
        self._abandoned: set[str] = set()
        self._contested: dict[str, float] = {}  # time of the last answer [s]

    def begin(self) -> list[str]:
        """Send the first quick stop to every axis; return the axes that could not be reached, each with the reason."""
        self._deaf_since.clear()
        self._abandoned.clear()
        self._contested.clear()
        unreached = []
        for name, axis in self._axes.items():
            try:
                axis.quick_stop()
            except Exception as error:  # whatever fails here, the other axis must still be stopped
                unreached.append(f"{name}: {error}")
        return unreached

    def again(self, report: StopReport, now: float) -> None:
        """Repeat the quick stop to drives not seen to obey, even if SYNC, samples or the heartbeat have ended."""
        if now - (report.commanded or report.detected) < RESEND_STOP_AFTER:
            return
        for name, axis in self._axes.items():
            sample = self._newest.get(name)
            seen = sample is not None and now - sample.time <= self._fresh
            if sample is not None and seen and sample.state is not DriveState.ENABLED:
                continue
            self._send(name)
            # The time counts from the first sample seen after the stop: a drive whose bus is off hears nothing, and may
            # come back late.
            if (
                seen
                and now - self._deaf_since.setdefault(name, now) >= WITHHOLD_HEARTBEAT_AFTER
                and name not in self._abandoned
            ):
                self._abandoned.add(name)
                report.detail += f" (the {name} drive ignores the quick stop: our heartbeat ends)"
                axis.withhold_heartbeat("it ignores the quick stop")

    def answer(self, name: str, now: float) -> None:
        """Answer a command of another master with a quick stop; from the first on, with one that no command undoes."""
        if now - self._contested.get(name, -1.0) >= _OFTEN:
            self._contested[name] = now
            self._send(name)

    def _send(self, name: str) -> None:
        with suppress(RigError):  # the bus is off: the drive's own heartbeat watchdog stops it
            self._axes[name].quick_stop(for_good=name in self._contested)
