"""Safety layer below the policy.

It checks every sample and every command, and stops the blade on a breach.

A software stop is not a safety function: wire the stop button to the drive's safe torque off.
"""

from __future__ import annotations

import dataclasses
import math
import threading
from collections.abc import Sequence
from contextlib import ExitStack

from cutenv.rig.config.settings import RigSettings, SafetyLimits
from cutenv.rig.devices.loop import Clock
from cutenv.rig.devices.protocols import DriveState, Event, ForceSample, Latch, MotionDriver, MotionSample, Phase
from cutenv.rig.errors import RigError
from cutenv.rig.safety.monitors import CREEP, ForceMonitor, ForceReadings, MotionMonitor
from cutenv.rig.safety.stop_causes import Breach, Cause, QuickStops, StopReport

MARGIN = 1.04  # ratio of the speed limit to the greatest commanded speed [1]: the drive's speed loop overshoots
_ROUNDING = 1e-9  # [m/s] of a speed that was reduced to the limit before
# time constant near the ends of travel [s]: a speed is allowed that would take at least this long to reach the end
BRAKING = 0.16
_SHORT = 1e-4  # [m] from an end of travel, the distance at which the allowed speed is zero
_STRAYED = {"blade": 0.003, "angle": math.radians(10.0), "height": 0.001, "side": 0.001}  # [m], [rad] of a locked axis
ASLEEP = 0.060  # time since the watchdog last ran, at which a reading or a command stops the blade [s]
_SENT_WITHIN = 0.5  # [s] for the quick stops of a stop to be sent, before its reset
_FALLEN = (DriveState.QUICK_STOP, DriveState.REACTING, DriveState.FAULT)


class Supervisor:
    """Safety monitor of a rig.

    Puts a quick stop on the bus at the first breach, and keeps the rig stopped.

    The loop, and drivers with a thread of their own, report to it, and every command passes through it. It refuses all
    motion until :meth:`release`; after a stop, :meth:`reset` has to come first. ``axes`` are the driver of the blade,
    and of angle, height and side where it has them; ``follows``: False for a replayed cut, for which following errors
    are not checked.
    """

    def __init__(
        self,
        settings: RigSettings,
        clock: Clock,
        axes: Sequence[MotionDriver],
        readings: ForceReadings,
        *,
        follows: bool = True,
    ) -> None:
        self.settings, self.limits = settings, settings.limits
        self._clock, self._reaches = clock, settings.reaches
        self._axes = {axis.name: axis for axis in axes}
        self._latch = Latch()
        for axis in axes:
            axis.latch = self._latch
        self.report: StopReport | None = None  # report of the last stop; None before the first
        self.limited = 0  # number of commands that were reduced to a limit since :meth:`release`
        self._lock = threading.Lock()  # of phase, report and commands; nothing is sent or awaited under it
        self._sent = threading.Event()  # not set: the quick stops of a stop are under way
        self._sent.set()
        self._commanding = threading.Lock()  # of those who send commands; a stop does not need it
        self._forces = ForceMonitor(self.limits, readings, settings.identified, settings.height)
        self._motions = MotionMonitor(settings, follows=follows)
        self._alive: dict[str, float] = {}
        self._follows = follows
        self._told = dict.fromkeys(self._axes, 0.0)  # [m/s], [rad/s] that each axis is commanded
        self._held_until = -math.inf  # [s] until which the last command holds
        self._locked_at: dict[str, float] = {}
        self._quick_stops = QuickStops(self._axes, self._motions.newest, fresh=self.limits.stale_motion)

    @property
    def phase(self) -> Phase:
        """State of the rig, which decides whether it may move; see :mod:`cutenv.rig.devices.protocols`."""
        return self._latch.phase

    # Reports from the drivers

    def force(self, sample: ForceSample) -> None:
        """Check one force reading; over-force is detected entirely here, as the packet is received."""
        breach = self._forces.check(
            sample, moving=any(speed != 0.0 for axis, speed in self._told.items() if axis != "angle")
        )
        if self.phase is Phase.STOPPED and self.report is not None:
            self.report.peak_force = max(self.report.peak_force, math.hypot(*sample.force))
        if self.phase is Phase.READY:
            if breach is not None:
                self.trip(*breach, sample.time)
            elif (asleep := self._asleep(sample.time)) is not None:
                self.trip(*asleep, sample.time)

    def motion(self, axis: str, sample: MotionSample) -> None:
        """Check one motion sample of an axis."""
        self._motions.note(axis, sample)
        if self.phase is Phase.READY:
            if (breach := self._motions.check(axis, self._told[axis])) is not None:
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
        if not abs(strayed) <= _STRAYED[name]:  # also where it is no number
            way = f"{1e3 * strayed:+.1f} mm" if name != "angle" else f"{math.degrees(strayed):+.0f} degrees"
            self.trip(Cause.FOLLOWING, f"locked, the {name} axis moves: {way}", sample.time, locked=True)

    def alive(self, axis: str, time: float) -> None:
        """Note the time of a drive's heartbeat."""
        self._alive[axis] = time

    def emergency(self, axis: str, code: int, meaning: str, time: float) -> None:
        """Stop the blade for an error code that a drive reports; code 0 means that there is no error."""
        if code:
            self.trip(Cause.DRIVE, f"the {axis} drive reports 0x{code:04X}, {meaning}", time)

    def foreign(self, axis: str, what: str, time: float) -> None:
        """Stop even a locked rig because another master commands a drive; answer each command with a quick stop."""
        cure = "close the other program or master, or switch off the gateway's echo of our own frames"
        self.trip(Cause.FOREIGN, f"another master commands the {axis} drive ({what}); {cure}", time, locked=True)
        if self.phase is Phase.STOPPED:
            self._quick_stops.answer(axis, time)

    def broken(self, axis: str, why: str, time: float) -> None:
        """Stop the blade because a drive cannot be reached; its own heartbeat watchdog has to stop it."""
        self.trip(Cause.BUS, f"{axis}: {why}", time)

    # Commands

    def drive(self, speed: float, angle: float, hold: float, **across: float) -> float:
        """Check, limit and send a command that is valid for ``hold`` [s]; return the angle to turn to [rad].

        ``across`` are the speeds of the other straight axes by name [m/s]: ``height`` upwards, ``side`` to the left; 0
        by default. Where one to the side is limited, the speed along the cut is reduced alike, and the other way round:
        the blade keeps its course. A stop does not wait for a driver that sends a command. No command follows a quick
        stop, which with some drive settings would start the motion again: drivers ask the latch before and after each
        frame, and an axis whose command has met a stop is stopped once more. Raise RigError if the rig is not released,
        or is stopped.
        """
        wanted = {"blade": speed} | {name: across.get(name, 0.0) for name in self.settings.cross_axes}
        if self.phase is Phase.READY and not (math.isfinite(angle) and all(map(math.isfinite, wanted.values()))):
            others = "".join(f", {name} {value} m/s" for name, value in wanted.items() if name != "blade")
            self.trip(Cause.NOT_A_NUMBER, f"the command is speed {speed} m/s, angle {angle} rad{others}")
            return angle
        if self.phase is Phase.READY and (asleep := self._asleep(self._clock.now())) is not None:
            self.trip(*asleep)
            return angle
        with self._commanding:
            with self._lock:
                if self.phase is not Phase.READY:
                    why = f"stopped ({self.report})" if self.phase is Phase.STOPPED else "not released"
                    raise RigError(f"the blade may not move: the rig is {why}. The operator has to release it first.")
                allowed = self._on_course({name: self._allowed(name, value) for name, value in wanted.items()}, wanted)
                turned = min(max(angle, self.limits.angle_low), self.limits.angle_high)
                reduced = any(abs(allowed[name] - speed) > _ROUNDING for name, speed in wanted.items())
                self.limited += reduced or turned != angle
                self._held_until = self._clock.now() + hold * (1.0 + self.limits.overrun)
                self._told |= allowed  # last: the watchdog looks at either without the lock
            self._command(allowed)
        return turned

    def _command(self, speeds: dict[str, float]) -> None:
        """Send speeds [m/s or rad/s] to axes by name; a driver that raises is a fault."""
        for name, speed in speeds.items():
            try:
                self._axes[name].command(speed)
            except RigError as error:
                return self.trip(Cause.BUS, str(error))
            except Exception as error:
                return self.trip(Cause.EXCEPTION, f"the driver of the {name} axis: {type(error).__name__}: {error}")
            finally:
                if self.phase is Phase.STOPPED:
                    self._quick_stops.send(name)

    def turn(self, rate: float) -> None:
        """Send a turning speed [rad/s] to the angle's axis, if the rig is released, for as long as the last command."""
        with self._commanding:
            with self._lock:
                if self.phase is not Phase.READY:
                    return
                top = self.settings.angle.speed if self.settings.angle is not None else 0.0
                self._told["angle"] = turned = min(max(rate, -top), top)
            self._command({"angle": turned})

    def _allowed(self, name: str, speed: float) -> float:
        """Return a straight axis's speed [m/s] reduced to the limit, which decreases toward the ends of travel."""
        sample = self._motions.newest.get(name)
        if sample is None or (self.relieving and name != "height"):
            return 0.0
        reach = self._reaches[name]
        braking = BRAKING + abs(sample.speed) / (2.0 * reach.axis.acceleration)
        top = min(reach.speed / MARGIN, reach.axis.speed)
        if self.beyond is not None:
            top = min(top, CREEP)
        highest = max(reach.high - _SHORT - sample.position, 0.0) / braking
        lowest = max(sample.position - reach.low - _SHORT, 0.0) / braking
        if self.relieving:
            top, lowest = min(top, CREEP), 0.0
        return min(max(speed, -min(top, lowest)), min(top, highest))

    def _on_course(self, allowed: dict[str, float], wanted: dict[str, float]) -> dict[str, float]:
        """Return allowed speeds [m/s] with those along the cut and to the side reduced by the same share."""
        if "side" in allowed:
            share = min(allowed[name] / wanted[name] if wanted[name] else 1.0 for name in ("blade", "side"))
            if share < 1.0:
                allowed |= {name: share * wanted[name] for name in ("blade", "side")}
        return allowed

    # Timing

    def watch(self, now: float) -> None:
        """Judge the rig: stop the blade if something is overdue.

        The loop calls it every :data:`~cutenv.rig.safety.stop_causes.WATCH`; without it the drivers send no sign of
        life, and the drives stop by themselves.
        """
        if self.phase is Phase.READY:
            try:
                missing = self._missing(now)
            except Exception as error:  # nobody would notice that a watchdog had died
                missing = [Breach(Cause.EXCEPTION, f"the watchdog failed: {type(error).__name__}: {error}")]
            if missing:
                self.trip(*missing[0], now)
        self._latch.judged = now

    def unwatched(self) -> None:
        """Take note that nobody calls :meth:`watch` any more: the rig is closed."""
        self._latch.judged = None

    def _asleep(self, now: float) -> Breach | None:
        """Return the breach of a rig that has not been judged for :data:`ASLEEP`; found by who else is awake."""
        judged = self._latch.judged
        if judged is None or now - judged <= ASLEEP:
            return None
        return Breach(Cause.EXCEPTION, f"the watchdog has not run for {1e3 * (now - judged):.0f} ms")

    def _missing(self, now: float) -> list[Breach]:
        limits = self.limits
        found: list[Breach] = []
        force = self._forces.newest
        # Each comparison is written so that a time that is no number is a breach.
        if not (silent := now - (-math.inf if force is None else force.time)) <= limits.stale_force:
            found.append(Breach(Cause.FORCE_STALE, f"no reading for {1e3 * silent:.0f} ms"))
        for axis in self._axes:
            sample = self._motions.newest.get(axis)
            if not (silent := now - (-math.inf if sample is None else sample.time)) <= limits.stale_motion:
                found.append(Breach(Cause.MOTION_STALE, f"no sample of the {axis} axis for {1e3 * silent:.0f} ms"))
            if not (silent := now - self._alive.get(axis, -math.inf)) <= limits.heartbeat:
                found.append(Breach(Cause.HEARTBEAT, f"no heartbeat from the {axis} drive for {1e3 * silent:.0f} ms"))
        if any(self._told.values()) and not (late := now - self._held_until) <= 0.0:
            found.append(Breach(Cause.OVERRUN, f"no new command, {1e3 * late:.0f} ms after the last one expired"))
        return found

    def resend_stop(self, now: float) -> None:
        """Repeat the quick stop to drives of a stopped rig that are not seen to obey."""
        if self.phase is Phase.STOPPED and self.report is not None:
            self._quick_stops.again(self.report, now)

    # Stop, release, reset

    def trip(self, cause: Cause, detail: str, detected: float | None = None, *, locked: bool = False) -> None:
        """Stop the blade, from any thread; do nothing if it is stopped, or is not released (unless ``locked``)."""
        with self._lock:
            report = self._latched(cause, detail, detected) if locked or self.phase is Phase.READY else None
        if report is not None:
            unreached = self._quick_stops.begin()
            if unreached:
                report.detail += f" (no quick stop could be sent: {'; '.join(unreached)})"
            report.commanded = self._clock.now()
            self._sent.set()

    def _latched(self, cause: Cause, detail: str, detected: float | None) -> StopReport | None:
        """Latch a stop, under the lock; return its report, or None for a rig that is stopped already."""
        if self.phase is Phase.STOPPED:
            return None
        now = self._clock.now() if detected is None else detected
        self._rest()
        blade = self._motions.newest.get("blade")
        self.report = report = StopReport(
            cause=cause, detail=detail, detected=now, position=None if blade is None else blade.position
        )
        self._sent.clear()
        self._latch.happens(Event.STOP)  # last: a thread that sees this phase reads this report
        return report

    def await_quick_stops(self) -> None:
        """Wait until the quick stops of a stop under way are sent; no longer than their drivers may take."""
        self._sent.wait(_SENT_WITHIN)

    def release(self, *, returning: bool = False) -> None:
        """Allow commands, once every signal is present and within its limits.

        ``returning``: True if the operator has agreed that a blade beyond an end of its travel creeps back inside, or
        that one which presses on the tissue is raised slowly; no other motion is allowed before. Raise RigError if
        something is missing or wrong; the message lists all of it.
        """
        if self.phase is Phase.READY:
            return  # the last command stays under watch
        if self.phase is Phase.STOPPED:
            raise RigError(f"the rig is stopped ({self.report}); reset it first.")
        wrong = [detail for _, detail in self._missing(self._clock.now())]
        wrong += [
            f'the {name} drive is in "{sample.state.value}"'
            for name, sample in self._motions.newest.items()
            if sample.state is not DriveState.ENABLED
        ]
        if self._forces.newest is not None and (status := self._forces.newest.status):
            wrong.append(f"the sensor's status is 0x{status:08X}")
        if self.beyond is not None and not returning:
            wrong.append(f"{self.beyond}: it may creep back if the operator agrees; prepare the rig again")
        if self.pressed is not None and not returning:
            wrong.append(f"{self.pressed}: it may be raised if the operator agrees; prepare the rig again")
        if wrong:
            raise RigError(f"the rig is not ready: {'; '.join(wrong)}.")
        self._rest()
        self.limited = 0
        self._forces.restart()
        self._motions.restart()
        if returning:
            self._motions.let_return()
            self._forces.let_relieve()
        self._latch.happens(Event.RELEASE)

    def lock(self) -> None:
        """Command zero speed on every axis, and refuse motion until the next :meth:`release`; for a blade at rest.

        Otherwise the last command of an axis would go on unwatched: a hinge that has not arrived, a blade that creeps.
        """
        if self.phase is not Phase.READY:  # a driver may hold the lock of a command that was stopped
            return
        with self._commanding:
            with self._lock:
                if self.phase is not Phase.READY:
                    return
                self._rest()
            self._command(dict.fromkeys(self._axes, 0.0))
            with self._lock:
                self._locked_at.clear()
                self._latch.happens(Event.LOCK)  # nothing, if it was stopped meanwhile

    def lower(self, limits: SafetyLimits) -> None:
        """Adopt each limit that is stricter than the present one.

        The others stay. For a rig that is locked. Raise RigError if the rig is released.
        """
        if self.phase is Phase.READY:
            raise RigError("limits are lowered between cuts, while the rig is locked.")
        strict = self.limits.strictest(limits)
        self.settings, self.limits = dataclasses.replace(self.settings, limits=strict), strict
        self._reaches = self.settings.reaches
        self._forces.adopt(strict)
        self._motions.adopt(self.settings)

    def _rest(self) -> None:
        self._told = dict.fromkeys(self._axes, 0.0)

    def reset(self, agreed: bool) -> None:
        """Clear what is :attr:`latched`, if the operator has explicitly ``agreed``.

        The drives are left without power. Raise RigError if the operator has not agreed, a drive does not leave its
        fault, or another stop happened meanwhile; the rig is then stopped and can be reset again.
        """
        if (why := self.latched) is None:
            return
        if not agreed:
            raise RigError(f"still stopped ({why}): the operator has not agreed to a reset.")
        self.await_quick_stops()  # any later one is a new stop
        with ExitStack() as resetting:
            with self._lock:
                if self.phase is Phase.UNREADY:
                    self.report = StopReport(cause=Cause.DRIVE, detail=why, detected=self._clock.now())
                self._rest()
                resetting.enter_context(self._latch.resetting())
                self._quick_stops.forget()
            for axis in self._axes.values():
                axis.clear()
            self._locked_at.clear()

    @property
    def latched(self) -> str | None:
        """Reason for which a reset has to precede any motion: a stop, or a drive that stopped by itself; or None."""
        if self.phase is Phase.STOPPED:
            return str(self.report)
        fallen = [
            f'the {name} drive went to "{sample.state.value}" by itself'
            for name, sample in self._motions.newest.items()
            if sample.state in _FALLEN
        ]
        return "; ".join(fallen) or None

    # Present state

    @property
    def newest_force(self) -> ForceSample | None:
        """Last force reading; None before the first."""
        return self._forces.newest

    @property
    def blade(self) -> MotionSample | None:
        """Last sample of the blade's axis; None before the first."""
        return self._motions.newest.get("blade")

    def axis(self, name: str) -> MotionSample | None:
        """Return the last sample of an axis; None before the first."""
        return self._motions.newest.get(name)

    @property
    def beyond(self) -> str | None:
        """Position of a blade beyond an end of its travel, as a text; None if it is inside."""
        return self._motions.beyond

    @property
    def pressed(self) -> str | None:
        """Vertical force of a blade that presses on the tissue beyond its limit, as a text; None if it is within."""
        return self._forces.pressed

    @property
    def relieving(self) -> bool:
        """True while a blade that presses on the tissue is raised, and nothing else may move."""
        return self._forces.relieving

    @property
    def standing(self) -> bool:
        """True if the blade is at rest, as far as its samples show."""
        return self._motions.standing
