"""Safety below the policy: it sees every packet and every command, trusts nobody, and stops the blade.

A software stop is not a safety function: the stop button belongs on the drive's safe torque off.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Sequence
from contextlib import ExitStack

from cutenv.rig.causes import Breach, Cause, StopReport
from cutenv.rig.clock import Clock
from cutenv.rig.drivers import MotionDriver, RigError
from cutenv.rig.force_watch import ForceWatch
from cutenv.rig.latch import Event, Latch, Phase
from cutenv.rig.motion_watch import CREEP, MotionWatch
from cutenv.rig.quick_stops import QuickStops
from cutenv.rig.samples import DriveState, ForceSample, MotionSample
from cutenv.rig.settings import RigSettings

MARGIN = 1.04
"""Of the speed's limit over what is commanded at most: a loop overshoots."""
BRAKING = 0.16
"""Time in which a blade near the end of its travel would arrive [s]: its command fades before."""
_SHORT = 1e-4  # [m] before the end of travel, where commands have faded out
_STRAYED = {"blade": 0.003, "angle": math.radians(10.0)}  # [m], [rad] of a locked axis from where it was locked
_FALLEN = (DriveState.QUICK_STOP, DriveState.REACTING, DriveState.FAULT)


class Supervisor:
    """Watches force, motion, commands and time; a breach puts a quick stop on the bus at once, and latches.

    It is told by the drivers' threads and by the watchdog, and asked before every command.  Until :meth:`release` it
    refuses every motion; after a stop it does until :meth:`reset`.

    Parameters
    ----------
    settings : RigSettings
        Limits among them.
    clock : Clock
        Time.
    axes : sequence of MotionDriver
        The blade's, and the angle's where there is one.
    rate : float
        Readings of force a second [Hz].
    follows : bool
        Whether the blade does what it is told; a replayed one does not, and is not held to it.
    """

    def __init__(
        self,
        settings: RigSettings,
        clock: Clock,
        axes: Sequence[MotionDriver],
        *,
        rate: float = 1000.0,
        follows: bool = True,
    ) -> None:
        self.settings, self.limits = settings, settings.limits
        self._clock = clock
        self._axes = {axis.name: axis for axis in axes}
        self._latch = Latch()
        for axis in axes:
            axis.latch = self._latch
        self.report: StopReport | None = None
        """Of the last stop."""
        self.limited = 0
        """Commands that were made smaller since :meth:`release`."""
        self._lock = threading.Lock()
        self._forces = ForceWatch(self.limits, rate, settings.identified)
        self._motions = MotionWatch(settings, follows=follows)
        self._alive: dict[str, float] = {}
        self._follows = follows
        self._command = self._turning = 0.0
        self._held_until = math.inf
        self._locked_at: dict[str, float] = {}
        self._quick_stops = QuickStops(self._axes, self._motions.newest, fresh=self.limits.stale_motion)
        self.on_stop: Callable[[StopReport], None] = lambda report: None
        """Called once for every stop, after the quick stop is on the bus."""

    @property
    def phase(self) -> Phase:
        """Whether the rig may move; see :mod:`cutenv.rig.latch`."""
        return self._latch.phase

    # What the drivers tell

    def force(self, sample: ForceSample) -> None:
        """Check one reading: the whole of detecting over-force is here, in the packet's own thread."""
        breach = self._forces.felt(sample, moving=self._command != 0.0)
        if self.phase is Phase.STOPPED and self.report is not None:
            self.report.peak_force = max(self.report.peak_force, math.hypot(*sample.force))
        if breach is not None and self.phase is Phase.READY:
            self.trip(*breach, sample.time)

    def motion(self, axis: str, sample: MotionSample) -> None:
        """Check one sample of an axis."""
        self._motions.note(axis, sample)
        if self.phase is Phase.READY:
            if (breach := self._motions.judge(axis, self._command if axis == "blade" else self._turning)) is not None:
                self.trip(*breach, sample.time)
            return
        self._motions.restart()
        report = self.report
        if sample.state is not DriveState.ENABLED:
            self._locked_at.pop(axis, None)
            if self.phase is Phase.STOPPED and report is not None and report.standstill is None and self.standing:
                report.standstill, report.rest_position = sample.time, self._motions.newest["blade"].position
        elif self._follows and self.phase is Phase.UNREADY:
            self._hold_to_its_place(axis, sample)

    def _hold_to_its_place(self, name: str, sample: MotionSample) -> None:
        """Stop an axis that moves though the rig is locked and its power is on."""
        strayed = sample.position - self._locked_at.setdefault(name, sample.position)
        if abs(strayed) > _STRAYED[name]:
            way = f"{1e3 * strayed:+.1f} mm" if name == "blade" else f"{math.degrees(strayed):+.0f} degrees"
            self.trip(Cause.FOLLOWING, f"locked, the {name} axis moves: {way}", sample.time, locked=True)

    def alive(self, axis: str, time: float) -> None:
        """Note a drive's heartbeat."""
        self._alive[axis] = time

    def emergency(self, axis: str, code: int, meaning: str, time: float) -> None:
        """Stop for an error that a drive reports."""
        if code:
            self.trip(Cause.DRIVE, f"the {axis} drive reports 0x{code:04X}, {meaning}", time)

    def foreign(self, axis: str, what: str, time: float) -> None:
        """Stop, even a locked rig, where somebody else commands a drive; have the last word as long as that goes on."""
        cure = "close the other program or master, or have the gateway not echo what we send"
        self.trip(Cause.FOREIGN, f"somebody else commands the {axis} drive ({what}); {cure}", time, locked=True)
        with self._lock:
            if self.phase is Phase.STOPPED:
                self._quick_stops.answer(axis, time)

    def broken(self, axis: str, why: str, time: float) -> None:
        """Stop where a drive cannot be reached: its own watch for our heartbeat has to."""
        self.trip(Cause.BUS, f"{axis}: {why}", time)

    # What is asked of it

    def drive(self, speed: float, angle: float, hold: float) -> float:
        """Judge a command that is to last for ``hold`` [s], and put it on the bus; return the angle to turn to.

        Judged and sent under one lock with :meth:`trip`: no command can follow a quick stop, which on some settings of
        a drive would set it going again.

        Raises
        ------
        RigError
            If the rig is not released, or stopped.
        """
        if self.phase is Phase.READY and not (math.isfinite(speed) and math.isfinite(angle)):
            self.trip(Cause.NOT_A_NUMBER, f"commanded are speed {speed} m/s and angle {angle} rad")
            return angle
        broken = None
        with self._lock:
            if self.phase is not Phase.READY:
                why = f"it is stopped ({self.report})" if self.phase is Phase.STOPPED else "it is not released"
                raise RigError(f"the blade may not move: {why}. The operator has to release it first.")
            allowed = self._allowed(speed)
            turned = min(max(angle, self.limits.angle_low), self.limits.angle_high)
            self.limited += allowed != speed or turned != angle
            self._command = allowed
            self._held_until = self._clock.now() + hold * (1.0 + self.limits.overrun)
            try:
                self._axes["blade"].command(allowed)
            except RigError as error:
                broken = str(error)
        if broken is not None:
            self.trip(Cause.BUS, broken)
        return turned

    def turn(self, rate: float) -> None:
        """Put a rate of turn [rad/s] on the bus of the angle's axis, if the rig is released."""
        broken = None
        with self._lock:
            if self.phase is Phase.READY:
                top = self.settings.angle.speed if self.settings.angle is not None else 0.0
                self._turning = min(max(rate, -top), top)
                try:
                    self._axes["angle"].command(self._turning)
                except RigError as error:
                    broken = str(error)
        if broken is not None:
            self.trip(Cause.BUS, broken)

    def _allowed(self, speed: float) -> float:
        """A speed within the limit, that fades out toward the ends of travel."""
        blade = self._motions.newest["blade"]
        braking = BRAKING + abs(blade.speed) / (2.0 * self.settings.blade.acceleration)
        top = min(self.limits.speed / MARGIN, self.settings.blade.speed)
        if self.beyond is not None:
            top = min(top, CREEP)
        highest = max(self.limits.high - _SHORT - blade.position, 0.0) / braking
        lowest = max(blade.position - self.limits.low - _SHORT, 0.0) / braking
        return min(max(speed, -min(top, lowest)), min(top, highest))

    # Time

    def watch(self, now: float) -> None:
        """Find out what is missing; the watchdog calls it every :data:`~cutenv.rig.causes.WATCH`."""
        if self.phase is not Phase.READY:
            return
        try:
            missing = self._missing(now)
        except Exception as error:  # a watchdog that dies would be missed by nobody
            missing = [Breach(Cause.EXCEPTION, f"the watchdog itself: {type(error).__name__}: {error}")]
        if missing:
            self.trip(*missing[0], now)

    def _missing(self, now: float) -> list[Breach]:
        limits = self.limits
        found: list[Breach] = []
        force = self._forces.newest
        if (silent := now - (-math.inf if force is None else force.time)) > limits.stale_force:
            found.append(Breach(Cause.FORCE_STALE, f"no reading for {1e3 * silent:.0f} ms"))
        for axis in self._axes:
            sample = self._motions.newest.get(axis)
            if (silent := now - (-math.inf if sample is None else sample.time)) > limits.stale_motion:
                found.append(Breach(Cause.MOTION_STALE, f"no sample of the {axis} axis for {1e3 * silent:.0f} ms"))
            if (silent := now - self._alive.get(axis, -math.inf)) > limits.heartbeat:
                found.append(Breach(Cause.HEARTBEAT, f"no heartbeat of the {axis} drive for {1e3 * silent:.0f} ms"))
        if (self._command != 0.0 or self._turning != 0.0) and (late := now - self._held_until) > 0.0:
            found.append(Breach(Cause.OVERRUN, f"no new command, {1e3 * late:.0f} ms after the last had to end"))
        return found

    def insist(self, now: float) -> None:
        """Stop drives of a stopped rig that are not seen to obey; a timer of its own calls it."""
        with self._lock:
            if self.phase is Phase.STOPPED and self.report is not None:
                self._quick_stops.again(self.report, now)

    # Stop, release, reset

    def trip(self, cause: Cause, detail: str, detected: float | None = None, *, locked: bool = False) -> None:
        """Stop the blade, unless it is stopped or, but for ``locked``, was not released; from any thread."""
        with self._lock:
            report = self._stop(cause, detail, detected) if locked or self.phase is Phase.READY else None
        if report is not None:
            self.on_stop(report)

    def _stop(self, cause: Cause, detail: str, detected: float | None) -> StopReport | None:
        if self.phase is Phase.STOPPED:
            return None
        now = self._clock.now() if detected is None else detected
        self._rest()
        blade = self._motions.newest.get("blade")
        self.report = report = StopReport(
            cause=cause, detail=detail, detected=now, position=None if blade is None else blade.position
        )
        self._latch.happens(Event.STOP)  # only now: who sees it, in another thread, takes the report for this stop's
        unreached = self._quick_stops.begin()
        report.commanded = self._clock.now()
        if unreached:
            report.detail += f" (no quick stop could be sent: {'; '.join(unreached)})"
        return report

    def release(self, *, returning: bool = False) -> None:
        """Let commands through, once everything is there and within limits.

        Parameters
        ----------
        returning : bool
            Whether the operator has agreed that a blade beyond an end of its travel creeps back inside; it may do
            nothing else before.

        Raises
        ------
        RigError
            If something is missing or wrong; names all of it.
        """
        if self.phase is Phase.READY:
            return  # what it was told last goes on to be watched
        if self.phase is Phase.STOPPED:
            raise RigError(f"the rig is stopped ({self.report}); reset it first.")
        wrong = [detail for _, detail in self._missing(self._clock.now())]
        wrong += self.powerless
        if self._forces.newest is not None and (status := self._forces.newest.status):
            wrong.append(f"the sensor's status is 0x{status:08X}")
        if self.beyond is not None and not returning:
            wrong.append(f"{self.beyond}: it may creep back, if the operator agrees; prepare the rig anew")
        if wrong:
            raise RigError(f"the rig is not ready: {'; '.join(wrong)}.")
        self._rest()
        self.limited = 0
        self._forces.restart()
        self._motions.restart()
        if returning:
            self._motions.let_return()
        self._latch.happens(Event.RELEASE)

    def lock(self) -> None:
        """Bid every axis rest, and refuse every motion until the next :meth:`release`; for a blade at rest.

        What an axis was told last would go on, watched by nobody: a hinge that has not arrived, a blade that creeps.
        """
        broken = None
        with self._lock:
            if self.phase is not Phase.READY:
                return
            self._rest()
            try:
                for axis in self._axes.values():
                    axis.command(0.0)
            except RigError as error:
                broken = str(error)
            else:
                self._locked_at.clear()
                self._latch.happens(Event.LOCK)
        if broken is not None:
            self.trip(Cause.BUS, broken)

    def _rest(self) -> None:
        self._command = self._turning = 0.0
        self._held_until = math.inf

    def reset(self, agreed: bool) -> None:
        """End what is :attr:`latched`: ``agreed`` is the operator's explicit word; the drives are left without power.

        Raises
        ------
        RigError
            If the operator has not agreed, a drive does not leave its fault, or another stop came meanwhile; the rig is
            stopped then, and may be reset once more.
        """
        if (why := self.latched) is None:
            return
        if not agreed:
            raise RigError(f"still stopped ({why}): the operator has not agreed to a reset.")
        with ExitStack() as resetting:
            with self._lock:  # no quick stop of this stop is under way any more: one from here on is another stop
                if self.phase is Phase.UNREADY:
                    self.report = StopReport(cause=Cause.DRIVE, detail=why, detected=self._clock.now())
                self._rest()
                resetting.enter_context(self._latch.resetting())
            for axis in self._axes.values():
                axis.clear()
            self._locked_at.clear()

    @property
    def latched(self) -> str | None:
        """Why a reset has to come before any motion: a stop, or a drive that has stopped by itself."""
        if self.phase is Phase.STOPPED:
            return str(self.report)
        fallen = [
            f'the {name} drive is in "{sample.state.value}" by itself'
            for name, sample in self._motions.newest.items()
            if sample.state in _FALLEN
        ]
        return "; ".join(fallen) or None

    # What it knows

    @property
    def newest_force(self) -> ForceSample | None:
        """The last reading of the force."""
        return self._forces.newest

    @property
    def blade(self) -> MotionSample | None:
        """The newest sample of the blade's axis."""
        return self._motions.newest.get("blade")

    def axis(self, name: str) -> MotionSample | None:
        """The newest sample of an axis."""
        return self._motions.newest.get(name)

    @property
    def powerless(self) -> list[str]:
        """What is wrong with drives that are not enabled, such as those that have stopped by themselves."""
        return [
            f'the {name} drive is in "{sample.state.value}"'
            for name, sample in self._motions.newest.items()
            if sample.state is not DriveState.ENABLED
        ]

    @property
    def beyond(self) -> str | None:
        """Where the blade is beyond an end of its travel, in words."""
        return self._motions.beyond

    @property
    def standing(self) -> bool:
        """Whether the blade stands, as far as is known."""
        return self._motions.standing
