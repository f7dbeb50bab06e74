"""The tip by which a rig assesses a cut, and its runs: those of :mod:`cutenv.tissue.crack_tip`."""

from __future__ import annotations

from cutenv._base.arrays import Struct
from cutenv._engine.jit import njit_internal
from cutenv.cutting.dtypes import TICK
from cutenv.task_quantities import SMALLEST_RUN
from cutenv.tissue.crack_tip import ESTIMATED_EVERY, BladeReading, MeanTissue, assess_tip

_UPDATES = round(ESTIMATED_EVERY / TICK)  # whatever the decision rate


@njit_internal
def estimated_tip(
    memory: Struct, task: Struct, nominal: Struct, tick: int, reading: BladeReading
) -> tuple[float, float]:
    """Return tip and unstable growth [m] at update ``tick`` (from 1 at reset); both change every 20 ms.

    The tip's advance beyond the blade's counts as an unstable run.  ``memory`` is
    :data:`~cutenv.tissue.crack_tip.ASSESSED_TIP`, changed in place.
    """
    if tick % _UPDATES != 0:
        return memory.tip, 0.0
    advance = max(reading.position - memory.position, 0.0)
    mean = MeanTissue(nominal.stiffness, len(nominal.stiffness), task.friction_per_depth)
    run = assess_tip(memory, mean, reading) - advance
    return memory.tip, run if run > SMALLEST_RUN else 0.0
