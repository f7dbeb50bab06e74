"""A script that draws back once, a few millimetres, and knows the tissue's stiffness from then on."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cutenv._base.arrays import Array, Array32, Indices
from cutenv._base.validation import in_range
from cutenv.policy.scripted import INCLINED, Script, checked_approach, checked_motion
from cutenv.policy.signals import DEPTH_COLUMN, FORCE_COLUMN, POSITION_COLUMN, SPEED_COLUMN, to_actions
from cutenv.policy.unloading import StopAndUnload, coasting
from cutenv.task_quantities import SHALLOWEST


class OneReturnStroke(Script):
    """A constant feed with one short return stroke before the target, which measures stiffness and friction.

    It gives up where the force tells that the crack would run beyond the target, as from a vessel that holds it.

    Parameters
    ----------
    speed, angle : float
        Speed [m/s] and angle [rad] of the feed.
    approach : float
        Distance of the estimated tip before the target at which to draw back [m].
    stroke, stroke_speed : float
        Length [m] and speed [m/s] of the return stroke.
    held : float
        Elastic force, in multiples of the resistance met so far, from which the tip counts as held.
    beyond : float
        Distance beyond the target that a predicted run may reach [m]; a held tip that would run further ends the cut.
    run_share : float
        Share of the predicted run that is expected.
    """

    def __init__(
        self,
        *,
        speed: float = 0.0165,
        angle: float = INCLINED,
        approach: float = 0.010,
        stroke: float = 0.0025,
        stroke_speed: float = 0.010,
        held: float = 1.3,
        beyond: float = 0.003,
        run_share: float = 0.7,
        unloading: StopAndUnload | None = None,
    ) -> None:
        super().__init__(unloading or StopAndUnload(margin=-0.0005, retreat_speed=0.012))
        self._speed, self._angle = checked_motion(speed, angle)
        self._approach = checked_approach(approach)
        self._stroke = in_range("stroke", stroke, 0.001, 0.05, "m", "2.5 mm is 0.0025.")
        self._stroke_speed = checked_motion(stroke_speed, angle)[0]
        self._held = in_range("held", held, 1.0, 10.0, "1", "A third above the resistance is 1.3.")
        self._beyond = in_range("beyond", beyond, -0.05, 0.05, "m", "3 mm is 0.003.")
        self._run_share = in_range("run_share", run_share, 0.0, 2.0, "1", "The whole run is 1.")

    def begin(self, rngs: Sequence[np.random.Generator]) -> None:
        """Forget all cuts, and begin ``len(rngs)``."""
        super().begin(rngs)
        self._drawing, self._drawn = np.zeros(len(rngs), bool), np.zeros(len(rngs), bool)

    def forget(self, cuts: Indices) -> None:
        """Begin those cuts again that are given by index."""
        super().forget(cuts)
        self._drawing[cuts] = self._drawn[cuts] = False

    def command(self, seen: Array) -> Array32:
        """Return the feed, or the return stroke."""
        position, speed = seen[:, POSITION_COLUMN], seen[:, SPEED_COLUMN]
        estimates, left = self.unloading.estimates, self.unloading.left
        self._drawing |= ~self._drawn & (left - coasting(speed) <= self._approach)
        self._drawn |= self._drawing
        back = self.unloading.tip_estimate.memory["furthest"] - position
        self._drawing &= (back < self._stroke) & ((seen[:, FORCE_COLUMN] > 0.0) | (speed > 0.0))
        resistance = estimates["resistance"] * np.maximum(seen[:, DEPTH_COLUMN], SHALLOWEST)
        held = (estimates["elastic"] > self._held * resistance) & (speed > 0.0)
        self.unloading.stop(held & (self._run_share * estimates["run"] > left + self._beyond))
        return to_actions(np.where(self._drawing, -self._stroke_speed, self._speed), self._angle)
