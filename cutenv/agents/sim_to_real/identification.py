"""Identification of a rig's constants: experiment, plan and result.

The experiment is made on a released rig: an empty axis under steps, sines and reversals, and a sensor at rest. Of each
constant the result has standard error and method, or why it is missing. The plan is the motions, within a rig's travel.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from datetime import date
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from cutenv._base.arrays import Array
from cutenv._base.result_table import aligned
from cutenv._base.validation import parameter_table
from cutenv.agents.sim_to_real.axis_response import (
    ForceDelay,
    Friction,
    Play,
    Response,
    SineCheck,
    Unseen,
    check_sine,
    coulomb_friction,
    fit_response,
    force_delay,
    play,
)
from cutenv.records.measurement.sensor_noise import NOISE_BLOCK, longest_still, sensor_at_rest
from cutenv.rig.config.file_schema import IDENTIFIED, FileKey
from cutenv.rig.config.settings import Identified, RigSettings
from cutenv.rig.errors import RigError
from cutenv.rig.operation.recorder import Felt, Recorder, Stretch
from cutenv.rig.plant import RigPlant
from cutenv.rig.safety.stop_causes import Cause, RigStopped
from cutenv.rig.safety.supervisor import BRAKING, MARGIN
from cutenv.sim.cutting.drive import Rig
from cutenv.sim.cutting.dtypes import TICK
from cutenv.sim.cutting.sensor import SensorParameters

_SHARES = (0.08, 0.16, 0.32, 0.6, 0.8)  # [1] speeds of the steps over the top speed
_FREQUENCIES = (0.5, 1.0, 2.0, 4.0, 8.0)  # [Hz]
_SWING = 0.2  # [1] amplitude of a slow sine over the top speed
_STEEPEST = 0.6  # [1] acceleration of a fast sine over its limit: beyond it the motion would not be a sine
_CYCLES, _MIN_DURATION = (
    4,
    2.0,
)  # least number of cycles, of which the first is ignored, and least duration [s] of a sine
_LAG = 0.1  # [s] that an axis may need besides its ramp
_CLEARANCE = 0.002  # [m] besides
_STEP_HOLD = 0.7  # [s] at least


class Sine(NamedTuple):
    """Sinusoidal speed: frequency [Hz] and amplitude [m/s]."""

    frequency: float
    amplitude: float

    @property
    def duration(self) -> float:
        """Duration in whole cycles [s]."""
        return max(_CYCLES, math.ceil(_MIN_DURATION * self.frequency)) / self.frequency

    def speed(self, time: float) -> float:
        """Return the commanded speed ``time`` [s] after the beginning [m/s]."""
        return self.amplitude * math.sin(2.0 * math.pi * self.frequency * time)


@dataclass(frozen=True, kw_only=True)
class Plan:
    """Plan of the experiment, in SI."""

    start: float  # position from which the blade moves away from the clamp, and to which it returns [m]
    speeds: tuple[float, ...]  # speeds of the steps, one after the other [m/s]
    step_hold: tuple[float, ...]  # duration of each step, and of the rest after it [s]
    sines: tuple[Sine, ...]
    turn_speed: float = 0.25e-3  # speed of the slow reversals [m/s], and distance between two of them [m]
    turn_travel: float = 0.6e-3
    turns: int = 8  # number of slow reversals
    rest: float = 20.0  # duration of the sensor's recording at rest [s]

    @classmethod
    def within(cls, settings: RigSettings, position: float) -> Plan:
        """Return the plan at the nearest start that travel allows.

        Raises RigError if the travel is too short.
        """
        limits, axis = settings.limits, settings.blade
        top = min(limits.speed / MARGIN, axis.speed)
        speeds = tuple(share * top for share in _SHARES)
        sines = tuple(
            Sine(each, min(_SWING * top, _STEEPEST * axis.acceleration / (2.0 * math.pi * each)))
            for each in _FREQUENCIES
        )
        holds = tuple(max(speed / axis.acceleration + 4.0 * _LAG, _STEP_HOLD) for speed in speeds)
        plan = cls(start=position, speeds=speeds, step_hold=holds, sines=sines)
        # Nearer to an end of travel, commands are reduced.
        clearance = top * (BRAKING + top / (2.0 * axis.acceleration)) + _CLEARANCE
        low, high = max(limits.low, axis.low) + clearance, min(limits.high, axis.high) - clearance - plan.travel
        if low > high:
            raise RigError(
                f"the rig's travel is {1e3 * (low - high):.0f} mm too short for this: widen its limits and travel, or"
                " lower limits.speed, in its file."
            )
        return replace(plan, start=min(max(position, low), high))

    @property
    def travel(self) -> float:
        """Greatest distance from the start [m]."""
        steps = max(speed * hold for speed, hold in zip(self.speeds, self.step_hold, strict=True))
        return max(steps, self.turn_travel, *(sine.amplitude / (math.pi * sine.frequency) for sine in self.sines))

    @property
    def path(self) -> tuple[float, float]:
        """Least and greatest position [m]."""
        swing = self.turn_travel
        return self.start - swing, self.start + self.travel + swing

    @property
    def duration(self) -> float:
        """Approximate duration of the whole experiment [s]."""
        turning = self.turns * self.turn_travel / self.turn_speed
        return self.rest + turning + 4.0 * sum(self.step_hold) + sum(sine.duration + 0.5 for sine in self.sines)


_DIGITS = 2  # of a standard error, to which a value is rounded


@dataclass(frozen=True)
class IdentifiedValue:
    """Estimate of one constant, under its name in :class:`~cutenv.rig.config.settings.Identified`; SI."""

    name: str
    value: float | None  # estimated value; None if it cannot be measured
    error: float | None
    how: str  # method, or the reason why it cannot be measured

    @property
    def rounded(self) -> float | None:
        """Value rounded to the digits that its standard error justifies, without one to four."""
        if self.value is None or self.value == 0.0:
            return self.value
        if not self.error:
            return float(f"{self.value:.4g}")
        return round(self.value, _DIGITS - 1 - math.floor(math.log10(self.error)))


@dataclass(frozen=True, kw_only=True)
class Identification:
    """Result of one experiment."""

    plan: Plan
    estimates: tuple[IdentifiedValue, ...]  # estimates, in the order of the rig's file
    response: Response
    checks: tuple[SineCheck, ...]  # comparisons with sines that were not used for the fit
    steps: tuple[Stretch, ...]  # recorded steps and sines, for a figure
    sines: tuple[Stretch, ...]

    def __getitem__(self, name: str) -> IdentifiedValue:
        """Return the estimate of that name."""
        return next(each for each in self.estimates if each.name == name)

    def identified(self, before: Identified, today: date) -> Identified:
        """Return the rig file's section, measured or known from ``before``."""
        found = {each.name: each.rounded for each in self.estimates if each.value is not None}
        return replace(before, date=today.isoformat(), **found)

    def table(self, before: Identified) -> list[str]:
        """Return table lines of measured values, the file's and the simulator's."""
        simulated = {row["name"]: row["default"] for row in parameter_table(Rig, SensorParameters)}
        rows = [("constant", "measured", "std error", "file", "simulator", "how")]
        for key in IDENTIFIED.keys:
            if key.field == "date":
                continue
            each = self[key.field]
            rows.append(
                (
                    f"{key.field} [{key.unit.sign}]",
                    _shown(key, each.rounded) if each.value is not None else "-",
                    "-" if each.error is None else f"{key.from_si(each.error):.2g}",
                    _shown(key, getattr(before, key.field)),
                    _shown(key, simulated.get(key.field)),
                    each.how if each.value is not None else f"not measurable: {each.how}",
                )
            )
        return aligned(rows)

    def drawn_steps(self) -> list[tuple[str, Array, Array, Array]]:
        """Return each step's name, time [s], measured and modelled position [m]."""
        names = [f"{1e3 * each.command[np.abs(each.command).argmax()]:+.3g} mm/s" for each in self.steps]
        return self._drawn(names, self.steps)

    def drawn_sines(self) -> list[tuple[str, Array, Array, Array]]:
        """Return each sine's name, time [s], measured and modelled position [m]."""
        return self._drawn([f"{sine.frequency:g} Hz" for sine in self.plan.sines], self.sines)

    def _drawn(self, names: Iterable[str], stretches: Iterable[Stretch]) -> list[tuple[str, Array, Array, Array]]:
        drawn = []
        for name, stretch in zip(names, stretches, strict=True):
            model = self.response.positions(stretch)
            measured = stretch.position - stretch.position[0]
            moved = stretch.command_time[np.flatnonzero(stretch.command)[0]]
            drawn.append((name, stretch.time - moved, measured, model + float(np.mean(measured - model))))
        return drawn

    def sine_table(self) -> list[str]:
        """Return a table of sines' gains, phases and model errors."""
        rows = [("sine [Hz]", "gain", "phase [deg]", "gain error [%]", "phase error [deg]", "verdict")]
        for each in self.checks:
            phases = [f"{math.degrees(each.phase):.1f}", f"{math.degrees(each.phase_error):+.1f}"]
            gains = [f"{each.gain:.3f}", f"{100 * each.gain_error:+.1f}"]
            rows.append((f"{each.frequency:g}", gains[0], phases[0], gains[1], phases[1], each.verdict))
        return aligned(rows)


def _shown(key: FileKey, value: float | None) -> str:
    if value is None:
        return "-"
    shown = f"{key.from_si(value):.4g}"
    return f"{float(shown):.0f}" if "e+" in shown else shown


APPROACH = 0.005  # speed of the approach to where the experiment starts [m/s]
_TICKS = 20  # [ms] between commands, as between decisions
_PAUSE = 0.4  # [s] of rest before each stretch
_REST_TICKS = 100


class Recorded(NamedTuple):
    """Response of axis and sensor."""

    steps: tuple[Stretch, ...]  # in the plan's order; for each speed one away from the clamp and one back
    sines: tuple[Stretch, ...]
    turns: Stretch
    force: Array  # readings along the cut at rest [N], shape (n,)
    rate: float  # rate of those readings [Hz]
    axes: Array = np.zeros((0, 3))  # those of all three axes of the sensor [N], shape (n, 3); empty if not kept
    felt: tuple[Felt, ...] = ()  # readings along the cut during each sine; empty if they were not kept


LOST_TIME = (
    Cause.FORCE_STALE, Cause.FORCE_LATE, Cause.FORCE_LOST, Cause.MOTION_STALE, Cause.HEARTBEAT, Cause.OVERRUN,
)  # fmt: skip
"""Stops that a delay of the computer causes, which concerns neither the rig nor what it does."""
_ATTEMPTS = 10  # to measure, each up to a stop by a delay


def perform(
    plant: RigPlant,
    plan: Plan,
    tell: Callable[[str], None] = lambda message: None,
    *,
    again: Callable[[RigStopped], None] | None = None,
) -> Recorded:
    """Move the empty axis as planned, and record its response.

    The rig is opened, prepared and released, with the blade in air. It ends at rest where it started, and released.
    After a stop that a delay of this computer caused, ``again`` is called to prepare and release it again: what was
    measured before is kept, and the part that was stopped is measured again; at most ten times. Without it every stop
    ends the experiment.

    Raises RigStopped if the supervisor stops the blade for another reason, or too often; RigError if commands were
    reduced to a limit, so that the response is not to the plan.
    """
    sensor = plant.settings.sensor
    recorder = Recorder("xyz".index(sensor.cut_axis), sensor.sign)
    came_from = plant.position
    moves = _Moves(plant, recorder)
    done: dict[str, list[Any]] = {}
    plant.witness = recorder
    try:
        for attempt in range(_ATTEMPTS):
            try:
                reduced = _measure(moves, plan, done, tell)  # before the way back, which may be faster than allowed
                plant.travel(came_from, speed=APPROACH)
                break
            except RigStopped as stop:
                if again is None or stop.report.cause not in LOST_TIME or attempt == _ATTEMPTS - 1:
                    raise
                tell(f"stopped ({stop.report.cause.value}); what was measured is kept, and it goes on from there")
                again(stop)
    finally:
        plant.witness = None
    if reduced:
        raise RigError(
            "commands were reduced to a limit, so the response is not to the plan: widen the limits of the"
            " rig's file, or start farther from the ends of travel."
        )
    (rest,), (turns,), steps, sines = (done[part] for part in ("rest", "turns", "steps", "sines"))
    force = recorder.force_along(*rest)
    felt = tuple(recorder.felt(float(sine.command_time[0]), float(sine.command_time[-1])) for sine in sines)
    rate = len(force) / (rest[1] - rest[0])
    return Recorded(tuple(steps), tuple(sines), turns, force, rate, recorder.force_axes(*rest), felt)


def _measure(moves: _Moves, plan: Plan, done: dict[str, list[Any]], tell: Callable[[str], None]) -> bool:
    """Make missing moves; return True if a command was limited."""
    tell(f"move to {1e3 * plan.start:.1f} mm")
    moves.begin(plan.start)
    steps = [(sign * speed, hold) for speed, hold in zip(plan.speeds, plan.step_hold, strict=True) for sign in (1, -1)]
    parts: tuple[tuple[str, str, list[Callable[[], Any]]], ...] = (
        ("rest", f"sensor at rest, {plan.rest:g} s", [lambda: moves.rest(plan.rest)]),
        ("turns", f"{plan.turns} slow reversals", [lambda: moves.turns(plan)]),
        (
            "steps",
            f"steps to {', '.join(f'{1e3 * speed:.3g}' for speed in plan.speeds)} mm/s",
            [partial(moves.step, *step) for step in steps],
        ),
        (
            "sines",
            f"sines of {', '.join(f'{sine.frequency:g}' for sine in plan.sines)} Hz",
            [partial(moves.sine, sine.speed, sine.duration) for sine in plan.sines],
        ),
    )
    for name, about, made in parts:
        kept = done.setdefault(name, [])
        if len(kept) < len(made):
            tell(about)
        if name == "steps" and len(kept) % 2:
            kept.pop()  # a step back begins where its step away has ended
        for make in made[len(kept) :]:
            kept.append(make())
    return moves.reduced


class _Moves:
    """Moves of the blade, with the commands recorded."""

    def __init__(self, plant: RigPlant, recorder: Recorder) -> None:
        self._plant, self._recorder = plant, recorder
        self._angle = plant.angle
        self._limited = 0

    def begin(self, start: float) -> None:
        """Go to the experiment's start [m], and start counting limited commands."""
        self._plant.travel(start, speed=APPROACH)
        self._limited = self._plant.supervisor.limited
        self._plant.begin()

    @property
    def reduced(self) -> bool:
        """True if a command was reduced to a limit."""
        return self._plant.supervisor.limited > self._limited

    def _command(self, speed: float, ticks: int) -> None:
        self._recorder.command(self._plant.clock.now(), speed)
        self._plant.advance(speed, self._angle, ticks)

    def _hold(self, speed: float, duration: float) -> None:
        for _ in range(max(round(duration / (_TICKS * TICK)), 1)):
            self._command(speed, _TICKS)

    def _recorded(self, moves: Callable[[], None]) -> Stretch:
        """Record ``moves``, with the rest before and after it."""
        start = self._plant.clock.now()
        self._hold(0.0, _PAUSE)
        moves()
        self._hold(0.0, _TICKS * TICK)
        return self._recorder.stretch(start, self._plant.clock.now())

    def rest(self, duration: float) -> tuple[float, float]:
        """Stand still for ``duration`` [s]; return start and end [s]."""
        self._hold(0.0, _PAUSE)
        start = self._plant.clock.now()
        while self._plant.clock.now() < start + duration:
            self._command(0.0, _REST_TICKS)
        return start, self._plant.clock.now()

    def step(self, speed: float, hold: float) -> Stretch:
        """Move at ``speed`` [m/s] from and to rest, each ``hold`` [s]."""

        def moves() -> None:
            self._hold(speed, hold)
            self._hold(0.0, hold)

        return self._recorded(moves)

    def turns(self, plan: Plan) -> Stretch:
        """Move slowly to and fro."""

        def moves() -> None:
            for k in range(plan.turns + 1):
                self._hold(math.copysign(plan.turn_speed, -((-1) ** k)), plan.turn_travel / plan.turn_speed)
            self._hold(0.0, _PAUSE)

        return self._recorded(moves)

    def sine(self, speed: Callable[[float], float], duration: float) -> Stretch:
        """Move at a speed [m/s], a function of time [s]."""

        def moves() -> None:
            begun = self._plant.clock.now()
            while (time := self._plant.clock.now() - begun) < duration:
                self._command(speed(time), _TICKS)
            self._hold(0.0, _PAUSE)

        return self._recorded(moves)


def identification_from(settings: RigSettings, plan: Plan, recorded: Recorded) -> Identification:
    """Estimate a rig's constants from recorded arrays.

    Takes some seconds, so close the rig before.

    Raises RigError if the axis did not move, or too little was recorded.
    """
    steps, sines, turns, force, rate, axes, felt = recorded
    axis = settings.blade
    try:
        response = fit_response(steps, nominal_acceleration=axis.acceleration)
        at_rest = [*_of_sensor(force, rate), *_of_axes(axes, rate)]
    except ValueError as error:
        raise RigError(f"the rig cannot be identified: {error}") from None
    friction = coulomb_friction(
        steps, axis, lag=response.lag, acceleration=response.least_acceleration, dead_time=max(response.dead_time, 0.0)
    )
    delay = Unseen("no readings of the force beside the sines")
    late = force_delay(sines, felt, [sine.frequency for sine in plan.sines]) if felt else delay
    of_axis = (*_of_response(response), _of_play(play(turns, axis)), _of_friction(friction))
    estimates = (*of_axis, *at_rest, _of_delay(late, settings.sensor.sign))
    checks: tuple[SineCheck, ...] = tuple(
        check_sine(sine, planned.frequency, response) for sine, planned in zip(sines, plan.sines, strict=True)
    )
    return Identification(plan=plan, estimates=estimates, response=response, checks=checks, steps=steps, sines=sines)


def _unseen(how: str, *names: str) -> list[IdentifiedValue]:
    return [IdentifiedValue(name, None, None, how) for name in names]


def _of_response(response: Response) -> list[IdentifiedValue]:
    fitted = f"least squares on {1e6 * response.misfit:.0f} um of misfit in the steps"
    delayed = "delay of the answer to the steps; holds the way over the bus and back"
    if response.acceleration is None:
        limit = _unseen(f"no step met a limit; above {response.least_acceleration:.2g} m/s2", "acceleration")
    else:
        slope = f"slope of the fast steps; {fitted}"
        limit = [IdentifiedValue("acceleration", response.acceleration, response.acceleration_error, slope)]
    return [
        IdentifiedValue("motor_lag", response.lag, response.lag_error, fitted),
        IdentifiedValue("dead_time", max(response.dead_time, 0.0), response.dead_time_error, delayed),
        *limit,
    ]


def _of_play(found: Play | Unseen) -> IdentifiedValue:
    if isinstance(found, Unseen):
        return _unseen(found.why, "backlash")[0]
    rise = f"way after slow reversals until torque rises by {found.carriage:.1f} N"
    return IdentifiedValue("backlash", found.backlash, found.error, f"{rise}: play, and the screw's stretch by that")


def _of_friction(found: Friction | Unseen) -> IdentifiedValue:
    if isinstance(found, Unseen):
        return _unseen(found.why, "friction")[0]
    how = f"torque at steady speeds both ways, of motor, screw and guide; {found.viscous:.0f} N s/m besides"
    return IdentifiedValue("friction", found.coulomb, found.error, how)


def _of_delay(found: ForceDelay | Unseen, sign: int) -> IdentifiedValue:
    if isinstance(found, Unseen):
        return _unseen(found.why, "force_delay")[0]
    if found.mass < 0.0:
        wrong = f"the force has the wrong sign: write sensor.sign = {-sign}, and measure again"
        return _unseen(wrong, "force_delay")[0]
    how = f"phase of the inertia of {1e3 * found.mass:.0f} g that the sensor carries, behind the position"
    return IdentifiedValue("force_delay", max(found.delay, 0.0), found.error, how)


def _of_axes(axes: Array, rate: float) -> list[IdentifiedValue]:
    names = ("force_still_x", "force_still_y", "force_still_z")
    if not len(axes):
        return _unseen("the axes were not recorded", *names)
    how = "longest run of equal readings that noise allows, or three times the longest seen"
    return [IdentifiedValue(name, longest_still(axes[:, k], rate), None, how) for k, name in enumerate(names)]


def _of_sensor(force: Array, rate: float) -> list[IdentifiedValue]:
    found = sensor_at_rest(force, rate)
    if found is None:
        return _unseen("all readings at rest are equal", "force_noise", "force_resolution", "force_drift")
    walk = "walk of the zero" if found.drift else f"no walk of the zero is seen: below {found.drift_seen:.2g} N"
    drift = f"{walk}; likelihood of {1e3 * NOISE_BLOCK:g} ms means"
    return [
        IdentifiedValue("force_noise", found.noise, found.noise_error, "readings at rest, before rounding"),
        IdentifiedValue("force_resolution", found.resolution, None, "smallest step of the readings"),
        IdentifiedValue("force_drift", found.drift, found.drift_error, drift),
    ]
