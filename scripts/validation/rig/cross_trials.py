"""Trials of the faults of an axis across the cut in real time: it and the blade move in air when the fault occurs.

``scripts/validation/rig/rig_faults.py --height`` and ``--side`` run many of them and print the table.
"""

from __future__ import annotations

import math
import threading
import time
from typing import Any, NamedTuple

from cutenv.emulation.control_port import EmulatorControl
from cutenv.rig.config.settings import RigSettings
from cutenv.rig.operation.preflight import SETTLE, return_inside
from cutenv.rig.safety.stop_causes import Cause, RigStopped, StopReport, detection_times
from scripts.validation.rig.cutting_rig import PERIOD, SPEED, UPRIGHT, WATCHED, CuttingRig
from scripts.validation.rig.rig_trials import EXPECTED_ACROSS, WAY, Trial, last_injected, stalls_around

ACROSS_SPEED = 0.003  # speed downwards, or to the right; upwards, or to the left, where the fault is of that way [m/s]
_LAG = 0.040  # [s], time constant of the velocity loop
_UNSTOPPED = 3.0  # [s] without a stop, after which a trial ends
_FROM = 0.006  # [m] place from which the blade descends or goes to the right; below or opposite it goes back
_TRAVEL = 0.010  # [m/s] to where a trial starts
_NEAR, _FAR = 0.01, 0.07  # [m] between which the blade moves
_RUNAWAY, _SHIFT = {"height": -0.02, "side": -0.035}, 0.002  # [m/s], [m]
_PRESSED, _PUSHED = -14.0, 25.0  # [N]
_FROM_LIMIT_SWITCH = 0x8A80


class CrossFault(NamedTuple):
    """Fault of the emulator as a trial injects it."""

    emulated: str  # name among :data:`cutenv.emulation.emulated_bench.FAULTS`
    given: dict[str, Any]
    forward: bool = False  # the blade is being raised, or goes to the left; else it descends, or goes to the right


def _faults(axis: str) -> dict[str, CrossFault]:
    """Return the faults of the table that both axes have."""
    on = {"axis": axis}
    return {
        "no answer": CrossFault("heartbeat_lost", on),
        "cable out": CrossFault("bus_off", on),
        "power loss": CrossFault("power_loss", on),
        "wrong position": CrossFault("wrong_position", {**on, "shift": _SHIFT}),
        "stuck encoder": CrossFault("stuck_encoder", on),
        "limit switch": CrossFault("drive_fault", {**on, "code": _FROM_LIMIT_SWITCH}),
        "error of the drive": CrossFault("drive_fault", on),
        "runaway": CrossFault("runaway", {**on, "speed": _RUNAWAY[axis]}),
        "second master": CrossFault("second_master", {**on, "speed": -0.01}),
        "quick stop not obeyed": CrossFault("deaf", on),
    }


CROSS_FAULTS: dict[str, dict[str, CrossFault]] = {
    "height": {
        **_faults("height"),
        "cannot be lowered": CrossFault("following_error", {"axis": "height"}),
        "cannot be raised": CrossFault("cannot_be_raised", {"axis": "height"}, forward=True),
        "vertical force": CrossFault("over_lift", {"force_N": _PRESSED}),
    },
    "side": {
        **_faults("side"),
        "cannot go right": CrossFault("following_error", {"axis": "side"}),
        "cannot go left": CrossFault("cannot_be_raised", {"axis": "side"}, forward=True),
        "force to the side": CrossFault("side_push", {"force_N": _PUSHED}),
    },
}
"""Every fault of the table, by axis; the one of the quick stop occurs together with a sensor that falls silent."""


class CrossingRig(CuttingRig):
    """A rig with an axis across the cut, both of which move to and fro in air, made ready again after every stop."""

    @property
    def axis(self) -> str:
        """Name of the axis across the cut."""
        (name,) = self.settings.cross_axes
        return name

    def begin_across(self, *, forward: bool) -> None:
        """Reset, make ready, and go to where a trial starts; stopped by a busy host on the way, it tries again."""
        self._across = ACROSS_SPEED if forward else -ACROSS_SPEED
        self.begin(0)

    def _begin(self, seed: int, specimen_class: str) -> None:
        plant, clock = self.plant, self.clock
        plant.supervisor.reset(agreed=True)
        plant.power()
        clock.sleep_until(clock.now() + SETTLE)
        if plant.supervisor.beyond is not None:
            return_inside(plant)
        if not self._laid:
            plant.supervisor.lock()
            plant.tare()
            self._laid = True
        self.session.start()
        plant.carry(self.axis, math.copysign(_FROM, -self._across), speed=_TRAVEL)
        if not _NEAR < plant.position < _FAR:
            plant.travel(_NEAR + 0.01, speed=_TRAVEL, angle=UPRIGHT)
        self._way = SPEED if plant.position < 0.5 * (_NEAR + _FAR) else -SPEED
        plant.begin()

    def move(self, seconds: float) -> StopReport | None:
        """Move for ``seconds``; return the report of a stop on the way."""
        ends, way, rise = self.clock.now() + seconds, self._way, self._across
        if self.axis == "side":  # the speed is where the blade points
            self.plant.heading.begin(math.atan(self._across / self._way))
            way, rise = math.copysign(math.hypot(self._way, self._across), self._way), 0.0
        try:
            while self.clock.now() < ends:
                self.plant.advance(way, UPRIGHT, round(1e3 * PERIOD), -rise)
        except RigStopped as stop:
            return stop.report
        return None


def stated_detection_across(fault: str, cause: Cause, settings: RigSettings) -> float:
    """Return the longest time from a fault to the decision to stop for that cause, at the speed of the trials [s]."""
    (axis,) = settings.cross_axes.values()
    stated = detection_times(settings.limits, sync=settings.bus.sync)[cause]
    if cause in (Cause.FOLLOWING, Cause.NOT_RAISED) and fault == "runaway":
        stated += math.sqrt(2.0 * axis.following / axis.acceleration) + _LAG
    elif cause is Cause.FOLLOWING:
        stated += axis.following / ACROSS_SPEED
    if cause is Cause.SPEED and fault == "runaway":
        stated += (axis.fastest - ACROSS_SPEED) / axis.acceleration + _LAG
    return stated


def cross_trial(rig: CrossingRig, control: EmulatorControl, fault: str, *, seed: int, after: float) -> Trial:
    """Move, and inject ``fault`` after so many seconds; the rig is ready for the next trial then."""
    injected = CROSS_FAULTS[rig.axis][fault]
    rig.begin_across(forward=injected.forward)
    since = len(control.events())
    injection = threading.Timer(after, _inject, [control, injected])
    injection.start()
    report = rig.move(after + _UNSTOPPED)
    injection.join()
    time.sleep(0.3 if fault == "quick stop not obeyed" else 0.1)  # it rests by now
    refused = report is not None and rig.refuses()
    events = control.events(since)
    result = _put_together(fault, seed, report, events, rig.settings)
    result.refused = refused
    result.moved = _moved_since(control, events, rig.axis)
    result.stalls = stalls_around(result, events, rig.host.stalls)
    control.clear()
    if fault in ("power loss", "cable out"):
        time.sleep(WATCHED)
        rig.reopen()
    return result


def _inject(control: EmulatorControl, fault: CrossFault) -> None:
    control.inject(fault.emulated, **fault.given)
    if fault.emulated == "deaf":  # by itself it is no cause of a stop
        control.inject("sensor_silent")


def _put_together(
    fault: str, seed: int, report: StopReport | None, events: list[dict[str, Any]], settings: RigSettings
) -> Trial:
    """Combine the reports of the rig and the emulator's events; the way is that of the axis across the cut."""
    (axis,) = settings.cross_axes
    begun = last_injected(events)
    injected = begun["time_s"]
    later = [event for event in events if event["time_s"] >= injected - WAY]
    quick_stops = [e["time_s"] for e in later if e["what"] == "quick stop received" and e["axis"] == axis]
    rests = [event for event in later if event["what"] == "standstill"]
    result = Trial(
        fault=fault,
        seed=seed,
        injected=injected,
        speed=SPEED,
        received=quick_stops[0] if quick_stops else None,
        standstill=rests[-1]["time_s"] if rests else None,
        way=abs(rests[-1][f"{axis}_m"] - begun[f"{axis}_m"]) if rests else None,
    )
    if report is not None:
        result.cause, result.detail, result.detected = report.cause, report.detail, report.detected
        result.stated = stated_detection_across(fault, Cause(report.cause), settings)
    assert fault in EXPECTED_ACROSS[axis], fault
    return result


def _moved_since(control: EmulatorControl, events: list[dict[str, Any]], axis: str) -> float | None:
    """Return the greater distance, along the cut or across it, from where both came to rest last [m]."""
    rests = [event for event in events if event["what"] == "standstill"]
    if not rests:
        return None
    truth = control.truth()
    return max((truth[name] - rests[-1][name] for name in ("position_m", f"{axis}_m")), key=abs)
