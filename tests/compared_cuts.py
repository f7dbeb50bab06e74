"""Made-up cuts to be compared: a force that saws while the blade moves on, more or less, later or sooner."""

from __future__ import annotations

import functools

import numpy as np

from cutenv.agents.sim_to_real import Agreement, ComparedCut
from cutenv.sim.trace import Trace

SPEED = 0.0127  # [m/s]


@functools.cache  # scored once
def made_up_cut(
    specimen: int, noise: int, *, offset: float = 0.0, delay: float = 0.0, success: bool = True, end: str = "finished"
) -> ComparedCut:
    """Three seconds at 1 kHz: the specimen's own sawing force, the sensor's noise, an offset [N], a delay [s]."""
    own, rng = np.random.default_rng(specimen), np.random.default_rng([specimen, noise + 1])
    time = 0.001 * np.arange(1, 3001)
    felt_at = time - delay
    pitch, height = own.uniform(0.3, 0.5), own.uniform(1.0, 2.0)
    force = 1.0 + height * np.mod(felt_at, pitch) / pitch + offset + 0.02 * rng.standard_normal(len(time))
    trace = Trace(
        time=time, force=force, position=SPEED * time, speed=np.full(len(time), SPEED),
        angle=np.full(len(time), np.pi / 2), depth=np.full(len(time), 0.02), metadata={"target_length_m": 0.04},
    )  # fmt: skip
    value = 0.5 + 0.1 * own.standard_normal() + 0.01 * rng.standard_normal()
    return ComparedCut(trace=trace, value=value, success=success, end=end)


@functools.cache
def made_up_agreement(specimens: int = 16, draws: int = 3, *, paired: bool = True, **of_rig: object) -> Agreement:
    """The rig's cuts beside the simulator's, ``of_rig`` changed as :func:`made_up_cut` takes it."""
    first = 0 if paired else 1000
    return Agreement(
        [made_up_cut(first + k, 99, **of_rig) for k in range(specimens)],  # type: ignore[arg-type]
        [[made_up_cut(k, draw) for draw in range(draws)] for k in range(specimens)],
        paired=paired,
    )
