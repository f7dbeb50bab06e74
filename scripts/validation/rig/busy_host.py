"""Check whether this machine lets a program run in time: lateness of a thread that should run every 2 ms."""

from __future__ import annotations

from dataclasses import dataclass

from cutenv.rig.devices.loop import PRIORITY, SystemClock, preferred
from scripts.validation.rig.cutting_rig import WATCHED, HostWatch

LOOKED = 4.0  # duration of the check [s]
LATE = 0.015  # lateness of a thread that soon stops a cut: readings of the force are stale after 20 ms [s]
MANY = 2  # number of these in LOOKED from which half of all trials would be stopped before their fault


class TooBusy(Exception):
    """Error raised if no trials can be run here now; the message contains what to ask for."""


@dataclass(frozen=True)
class Lateness:
    """Lateness of threads on this machine."""

    late: list[float]  # delays of a thread by more than :data:`LATE` [s]
    preferred: bool  # whether the system gave it priority

    def check(self) -> None:
        """Raise :class:`TooBusy` if the machine is too busy."""
        if len(self.late) < MANY:
            return
        seen = (
            f"this machine is too busy: {len(self.late)} times in {LOOKED:g} s a thread that should run every "
            f"{1e3 * WATCHED:g} ms was late by more than {1e3 * LATE:g} ms, by {1e3 * max(self.late):.0f} ms at most"
        )
        if self.preferred:
            raise TooBusy(
                f"{seen}, though it has real-time priority. End what else runs with such a priority; a virtual machine "
                "that is not run by its host cannot be helped from within: take another one."
            )
        raise TooBusy(
            f"{seen}. It may not ask for real-time priority (SCHED_RR, {PRIORITY}). Let it: as root, put the line\n"
            f"    {{user}} - rtprio {PRIORITY}\n"
            "with your user's name into a file of /etc/security/limits.d and log in again, or start the command with"
            f"\n    sudo chrt --rr {PRIORITY}\n"
            "Or end what else runs here."
        )


def look() -> Lateness:
    """Measure the lateness for some seconds, with the priority that a rig would have."""
    clock = SystemClock()
    with preferred() as allowed:
        watch = HostWatch(clock)
        clock.sleep_until(clock.now() + LOOKED)
        watch.stop()
    return Lateness([late for _, late in watch.stalls if late > LATE], allowed)
