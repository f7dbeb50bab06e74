"""Privileged state of ``cutenv/DepthCut-v1`` for an asymmetric critic: for training, never for a policy."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cutenv._base.arrays import Array, StructArray
from cutenv._engine.elementary import log
from cutenv._engine.jit import njit
from cutenv.task.cuts import Cuts
from cutenv.task.privileged import PRIVILEGED_FEATURES, append_further
from cutenv.task_quantities import DEPTH_TOLERANCE
from cutenv.tissue.grid import N_POINTS, POINTS_PER_METRE

DEPTH_PRIVILEGED = (
    *PRIVILEGED_FEATURES,
    "depth of cut at the tip less the wanted depth [2 mm]",
    "that less the wanted depth 5 mm further [2 mm]",
    "floor of the cut to the layer below [2 mm]",
    "blade to the layer below, at the tip [2 mm]",
    "logarithm of the layer's toughness over the tissue's [1]",
    "logarithm of the layer's modulus over the tissue's [1]",
    "error of the measured surface at the tip [mm]",
    "mean error of the depth so far over that of a success [1]",
    "largest depth into the layer below [mm]",
)
"""Names of the privileged features: those of gentle cutting, and those of the depth."""
_SHORT, _FINE = 0.002, 0.001  # scales of lengths [m]
_FURTHER = 0.005  # [m]


def append_depth_privileged(
    cuts: Cuts,
    descents: StructArray,
    depths: StructArray,
    features: NDArray[np.float32],
    which: NDArray[np.int64],
) -> NDArray[np.float32]:
    """Append the privileged state of the cuts ``which`` to features, shape (m, size); return shape (m, size + 20).

    ``descents`` and ``depths`` are the records of all cuts, :data:`~cutenv.cutting.descent.DESCENT` and
    :data:`~cutenv.task.depth_terms.DEPTH`.  The columns are those of :data:`DEPTH_PRIVILEGED`, clipped as observations
    are.
    """
    hidden = np.empty((len(which), len(DEPTH_PRIVILEGED) - len(PRIVILEGED_FEATURES)))
    _fill(cuts, descents, depths, which, hidden)
    return append_further(cuts, features, which, hidden)


@njit
def _fill(cuts: Cuts, descents: StructArray, depths: StructArray, which: StructArray, hidden: Array) -> None:
    """Fill the privileged state that depth adds to that of the cuts ``which``, a row for each."""
    for m in range(len(which)):
        n = which[m]
        state, measured, task, descent, depth = (
            cuts.states[n],
            cuts.nominals[n],
            cuts.tasks[n],
            descents[n],
            depths[n],
        )
        i = min(int(state.tip * POINTS_PER_METRE + 0.5), N_POINTS - 1)
        further = min(int((state.tip + _FURTHER) * POINTS_PER_METRE + 0.5), N_POINTS - 1)
        floor, blade = descent.surface[i] - descent.engaged, descent.surface[i] - descent.level
        hidden[m, 0] = (floor - depth.wanted[i]) / _SHORT
        hidden[m, 1] = (floor - depth.wanted[further]) / _SHORT
        hidden[m, 2] = (descent.boundary - floor) / _SHORT
        hidden[m, 3] = (descent.boundary - blade) / _SHORT
        hidden[m, 4] = log(descent.deep_toughness)
        hidden[m, 5] = log(descent.deep_modulus)
        hidden[m, 6] = (measured.depth[i] - descent.surface[i]) / _FINE
        hidden[m, 7] = (depth.deep + depth.uncut) / (task.target * DEPTH_TOLERANCE)
        hidden[m, 8] = depth.deepest / _FINE
