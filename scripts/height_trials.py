"""Trials of the faults of a height axis in real time: blade and height axis move in air when the fault occurs.

``scripts/rig_faults.py --height`` runs many of them and prints the table.
"""

from __future__ import annotations

import math
import threading
import time
from typing import Any, NamedTuple

from cutting_rig import PERIOD, SPEED, UPRIGHT, WATCHED, CuttingRig
from rig_trials import EXPECTED_OF_HEIGHT, WAY, Trial, stalls_around

from cutenv.rig.config.settings import RigSettings
from cutenv.rig.emulator.control import EmulatorControl
from cutenv.rig.operation.preflight import SETTLE, return_inside
from cutenv.rig.safety.stop_causes import Cause, RigStopped, StopReport, detection_times

DESCENT_SPEED = 0.003
"""Speed downwards, or upwards where the fault is one of raising [m/s]."""
_LAG = 0.040  # [s], time constant of the velocity loop
_UNSTOPPED = 3.0  # [s] without a stop, after which a trial ends
_FROM = 0.006  # [m] height from which the blade descends, and depth from which it is raised
_TRAVEL = 0.010  # [m/s] to where a trial starts
_NEAR, _FAR = 0.01, 0.07  # [m] between which the blade moves
_RUNAWAY, _SHIFT, _PRESSED = -0.02, 0.002, -14.0  # [m/s], [m], [N]
_FROM_LIMIT_SWITCH = 0x8A80


class HeightFault(NamedTuple):
    """Fault of the emulator as a trial injects it.

    Attributes
    ----------
    emulated : str
        Name among :data:`cutenv.rig.emulator.faults.FAULTS`.
    given : dict
        Its parameters.
    raises : bool
        True if the blade is being raised when it occurs; else it descends.
    """

    emulated: str
    given: dict[str, Any]
    raises: bool = False


_AXIS = {"axis": "height"}
HEIGHT_FAULTS: dict[str, HeightFault] = {
    "no answer": HeightFault("heartbeat_lost", _AXIS),
    "cable out": HeightFault("bus_off", _AXIS),
    "power loss": HeightFault("power_loss", _AXIS),
    "wrong position": HeightFault("wrong_position", {**_AXIS, "shift": _SHIFT}),
    "stuck encoder": HeightFault("stuck_encoder", _AXIS),
    "cannot be lowered": HeightFault("following_error", _AXIS),
    "cannot be raised": HeightFault("cannot_be_raised", _AXIS, raises=True),
    "limit switch": HeightFault("drive_fault", {**_AXIS, "code": _FROM_LIMIT_SWITCH}),
    "error of the drive": HeightFault("drive_fault", _AXIS),
    "runaway": HeightFault("runaway", {**_AXIS, "speed": _RUNAWAY}),
    "second master": HeightFault("second_master", {**_AXIS, "speed": -0.01}),
    "quick stop not obeyed": HeightFault("deaf", _AXIS),
    "vertical force": HeightFault("over_lift", {"force_N": _PRESSED}),
}
"""Every fault of the table; the one of the quick stop occurs together with a sensor that falls silent."""


class RaisingRig(CuttingRig):
    """A rig with a height axis that moves to and fro and down or up in air, made ready again after every stop."""

    def begin_height(self, *, raises: bool) -> None:
        """Reset, make ready, and go to where a trial starts; stopped by a busy host on the way, it tries again."""
        self._raises = raises
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
        plant.raise_to(-_FROM if self._raises else _FROM, speed=_TRAVEL)
        if not _NEAR < plant.position < _FAR:
            plant.travel(_NEAR + 0.01, speed=_TRAVEL, angle=UPRIGHT)
        self._way = SPEED if plant.position < 0.5 * (_NEAR + _FAR) else -SPEED
        plant.begin()

    def move(self, seconds: float) -> StopReport | None:
        """Move for ``seconds``; return the report of a stop on the way."""
        ends = self.clock.now() + seconds
        descent = -DESCENT_SPEED if self._raises else DESCENT_SPEED
        try:
            while self.clock.now() < ends:
                self.plant.advance(self._way, UPRIGHT, round(1e3 * PERIOD), descent)
        except RigStopped as stop:
            return stop.report
        return None


def stated_detection_of_height(fault: str, cause: Cause, settings: RigSettings) -> float:
    """Return the longest time from a fault to the decision to stop for that cause, at the speed of the trials [s]."""
    axis = settings.require_height_axis(by="the trials")
    stated = detection_times(settings.limits, sync=settings.bus.sync)[cause]
    if cause in (Cause.FOLLOWING, Cause.NOT_RAISED) and fault == "runaway":
        stated += math.sqrt(2.0 * axis.following / axis.acceleration) + _LAG
    elif cause is Cause.FOLLOWING:
        stated += axis.following / DESCENT_SPEED
    if cause is Cause.SPEED and fault == "runaway":
        stated += (axis.fastest - DESCENT_SPEED) / axis.acceleration + _LAG
    return stated


def height_trial(rig: RaisingRig, control: EmulatorControl, fault: str, *, seed: int, after: float) -> Trial:
    """Move, and inject ``fault`` after so many seconds; the rig is ready for the next trial then."""
    injected = HEIGHT_FAULTS[fault]
    rig.begin_height(raises=injected.raises)
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
    result.moved = _moved_since(control, events)
    result.stalls = stalls_around(result, events, rig.host.stalls)
    control.clear()
    if fault in ("power loss", "cable out"):
        time.sleep(WATCHED)
        rig.reopen()
    return result


def _inject(control: EmulatorControl, fault: HeightFault) -> None:
    control.inject(fault.emulated, **fault.given)
    if fault.emulated == "deaf":  # by itself it is no cause of a stop
        control.inject("sensor_silent")


def _put_together(
    fault: str, seed: int, report: StopReport | None, events: list[dict[str, Any]], settings: RigSettings
) -> Trial:
    """Combine the reports of the rig and the emulator's events; the way is that of the height axis."""
    begun = next(event for event in events if event["what"] == "fault injected")
    injected = begun["time_s"]
    later = [event for event in events if event["time_s"] >= injected - WAY]
    quick_stops = [e["time_s"] for e in later if e["what"] == "quick stop received" and e["axis"] == "height"]
    rests = [event for event in later if event["what"] == "standstill"]
    result = Trial(
        fault=fault,
        seed=seed,
        injected=injected,
        speed=SPEED,
        received=quick_stops[0] if quick_stops else None,
        standstill=rests[-1]["time_s"] if rests else None,
        way=abs(rests[-1]["height_m"] - begun["height_m"]) if rests else None,
    )
    if report is not None:
        result.cause, result.detail, result.detected = report.cause, report.detail, report.detected
        result.stated = stated_detection_of_height(fault, Cause(report.cause), settings)
    assert fault in EXPECTED_OF_HEIGHT, fault
    return result


def _moved_since(control: EmulatorControl, events: list[dict[str, Any]]) -> float | None:
    """Return the greater distance, along the cut or in height, from where both came to rest last [m]."""
    rests = [event for event in events if event["what"] == "standstill"]
    if not rests:
        return None
    truth = control.truth()
    return max((truth[name] - rests[-1][name] for name in ("position_m", "height_m")), key=abs)
