"""One trial of a fault in real time: a rig cuts on an emulated one, something goes wrong, and what came of it.

Times are those of the machine's monotonic clock, which is the same in all its processes; what the blade really did is
told by the emulator.  ``scripts/rig_faults.py`` makes many trials and prints the table.
"""

from __future__ import annotations

import json
import math
import os
import select
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from cutenv.envs.rig_source import EmulatedSupply
from cutenv.rig.canopen.network import DRIVE_PATIENCE
from cutenv.rig.causes import Cause, RigStopped, StopReport, detection_times
from cutenv.rig.drivers import RigError
from cutenv.rig.emulator.control import EmulatorControl
from cutenv.rig.emulator.faults import FAULTS
from cutenv.rig.emulator.process import RunningEmulator, emulated_settings
from cutenv.rig.hardware import rig_plant
from cutenv.rig.operator import AutomaticOperator
from cutenv.rig.preparation import SETTLE
from cutenv.rig.session import RigSession
from cutenv.rig.settings import RigSettings
from cutenv.rig.supply import SpecimenKey
from cutenv.tissue.specimen import Specimen

SPEED = 0.015
"""Of the cuts [m/s]."""
PERIOD = 0.020
"""From command to command [s]."""
SENSOR_DELAY = 0.010
"""By which the emulated sensor's readings are behind the force, as the simulated one's [s]."""
STALL = 0.005
"""Lateness of a thread that should run every 2 ms, from which the host counts as stalled [s]."""
_WATCHED = 0.002  # [s]
_WAY = 0.003  # [s]: a millisecond of the emulator, a frame's or packet's way, an event's
_WINDOW = 0.1  # [s], over which lost readings are counted
_UPRIGHT = math.pi / 2
_DIES = 0.010  # [s] that the system takes to end a killed process, whose threads go on until then
_FAR = 0.09  # [m], from which the cut goes on in another specimen
_STAYS = 5e-5  # [m]: what a stopped carriage may still give way
_LATCHED_FOR = 0.5  # [s]
_STANDS_WITHIN = 1.0  # [s] of detection
_UNSTOPPED = 3.0  # [s] without a stop, after which a trial ends
_BACK = 0.02  # [m/s], to the clamp
_LAG = 0.040  # [s] of the velocity loop
_ATTEMPTS = 5  # to begin a cut
_PATIENCE = 60.0  # [s] with a child process

OWN = ("nan_command", "exception", "late_policy", "sigterm", "ctrl_c", "parent_death", "kill_9")
"""Faults on the rig's own side of the wires."""
IN_CHILD = ("sigterm", "ctrl_c", "parent_death", "kill_9")

EXPECTED: dict[str, tuple[Cause, ...]] = {
    "bad_status": (Cause.FORCE_STATUS,),
    "bus_off": (Cause.MOTION_STALE,),
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
"""What each fault may be found out as: a stuck encoder that shows speed zero at once is an acceleration, say.  A
carriage that slips behind its motor's encoder is seen by nobody; it stands, or goes less far than it is told."""
BY_THE_DRIVE = ("bus_off", "power_loss", "kill_9")
"""Faults in which no frame gets to the drive: its own watch for the heartbeat stops it, or it coasts."""


def stated_detection(fault: str, cause: Cause, settings: RigSettings) -> float | None:
    """Longest time from a fault to the decision to stop it for that cause, of what grows at this speed [s].

    None for readings that overtake each other: about a fifth of them are lost, as many as are allowed.
    """
    if fault == "reordering":
        return None
    if fault == "kill_9":
        return DRIVE_PATIENCE + _DIES  # of the drive's own watch
    limits = settings.limits
    stated = detection_times(limits, sync=settings.bus.sync)[cause]
    if cause is Cause.FORCE_LOST:
        stated += _WINDOW
    if cause is Cause.FOLLOWING:
        # A blade that stands falls back by its speed; one that runs away gains ever more, by its acceleration.
        gained = math.sqrt(2.0 * limits.following / settings.blade.acceleration)
        stated += limits.following / SPEED if fault != "runaway" else gained + _LAG
    if cause is Cause.SPEED:
        stated += (limits.speed - SPEED) / settings.blade.acceleration + _LAG
    if cause is Cause.OVERRUN:
        stated += PERIOD * limits.overrun
    if fault == "over_force":
        stated += SENSOR_DELAY
    if fault == "parent_death":
        stated += _DIES
    return stated


@dataclass(kw_only=True)
class Trial:
    """What came of one fault; times of the machine's clock [s], None for what did not happen."""

    fault: str
    seed: int
    injected: float
    speed: float
    """Of the carriage just before, if the fault is the rig's own; else as it was told [m/s]."""
    cause: str | None = None
    detail: str = ""
    stated: float | None = None
    """From the fault to the decision, at the longest [s]."""
    crossed: float | None = None
    """When the true force passed the limit."""
    detected: float | None = None
    received: float | None = None
    """Quick stop, by the drive."""
    standstill: float | None = None
    way: float | None = None
    """Of the carriage, from the fault to its rest [m]."""
    way_detected: float | None = None
    """From the decision on, by the rig's own report [m]."""
    refused: bool = False
    """Whether commands were refused afterwards."""
    moved: float | None = None
    """Half a second later, from where it had come to rest [m]."""
    stalls: list[float] | None = None
    """How late the host's processes were around the trial, one each [s]."""

    @property
    def before(self) -> bool:
        """Whether the rig had stopped before the fault: no trial of it."""
        early = self.detected is not None and self.detected < self.injected - _WAY
        return early or self.speed < 0.5 * SPEED

    @property
    def stopped(self) -> bool:
        """Whether the blade came to rest in time after a decision."""
        late = _since(self.standstill, self.detected)
        return late is not None and late < _STANDS_WITHIN

    @property
    def latched(self) -> bool:
        """Whether it stayed so."""
        return self.refused and self.moved is not None and abs(self.moved) < _STAYS

    @property
    def times(self) -> dict[str, float | None]:
        """From fault to decision, from there to the quick stop on the bus, and to standstill [s]."""
        return {
            "detection": _since(self.detected, self.injected),
            "quick_stop": _since(self.received, self.detected),
            "standstill": _since(self.standstill, self.detected),
        }

    def wrong(self) -> list[str]:
        """What is not as promised; the host's stalls excuse a late decision, or another one, and nothing else."""
        if self.fault == "slip":
            return [] if self.cause is None else [f"stopped for {self.cause}, which nobody can know"]
        found = []
        if self.cause is None or (self.cause not in EXPECTED[self.fault] and not self.stalls):
            found.append(f"the cause is {self.cause} ({self.detail})")
        if not self.stopped:
            found.append("the blade does not come to rest")
        if not self.latched:
            found.append(f"not latched: refused {self.refused}, moved {self.moved} m")
        detection, quick_stop = self.times["detection"], self.times["quick_stop"]
        if self.fault not in BY_THE_DRIVE and (quick_stop is None or quick_stop > PERIOD):
            found.append(f"quick stop on the bus {quick_stop} s after the decision")
        if not self.stalls and detection is not None and self.stated is not None and detection > self.stated + _WAY:
            found.append(f"found out after {1e3 * detection:.1f} ms, stated are {1e3 * self.stated:.1f}")
        return found


def _since(later: float | None, earlier: float | None) -> float | None:
    return None if later is None or earlier is None else max(later - earlier, 0.0)


class HostWatch:
    """Notes when a thread of this process that should run every 2 ms was late: the machine was busy elsewhere."""

    def __init__(self, clock: Any) -> None:
        self.stalls: list[tuple[float, float]] = []
        """When it ran again, and how late [s]."""
        self._last = clock.now()
        self._turns = clock.every(_WATCHED, self._note, "host watch")

    def _note(self, now: float) -> None:
        late, self._last = now - self._last - _WATCHED, now
        if late > STALL:
            self.stalls.append((now, late))

    def stop(self) -> None:
        """Watch no longer."""
        self._turns.stop()


class CuttingRig:
    """A rig that cuts in an emulated one's specimens, made ready again after every stop.

    Parameters
    ----------
    settings : RigSettings
        Of the emulated rig.
    control : EmulatorControl
        To lay specimens.
    """

    def __init__(self, settings: RigSettings, control: EmulatorControl) -> None:
        self.settings, self._supply = settings, EmulatedSupply(control)
        Specimen.drawn(0, 0)  # compiles: a drive would miss this process's heartbeat
        self._open()

    def _open(self) -> None:
        self.session = RigSession(rig_plant(self.settings), AutomaticOperator(self.settings), self._supply)
        self.plant = self.session.plant
        self.clock = self.plant.clock
        self.session.open()
        self.host = HostWatch(self.clock)
        self._laid = False

    def close(self) -> None:
        """Leave the emulated rig."""
        self.host.stop()
        self.session.close()

    def reopen(self) -> None:
        """Connect anew, to a drive that has lost its set-up, or after the session's end."""
        self.close()
        self._open()

    def begin(self, seed: int, *, specimen_class: str = "liver") -> None:
        """Reset, and be ready to cut on; first, and where the specimen ends, lay another at the clamp and tare.

        A busy host may stop the blade on its way: then once more.
        """
        for attempt in range(_ATTEMPTS):
            try:
                return self._begin(seed, specimen_class)
            except RigError:
                if attempt == _ATTEMPTS - 1:
                    raise
                self.plant.halt()

    def _begin(self, seed: int, specimen_class: str) -> None:
        plant, clock = self.plant, self.clock
        specimen = Specimen.drawn(seed, 0, specimen_class=specimen_class)
        plant.supervisor.reset(agreed=True)
        plant.power()
        clock.sleep_until(clock.now() + SETTLE)
        self.session.start()
        if not self._laid or plant.position > _FAR:
            plant.travel(0.0, speed=_BACK, angle=_UPRIGHT)
            plant.supervisor.lock()
            plant.depth = specimen.depth
            self._supply.lay(SpecimenKey(seed=seed, episode=0, specimen=specimen))
            clock.sleep_until(clock.now() + SETTLE)
            plant.tare()
            self._laid = True
            self.session.start()
        plant.begin()

    def cut(self, seconds: float) -> StopReport | None:
        """Cut for that long; the report of a stop on the way."""
        ends = self.clock.now() + seconds
        try:
            while self.clock.now() < ends:
                self.plant.advance(SPEED, _UPRIGHT, round(1e3 * PERIOD))
        except RigStopped as stop:
            return stop.report
        return None

    def refuses(self) -> bool:
        """Whether commands are refused, for half a second."""
        for _ in range(5):
            try:
                self.plant.supervisor.drive(SPEED, _UPRIGHT, PERIOD)
            except RigError:
                self.clock.sleep_until(self.clock.now() + _LATCHED_FOR / 5)
                continue
            return False
        return True


class PolicyFailed(RuntimeError):
    """What a policy raises in the trial of an exception."""


def trial(rig: CuttingRig, control: EmulatorControl, fault: str, *, seed: int, after: float) -> Trial:
    """Cut, and let ``fault`` happen ``after`` so many seconds; the rig is ready for the next trial then.

    ``fault`` is one of the emulator's, or of :data:`OWN` outside of :data:`IN_CHILD`.
    """
    rig.begin(seed)
    since = len(control.events())
    truth, injected, report = _happens(rig, control, fault, after)
    time.sleep(0.1)  # it rests by now, and the sensor of an unseen one has told more
    refused = report is not None and rig.refuses()
    events = control.events(since)
    result = _told(fault, seed, truth, injected, report, events, rig.settings)
    result.refused = refused
    result.moved = _moved(control, events)
    result.stalls = _stalls(result, events, rig.host.stalls)
    control.clear()
    if fault == "slip":
        rig.plant.halt()
    if fault in ("power_loss", "exception"):
        time.sleep(_WATCHED)
        rig.reopen()
    return result


def _happens(
    rig: CuttingRig, control: EmulatorControl, fault: str, after: float
) -> tuple[dict[str, Any], float | None, StopReport | None]:
    """Cut until the fault has happened and been found out.

    What the emulator tells of the carriage just before, when the rig's own fault happened [s], and the rig's report.
    """
    if fault in FAULTS:
        injection = threading.Timer(after, control.inject, [fault])
        injection.start()
        report = rig.cut(after + (1.0 if fault == "slip" else _UNSTOPPED))
        injection.join()
        return {}, None, report
    report = rig.cut(after)
    truth, injected = control.truth(), rig.clock.now()
    if report is not None:
        return truth, injected, report
    if fault == "exception":
        try:
            with rig.session:
                raise PolicyFailed("as it was told to")
        except PolicyFailed:
            return truth, injected, rig.plant.supervisor.report
    if fault == "late_policy":
        time.sleep(0.2)
    try:
        rig.plant.advance(math.nan if fault == "nan_command" else SPEED, _UPRIGHT, round(1e3 * PERIOD))
    except RigStopped as stop:
        return truth, injected, stop.report
    return truth, injected, None


def _told(
    fault: str,
    seed: int,
    truth: dict[str, Any],
    injected: float | None,
    report: StopReport | None,
    events: list[dict[str, Any]],
    settings: RigSettings,
) -> Trial:
    """Put together what the rig and the emulator's events tell."""
    if injected is None:
        event = next(event for event in events if event["what"] == "fault injected")
        injected, start, speed = event["time_s"], event["position_m"], SPEED
    else:
        speed = truth["speed_m_s"]
        start = truth["position_m"] + speed * (injected - truth["time_s"])
    later = [event for event in events if event["time_s"] >= injected - _WAY and event.get("axis") in (None, "blade")]

    def first(what: str) -> float | None:
        return next((event["time_s"] for event in later if event["what"] == what), None)

    rests = [event for event in later if event["what"] == "standstill"]
    result = Trial(
        fault=fault,
        seed=seed,
        injected=injected,
        speed=speed,
        crossed=first("force limit crossed"),
        received=first("quick stop received"),
        standstill=rests[-1]["time_s"] if rests else None,
    )
    if fault == "kill_9":  # nobody is left to report
        lost = first("heartbeat of the master lost")
        result.cause, result.detected = (None, None) if lost is None else (Cause.HEARTBEAT, lost)
    elif report is not None:
        result.cause, result.detail, result.detected = report.cause, report.detail, report.detected
        result.way_detected = report.distance_to_standstill
    if result.cause is not None:
        result.stated = stated_detection(fault, Cause(result.cause), settings)
    if rests:
        result.way = rests[-1]["position_m"] - start
    return result


def _moved(control: EmulatorControl, events: list[dict[str, Any]]) -> float | None:
    """How far the carriage is from where it came to rest last [m]."""
    rests = [event["position_m"] for event in events if event["what"] == "standstill"]
    return control.truth()["position_m"] - rests[-1] if rests else None


def _stalls(result: Trial, events: list[dict[str, Any]], own: list[tuple[float, float]]) -> list[float]:
    """Lateness of emulator and rig between shortly before the fault and the blade's rest [s]."""
    stalls = own + [(event["time_s"], event["late_s"]) for event in events if event["what"] == "stall"]
    ends = max(result.standstill or 0.0, result.detected or 0.0, result.injected)
    return [late for ended, late in stalls if ended >= result.injected - PERIOD and ended - late <= ends]


# Faults that end the rig's process, or its parent's


class CutProcess:
    """A rig that cuts in a process of its own; see :func:`cut_until_stopped`.

    Parameters
    ----------
    emulator : RunningEmulator
        What it cuts on.
    seed : int
        Of the specimen.
    kept : bool
        Whether a process stands between this one and it, which may then be killed.
    """

    def __init__(self, emulator: RunningEmulator, *, seed: int, kept: bool = False) -> None:
        settings = emulator.settings
        ready = {
            "can": settings.bus.port,
            "sensor": settings.sensor.port,
            "page": settings.sensor.page,
            "control": emulator.control.port,
        }
        command = [sys.executable, __file__, json.dumps(ready), str(seed)]
        keeper = [sys.executable, "-c", "import subprocess, sys; subprocess.run(sys.argv[1:])"]
        self.process = subprocess.Popen(
            keeper + command if kept else command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE
        )
        self._read = b""

    def line(self) -> dict[str, Any]:
        """The next line of JSON that it prints.

        Raises
        ------
        RigError
            If there is none in time, or it has ended.
        """
        output = self.process.stdout
        assert output is not None
        deadline = time.monotonic() + _PATIENCE
        while b"\n" not in self._read:
            ready, _, _ = select.select([output], [], [], max(deadline - time.monotonic(), 0.0))
            read = os.read(output.fileno(), 4096) if ready else b""
            if not read:
                raise RigError("the process that cuts says nothing any more; it has said above why.")
            self._read += read
        line, _, self._read = self._read.partition(b"\n")
        told: dict[str, Any] = json.loads(line)
        return told

    def end(self) -> None:
        """End it, whatever it does."""
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait(_PATIENCE)
        assert self.process.stdout is not None
        self.process.stdout.close()


_SIGNALS = {
    "sigterm": signal.SIGTERM,
    "ctrl_c": signal.SIGINT,
    "parent_death": signal.SIGKILL,
    "kill_9": signal.SIGKILL,
}


def trial_in_child(emulator: RunningEmulator, fault: str, *, seed: int, after: float) -> Trial:
    """The same for a fault of :data:`IN_CHILD`: the rig cuts in a process of its own, and nobody cuts in this one."""
    child = CutProcess(emulator, seed=seed, kept=fault == "parent_death")
    control = emulator.control
    try:
        since = child.line()["since"]
        time.sleep(after)
        truth, injected = control.truth(), time.monotonic()
        child.process.send_signal(_SIGNALS[fault])
        if fault == "kill_9":
            time.sleep(DRIVE_PATIENCE + 0.1 + _LATCHED_FOR)
            told: dict[str, Any] = {"refused": not _enabled(control), "stalls": [], "report": None}
        else:
            told = child.line()
    finally:
        child.end()
    events = control.events(since)
    report = told["report"]
    if report is not None:
        way = report.pop("way")
        report = StopReport(**{**report, "cause": Cause(report["cause"])})
        report.position, report.rest_position = 0.0, way
    result = _told(fault, seed, truth, injected, report, events, emulator.settings)
    result.refused = told["refused"]
    result.moved = _moved(control, events)
    result.stalls = _stalls(result, events, [(ended, late) for ended, late in told["stalls"]])
    return result


def _enabled(control: EmulatorControl) -> bool:
    """Whether a drive is powered and follows its target."""
    return any(node["state"] == "operation enabled" for node in control.state()["nodes"])


def cut_until_stopped(ready: dict[str, Any], seed: int, tell: Callable[[dict[str, Any]], None]) -> None:
    """What the child does: cut until it is stopped, see that it stays so, and tell.

    Ends by itself once its parent is gone: what it prints is then read by the one above.
    """
    control = EmulatorControl(ready["control"])
    rig = CuttingRig(emulated_settings(ready), control)
    try:
        rig.begin(seed)
        rig.cut(0.1)
        tell({"since": len(control.events())})
        report = rig.cut(20.0)
        refused = report is not None and rig.refuses()
        told = None
        if report is not None:
            told = {
                "cause": report.cause,
                "detail": report.detail,
                "detected": report.detected,
                "way": report.distance_to_standstill,
            }
        tell({"report": told, "refused": refused, "stalls": rig.host.stalls})
    finally:
        rig.close()


def main() -> None:
    """Cut in a child process."""
    ready, seed = sys.argv[1:]
    cut_until_stopped(json.loads(ready), int(seed), lambda told: print(json.dumps(told), flush=True))


if __name__ == "__main__":
    main()
