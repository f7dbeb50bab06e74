"""Structured dtypes of the compiled assessment; SI units and radians."""

from __future__ import annotations

from typing import Any

import numpy as np

from cutenv.cutting.dtypes import PROFILE

__all__ = ["ENDS", "EPISODE", "PROGRESS", "STOPPED", "TASK", "TERMS"]

TERMS = (
    "progress",
    "uncontrolled",
    "jump",
    "force",
    "lag",
    "backward",
    "haste",
    "time",
    "tip_error",
    "wedge",
    "stored",
    "safety",
)
"""Names of the reward's terms, in the order of the arrays that hold them."""

ENDS = ("", "finished", "force_limit", "overshoot", "deadline")
"""Names of the ends by code; code 0: not ended."""
STOPPED = "stopped"
"""Name of the end of a cut that a rig's safety has stopped; no simulated cut has it."""

TASK: np.dtype[Any] = np.dtype(
    (
        np.record,
        [(name, "f8") for name in TERMS[1:-1]]  # weights, see RewardWeights
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
            ("window_tip", "f8"),  # tip [m] at the start of the present window of the estimate
            ("window_position", "f8"),
            ("furthest", "f8"),  # of the blade so far [m]
            ("quiet", "f8"),  # time for which the blade has been at rest and unloaded [s]
            ("time", "f8"),  # since reset [s]
            (
                "bristle",
                "f8",
            ),  # deflection of the friction bristles [m]; settled: updates for which it has not changed
            ("settled", "i8"),
            ("out_of_range", "i8"),  # updates of this step at a speed outside the measured range
            ("updates", "i8"),  # number in this step, up to the end if there is one
            ("angle", "f8"),  # of the blade at the last update [rad]
            ("touched", "i8"),  # 1 once the blade has loaded the tissue
            ("end", "i8"),  # index in ENDS
            ("over_limit", "f8"),  # largest force above the limit in this step [N]
            ("overshoot", "f8"),  # of the tip beyond the target [m]
        ],
    )
)
"""Memory of the assessment between decisions."""

EPISODE: np.dtype[Any] = np.dtype((np.record, [("task", TASK), ("progress", PROGRESS), ("nominal", PROFILE)]))
"""One episode: task, progress, and the profile that a rig expects."""
