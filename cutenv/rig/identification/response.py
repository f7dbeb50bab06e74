"""Response of an axis to a commanded speed: lag, acceleration limit, dead time, fitted with the simulator's drive."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import least_squares

from cutenv._base.arrays import Array, StructArray
from cutenv._engine.jit import njit
from cutenv.cutting.drive import Rig, advance_command, lag_gain
from cutenv.cutting.dtypes import STATE
from cutenv.rig.identification.recording import Stretch

_DT = 0.5e-3  # [s] step of the model: its lag is exact for any, and a command is late by less than half of it
_FAR = 100.0  # [m] start of the model's carriage, far from any end stop
_SCALES = np.array([1.0, 1.0, 0.01])  # of log lag, log acceleration, dead time [s]
_LOW, _HIGH = (math.log(2e-4), math.log(2e-3), -0.005), (math.log(1.0), math.log(50.0), 0.1)
_STARTS = ((0.040, 0.002), (0.010, 0.015), (0.120, 0.002))  # lag, dead time [s]
_FINEST = 1e-6  # [m] of misfit, below which nothing is an outlier
_CLEARLY = 1.3  # [1] ratio over the limit that the fastest step must demand before it counts as limited


@dataclass(frozen=True, kw_only=True)
class Response:
    """Response of the velocity loop to a command; SI, with jackknife standard errors over steps.

    Attributes
    ----------
    lag, dead_time : float
        Lag and dead time [s]; the dead time includes the transport of command and sample over the bus.
    acceleration : float or None
        Acceleration limit [m/s2]; None if no step was fast enough to reach a limit.
    lag_error, dead_time_error, acceleration_error : float
        Standard errors.
    least_acceleration : float
        Greatest acceleration that was reached [m/s2].
    misfit : float
        Root mean square of measured minus modelled position [m].
    """

    lag: float
    dead_time: float
    acceleration: float | None
    lag_error: float
    dead_time_error: float
    acceleration_error: float
    least_acceleration: float
    misfit: float

    def positions(self, stretch: Stretch) -> Array:
        """Return the model's positions at the samples' times [m], up to a constant."""
        return modelled(stretch, self.lag, self.acceleration or _HIGH[1], self.dead_time)


class SineCheck(NamedTuple):
    """Comparison of a measured sine with the model: gain and phase [rad] from commanded to measured, and the errors."""

    frequency: float
    gain: float
    phase: float
    gain_error: float
    """Measured gain over the modelled, minus 1."""
    phase_error: float
    """Measured phase minus the modelled [rad]."""


@njit
def _follow(drives: StructArray, states: StructArray, targets: Array, dt: float, positions: Array) -> None:
    drive, state = drives[0], states[0]
    share = lag_gain(drive, dt)
    for k in range(len(targets)):
        positions[k] = state.hand
        advance_command(state, drive, share, targets[k], dt)


def modelled(stretch: Stretch, lag: float, acceleration: float, dead_time: float) -> Array:
    """Return the position of the simulator's drive under a stretch's commands, at its samples' times [m], from 0 on.

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
    """Fit lag, acceleration limit and dead time to steps of speed, each from rest to rest.

    Least squares on position with a loss that is robust to samples which arrived late; the offset of each step is free.

    Parameters
    ----------
    steps : sequence of Stretch
        Steps at several speeds: slow ones determine the lag, fast ones the limit.
    nominal_acceleration : float
        Acceleration set in the drive [m/s2], from which the fit starts.

    Raises
    ------
    ValueError
        If there are fewer than three steps with motion.
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
    errors = np.sqrt((n - 1) / n * np.sum((left_out - left_out.mean(axis=0)) ** 2, axis=0))  # jackknife
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


def _fit(steps: Sequence[Stretch], start: Array, usual: float | None) -> Any:
    """Fit; misfits beyond the ``usual`` one [m] count less than their squares, if it is given."""

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
    """Compare the response to a sine of ``frequency`` [Hz] with the fitted model's; the first cycle is ignored."""
    commanded = modelled(stretch, 1e-6, 1e6, 0.0)  # a drive without lag or limit
    settled = stretch.time >= stretch.command_time[0] + 1.0 / frequency
    settled &= stretch.time <= stretch.command_time[-1]
    time = stretch.time[settled]
    measured, model, told = (
        _component(time, position[settled], frequency)
        for position in (stretch.position, response.positions(stretch), commanded)
    )
    return SineCheck(
        frequency=frequency,
        gain=abs(measured / told),
        phase=float(np.angle(measured / told)),
        gain_error=abs(measured / model) - 1.0,
        phase_error=float(np.angle(measured / model)),
    )


def _component(time: Array, position: Array, frequency: float) -> complex:
    """Return amplitude and phase of a sine in positions with a linear drift."""
    turn = 2.0 * math.pi * frequency * (time - time[0])
    columns = np.column_stack((np.cos(turn), -np.sin(turn), np.ones_like(time), time - time[0]))
    found = np.linalg.lstsq(columns, position, rcond=None)[0]
    return complex(found[0], found[1])
