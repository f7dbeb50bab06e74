"""Friction from the motor's torque at steady speeds, and play from slow reversals of an empty axis."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cutenv._base.arrays import Array
from cutenv.rig.config.axes import Axis
from cutenv.rig.identification.recording import Stretch

TORQUE_STEP = 1e-3
"""Resolution of the reported torque over the rated one: drives count per mille."""
_LAGS = 5.0  # lags after which a speed counts as steady
_FEWEST = 8  # least number of samples of a steady speed
_BEGUN = 0.5  # share of the speed, from which an axis that reversed counts as moving again
_SIDE = 4  # least number of samples on each side of a step of torque
_CLEAR = 6.0  # standard errors by which the step must exceed zero
_COUNTS = 0.4  # least step, on average, in counts of torque
_ROOM = 0.8  # share of the way between two turns, within which a play can be measured


class Friction(NamedTuple):
    """Friction of the whole axis, as a force on its carriage: Coulomb's part [N], its standard error, and viscous."""

    coulomb: float
    error: float
    viscous: float
    """Viscous friction [N s/m]."""


class Play(NamedTuple):
    """Play between motor and carriage [m], its standard error, and the force that pushes the carriage [N]."""

    backlash: float
    error: float
    carriage: float


class Unseen(NamedTuple):
    """Reason why a quantity cannot be measured."""

    why: str


def force_per_torque(axis: Axis) -> float:
    """Return the force on the carriage [N] at the motor's rated torque; positive: away from the clamp."""
    return axis.direction * axis.rated_torque * 2.0 * math.pi * axis.gear / axis.lead


def coulomb_friction(
    steps: Sequence[Stretch], axis: Axis, *, lag: float, acceleration: float, dead_time: float
) -> Friction | Unseen:
    """Estimate friction from torque at steady speeds both ways: |F| = Coulomb's + viscous |v|, plus a constant load.

    Parameters
    ----------
    steps : sequence of Stretch
        Steps of speed, held until they are steady.
    axis : Axis
        Gear, lead and rated torque.
    lag, acceleration, dead_time : float
        Lag [s], acceleration [m/s2] and dead time [s] of the axis, after which a speed is steady.
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
            if speed != 0.0 and steady.sum() >= _FEWEST:
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
    """Estimate backlash from slow reversals: while the play is crossed, the torque lacks the carriage's friction.

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
    """Return the distance since the motor reversed [m] and the torque there, from where it moves again."""
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
    """Return where torque steps up [m], and by how much, or None if unclear: the split with the least squares."""
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
    """Return the distance between two samples of one leg, at the step [m]."""
    gaps = []
    for way, _ in legs:
        at = int(np.searchsorted(way, place))
        if 0 < at < len(way):
            gaps.append(float(way[at] - way[at - 1]))
    return max(gaps, default=0.0)
