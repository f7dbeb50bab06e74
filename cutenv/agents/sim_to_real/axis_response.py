"""Response of an axis to a commanded speed, and friction.

It is fitted with the simulator's drive.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from cutenv._base.arrays import Array, StructArray
from cutenv._engine.jit import njit
from cutenv.rig.config.settings import Axis
from cutenv.rig.operation.recorder import Felt, Stretch
from cutenv.sim.cutting.drive import Rig, advance_command, lag_gain
from cutenv.sim.cutting.dtypes import STATE

_DT = 0.5e-3  # [s] step of the model: its lag is exact for any, and a command is late by less than half of it
_FAR = 100.0  # [m] start of the model's carriage, far from any end stop
_SCALES = np.array([1.0, 1.0, 0.01])  # of log lag, log acceleration, dead time [s]
_LOW, _HIGH = (math.log(2e-4), math.log(2e-3), -0.005), (math.log(1.0), math.log(50.0), 0.1)
_STARTS = ((0.040, 0.002), (0.010, 0.015), (0.120, 0.002))  # lag, dead time [s]
_FINEST = 1e-6  # [m] of misfit, below which nothing is an outlier
_CLEARLY = 1.3  # [1] ratio over the limit that the fastest step must demand before it counts as limited


@dataclass(frozen=True, kw_only=True)
class Response:
    """Velocity loop's response to commands, in SI with standard errors.

    A standard error holds two things: the spread between steps (jackknife), and what the model does not describe. The
    misfit that is left over is alike within a step, and a constant may have taken up as much of it again; so it counts
    as one misfit of that size for each step, however many samples the step has.
    """

    lag: float  # lag and dead time [s]; the dead time includes the transport of command and sample over the bus
    dead_time: float
    acceleration: float | None  # acceleration limit [m/s2]; None if no step was fast enough to reach a limit
    lag_error: float  # standard errors
    dead_time_error: float
    acceleration_error: float
    least_acceleration: float  # greatest acceleration that was reached [m/s2]
    misfit: float  # root mean square of measured minus modelled position [m]

    def positions(self, stretch: Stretch) -> Array:
        """Return modelled positions at the samples [m], up to a constant."""
        return modelled(stretch, self.lag, self.acceleration or _HIGH[1], self.dead_time)


class SineCheck(NamedTuple):
    """Comparison of a measured sine with the model.

    Gain and phase [rad] from commanded to measured, and the errors.
    """

    frequency: float
    gain: float
    phase: float
    gain_error: float  # measured gain over the modelled, minus 1
    phase_error: float  # measured phase minus the modelled [rad]
    swing: float  # amplitude of the measured position [m]

    @property
    def verdict(self) -> str:
        """Verdict in words: the model describes this sine, or does not."""
        if abs(self.gain_error) <= SAME_GAIN and abs(self.phase_error) <= SAME_PHASE:
            return "as the model"
        return f"not as the model; the axis swings by {1e6 * self.swing:.0f} um"


SAME_GAIN, SAME_PHASE = 0.05, math.radians(5.0)
"""Errors of gain [1] and phase [rad] up to which a sine counts as described by the model."""


class ForceDelay(NamedTuple):
    """Delay of the force, and the mass that the sensor moves.

    The delay is behind the position; both have standard errors.
    """

    delay: float  # [s]
    error: float
    mass: float  # its inertia is what is felt in air [kg]; negative: the force has the wrong sign
    mass_error: float


def force_delay(sines: Sequence[Stretch], felt: Sequence[Felt], frequencies: Sequence[float]) -> ForceDelay | Unseen:
    """Estimate force delay by inertia in air: F(t) = m a(t - delay).

    Of each sine, whose frequency is in hertz, one amplitude and one phase is taken of the position and of the force.
    Mass and delay are those that fit the phases of all frequencies; the standard errors are those of the noise beside
    the sines.
    """
    ratios, errors, turns = [], [], []
    for sine, readings, frequency in zip(sines, felt, frequencies, strict=True):
        moved, heard = (_within(sine, times, frequency) for times in (sine.time, readings.time))
        if moved.sum() < _MIN_SAMPLES or heard.sum() < _MIN_SAMPLES:
            continue
        omega, begun = 2.0 * math.pi * frequency, float(sine.time[moved][0])
        position, _ = _component(sine.time[moved], sine.position[moved], frequency, begun)
        force, noise = _component(readings.time[heard], readings.force[heard], frequency, begun)
        if position == 0.0:
            continue
        acceleration = -(omega**2) * position
        ratios.append(force / acceleration)
        errors.append(noise / abs(acceleration))
        turns.append(omega)
    if not ratios:
        return Unseen("no readings of the force beside the sines")
    ratio, error, omega_of = np.array(ratios), np.maximum(errors, _LEAST_ERROR), np.array(turns)

    def misfits(at: Array) -> Array:
        off = (at[0] * np.exp(-1j * omega_of * at[1]) - ratio) / error
        return np.concatenate((off.real, off.imag))

    fits = [
        least_squares(misfits, [float(sign) * float(np.median(np.abs(ratio))), delay], x_scale=[0.1, 0.01])
        for sign in (1, -1)
        for delay in (0.0, 0.02)
    ]
    best = min((fit for fit in fits if -_LATEST < fit.x[1] < _LATEST), key=lambda fit: float(fit.cost), default=None)
    if best is None:
        return Unseen("the force does not follow the axis")
    slopes = np.asarray(best.jac)
    covariance = np.linalg.pinv(slopes.T @ slopes)
    scale = max(1.0, 2.0 * float(best.cost) / max(2 * len(ratio) - 2, 1))  # misfits beyond the noise count as noise
    mass_error, delay_error = np.sqrt(scale * np.diag(covariance)).tolist()
    mass, delay = best.x.tolist()
    if abs(mass) < _CLEAR * mass_error:
        return Unseen(
            f"the inertia of what the sensor carries, {1e3 * mass:.0f} g, is not clear of its error of "
            f"{1e3 * mass_error:.0f} g: clamp some 200 g to it for this"
        )
    return ForceDelay(delay, delay_error, mass, mass_error)


def _within(sine: Stretch, times: Array, frequency: float) -> NDArray[np.bool_]:
    """Return a mask of times within the sine, after one cycle."""
    begun, ended = float(sine.command_time[0]) + 1.0 / frequency, float(sine.command_time[-1])
    return np.asarray((times >= begun) & (times <= ended))


_LATEST = 0.15  # [s] of delay, beyond which a phase of the slow sines is no delay
_LEAST_ERROR = 1e-6  # [kg], so that readings without noise have a weight, too


@njit
def _follow(drives: StructArray, states: StructArray, targets: Array, dt: float, positions: Array) -> None:
    drive, state = drives[0], states[0]
    share = lag_gain(drive, dt)
    for k in range(len(targets)):
        positions[k] = state.hand
        advance_command(state, drive, share, targets[k], dt)


def modelled(stretch: Stretch, lag: float, acceleration: float, dead_time: float) -> Array:
    """Return the simulated drive's position at the samples [m], from 0.

    A pure delay of the command is one of the response, so ``dead_time`` [s] need not be whole milliseconds.
    """
    begin = float(stretch.command_time[0])
    end = max(float(stretch.time[-1]), begin) + 0.01
    grid = begin + _DT * np.arange(math.ceil((end - begin) / _DT) + 1)
    # A command acts from the grid's nearest instant on.
    targets = stretch.command[np.searchsorted(stretch.command_time, grid + 0.5 * _DT, side="right") - 1]
    drives = Rig(motor_lag=0.04, acceleration=0.1).records(2.0 * _FAR)
    drives["lag"], drives["acceleration"] = lag, acceleration
    states = np.zeros(1, STATE)
    states["hand"] = _FAR
    positions = np.empty(len(grid))
    _follow(drives, states, targets, _DT, positions)
    return np.interp(stretch.time - dead_time, grid, positions - _FAR)


def fit_response(steps: Sequence[Stretch], *, nominal_acceleration: float) -> Response:
    """Fit lag, acceleration limit and dead time to speed steps.

    Each step is from rest to rest; slow ones determine the lag, fast ones the limit.  Least squares on position with a
    loss that is robust to samples which arrived late; the offset of each step is free.  The fit starts from the
    acceleration set in the drive [m/s2].

    Raises ValueError if there are fewer than three steps with motion.
    """
    steps = [each for each in steps if len(each.time) >= 20 and np.ptp(each.position) > 0.0]
    if len(steps) < 3:
        raise ValueError(f"{len(steps)} steps with motion are too few to identify the axis: give 3 or more.")
    plain = (
        _fit(steps, np.array([math.log(lag), math.log(nominal_acceleration), dead]), None) for lag, dead in _STARTS
    )
    first = min(plain, key=lambda fit: float(fit.cost))
    usual = max(1.4826 * float(np.median(np.abs(first.fun))), _FINEST)
    found: Array = _fit(steps, first.x, usual).x
    left_out = np.array([_fit([*steps[:k], *steps[k + 1 :]], found, usual).x for k in range(len(steps))])
    n = len(steps)
    spread = np.sqrt((n - 1) / n * np.sum((left_out - left_out.mean(axis=0)) ** 2, axis=0))  # jackknife
    errors = np.hypot(spread, _taken_up(steps, found))
    lag, acceleration, dead_time = math.exp(found[0]), math.exp(found[1]), float(found[2])
    asked = max(float(np.abs(step.command).max()) for step in steps) / lag
    limited = asked > _CLEARLY * acceleration
    return Response(
        lag=lag,
        dead_time=dead_time,
        acceleration=acceleration if limited else None,
        lag_error=float(errors[0]) * lag,
        dead_time_error=float(errors[2]),
        acceleration_error=float(errors[1]) * acceleration,
        least_acceleration=min(asked, acceleration),
        misfit=float(np.sqrt(np.mean(_misfits(steps, found) ** 2))),
    )


def _misfits(steps: Sequence[Stretch], at: Array) -> Array:
    parts = []
    for step in steps:
        off = step.position - modelled(step, math.exp(at[0]), math.exp(at[1]), float(at[2]))
        parts.append(off - off.mean())
    return np.concatenate(parts)


def _taken_up(steps: Sequence[Stretch], at: Array) -> Array:
    """Return fit errors if a usual misfit per step were absorbed."""
    left = _misfits(steps, at)
    columns = []
    for k, change in enumerate(1e-3 * _SCALES):
        further = np.eye(len(at))[k] * change
        columns.append((_misfits(steps, at + further) - _misfits(steps, at - further)) / (2.0 * change))
    slopes = np.column_stack(columns)
    variance = float(left @ left) / len(steps)
    return np.asarray(np.sqrt(variance * np.diag(np.linalg.pinv(slopes.T @ slopes))))


def _fit(steps: Sequence[Stretch], start: Array, usual: float | None) -> Any:
    """Fit, with less weight for misfits beyond ``usual`` [m], if given."""

    def misfits(at: Array) -> Array:
        return _misfits(steps, at)

    return least_squares(
        misfits,
        start,
        bounds=(_LOW, _HIGH),
        x_scale=_SCALES,
        loss="linear" if usual is None else "soft_l1",
        f_scale=usual or 1.0,
    )


def check_sine(stretch: Stretch, frequency: float, response: Response) -> SineCheck:
    """Compare measured and modelled response to a sine of ``frequency`` [Hz].

    The first cycle is ignored.
    """
    commanded = modelled(stretch, 1e-6, 1e6, 0.0)  # a drive without lag or limit
    settled = _within(stretch, stretch.time, frequency)
    time = stretch.time[settled]
    measured, model, told = (
        _component(time, position[settled], frequency, float(time[0]))[0]
        for position in (stretch.position, response.positions(stretch), commanded)
    )
    return SineCheck(
        frequency=frequency,
        gain=abs(measured / told),
        phase=float(np.angle(measured / told)),
        gain_error=abs(measured / model) - 1.0,
        phase_error=float(np.angle(measured / model)),
        swing=abs(measured),
    )


def _component(time: Array, values: Array, frequency: float, begun: float) -> tuple[complex, float]:
    """Return a drifting sine's amplitude, its phase at ``begun``, and the standard error of either part."""
    turn = 2.0 * math.pi * frequency * (time - begun)
    columns = np.column_stack((np.cos(turn), -np.sin(turn), np.ones_like(time), time - begun))
    found = np.linalg.lstsq(columns, values, rcond=None)[0]
    off = values - columns @ found
    return complex(found[0], found[1]), math.sqrt(2.0 * float(off @ off)) / len(values)


TORQUE_STEP = 1e-3  # resolution of the reported torque over the rated one: drives count per mille
_LAGS = 5.0  # lags after which a speed counts as steady
_MIN_SAMPLES = 8  # least number of samples of a steady speed
_BEGUN = 0.5  # share of the speed, from which an axis that reversed counts as moving again
_SIDE = 4  # least number of samples on each side of a step of torque
_CLEAR = 6.0  # standard errors by which the step must exceed zero
_COUNTS = 0.4  # least step, on average, in counts of torque
_ROOM = 0.8  # share of the way between two turns, within which a play can be measured


class Friction(NamedTuple):
    """Friction of the whole axis, as a force on its carriage.

    Coulomb's part [N], its standard error, and viscous.
    """

    coulomb: float
    error: float
    viscous: float  # viscous friction [N s/m]


class Play(NamedTuple):
    """Play between motor and carriage [m], its standard error, and pushing force [N]."""

    backlash: float
    error: float
    carriage: float


class Unseen(NamedTuple):
    """Reason why a quantity cannot be measured."""

    why: str


def force_per_torque(axis: Axis) -> float:
    """Return the carriage's force [N] at rated torque, positive from the clamp."""
    return axis.direction * axis.rated_torque * 2.0 * math.pi * axis.gear / axis.lead


def coulomb_friction(
    steps: Sequence[Stretch], axis: Axis, *, lag: float, acceleration: float, dead_time: float
) -> Friction | Unseen:
    """Estimate Coulomb's and viscous friction from torque at steady speeds.

    |F| = Coulomb's + viscous |v|, plus a constant load. A speed is steady some lags [s] after dead time [s] and ramp.
    """
    speeds, forces = [], []
    for step in steps:
        last = step.command_time[-1]
        for k in np.flatnonzero(np.diff(step.command, prepend=0.0)):  # where the command changes
            speed = float(step.command[k])
            later = np.flatnonzero(step.command[k:] != speed)
            end = step.command_time[k + later[0]] if len(later) else last
            change = abs(speed - (step.command[k - 1] if k else 0.0))
            begin = step.command_time[k] + dead_time + change / acceleration + _LAGS * lag
            steady = (step.time >= begin) & (step.time < end)
            if speed != 0.0 and steady.sum() >= _MIN_SAMPLES:
                speeds.append(speed)
                forces.append(force_per_torque(axis) * float(step.torque[steady].mean()))
    told, force = np.array(speeds), np.array(forces)
    if len(told) < 4 or (told > 0.0).sum() < 2 or (told < 0.0).sum() < 2:
        return Unseen("too few steady speeds, both ways")
    if not np.any(force):
        return Unseen("the drive reports no torque")
    columns = np.column_stack((np.sign(told), told, np.ones_like(told)))
    found = np.linalg.lstsq(columns, force, rcond=None)[0]
    off = force - columns @ found
    count = abs(force_per_torque(axis)) * TORQUE_STEP / math.sqrt(12.0)  # a torque is known to a count
    variance = max(float(off @ off) / (len(told) - 3), count**2)
    error = math.sqrt(variance * float(np.linalg.inv(columns.T @ columns)[0, 0]))
    if found[0] < 2.0 * error:
        return Unseen(f"{found[0]:.2g} N is not clear of its error of {error:.2g} N: torque is too coarse")
    return Friction(float(found[0]), error, float(found[1]))


def play(turns: Stretch, axis: Axis) -> Play | Unseen:
    """Estimate backlash from slow reversals, by the torque missing while it is crossed.

    All reversals are superposed by the distance since the motor reversed, and one step of torque is fitted. The
    standard error is a jackknife over reversals.

    Parameters
    ----------
    turns : Stretch
        The same slow speed to and fro, several times.
    axis : Axis
        Encoder, gear, lead and rated torque.
    """
    legs = [_leg(turns, k) for k in range(1, len(_turning(turns)))]  # the first begins from rest, on an unknown side
    legs = [leg for leg in legs if len(leg[0]) > 2 * _SIDE]
    if len(legs) < 3:
        return Unseen("fewer than three reversals with motion")
    if not any(np.any(torque) for _, torque in legs):
        return Unseen("the drive reports no torque")
    found = _step(legs)
    least = float(np.median([leg[0][min(_SIDE, len(leg[0]) - 1)] for leg in legs]))
    count = abs(force_per_torque(axis)) * TORQUE_STEP
    if found is None or found[1] < _COUNTS * TORQUE_STEP:
        return Unseen(
            f"torque shows no step after a reversal: the play is below {1e6 * least:.0f} um, or pushing the carriage"
            f" takes less than a count of torque, {count:.1g} N"
        )
    farthest = float(np.median([leg[0][-1] for leg in legs]))
    if found[0] > _ROOM * farthest:
        return Unseen(f"the play is not crossed within {1e3 * _ROOM * farthest:.2g} mm")
    places = []
    for k in range(len(legs)):
        without = _step([*legs[:k], *legs[k + 1 :]])
        places.append(found[0] if without is None else without[0])
    n = len(legs)
    spread = math.sqrt((n - 1) / n * float(np.sum((np.array(places) - np.mean(places)) ** 2)))
    resolution = _spacing(legs, found[0]) / math.sqrt(12.0)
    return Play(found[0], max(spread, resolution), abs(force_per_torque(axis)) * found[1])


def _turning(turns: Stretch) -> NDArray[np.int64]:
    return np.flatnonzero(np.diff(np.sign(turns.command), prepend=0.0))


def _leg(turns: Stretch, number: int) -> tuple[Array, Array]:
    """Return the distance since reversal [m] and torque, from where motion resumes."""
    turning = _turning(turns)
    begin = turns.command_time[turning[number]]
    later = turning[number + 1 :]
    end = turns.command_time[later[0]] if len(later) else turns.command_time[-1]
    speed = float(turns.command[turning[number]])
    here = (turns.time >= begin) & (turns.time < end)
    if speed == 0.0 or here.sum() <= 2 * _SIDE or np.ptp(turns.time[here]) == 0.0:
        return np.empty(0), np.empty(0)
    way = math.copysign(1.0, speed)
    position, torque, time = way * turns.position[here], way * turns.torque[here], turns.time[here]
    travelled = position - position.min()
    # Samples are a SYNC apart, whenever they arrive: bunched ones do not show the speed.
    moving = np.gradient(position, float(np.ptp(time)) / (len(time) - 1)) > _BEGUN * abs(speed)
    moving &= np.arange(len(time)) > position.argmin()
    if not moving.any():
        return np.empty(0), np.empty(0)
    first = int(moving.argmax())
    return travelled[first:], torque[first:]


def _step(legs: Sequence[tuple[Array, Array]]) -> tuple[float, float] | None:
    """Return where torque steps up [m] and by how much, or None."""
    way = np.concatenate([leg[0] for leg in legs])
    torque = np.concatenate([leg[1] for leg in legs])
    order = np.argsort(way, kind="stable")
    way, torque = way[order], torque[order]
    n, side = len(way), _SIDE * len(legs)
    if n <= 2 * side:
        return None
    below = np.arange(1, n)
    total, squares = np.cumsum(torque), float(torque @ torque)
    before, after = total[:-1] / below, (total[-1] - total[:-1]) / (n - below)
    left = squares - below * before**2 - (n - below) * after**2
    left[: side - 1] = left[n - side :] = np.inf
    at = int(left.argmin())
    height = float(after[at] - before[at])
    spread = math.sqrt(max(float(left[at]), 0.0) / (n - 2)) * math.sqrt(1.0 / below[at] + 1.0 / (n - below[at]))
    if height <= _CLEAR * spread:
        return None
    return 0.5 * float(way[at] + way[at + 1]), height


def _spacing(legs: Sequence[tuple[Array, Array]], place: float) -> float:
    """Return the distance between a leg's samples at the step [m]."""
    gaps = []
    for way, _ in legs:
        at = int(np.searchsorted(way, place))
        if 0 < at < len(way):
            gaps.append(float(way[at] - way[at - 1]))
    return max(gaps, default=0.0)
