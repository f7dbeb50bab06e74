"""Stop and unload: the common ending of every script's cut, so that none fails for lack of stopping."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cutenv._base.arrays import Array, Array32, Indices, StructArray
from cutenv._base.validation import in_range
from cutenv.policy.signals import DISTANCE_COLUMN, FORCE_COLUMN, POSITION_COLUMN, SPEED_COLUMN, choose, in_si
from cutenv.policy.tip_estimate import CUT_ESTIMATE, TipEstimate
from cutenv.task.observation import to_action

UPRIGHT = math.pi / 2
_DECELERATION = 0.1  # [m/s2]
_REACTION = 0.060  # [s]: some 50 ms more than the rig needs; every script's margin was tuned with this value


def coasting(speed: ArrayLike) -> Array:
    """Return the stopping distance [m] of a blade at ``speed`` [m/s] after a stop command."""
    v: Array = np.maximum(speed, 0.0)
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
    tip, left : float, or array of shape (n,)
        The estimated tip and its distance to the target [m], at the last observation, or at those of n cuts.
    estimates : Records, shape (n,)
        All that is estimated of the cuts, :data:`cutenv.policy.tip_estimate.CUT_ESTIMATE`.
    """

    def __init__(
        self, *, margin: float = 0.0, retreat_speed: float = 0.005, tip_estimate: TipEstimate | None = None
    ) -> None:
        self._margin = in_range("margin", margin, -0.05, 0.05, "m", "3 mm is 0.003.")
        in_range("retreat_speed", retreat_speed, 1e-4, 0.0254, "m/s", "5 mm/s is 0.005.")
        self._draw_back, self._rest = to_action(-retreat_speed, UPRIGHT), to_action(0.0, UPRIGHT)
        self.tip_estimate = tip_estimate or TipEstimate()
        self.reset()

    def reset(self) -> None:
        """Forget the last cut."""
        self.begin(1)

    def begin(self, count: int) -> None:
        """Forget all cuts, and begin ``count``."""
        self.tip_estimate.begin(count)
        self.estimates: StructArray = np.zeros(count, CUT_ESTIMATE)
        self.tip: Any = np.zeros(count)
        self.left: Any = np.zeros(count)
        self._stopping, self._unloaded = np.zeros(count, bool), np.zeros(count, bool)

    def forget(self, cuts: Indices) -> None:
        """Begin those cuts again that are given by index."""
        self.tip_estimate.forget(cuts)
        self._stopping[cuts] = self._unloaded[cuts] = False

    def stop(self, cuts: NDArray[np.bool_]) -> None:
        """Begin the ending of those cuts now, wherever their tips are; ``cuts`` has shape (n,)."""
        self._stopping |= cuts

    def __call__(self, observation: Array32) -> Array32 | None:
        """Return the action of the ending once it has begun, else None, for an observation, shape (12,)."""
        begun, actions = self.endings(in_si(observation)[None])
        self.tip, self.left = float(self.tip[0]), float(self.left[0])
        return actions[0] if begun[0] else None

    def endings(self, seen: Array) -> tuple[NDArray[np.bool_], Array32]:
        """Return which endings have begun, shape (n,), and their actions, for observations in SI units, (n, 12)."""
        self.estimates = self.tip_estimate.estimates(seen)
        self.tip = self.estimates["tip"]
        self.left = seen[:, POSITION_COLUMN] + seen[:, DISTANCE_COLUMN] - self.tip
        self._stopping |= self.left - coasting(seen[:, SPEED_COLUMN]) <= self._margin
        # While the blade draws back, friction lowers the measured force, so that zero is reached while the tissue still
        # holds the blade with a force of friction's size: little energy is left, and the rest counts as unloaded.
        self._unloaded |= self._stopping & (seen[:, FORCE_COLUMN] <= 0.0)
        return self._stopping, choose(self._unloaded, self._rest, self._draw_back)
