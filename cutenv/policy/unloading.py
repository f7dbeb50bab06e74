"""Stop and unload: how every script ends a cut, so that none fails for not stopping."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cutenv.policy.tip_estimate import TipEstimate
from cutenv.task.observation import in_units, to_action
from cutenv.validation import in_range

UPRIGHT = math.pi / 2


class StopAndUnload:
    """Ends a cut: stop at the target, turn upright, draw back until the tissue is unloaded, rest.

    Parameters
    ----------
    margin : float
        Stop when the estimated tip is this far before the target [m]: half a unit, so that the run that crosses
        this line ends around the target.
    retreat_speed : float
        Of drawing back [m/s].
    tip_estimate : TipEstimate, optional
        Default: with the measured pig liver's mean stiffness.
    """

    def __init__(
        self, *, margin: float = 0.003, retreat_speed: float = 0.005, tip_estimate: TipEstimate | None = None
    ) -> None:
        self._margin = in_range("margin", margin, -0.05, 0.05, "m", "Half a unit, 3 mm, is 0.003.")
        self._retreat_speed = in_range("retreat_speed", retreat_speed, 1e-4, 0.0254, "m/s", "5 mm/s is 0.005.")
        self._tip_estimate = tip_estimate or TipEstimate()
        self.reset()

    def reset(self) -> None:
        """Forget the last cut."""
        self._tip_estimate.reset()
        self._stopping = False
        self._unloaded = False

    def distance_left(self, observation: NDArray[np.float32]) -> float:
        """From the estimated tip to the target [m], for an observation, shape (12,)."""
        seen = in_units(observation)
        return float(seen["position"] + seen["distance"]) - self._tip_estimate(observation)

    def __call__(self, observation: NDArray[np.float32]) -> NDArray[np.float32] | None:
        """The action once the cut is to end, else None."""
        left = self.distance_left(observation)
        if not self._stopping and left > self._margin:
            return None
        self._stopping = True
        # Drawing back, friction pulls the force below the elastic one, so that zero is reached while the tissue still
        # holds the blade by the size of friction: little energy, and a rest that counts as unloaded.
        self._unloaded = self._unloaded or bool(in_units(observation)["force"] <= 0.0)
        return to_action(0.0 if self._unloaded else -self._retreat_speed, UPRIGHT)
