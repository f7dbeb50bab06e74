"""Trial of a fault in real time: a rig cuts on an emulated one, a fault occurs, and the outcome is recorded.

Times are those of the machine's monotonic clock, which is the same in all its processes; the emulator reports the
motion of the blade.  ``scripts/validation/rig/rig_faults.py`` runs many trials and prints the table.
"""

from __future__ import annotations

import math
import threading
import time
from dataclasses import dataclass
from typing import Any

from cutenv.drivers.grbl_axis import PIECE, SENT_AHEAD
from cutenv.emulation.control_port import EmulatorControl
from cutenv.rig.config.settings import RigSettings
from cutenv.rig.devices.canopen.network import DRIVE_PATIENCE
from cutenv.rig.devices.serial.board import BOARD_PATIENCE
from cutenv.rig.devices.serial.board_drivers import sensor_delay
from cutenv.rig.safety.stop_causes import Cause, RigStopped, StopReport, detection_times
from scripts.validation.rig.cutting_rig import PERIOD, SLOW, SPEED, UPRIGHT, WATCHED, CuttingRig, pace_of

SENSOR_DELAY = 0.010  # delay of the emulated sensor's readings, as in the simulated one [s]
WAY = 0.003
"""Allowance beyond a stated time [s]: a millisecond of the emulator, transport of a frame or packet, an event."""
PATIENCE = {"serial": BOARD_PATIENCE, "grbl": SENT_AHEAD + PIECE}
"""Time for which a blade goes on without its computer, by driver [s]."""
_WINDOW = 0.1  # [s], over which lost readings are counted
_DIES = 0.010  # [s] that the system takes to end a killed process, whose threads run until then
_STAYS = 5e-5  # [m] by which a stopped carriage may still give way
_STANDS_WITHIN = 1.0  # [s] of detection
_UNSTOPPED = 3.0  # [s] without a stop, after which a trial ends
_LAG = 0.040  # [s], time constant of the velocity loop

OWN = ("nan_command", "exception", "late_policy", "sigterm", "ctrl_c", "parent_death", "kill_9")
"""Faults on the rig's own side of the wires."""
GAP = 0.060  # duration for which a bus is off that comes back before the drive's own watchdog expires [s]
GAPS = {"bus_gap": "bus_off"}  # faults of the emulator that end by themselves after GAP: a frame sent meanwhile is lost
IN_CHILD = ("sigterm", "ctrl_c", "parent_death", "kill_9")

EXPECTED: dict[str, tuple[Cause, ...]] = {
    "bad_status": (Cause.FORCE_STATUS,),
    "bus_off": (Cause.MOTION_STALE,),
    "bus_gap": (Cause.MOTION_STALE,),
    "doubled_frames": (Cause.MOTION_DOUBLED,),
    "drive_fault": (Cause.DRIVE,),
    "following_error": (Cause.ACCELERATION, Cause.FOLLOWING, Cause.STUCK, Cause.DRIVE),
    "heartbeat_lost": (Cause.HEARTBEAT,),
    "latency": (Cause.FORCE_STALE, Cause.FORCE_LATE),
    "over_force": (Cause.FORCE, Cause.FORCE_RISE),
    "packet_loss": (Cause.FORCE_LOST,),
    "power_loss": (Cause.MOTION_STALE,),
    "reordering": (Cause.FORCE_LOST,),
    "runaway": (Cause.FOLLOWING, Cause.SPEED, Cause.ACCELERATION),
    "saturation": (Cause.FORCE_STATUS, Cause.FORCE, Cause.FORCE_RISE),
    "second_master": (Cause.FOREIGN,),
    "axis_freeze": (Cause.FORCE_AXIS,),
    "sensor_freeze": (Cause.FORCE_FROZEN,),
    "sensor_silent": (Cause.FORCE_STALE,),
    "slip": (),
    "stuck_encoder": (Cause.ACCELERATION, Cause.STUCK, Cause.FOLLOWING, Cause.DRIVE),
    "nan_command": (Cause.NOT_A_NUMBER,),
    "exception": (Cause.EXCEPTION,),
    "late_policy": (Cause.OVERRUN,),
    "sigterm": (Cause.INTERRUPTED,),
    "ctrl_c": (Cause.INTERRUPTED,),
    "parent_death": (Cause.ORPHANED,),
    "kill_9": (Cause.HEARTBEAT,),
}
"""Causes as which each fault may be detected: for example, a stuck encoder with speed zero is an acceleration.  A
carriage that slips behind its motor's encoder cannot be detected; it stands, or moves less than commanded."""
_OF_EITHER: dict[str, tuple[Cause, ...]] = {
    "no answer": (Cause.HEARTBEAT,),
    "cable out": (Cause.MOTION_STALE,),
    "power loss": (Cause.MOTION_STALE,),
    "wrong position": (Cause.SPEED,),
    "stuck encoder": (Cause.STUCK, Cause.FOLLOWING, Cause.DRIVE),
    "limit switch": (Cause.DRIVE,),
    "error of the drive": (Cause.DRIVE,),
    "runaway": (Cause.FOLLOWING, Cause.SPEED),
    "second master": (Cause.FOREIGN,),
    "quick stop not obeyed": (Cause.FORCE_STALE,),
}
EXPECTED_ACROSS: dict[str, dict[str, tuple[Cause, ...]]] = {
    "height": {
        **_OF_EITHER,
        "cannot be lowered": (Cause.STUCK, Cause.FOLLOWING, Cause.DRIVE),
        "cannot be raised": (Cause.NOT_RAISED,),
        "vertical force": (Cause.VERTICAL_FORCE,),
    },
    "side": {
        **_OF_EITHER,
        "cannot go right": (Cause.STUCK, Cause.FOLLOWING, Cause.DRIVE),
        "cannot go left": (Cause.STUCK, Cause.FOLLOWING, Cause.DRIVE),
        "force to the side": (Cause.FORCE, Cause.FORCE_RISE),
    },
}
"""Causes as which the faults of an axis across the cut may be detected, see ``cross_trials.py``."""
EXPECTED_OF_SERIAL: dict[str, tuple[Cause, ...]] = {
    "cable_out": (Cause.BUS,),
    "board_restart": (Cause.DRIVE, Cause.FORCE_STATUS),
    "board_deaf": (Cause.DRIVE,),
    "board_mute": (Cause.MOTION_STALE, Cause.FORCE_STALE),
    "damaged_lines": (Cause.FORCE_LOST, Cause.FORCE_STALE, Cause.MOTION_STALE),
    "lost_lines": (Cause.FORCE_LOST, Cause.FORCE_STALE, Cause.MOTION_STALE),
    "noise": (Cause.MOTION_STALE, Cause.FORCE_STALE),
    "doubled_lines": (Cause.MOTION_DOUBLED,),
    "latency": (Cause.MOTION_STALE, Cause.FORCE_STALE),
    "stop_button": (Cause.DRIVE,),
    "limit_switch": (Cause.DRIVE,),
    "blocked": (),
    "cell_silent": (Cause.FORCE_STALE,),
    "cell_frozen": (Cause.FORCE_FROZEN,),
    "cell_saturated": (Cause.FORCE_STATUS,),
    "cell_wire_off": (Cause.FORCE, Cause.FORCE_RISE),
    "over_force": (Cause.FORCE, Cause.FORCE_RISE),
    **{fault: EXPECTED[fault] for fault in OWN},
}
"""Causes as which the faults of a serial rig may be detected. A motor that loses steps cannot be: it has no encoder."""
_OF_GRBL: dict[str, tuple[Cause, ...]] = {
    "grbl_cable_out": (Cause.BUS,),
    "grbl_deaf": (Cause.MOTION_STALE, Cause.HEARTBEAT),
    "grbl_mute": (Cause.MOTION_STALE, Cause.HEARTBEAT, Cause.STUCK, Cause.FOLLOWING),
    "grbl_damaged_lines": (Cause.MOTION_STALE, Cause.HEARTBEAT, Cause.STUCK, Cause.FOLLOWING, Cause.SPEED),
    "grbl_lost_lines": (Cause.MOTION_STALE, Cause.HEARTBEAT, Cause.STUCK, Cause.FOLLOWING),
    "grbl_noise": (Cause.MOTION_STALE, Cause.HEARTBEAT),
    "grbl_doubled_lines": (),
    "grbl_latency": (Cause.MOTION_STALE, Cause.HEARTBEAT, Cause.FOLLOWING),
    "grbl_restart": (Cause.DRIVE,),
    "grbl_alarm": (Cause.DRIVE,),
    "feed_hold": (),
    "cancel_ignored": (Cause.FORCE, Cause.FORCE_RISE),
    "board_cable_out": (Cause.FORCE_STALE,),
    "board_restart": (Cause.FORCE_STALE, Cause.FORCE_STATUS, Cause.FORCE_LOST),
    "board_mute": (Cause.FORCE_STALE,),
}
EXPECTED_OF_GRBL: dict[str, tuple[Cause, ...]] = {  # causes as which the faults of a rig with GRBL may be detected
    **_OF_GRBL,
    **{fault: causes for fault, causes in EXPECTED_OF_SERIAL.items() if fault.startswith("cell_")},
    "over_force": EXPECTED["over_force"],
    "blocked": (),
    **{fault: EXPECTED[fault] for fault in OWN},
}
WITH = {"cancel_ignored": "over_force"}
"""Faults that only show when the blade is stopped, and what is injected with each for that."""
UNKNOWABLE = ("slip", "blocked", "feed_hold", "grbl_doubled_lines")
"""Faults that nothing here can detect: the carriage stands, or moves less than commanded.  GRBL goes on after a feed
hold with the next jogs; a report of its that comes twice is as true as the first, and does no harm."""
SPOILS = (  # faults after which a rig is set up anew: nobody knows where its carriage is, or its port has gone
    "slip", "blocked", "cable_out", "board_restart", "grbl_cable_out", "grbl_restart", "grbl_alarm", "board_cable_out",
    "cancel_ignored",
)  # fmt: skip
BY_THE_DRIVE = (
    "bus_off", "power_loss", "kill_9", "cable out", "power loss", "cable_out", "board_deaf", "board_restart",
    "stop_button", "limit_switch", "grbl_cable_out", "grbl_deaf", "grbl_alarm", "grbl_restart",
)  # fmt: skip
"""Faults in which no command reaches the drive, or it has stopped before: its own watch stops it, or it coasts."""


def stated_detection(fault: str, cause: Cause, settings: RigSettings) -> float | None:
    """Return the longest time from a fault to the decision to stop for that cause, from what grows at this speed [s].

    None for readings out of order, of which about a fifth are lost, as many as are allowed; and for lines that are lost
    by chance: some get through.
    """
    if fault in ("reordering", "damaged_lines", "lost_lines", "grbl_damaged_lines", "grbl_lost_lines"):
        return None
    limits, (speed, period) = settings.limits, pace_of(settings)
    slow, patience = settings.blade.driver in SLOW, PATIENCE.get(settings.blade.driver, DRIVE_PATIENCE)
    if fault == "kill_9":
        ramp = speed / settings.blade.acceleration if settings.blade.driver == "grbl" else 0.0
        return patience + _DIES + ramp  # the drive's own watchdog; with GRBL, the jogs that it has, to their end
    stated = detection_times(limits, packet=1.0 / settings.sensor.rate, sync=settings.bus.sync)[cause]
    if fault == "cell_wire_off":
        stated += 2.0 / settings.sensor.rate  # a reading may lie within the limit by chance
    if fault == "board_restart" and cause is Cause.FORCE_STATUS:
        stated += 1.0 / settings.sensor.rate  # the first reading after it
    if fault == "board_deaf":
        stated += BOARD_PATIENCE
    if cause is Cause.FORCE_LOST:
        stated += _WINDOW
    if cause is Cause.FOLLOWING:
        # A blade that stands falls back by its speed; one that runs away gains ever more, by its acceleration.
        gained = math.sqrt(2.0 * limits.following / settings.blade.acceleration)
        stated += limits.following / speed if fault != "runaway" else gained + _LAG
    if cause is Cause.SPEED:
        stated += (limits.speed - speed) / settings.blade.acceleration + _LAG
    if cause is Cause.OVERRUN:
        stated += period * limits.overrun
    if fault in ("over_force", "cancel_ignored"):
        stated += sensor_delay(settings) if slow else SENSOR_DELAY
    if fault == "parent_death":
        stated += _DIES
    return stated


@dataclass(kw_only=True)
class Trial:
    """Outcome of one fault; times of the machine's clock [s], None for what did not happen."""

    fault: str
    seed: int
    injected: float
    speed: float  # speed of the carriage just before, if the fault is the rig's own; else the commanded one [m/s]
    commanded: float = SPEED  # commanded speed [m/s]
    cause: str | None = None
    detail: str = ""
    stated: float | None = None  # longest time from the fault to the decision, as stated [s]
    crossed: float | None = None  # time at which the true force passed the limit
    detected: float | None = None
    received: float | None = None  # time at which the drive received the quick stop
    standstill: float | None = None
    way: float | None = None  # travel of the carriage from the fault to its rest [m]
    way_detected: float | None = None  # travel after the decision, by the rig's own report [m]
    refused: bool = False  # true if commands were refused afterwards
    moved: float | None = None  # displacement half a second later, from where it had come to rest [m]
    driver: str = ""  # driver of the blade
    stalls: list[float] | None = None  # lateness of the host's processes around the trial [s]

    @property
    def expected(self) -> tuple[Cause, ...]:
        """Causes as which the fault may be detected."""
        of_grbl = EXPECTED_OF_GRBL if self.driver == "grbl" else {}
        across = EXPECTED_ACROSS["height"] | EXPECTED_ACROSS["side"]
        return (EXPECTED | across | EXPECTED_OF_SERIAL | of_grbl)[self.fault]

    @property
    def before(self) -> bool:
        """True if the rig had stopped before the fault, or for the tissue's own force: not a trial of it."""
        early = self.detected is not None and self.detected < self.injected - WAY
        by_tissue = self.crossed is not None and Cause.FORCE not in self.expected and self.cause == Cause.FORCE
        return early or by_tissue or self.speed < 0.5 * self.commanded

    @property
    def stopped(self) -> bool:
        """True if the blade came to rest in time after a decision."""
        late = _since(self.standstill, self.detected)
        return late is not None and late < _STANDS_WITHIN

    @property
    def latched(self) -> bool:
        """True if it stayed at rest."""
        return self.refused and self.moved is not None and abs(self.moved) < _STAYS

    @property
    def times(self) -> dict[str, float | None]:
        """Times from fault to decision, from there to the quick stop on the bus, and to standstill [s]."""
        return {
            "detection": _since(self.detected, self.injected),
            "quick_stop": _since(self.received, self.detected),
            "standstill": _since(self.standstill, self.detected),
        }

    @property
    def late(self) -> str | None:
        """By how much it was detected later than stated, or None: the host's delays below a stall may add up to it."""
        detection = self.times["detection"]
        if detection is None or self.stated is None or detection <= self.stated + WAY:
            return None
        return f"found out after {1e3 * detection:.1f} ms, stated are {1e3 * self.stated:.1f}"

    def wrong(self) -> list[str]:
        """Return what is not as promised; the host's stalls excuse only a late decision, or another one."""
        if self.fault in UNKNOWABLE:
            return [] if self.cause is None or self.stalls else [f"stopped for {self.cause}, which cannot be known"]
        found = []
        if self.cause is None or (self.cause not in self.expected and not self.stalls):
            found.append(f"the cause is {self.cause} ({self.detail})")
        if not self.stopped:
            found.append("the blade does not come to rest")
        if not self.latched:
            found.append(f"not latched: refused {self.refused}, moved {self.moved} m")
        quick_stop = self.times["quick_stop"]
        within = GAP if self.fault in GAPS else PERIOD
        if self.fault not in BY_THE_DRIVE and (quick_stop is None or quick_stop > within):
            found.append(f"quick stop on the bus {quick_stop} s after the decision")
        if not self.stalls and self.late is not None:
            found.append(self.late)
        return found


def _since(later: float | None, earlier: float | None) -> float | None:
    return None if later is None or earlier is None else max(later - earlier, 0.0)


class PolicyFailed(RuntimeError):
    """Exception that a policy raises in the trial of an exception."""


def trial(rig: CuttingRig, control: EmulatorControl, fault: str, *, seed: int, after: float) -> Trial:
    """Cut, and inject ``fault`` ``after`` so many seconds; the rig is ready for the next trial then.

    ``fault`` is one of the emulator's, of :data:`GAPS`, or of :data:`OWN` outside of :data:`IN_CHILD`.
    """
    rig.begin(seed)
    since = len(control.events())
    truth, injected, report = _happens(rig, control, fault, after)
    time.sleep(0.1)  # it rests by now, and the sensor of an undetected fault has sent more
    refused = report is not None and rig.refuses()
    events = control.events(since)
    result = put_together(fault, seed, truth, injected, report, events, rig.settings)
    result.refused = refused
    result.moved = moved_since(control, events)
    result.stalls = stalls_around(result, events, rig.host.stalls)
    control.clear()
    if fault in UNKNOWABLE:
        rig.plant.halt()
    if fault in ("power_loss", "exception"):
        time.sleep(WATCHED)
        rig.reopen()
    return result


def _happens(
    rig: CuttingRig, control: EmulatorControl, fault: str, after: float
) -> tuple[dict[str, Any], float | None, StopReport | None]:
    """Cut until the fault has happened and been detected.

    Returns the emulator's state just before, the time of the rig's own fault [s], and the rig's report.
    """
    if fault not in OWN:
        injection = threading.Timer(after, _inject, [control, fault])
        injection.start()
        report = rig.cut(after + (1.0 if fault in UNKNOWABLE else _UNSTOPPED))
        injection.join()
        return {}, None, report
    report = rig.cut(after)
    truth, injected = control.truth(), rig.clock.now()
    if report is not None:
        return truth, injected, report
    if fault == "exception":
        try:
            with rig.session:
                raise PolicyFailed("raised on purpose")
        except PolicyFailed:
            return truth, injected, rig.plant.supervisor.report
    if fault == "late_policy":
        time.sleep(0.2)
    try:
        rig.plant.advance(math.nan if fault == "nan_command" else rig.speed, UPRIGHT, round(1e3 * rig.period))
    except RigStopped as stop:
        return truth, injected, stop.report
    return truth, injected, None


def _inject(control: EmulatorControl, fault: str) -> None:
    control.inject(GAPS.get(fault, fault))
    if fault in WITH:
        control.inject(WITH[fault])
    if fault in GAPS:
        time.sleep(GAP)
        control.clear(GAPS[fault])


def put_together(
    fault: str,
    seed: int,
    truth: dict[str, Any],
    injected: float | None,
    report: StopReport | None,
    events: list[dict[str, Any]],
    settings: RigSettings,
) -> Trial:
    """Combine the reports of the rig and the emulator's events."""
    if injected is None:
        event = last_injected(events)
        injected, start, speed = event["time_s"], event["position_m"], pace_of(settings)[0]
    else:
        speed = truth["speed_m_s"]
        start = truth["position_m"] + speed * (injected - truth["time_s"])
    later = [event for event in events if event["time_s"] >= injected - WAY and event.get("axis") in (None, "blade")]

    def first(what: str) -> float | None:
        return next((event["time_s"] for event in later if event["what"] == what), None)

    rests = [event for event in later if event["what"] == "standstill"]
    result = Trial(
        fault=fault,
        seed=seed,
        injected=injected,
        speed=speed,
        commanded=pace_of(settings)[0],
        driver=settings.blade.driver,
        crossed=first("force limit crossed"),
        received=first("quick stop received"),
        standstill=rests[-1]["time_s"] if rests else None,
    )
    if fault == "kill_9":  # the spine is killed: nothing is left to report
        lost = first("heartbeat of the master lost") or first("jogs made")
        result.cause, result.detected = (None, None) if lost is None else (Cause.HEARTBEAT, lost)
    elif report is not None:
        result.cause, result.detail, result.detected = report.cause, report.detail, report.detected
        result.way_detected = report.distance_to_standstill
    if result.cause is not None:
        result.stated = stated_detection(fault, Cause(result.cause), settings)
    if rests:
        result.way = rests[-1]["position_m"] - start
    return result


def last_injected(events: list[dict[str, Any]]) -> dict[str, Any]:
    """Return the event of the fault that stops the blade: of two, one after the other, the first by itself does not."""
    return [event for event in events if event["what"] == "fault injected"][-1]


def moved_since(control: EmulatorControl, events: list[dict[str, Any]]) -> float | None:
    """Return the distance of the carriage from where it came to rest last [m]."""
    rests = [event["position_m"] for event in events if event["what"] == "standstill"]
    return control.truth()["position_m"] - rests[-1] if rests else None


def stalls_around(result: Trial, events: list[dict[str, Any]], own: list[tuple[float, float]]) -> list[float]:
    """Return the lateness of emulator and rig between shortly before the fault and the blade's rest [s]."""
    stalls = own + [(event["time_s"], event["late_s"]) for event in events if event["what"] == "stall"]
    ends = max(result.standstill or 0.0, result.detected or 0.0, result.injected)
    return [late for ended, late in stalls if ended >= result.injected - PERIOD and ended - late <= ends]
