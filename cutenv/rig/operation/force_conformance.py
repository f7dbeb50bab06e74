"""Conformance of a force driver: readings in order and in time, a tare, an orderly end; nothing may touch it."""

from __future__ import annotations

import math
import threading
from itertools import pairwise

import numpy as np

from cutenv.rig.config.settings import RigSettings
from cutenv.rig.devices.clock import Clock
from cutenv.rig.devices.drivers import ForceDriver
from cutenv.rig.operation.conformance import Listening, TriedPromise, closed, must_refuse, reopened
from cutenv.rig.operation.preflight import ZERO_FORCE

_LISTEN = 2.0  # [s]
_FEWEST, _MOST = 20, 200  # readings of a tare
_SEQUENCES = 2**32


def conform_force(driver: ForceDriver, rig: RigSettings, clock: Clock) -> list[TriedPromise]:
    """Try a force driver against its protocol, for some seconds.

    Parameters
    ----------
    driver : ForceDriver
        Driver, not open.
    rig : RigSettings
        Rig that it is for: its limits are what is allowed.
    clock : Clock
        Clock of the driver.

    Returns
    -------
    list of TriedPromise
        What was promised, allowed, measured.

    Raises
    ------
    RigError
        If it cannot be opened.
    """
    before, listening = set(threading.enumerate()), Listening()
    driver.open(listening)
    try:
        findings = _readings(driver, listening, rig, clock)
        findings.append(must_refuse("a second open is refused", lambda: driver.open(Listening())))
        findings += _tares(driver, listening, clock)
    finally:
        findings_of_end = closed(driver, listening, clock, before)
    return [*findings, *findings_of_end, reopened(driver, clock)]


def _readings(driver: ForceDriver, listening: Listening, rig: RigSettings, clock: Clock) -> list[TriedPromise]:
    start = clock.now()
    clock.sleep_until(start + _LISTEN)
    now = clock.now()
    readings = [each for each in listening.forces if each.time >= start]
    if len(readings) < 2:
        return [TriedPromise("readings arrive", "2 or more", f"{len(readings)} in {_LISTEN:g} s", False)]
    times = np.array([each.time for each in readings])
    lost = sum(each.lost for each in readings[1:])
    sent = (len(readings) - 1 + lost) / (times[-1] - times[0])
    tolerance = max(0.02, driver.rate_error)
    gap, share = float(np.diff(times).max()), lost / (lost + len(readings))
    in_order = all(
        (later.sequence - earlier.sequence - 1 - later.lost) % _SEQUENCES == 0 for earlier, later in pairwise(readings)
    )
    deaf = [
        axis
        for number, axis in enumerate("xyz")
        if axis in driver.axes and len({each.counts[number] for each in readings}) == 1
    ]
    idle = [
        axis
        for number, axis in enumerate("xyz")
        if axis not in driver.axes and any(each.force[number] for each in readings)
    ]
    finite = all(math.isfinite(value) for each in readings for value in (*each.force, *each.torque))
    statuses = {each.status for each in readings}
    limits = rig.limits
    return [
        TriedPromise(
            "readings come at its rate",
            f"{driver.rate:g} Hz within {tolerance:.0%}",
            f"{sent:.1f} Hz",
            abs(sent / driver.rate - 1.0) <= tolerance,
        ),
        TriedPromise(
            "no gap stops the blade",
            f"{1e3 * limits.stale_force:g} ms",
            f"{1e3 * gap:.1f} ms",
            gap <= limits.stale_force,
        ),
        TriedPromise("few readings are lost", f"{limits.lost_force:.0%}", f"{share:.1%}", share <= limits.lost_force),
        TriedPromise(
            "numbers count readings and losses",
            "each follows the last",
            "they do" if in_order else "they do not",
            in_order,
        ),
        TriedPromise(
            "times are the clock's, and never go back",
            "0 to now",
            f"least step {1e3 * float(np.diff(times).min()):.2f} ms, newest {1e3 * (now - times[-1]):.1f} ms old",
            bool((np.diff(times) >= 0.0).all() and times[-1] <= now),
        ),
        TriedPromise("counts of each axis flicker", driver.axes, f"still: {', '.join(deaf) or 'none'}", not deaf),
        TriedPromise("other axes read 0", "0 N", f"not 0: {', '.join(idle) or 'none'}", not idle),
        TriedPromise("forces are numbers", "finite", "finite" if finite else "not finite", finite),
        TriedPromise("status at rest is healthy", "0", ", ".join(map(str, sorted(statuses))), statuses == {0}),
        TriedPromise(
            "limits leave room for its rate",
            "4 readings before it counts as silent",
            f"{limits.stale_force * driver.rate:.1f} readings",
            limits.stale_force * driver.rate >= 4.0 - 1e-9,
        ),
    ]


def _tares(driver: ForceDriver, listening: Listening, clock: Clock) -> list[TriedPromise]:
    samples = min(max(round(driver.rate), _FEWEST), _MOST)
    first = driver.tare(samples)
    start = clock.now()
    clock.sleep_until(start + 0.5 + 5.0 / driver.rate)
    readings = [each.force for each in listening.forces if each.time > start]
    left = float(np.abs(np.mean(readings, axis=0)).max()) if readings else math.inf
    second = driver.tare(samples)
    moved = max(abs(a - b) for a, b in zip(first, second, strict=True))
    return [
        TriedPromise("after a tare it reads 0", f"{ZERO_FORCE:g} N", f"{left:.4f} N", left <= ZERO_FORCE),
        TriedPromise("tares tell the whole zero", f"{ZERO_FORCE:g} N apart", f"{moved:.4f} N", moved <= ZERO_FORCE),
    ]
