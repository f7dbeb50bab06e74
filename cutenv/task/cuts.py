"""Many cuts side by side: one compiled call commands, cuts, feels, assesses and observes all of them, on all cores."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from cutenv.compiled import compiled, compiled_for_cores
from cutenv.cutting.drive import made_up
from cutenv.cutting.records import DRIVE, LAW, PROFILE, READING, STATE, TICK, Records
from cutenv.cutting.sensor import SENSOR, WRAP
from cutenv.cutting.simulate import update
from cutenv.task.assessment import assess
from cutenv.task.estimate import estimate
from cutenv.task.observation import ANGLE_CENTRE, ANGLE_SCALE, SPEED_SCALE, observe
from cutenv.task.records import PROGRESS, TASK, TERMS
from cutenv.task.told import tell
from cutenv.tissue.grid import N_POINTS, POINTS_PER_METRE

SPECIMEN: np.dtype[Any] = np.dtype(
    (np.record, [("modulus", "f8", (N_POINTS,)), ("fracture_resistance", "f8", (N_POINTS,))])
)
"""What is told of a specimen beyond its profile: local effective modulus [Pa], measured kind of resistance [J/m2]."""


class Cuts(NamedTuple):
    """Everything about n cuts, as records of shape (n,)."""

    states: Records
    profiles: Records
    laws: Records
    drives: Records
    sensors: Records
    tasks: Records
    progresses: Records
    nominals: Records
    """The profiles that a rig expects."""
    per_depth: Records
    """Their stiffness [N/m2] and toughness [N/m] over depth; shape (1,), the same for all cuts."""
    specimens: Records

    @classmethod
    def empty(cls, count: int) -> Cuts:
        """``count`` cuts not yet begun."""
        return cls(
            states=np.zeros(count, STATE),
            profiles=np.zeros(count, PROFILE),
            laws=np.zeros(count, LAW),
            drives=np.zeros(count, DRIVE),
            sensors=np.zeros(count, SENSOR),
            tasks=np.zeros(count, TASK),
            progresses=np.zeros(count, PROGRESS),
            nominals=np.zeros(count, PROFILE),
            per_depth=np.zeros(1, PROFILE),
            specimens=np.zeros(count, SPECIMEN),
        )


@compiled_for_cores
def step_some(
    first: int,
    last: int,
    cuts: Cuts,
    ticks: int,
    from_truth: bool,
    waiting: Records,
    actions: Records,
    observations: Records,
    rewards: Records,
    ends: Records,
    told: Records,
) -> float:
    """One decision of the cuts from ``first`` to before ``last`` of n.

    Parameters
    ----------
    first, last : int
        See :func:`cutenv.cores.over_cores`.
    cuts : Cuts
        Changed in place.
    ticks : int
        Milliseconds until the next decision.
    from_truth : bool
        Whether the reward is assessed by hidden state, or by what a rig estimates.
    waiting : array of bool, shape (n,)
        Cuts that are left alone: they have ended.
    actions : array, shape (n, 2)
        Within [-1, 1].
    observations, rewards, ends, told : array, shape (n, 12) float32, (n,), (n,) int64, (n, 30)
        Filled: ``ends`` are indices in :data:`~cutenv.task.records.ENDS`; ``told`` is what
        :func:`~cutenv.task.told.tell` tells.
    """
    # One room for all: it stays in the first-level cache.
    readings = np.empty(ticks, READING)
    tips, jumps = np.empty(ticks), np.empty(ticks)
    terms = np.empty(len(TERMS))
    states = np.empty(1, STATE)
    touched = 0.0
    for n in range(first, last):
        touched += _touch(cuts, min(n + 1, last - 1))
        if waiting[n]:
            rewards[n] = 0.0
            ends[n] = 0
            continue
        # Records, for they are passed on without counting references: two cores would quarrel about the counts.
        state, sensor, drive, law = cuts.states[n], cuts.sensors[n], cuts.drives[n], cuts.laws[n]
        profile, nominal, specimen = cuts.profiles[n], cuts.nominals[n], cuts.specimens[n]
        task, progress = cuts.tasks[n], cuts.progresses[n]
        speed = SPEED_SCALE * actions[n, 0]
        angle = ANGLE_CENTRE + ANGLE_SCALE * actions[n, 1]
        share = made_up(drive, TICK)
        states[0] = state
        offset = sensor.offset
        for i in range(ticks):
            update(state, profile, law, drive, sensor, share, speed, angle, TICK, readings[i])
        known = profile
        if not from_truth:
            known = nominal
            estimate(task, progress, nominal, readings, tips, jumps)
        assess(task, progress, known, readings, from_truth, tips, jumps, terms)
        observe(task, nominal, readings[: progress.updates], progress.time, actions[n], observations[n])
        if progress.updates < ticks:  # what came after the end is taken back
            cuts.states[n] = states[0]
            sensor.offset = offset  # the rest of its memory is written anew before it is read
            for i in range(progress.updates):
                update(state, profile, law, drive, sensor, share, speed, angle, TICK, readings[i])
        rewards[n] = total(terms)
        ends[n] = progress.end
        tell(
            state, profile, law, task, progress, specimen.modulus, specimen.fracture_resistance, terms, told[n]
        )  # fmt: skip
    return touched


@compiled
def _touch(cuts: Cuts, n: int) -> float:
    """Have the memory of cut n brought near, all of it at once: met one after the other, each part is waited for.

    The sum is of no use, but that it keeps the compiler from leaving this out.
    """
    state, sensor, profile, specimen = cuts.states[n], cuts.sensors[n], cuts.profiles[n], cuts.specimens[n]
    at_tip = min(max(int(state.tip * POINTS_PER_METRE), 0), N_POINTS - 2)
    at_blade = min(max(int(state.blade * POINTS_PER_METRE), 0), N_POINTS - 2)
    touched: float = (
        profile.stiffness[at_tip]
        + profile.toughness[at_tip]
        + profile.depth[at_blade]
        + cuts.nominals[n].depth[at_blade]
        + specimen.modulus[at_tip]
        + specimen.fracture_resistance[at_tip]
        + cuts.laws[n].eta90
        + cuts.drives[n].lag
        + cuts.tasks[n].target
        + cuts.progresses[n].time
        + sensor.noise
        + sensor.line[state.tick & WRAP]
        + sensor.line[(state.tick + 16) & WRAP]
        + sensor.standard_noise[0]
    )
    return touched


@compiled
def total(terms: Records) -> float:
    """The reward: the sum of its terms, one after the other."""
    reward = 0.0
    for k in range(len(terms)):
        reward += terms[k]
    return reward


@compiled
def tell_of_all(cuts: Cuts, which: Records, told: Records) -> None:
    """Fill what is told of the cuts numbered ``which`` at their start: no reward yet."""
    terms = np.zeros(len(TERMS))
    for n in which:
        specimen = cuts.specimens[n]
        tell(
            cuts.states[n], cuts.profiles[n], cuts.laws[n], cuts.tasks[n], cuts.progresses[n],
            specimen.modulus, specimen.fracture_resistance, terms, told[n],
        )  # fmt: skip
