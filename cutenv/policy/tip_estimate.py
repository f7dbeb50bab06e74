"""Where the tip is, from what a rig sees: the blade less the elastic force over the nominal stiffness."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cutenv.task.observation import COMPONENTS, OFFSETS, SCALES, checked_observation
from cutenv.tissue.description import TissueDescription, measured_liver
from cutenv.tissue.specimen import SPACING, unit_stiffness

_INDEX = {component.name: k for k, component in enumerate(COMPONENTS)}
_ITERATIONS = 3  # of a = x - F/K(a): converges by K'(x - a)/K each time
_SHALLOWEST = 0.001  # [m]


class TipEstimate:
    """The crack tip for an observation, if the tissue were the mean one.

    An observation tells the depth at the blade; the tip stands behind, where the bulge is thinner.  So the depth is
    remembered from when the blade passed.

    Parameters
    ----------
    tissue : TissueDescription, optional
        What the rig believes to cut; default the measured pig liver.
    """

    def __init__(self, tissue: TissueDescription | None = None) -> None:
        tissue = tissue or measured_liver()
        self._stiffness_per_depth = (tissue.intercept_90 * unit_stiffness(tissue)).tolist()
        self._friction_per_depth = tissue.friction_share * tissue.fracture_resistance
        self.reset()

    def reset(self) -> None:
        """Forget the last cut."""
        self._depth: list[float] = []  # at 0, 1, 2 ... grid spacings from the clamp, as far as the blade has been

    def __call__(self, observation: NDArray[np.float32]) -> float:
        """The tip [m] for an observation, shape (12,), of the cut since :meth:`reset`."""
        seen = (checked_observation(observation) * SCALES + OFFSETS).tolist()
        position, speed = max(seen[_INDEX["position"]], 0.0), seen[_INDEX["speed"]]
        depth = max(seen[_INDEX["depth"]], _SHALLOWEST)
        self._remember(position, depth)
        friction = math.copysign(self._friction_per_depth * depth, speed) if speed else 0.0
        elastic = max(seen[_INDEX["force"]] - friction, 0.0)
        tip: float = position
        for _ in range(_ITERATIONS):
            place = min(max(round(tip / SPACING), 0), len(self._depth) - 1)
            tip = position - elastic / (self._stiffness_per_depth[place] * self._depth[place])
        return max(tip, 0.0)

    def _remember(self, position: float, depth: float) -> None:
        """Keep the depth up to ``position``, evenly between here and where it was last seen."""
        passed = min(round(position / SPACING), len(self._stiffness_per_depth) - 1) + 1 - len(self._depth)
        before = self._depth[-1] if self._depth else depth
        self._depth.extend(before + (depth - before) * (k + 1) / passed for k in range(passed))
