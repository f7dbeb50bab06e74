"""Privileged state of ``cutenv/PathCut-v1`` for an asymmetric critic: for training, never for a policy."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cutenv._base.arrays import Array, StructArray
from cutenv._engine.jit import njit
from cutenv.cutting.law import grid_index, lerp
from cutenv.task.cuts import Cuts
from cutenv.task.privileged import PRIVILEGED_FEATURES, append_further
from cutenv.task_quantities import FARTHEST_TOLERANCE, LINE_TOLERANCE

PATH_PRIVILEGED = (
    *PRIVILEGED_FEATURES,
    "tip to the left of the line [mm]",
    "sine of the angle from the line to the crack [0.2]",
    "curvature of the line at the tip, to the left [25/m]",
    "blade to the left of the crack's course [2 mm]",
    "shift of the blade to the left per way along the crack that its stiffness asks for [1]",
    "stiffness across the crack over that along it [1]",
    "mean distance of the cut to the line so far over that of a success [1]",
    "largest distance of the cut to the line so far over that of a success [1]",
)
"""Names of the privileged features: those of gentle cutting, and those of the path."""
_MILLIMETRE = 0.001  # [m]


def append_path_privileged(
    cuts: Cuts, steerings: StructArray, paths: StructArray, features: NDArray[np.float32], which: NDArray[np.int64]
) -> NDArray[np.float32]:
    """Append the privileged state of the cuts ``which`` to features, shape (m, size); return shape (m, size + 19).

    ``steerings`` and ``paths`` are the records of all cuts, :data:`~cutenv.cutting.steering.STEERING` and
    :data:`~cutenv.task.path_terms.PATH_MAP`.  The columns are those of :data:`PATH_PRIVILEGED`, clipped as observations
    are.
    """
    hidden = np.empty((len(which), len(PATH_PRIVILEGED) - len(PRIVILEGED_FEATURES)))
    _fill(cuts, steerings, paths, which, hidden)
    return append_further(cuts, features, which, hidden)


@njit
def _fill(cuts: Cuts, steerings: StructArray, paths: StructArray, which: StructArray, hidden: Array) -> None:
    """Fill the privileged state that the path adds to that of the cuts ``which``, a row for each."""
    for m in range(len(which)):
        n = which[m]
        state, profile, task, steering, path = (cuts.states[n], cuts.profiles[n], cuts.tasks[n], steerings[n], paths[n])
        i, share = grid_index(state.tip)
        t_x, t_y = lerp(steering.cosine, i, share), lerp(steering.sine, i, share)
        along = lerp(profile.stiffness, i, share) * steering.per_stretch**2
        hidden[m, 0] = steering.tip_aside / _MILLIMETRE
        hidden[m, 1] = (t_x * steering.tip_across - t_y * steering.tip_ahead) / 0.2
        hidden[m, 2] = lerp(steering.curvature, i, share) / 25.0
        hidden[m, 3] = steering.offset / (2.0 * _MILLIMETRE)
        hidden[m, 4] = 0.0 - steering.coupling * along / max(steering.side_stiffness, 1e-3 * along)
        hidden[m, 5] = steering.side_stiffness / along
        hidden[m, 6] = path.distance / (task.target * LINE_TOLERANCE)
        hidden[m, 7] = path.farthest / FARTHEST_TOLERANCE
