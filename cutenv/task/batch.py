"""Many cuts side by side: one compiled call commands, cuts, feels, assesses and observes all of them."""

from __future__ import annotations

import numba

from cutenv.compiled import compiled, compiled_parallel
from cutenv.cutting.law import depth_at, elastic_force, stiffness_at, toughness_at
from cutenv.cutting.records import TICK, Records
from cutenv.cutting.simulate import update
from cutenv.task.assessment import assess
from cutenv.task.observation import ANGLE_CENTRE, ANGLE_SCALE, SPEED_SCALE, observe

HIDDEN = (
    "distance from tip to target [cm]",
    "lag of the tip behind the blade [cm]",
    "elastic force over R B at the tip [1]",
    "its value at the last arrest [1]",
    "ledger over R B 1 mm [1]",
    "K over 500 N/m",
    "R over 200 J/m2 at the tip",
    "R over 200 J/m2, 3 mm further",
    "R over 200 J/m2, 6 mm further",
    "R over 200 J/m2, 12 mm further",
)
"""The hidden state as numbers of order 1, for a critic that may see it during training."""
_AHEAD = (0.0, 0.003, 0.006, 0.012)


@compiled_parallel
def step_all(
    states: Records,
    profiles: Records,
    laws: Records,
    drives: Records,
    sensors: Records,
    tasks: Records,
    progresses: Records,
    nominals: Records,
    actions: Records,
    readings: Records,
    terms: Records,
    observations: Records,
) -> None:
    """One decision of n cuts, assessed by hidden state; every array has a leading axis of length n.

    ``actions`` (n, 2) float64 within [-1, 1]; ``readings`` (n, ticks), ``terms`` (n, 12) and ``observations`` (n, 12)
    float32 are filled.
    """
    for n in numba.prange(len(states)):
        speed = SPEED_SCALE * actions[n, 0]
        angle = ANGLE_CENTRE + ANGLE_SCALE * actions[n, 1]
        own = readings[n]
        for i in range(len(own)):
            update(states[n], profiles[n], laws[n], drives[n], sensors[n], speed, angle, TICK, own[i])
        assess(tasks[n], progresses[n], profiles[n], own, own["true_force"], own["tip"], own["jump"], terms[n])
        felt = own[: progresses[n].updates]
        observe(tasks[n], nominals[n], felt, progresses[n].time, actions[n], observations[n])


@compiled
def reveal_all(states: Records, profiles: Records, tasks: Records, hidden: Records) -> None:
    """Fill ``hidden``, shape (n, 10), with what :data:`HIDDEN` names."""
    for n in range(len(states)):
        state, profile = states[n], profiles[n]
        a = state.tip
        toughness = toughness_at(profile, a)
        hidden[n, 0] = (tasks[n].target - a) / 0.01
        hidden[n, 1] = (state.blade - a) / 0.01
        hidden[n, 2] = elastic_force(profile, state.blade, a) / toughness
        hidden[n, 3] = min(state.arrest_ratio, 2.0)
        hidden[n, 4] = state.ledger / (toughness * 0.001)
        hidden[n, 5] = stiffness_at(profile, a)[0] / 500.0
        for k in range(len(_AHEAD)):
            place = a + _AHEAD[k]
            hidden[n, 6 + k] = toughness_at(profile, place) / depth_at(profile, place) / 200.0
