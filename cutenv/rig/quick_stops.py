"""Quick stops that go on until every drive is seen to obey: a frame is sent once, and may be lost or undone."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress

from cutenv.rig.causes import StopReport
from cutenv.rig.drivers import MotionDriver, RigError
from cutenv.rig.samples import DriveState, MotionSample

AGAIN = 0.005
"""Period of the timer that sends them [s]."""
INSIST = 0.010
"""Time after a quick stop [s] from which a drive that is not seen to obey is sent another one every time."""
DEAF = 0.040
"""Time of being sent more after which our heartbeat ends too, so that the drive stops by its own watch for it [s]."""
_OFTEN = 0.0005  # [s] between two that answer somebody else's frames: no more load for the bus than theirs


class QuickStops:
    """Sends quick stops to the axes of a stopped rig; its owner calls it under one lock, and only while it is stopped.

    Parameters
    ----------
    axes : mapping of str to MotionDriver
        By name.
    newest : mapping of str to MotionSample
        The last sample of each axis.
    fresh : float
        Age up to which a sample tells how its drive is [s].
    """

    def __init__(self, axes: Mapping[str, MotionDriver], newest: Mapping[str, MotionSample], *, fresh: float) -> None:
        self._axes, self._newest, self._fresh = axes, newest, fresh
        self._deaf_since: dict[str, float] = {}
        self._abandoned: set[str] = set()
        self._contested: dict[str, float] = {}  # when it was answered last [s]

    def begin(self) -> list[str]:
        """Send the first one to every axis; return to whom it could not be sent, and why."""
        self._deaf_since.clear()
        self._abandoned.clear()
        self._contested.clear()
        unreached = []
        for name, axis in self._axes.items():
            try:
                axis.quick_stop()
            except Exception as error:  # whatever it is, the other axis is to be stopped all the same
                unreached.append(f"{name}: {error}")
        return unreached

    def again(self, report: StopReport, now: float) -> None:
        """Send one to every drive that is not seen to obey, whatever else has ended: SYNC, samples, the heartbeat."""
        if now - (report.commanded or report.detected) < INSIST:
            return
        for name, axis in self._axes.items():
            sample = self._newest.get(name)
            seen = sample is not None and now - sample.time <= self._fresh
            if sample is not None and seen and sample.state is not DriveState.ENABLED:
                continue
            self._send(name)
            # It is deaf from its first answer on: nothing gets to a drive whose bus is off, and it may come back late.
            if seen and now - self._deaf_since.setdefault(name, now) >= DEAF and name not in self._abandoned:
                self._abandoned.add(name)
                report.detail += f" ({name} did not hear the quick stop: left to its own watch)"
                axis.abandon("it does not stop when it is told to")

    def answer(self, name: str, now: float) -> None:
        """Send one after a command of somebody else; from the first on they are such that no command undoes."""
        if now - self._contested.get(name, -1.0) >= _OFTEN:
            self._contested[name] = now
            self._send(name)

    def _send(self, name: str) -> None:
        with suppress(RigError):  # the bus is off: the drive's own watch for our heartbeat stops it
            self._axes[name].quick_stop(for_good=name in self._contested)
