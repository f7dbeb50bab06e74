"""Suitability of a rig for tasks, from its file alone."""

from __future__ import annotations

import math
from dataclasses import fields
from typing import NamedTuple

from cutenv.rig.config.identified import environment_arguments
from cutenv.rig.config.settings import RigSettings
from cutenv.rig.devices.driver_registry import KIND_OF_ROLE, traits_of
from cutenv.rig.devices.serial.board_drivers import sensor_delay
from cutenv.rig.safety.stop_causes import Cause, detection_times
from cutenv.rig.safety.supervisor import MARGIN
from cutenv.sim.cutting.sensor import SensorParameters

TASK_SPEED = 0.0254  # greatest speed that an action of the tasks commands [m/s]
FEWEST_DECISIONS = 5.0  # decisions a second below which no policy is worth trying: assumed [Hz]
_DEADLINE, _ENDING = 30.0, 4.0  # [s] of a cut, of which so much is needed to stop and unload
_MAX_TARGET, _MIN_TARGET, _AHEAD = 0.100, 0.060, 0.010  # [m] targets of the tasks, and how far the blade leads the tip
_LONGEST_DELAY = next(f.metadata["high"] for f in fields(SensorParameters) if f.name == "force_delay")  # [s]
_FRAME = 0.002  # [s] of a line or frame, and of the threads


class Fit(NamedTuple):
    """One thing a rig can or cannot do, with the reason."""

    name: str
    possible: bool
    why: str

    def __str__(self) -> str:
        return f"{'yes ' if self.possible else 'no  '} {self.name}: {self.why}"


def top_speed(settings: RigSettings) -> float:
    """Return the greatest speed that is ever commanded [m/s]."""
    return min(settings.limits.speed / MARGIN, settings.blade.speed)


def simulator_keywords(settings: RigSettings) -> dict[str, float]:
    """Return keywords to make the simulator like a rig, in SI.

    They are what was identified, and what its file states. That is the top speed if it is below that of the tasks, and
    the mean delay of a force until it is read: as it was identified, or half the sensor's settling time and half a
    reading.
    """
    found = environment_arguments(settings.identified, settings.position_control)
    if (speed := top_speed(settings)) < TASK_SPEED:
        found["top_speed"] = speed
    if (settling := sensor_delay(settings)) > 0.0 and "force_delay" not in found:
        found["force_delay"] = min(0.5 * settling + 0.5 / settings.sensor.rate, _LONGEST_DELAY)
    return found


def decisions(settings: RigSettings) -> int:
    """Return the highest rate of observed decisions [Hz]; divides 1000.

    Each decision sees the outcome of the one before. That is the rate at which sensor's delay, one reading and one
    sample of the motion fit into a period.
    """
    shortest = sensor_delay(settings) + 1.0 / settings.sensor.rate + settings.bus.sync
    return max((rate for rate in range(1, 1001) if 1000 % rate == 0 and rate * shortest <= 1.0), default=1)


def stopping_ways(settings: RigSettings) -> dict[str, float]:
    """Return stated stopping distances at top speed by fault [m].

    None of them is measured. By what has happened: a force that passes its limit, a sensor or a drive that falls
    silent, a computer that does. nan: the driver does not state how long it goes on.
    """
    limits, speed = settings.limits, top_speed(settings)
    found = detection_times(limits, packet=1.0 / settings.sensor.rate, sync=settings.bus.sync)
    braking = speed**2 / (2.0 * settings.blade.quick_stop)
    patience = traits_of(KIND_OF_ROLE["blade"], settings.blade.driver).patience

    def way(seconds: float) -> float:
        return speed * (seconds + _FRAME) + braking

    return {
        "force beyond its limit": way(sensor_delay(settings) + found[Cause.FORCE]),
        "force sensor silent": way(found[Cause.FORCE_STALE]),
        "drive silent": way(found[Cause.MOTION_STALE]),
        "computer silent": way(patience),
    }


def fits(settings: RigSettings) -> list[Fit]:
    """Return what a rig can do, task by task."""
    rate, speed, most = decisions(settings), top_speed(settings), settings.limits.high - _AHEAD
    reach = min(speed * (_DEADLINE - _ENDING) - _AHEAD, most)
    enough = rate >= FEWEST_DECISIONS
    slow = f"{rate} decisions a second see their outcome, {FEWEST_DECISIONS:g} are needed"
    cut = enough and reach >= _MIN_TARGET
    why = f"{rate} decisions a second, {1e3 * speed:.1f} mm/s, up to {1e3 * min(reach, _MAX_TARGET):.0f} mm"
    if not enough:
        why = slow
    elif reach < _MIN_TARGET:
        why = f"in 30 s it cuts {1e3 * max(reach, 0.0):.0f} mm, and targets begin at {1e3 * _MIN_TARGET:g} mm"
    free = settings.angle is not None
    lifts, aside = settings.height is not None, settings.side is not None
    fast = speed >= 0.98 * TASK_SPEED / MARGIN
    found = [
        Fit("RigCut-v1, angle fixed", cut, why),
        Fit("RigCut-v1, angle free", cut and free, why if free else "no drive turns the blade"),
        Fit("RigDepthCut-v1", cut and lifts, why if lifts else "no drive raises the blade"),
        Fit("RigPathCut-v1", cut and aside, why if aside else "no drive moves the blade to the side"),
        Fit(
            "policies at full speed",
            cut and fast,
            f"commands reach {1e2 * TASK_SPEED:g} cm/s" + ("" if fast else f", this rig {1e2 * speed:.2g}"),
        ),
        Fit("records to score", True, f"force at {settings.sensor.rate:g} readings a second"),
    ]
    run = 0.06  # [s] in which a crack runs some millimetres
    seen = sensor_delay(settings) + 1.0 / settings.sensor.rate <= 0.5 * run
    found.append(
        Fit(
            "sudden runs as they are",
            seen,
            f"a force is read after {1e3 * (sensor_delay(settings) + 1.0 / settings.sensor.rate):.0f} ms",
        )
    )
    return found


def suitability_lines(settings: RigSettings) -> list[str]:
    """Return decisions, ways and tasks as lines of text."""
    shown = [
        f"decisions: {decisions(settings)} a second at most (control_hz), each of which sees what the last one did"
    ]
    shown.append(f"ways to rest from {1e3 * top_speed(settings):.1f} mm/s, as stated:")
    for what, way in stopping_ways(settings).items():
        shown.append(f"  {what:<24} {'not stated by its driver' if math.isnan(way) else f'{1e3 * way:.2f} mm'}")
    return [*shown, "what it can do:", *(f"  {each}" for each in fits(settings))]
