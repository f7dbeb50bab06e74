"""Hidden state scaled to order 1, for an asymmetric critic, never a policy."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cutenv._base.arrays import StructArray
from cutenv._engine.jit import njit
from cutenv.sim.cutting.law import depth_at, elastic_force, force_to_grow, stiffness_at, toughness_at
from cutenv.task.declare import Cuts, Task
from cutenv.task.observation import CLIP

PRIVILEGED_FEATURES = (
    "distance from tip to target [cm]",
    "lag of the tip behind the blade [cm]",
    "elastic force over R B at the tip [1]",
    "its value above which a loading blade cuts [1]",
    "ledger over R B 1 mm [1]",
    "K over 500 N/m",
    "LEM at 45 degrees over that at 90, for v -> 0",
    "R over 200 J/m2 at the tip",
    "R over 200 J/m2, 3 mm further",
    "R over 200 J/m2, 6 mm further",
    "R over 200 J/m2, 12 mm further",
)
"""Names of the privileged features."""
LAG = 1  # number of the lag among them
_AHEAD = (0.0, 0.003, 0.006, 0.012)


def privileged_names(task: Task) -> tuple[str, ...]:
    """Return the names of the privileged features of a task."""
    return (*PRIVILEGED_FEATURES, *task.hidden)


def append_privileged(
    cuts: Cuts, task: Task, features: NDArray[np.float32], which: NDArray[np.int64]
) -> NDArray[np.float32]:
    """Append :func:`privileged_names` of cuts ``which``, clipped, to features, (m, size + k)."""
    seen = np.empty((len(features), features.shape[1] + len(PRIVILEGED_FEATURES)), np.float32)
    _append_privileged(cuts.states, cuts.profiles, cuts.laws, cuts.tasks, features, which, seen)
    if task.hide is None:
        return seen
    hidden = np.empty((len(which), len(task.hidden)))
    task.hide(cuts, which, hidden)
    return np.concatenate([seen, np.clip(hidden, -CLIP, CLIP).astype(np.float32)], axis=1)


@njit
def _append_privileged(
    states: StructArray,
    profiles: StructArray,
    laws: StructArray,
    tasks: StructArray,
    features: StructArray,
    which: StructArray,
    seen: StructArray,
) -> None:
    """Fill ``seen`` with the features and the privileged state."""
    hidden = np.empty(len(PRIVILEGED_FEATURES))
    size = features.shape[1]
    for m in range(len(which)):
        n = which[m]
        state, profile, law = states[n], profiles[n], laws[n]
        a = state.tip
        toughness = toughness_at(profile, a)
        hidden[0] = (tasks[n].target - a) / 0.01
        hidden[1] = (state.blade - a) / 0.01
        hidden[2] = elastic_force(profile, state.blade - state.creep, a) / toughness
        growing = force_to_grow(law, state.arrest_ratio, state.held_force, state.pushing, toughness)
        hidden[3] = growing / toughness
        hidden[4] = state.ledger / (toughness * 0.001)
        hidden[5] = stiffness_at(profile, a)[0] / 500.0
        hidden[6] = law.intercept_45 / law.intercept_90
        for k in range(len(_AHEAD)):
            place = a + _AHEAD[k]
            hidden[7 + k] = toughness_at(profile, place) / depth_at(profile, place) / 200.0
        for k in range(size):
            seen[m, k] = features[m, k]
        for k in range(len(hidden)):
            seen[m, size + k] = min(max(hidden[k], -CLIP), CLIP)
