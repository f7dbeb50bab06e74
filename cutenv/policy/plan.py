"""Plans of a whole cut and their rollouts through a known tissue, compiled."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from cutenv._base.arrays import Struct, StructArray
from cutenv._engine.jit import njit, njit_internal
from cutenv.cutting.drive import lag_gain
from cutenv.cutting.dtypes import TICK
from cutenv.cutting.simulate import update
from cutenv.task.assessment import assess
from cutenv.task.observation import ANGLE_CENTRE, ANGLE_SCALE, SPEED_SCALE

KNOTS = 28
"""Number of segments of a plan, each with its own speed and angle."""
STRETCH = 0.005
"""Length of a segment along the cut [m]; the last one extends to the end."""
UPRIGHT = 0.5 * math.pi

PLAN: np.dtype[Any] = np.dtype(
    (
        np.record,
        [
            ("speed", "f8", (KNOTS,)),  # of each segment [m/s]
            ("angle", "f8", (KNOTS,)),  # of each segment [rad]
            ("upright_from", "f8"),  # blade position from which the blade turns upright [m]
            ("slow_from", "f8"),  # blade position from which the last speed holds [m]
            ("last_speed", "f8"),  # [m/s]
            ("stop", "f8"),  # blade position at which it stops [m]
            ("retreat", "f8"),  # speed of drawing back [m/s]
            ("rest_lag", "f8"),  # lag of the tip at which drawing back ends [m]
        ],
    )
)
"""Structured dtype of a plan; commands depend on the blade's position, so that a plan does not depend on timing."""


@njit
def planned_command(plan: Struct, position: float) -> tuple[float, float]:
    """Return speed [m/s] and angle [rad] before the stop, for a blade at ``position`` [m]."""
    k = min(max(int(position / STRETCH), 0), KNOTS - 1)
    speed = plan.last_speed if position >= plan.slow_from else plan.speed[k]
    angle = UPRIGHT if position >= plan.upright_from else plan.angle[k]
    return speed, angle


@njit_internal
def roll_out(
    state: Struct,
    profile: Struct,
    law: Struct,
    drive: Struct,
    sensor: Struct,
    task: Struct,
    progress: Struct,
    plan: Struct,
    readings: StructArray,
    terms: StructArray,
    commands: StructArray,
) -> float:
    """Follow ``plan`` to the end of the cut; return its return (sum of rewards).

    Parameters
    ----------
    state, law, drive, sensor, task, progress : Record
        The cut at its start; ``state``, ``sensor`` and ``progress`` are changed.
    profile : Record
        The tissue.
    readings : Records
        Buffer for the readings of a decision, shape (ticks,).
    terms : array, shape (12,)
        Buffer for the reward's terms.
    commands : array, shape (decisions, 2)
        Filled with the speeds [m/s] and angles [rad] commanded.
    """
    total = 0.0
    share = lag_gain(drive, TICK)
    stopping = False
    rested = False
    for decision in range(len(commands)):
        speed, angle = planned_command(plan, state.blade)
        stopping = stopping or state.blade >= plan.stop
        if stopping:
            rested = rested or (state.speed <= 0.0 and state.blade - state.tip <= plan.rest_lag)
            speed, angle = (0.0 if rested else -plan.retreat), UPRIGHT
        # Rounded like an action (float32), so that the plan's rollout equals its execution.
        speed = SPEED_SCALE * np.float64(np.float32(speed / SPEED_SCALE))
        angle = ANGLE_CENTRE + ANGLE_SCALE * np.float64(np.float32((angle - ANGLE_CENTRE) / ANGLE_SCALE))
        commands[decision, 0] = speed
        commands[decision, 1] = angle
        for i in range(len(readings)):
            update(state, profile, law, drive, sensor, share, speed, angle, TICK, readings[i])
        assess(task, progress, profile, readings, True, terms, terms, terms)  # no estimates are needed
        total += terms.sum()
        if progress.end != 0:
            break
    return total


@njit
def roll_out_all(
    starts: StructArray,
    profiles: StructArray,
    laws: StructArray,
    drives: StructArray,
    sensors: StructArray,
    tasks: StructArray,
    progresses: StructArray,
    plans: StructArray,
    readings: StructArray,
    terms: StructArray,
    commands: StructArray,
    returns: StructArray,
) -> None:
    """Run :func:`roll_out` for every plan, shape (n,), from one start (arrays of length 2: start, working copy)."""
    for n in range(len(plans)):
        starts[1] = starts[0]
        sensors[1] = sensors[0]
        progresses[1] = progresses[0]
        returns[n] = roll_out(
            starts[1], profiles[0], laws[0], drives[0], sensors[1], tasks[0], progresses[1], plans[n], readings, terms,
            commands,
        )  # fmt: skip
