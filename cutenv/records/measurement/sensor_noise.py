"""Sensor properties at rest: least step, noise and zero drift."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.fft import dst
from scipy.optimize import minimize, minimize_scalar
from scipy.special import erf, ndtr

from cutenv._base.arrays import Array

NOISE_BLOCK = 0.2  # time over which the zero is assumed constant [s]
_MIN_BLOCKS = 25  # blocks
_FINE = 0.5  # [1] ratio to the spread, below which a step has no effect
_DUST = 1e-9  # [1] share of the readings' span, which is only rounding of equal readings
_CLEAR = 2.0  # standard errors that a drift must exceed
_NO_LESS = 1e-300
_ONCE_IN = 1e-9  # readings, one of which may stay for longer: some hundred hours
_TIMES_SEEN = 3


@dataclass(frozen=True, kw_only=True)
class SensorAtRest:
    """Properties of one force axis at rest."""

    resolution: float  # smallest step of the readings [N]
    noise: float  # standard deviation before rounding, and its standard error [N]
    noise_error: float
    # standard deviation after one second of a random walk of the zero, and its standard error [N]; 0 if the walk is not
    # distinguishable from noise
    drift: float
    drift_error: float
    drift_seen: float  # least drift that would have been detected [N]


def longest_still(force: Array, rate: float) -> float:
    """Return how long noisy readings [N] may stay equal [s].

    The longest run that white noise allows once in 10^9 readings, if its zero is in the middle of a step; but at least
    three times the longest run seen in the 5 s or more at rest, because a sensor's filter makes neighbours alike.
    """
    changes = np.flatnonzero(np.diff(force))
    seen = int(np.diff(changes, prepend=-1, append=len(force) - 1).max())
    at_rest = sensor_at_rest(force, rate)
    if at_rest is None:
        return _TIMES_SEEN * seen / rate
    stays = float(erf(at_rest.resolution / (2.0 * math.sqrt(2.0) * at_rest.noise)))
    readings = math.log(_ONCE_IN) / math.log(stays) if 0.0 < stays < 1.0 else 0.0
    return max(readings, _TIMES_SEEN * seen) / rate


def sensor_at_rest(force: Array, rate: float) -> SensorAtRest | None:
    """Estimate noise, resolution and drift at rest; None if all equal.

    `force` [N] at `rate` [Hz] are 5 s or more with nothing touching the blade.
    """
    size = round(NOISE_BLOCK * rate)
    blocks = len(force) // size
    if blocks < _MIN_BLOCKS:
        raise ValueError(
            f"{len(force) / rate:.1f} s of readings are too few: give {_MIN_BLOCKS * NOISE_BLOCK:g} s or more."
        )
    levels = np.unique(force)
    steps = np.diff(levels)
    steps = steps[steps > _DUST * np.ptp(force)]
    if len(steps) == 0:
        return None
    resolution = float(steps.min())
    by_block = force[: blocks * size].reshape(blocks, size)
    spread = float(np.sqrt(by_block.var(axis=1, ddof=1).mean()))
    if resolution < _FINE * spread:
        noise = math.sqrt(spread**2 - resolution**2 / 12.0)  # Sheppard's correction
        zeros = by_block.mean(axis=1)
    else:
        noise, zeros = _unrounded(by_block, resolution, spread)
    drift, error, seen = _walk(zeros, NOISE_BLOCK)
    return SensorAtRest(
        resolution=resolution,
        noise=noise,
        noise_error=noise / math.sqrt(2.0 * blocks * (size - 1)),
        drift=drift,
        drift_error=error,
        drift_seen=seen,
    )


def _unrounded(by_block: Array, resolution: float, spread: float) -> tuple[float, Array]:
    """Return noise before rounding and block zeros by maximum likelihood."""
    n = len(by_block)
    rows, values, counts = [], [], []
    for number, readings in enumerate(by_block):
        levels, repeats = np.unique(readings, return_counts=True)
        rows.append(np.full(len(levels), number))
        values.append(levels)
        counts.append(repeats)
    row, value, count = np.concatenate(rows), np.concatenate(values), np.concatenate(counts)

    def cost(at: Array) -> tuple[float, Array]:
        zero, noise = at[:-1] * resolution, resolution * math.exp(at[-1])
        high = (value + 0.5 * resolution - zero[row]) / noise
        low = high - resolution / noise
        share = np.maximum(ndtr(high) - ndtr(low), _NO_LESS)
        bell_high, bell_low = (np.exp(-0.5 * each**2) / math.sqrt(2.0 * math.pi) for each in (high, low))
        by_zero = np.bincount(row, count * (bell_high - bell_low) / share / noise * resolution, n)
        by_noise = float(np.sum(count * (high * bell_high - low * bell_low) / share))
        return -float(np.sum(count * np.log(share))), np.append(by_zero, by_noise)

    start = np.append(by_block.mean(axis=1) / resolution, math.log(max(spread / resolution, 0.2)))
    found = minimize(cost, start, jac=True, method="L-BFGS-B", bounds=[(None, None)] * n + [(-4.0, 3.0)]).x
    return resolution * math.exp(found[-1]), found[:-1] * resolution


def _walk(zeros: Array, width: float) -> tuple[float, float, float]:
    """Return a random walk's SD after a second, and its error.

    Differences of neighbouring means have a covariance of three diagonals, both for a walk (2/3 and 1/6 of its variance
    over a width) and for noise (2 and -1 of its variance). A sine transform makes both diagonal, which leaves a
    likelihood of two numbers.
    """
    change = np.diff(zeros)
    n = len(change)
    power = dst(change, type=1, norm="ortho") ** 2
    cosine = np.cos(np.pi * np.arange(1, n + 1) / (n + 1))
    of_walk, of_noise = width * (2.0 + cosine) / 3.0, 2.0 - 2.0 * cosine
    if not power.any():
        return 0.0, 0.0, 0.0

    def noise_beside(ratio: float) -> float:
        """Return the best noise variance for a walk ``ratio``."""
        return float(np.mean(power / (ratio * of_walk + of_noise)))

    def cost(logarithm: float) -> float:
        """Return twice the negative log-likelihood, up to a constant."""
        ratio = math.exp(logarithm)
        return float(np.sum(np.log(ratio * of_walk + of_noise)) + n * math.log(noise_beside(ratio)))

    tried = np.linspace(math.log(1e-6), math.log(1e6), 49)
    best = float(tried[np.argmin([cost(each) for each in tried])])
    found = minimize_scalar(cost, bounds=(best - 0.6, best + 0.6), method="bounded")
    ratio = math.exp(found.x)
    noise = noise_beside(ratio)
    shape = ratio * of_walk + of_noise
    first, second = of_walk / shape, of_noise / shape
    information = 0.5 * np.array([[first @ first, first @ second], [first @ second, second @ second]])
    variance, variance_error = ratio * noise, noise * math.sqrt(float(np.linalg.inv(information)[0, 0]))
    seen = math.sqrt(_CLEAR * variance_error)
    if cost(math.log(1e-9)) - found.fun < _CLEAR**2:  # as likely without any
        return 0.0, 0.0, seen
    drift = math.sqrt(variance)
    return drift, 0.5 * variance_error / drift, seen
