"""Structured dtypes of the compiled assessment; SI units and radians."""

from __future__ import annotations

from typing import Any

import numpy as np

from cutenv.task.reward import ENDS, REWARD, STOPPED, TERMS
from cutenv.tissue.grid import N_POINTS

__all__ = ["ENDS", "PROGRESS", "SPECIMEN", "STOPPED", "TASK", "TERMS"]

TASK: np.dtype[Any] = np.dtype(
    (
        np.record,
        [(term.name, "f8") for term in REWARD if term.weight is not None]  # weights, see RewardWeights
        + [
            ("target", "f8"),  # L [m]
            ("deadline", "f8"),  # [s]
            ("force_limit_per_depth", "f8"),  # [N/m]
            ("friction_per_depth", "f8"),  # of the moving blade [N/m]
            ("speed_min", "f8"),  # measured range [m/s]
            ("speed_max", "f8"),
        ],
    )
)

PROGRESS: np.dtype[Any] = np.dtype(
    (
        np.record,
        [
            ("tip", "f8"),  # so far, as assessed [m]
            ("position", "f8"),  # of the blade at the last reading [m]
            ("furthest", "f8"),  # of the blade so far [m]
            ("quiet", "f8"),  # time for which the blade has been at rest and unloaded [s]
            ("loaded_at", "f8"),  # position of the blade when the tissue was last loaded [m]
            ("time", "f8"),  # since reset [s]
            ("updates", "i8"),  # number in this step, up to the end if there is one
            ("angle", "f8"),  # of the blade at the last update [rad]
            ("touched", "i8"),  # 1 once the blade has loaded the tissue
            ("end", "i8"),  # index in ENDS
        ],
    )
)
"""Memory of the assessment between decisions."""

SPECIMEN: np.dtype[Any] = np.dtype(
    (np.record, [("modulus", "f8", (N_POINTS,)), ("fracture_resistance", "f8", (N_POINTS,))])
)
"""Properties of a specimen reported in `info` beyond its profile: modulus [Pa], fracture resistance [J/m2]."""
