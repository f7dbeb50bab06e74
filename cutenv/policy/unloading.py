"""Stop and unload: the common ending of every script's cut, so that none fails for lack of stopping."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cutenv._base.validation import in_range
from cutenv.policy.tip_estimate import TipEstimate
from cutenv.task.observation import COMPONENTS, SCALES, to_action

UPRIGHT = math.pi / 2
_DECELERATION = 0.1  # [m/s2]
_REACTION = 0.060  # [s]: some 50 ms more than the rig needs; every script's margin was tuned with this value
_NAMES = [component.name for component in COMPONENTS]
_FORCE, _POSITION, _SPEED, _DISTANCE = (_NAMES.index(name) for name in ("force", "position", "speed", "distance"))


def coasting(speed: float) -> float:
    """Return the stopping distance [m] of a blade at ``speed`` [m/s] after a stop command."""
    v = max(speed, 0.0)
    return v * _REACTION + v**2 / (2.0 * _DECELERATION)


class StopAndUnload:
    """Shared ending of a cut: stop at the target, turn upright, draw back until the tissue is unloaded, rest.

    Parameters
    ----------
    margin : float
        Distance of the estimated tip before the target, once the blade has stopped, at which to command the stop [m].
        retreat_speed : float
            Speed of drawing back [m/s].
    tip_estimate : TipEstimate, optional
        Default: the estimator with the measured pig liver's mean stiffness.

    Attributes
    ----------
    tip, left : float
        The estimated tip and its distance to the target [m], at the last observation.
    """

    def __init__(
        self, *, margin: float = 0.0, retreat_speed: float = 0.005, tip_estimate: TipEstimate | None = None
    ) -> None:
        self._margin = in_range("margin", margin, -0.05, 0.05, "m", "3 mm is 0.003.")
        self._retreat_speed = in_range("retreat_speed", retreat_speed, 1e-4, 0.0254, "m/s", "5 mm/s is 0.005.")
        self.tip_estimate = tip_estimate or TipEstimate()
        self.reset()

    def reset(self) -> None:
        """Forget the last cut."""
        self.tip_estimate.reset()
        self.tip = self.left = 0.0
        self._stopping = False
        self._unloaded = False

    def __call__(self, observation: NDArray[np.float32]) -> NDArray[np.float32] | None:
        """Return the action of the ending once it has begun, else None, for an observation, shape (12,)."""
        self.tip = self.tip_estimate(observation)
        position, distance = (float(observation[k]) * SCALES[k] for k in (_POSITION, _DISTANCE))
        self.left = float(position + distance) - self.tip
        if not self._stopping and self.left - coasting(float(observation[_SPEED]) * SCALES[_SPEED]) > self._margin:
            return None
        self._stopping = True
        # While the blade draws back, friction lowers the measured force, so that zero is reached while the tissue still
        # holds the blade with a force of friction's size: little energy is left, and the rest counts as unloaded.
        self._unloaded = self._unloaded or bool(observation[_FORCE] <= 0.0)
        return to_action(0.0 if self._unloaded else -self._retreat_speed, UPRIGHT)
