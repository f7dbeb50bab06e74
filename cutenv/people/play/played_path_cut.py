"""Cut by a person along a drawn line.

An episode of ``cutenv/PathCut-v1`` at 1 kHz.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cutenv._base.arrays import Array
from cutenv.envs.path_cut import PathCutEnv, to_path_action
from cutenv.people.play.devices import ScriptedDevice, watching_hand
from cutenv.people.play.hand_model import PLAYED_HAND, hand_over_slab, steered_toward
from cutenv.people.play.haptics import Stylus
from cutenv.people.play.played_cut import PlayedCut
from cutenv.task.path import PATH_CUT

_AT = [each.name for each in PATH_CUT.all_components].index("lateral")
_LATERAL = PATH_CUT.all_components[_AT]


class PlayedPathCut(PlayedCut):
    """Cut of one specimen by a hand along a drawn line.

    The blade points where the hand is moved.

    It is an episode of ``PathCutEnv(drive="hand", control_hz=1000)`` with the same seed.  The blade hangs on the hand
    by a spring, behind it; it turns toward the place where the hand is wanted, at the task's rate of turn at most.
    """

    environment = PathCutEnv
    channels = ("blade_x", "blade_y", "lateral_force")
    third = "across"

    @property
    def places(self) -> Array:
        """Blade places along and across the slab [m], shape (n, 2)."""
        return self._further[: self._count, :2]

    @property
    def lateral_force(self) -> Array:
        """Measured blade force to its right [N], shape (n,)."""
        return self._channel("lateral_force")

    @property
    def hand_place(self) -> tuple[float, float]:
        """Hand's place along and left across [m], ahead of the blade."""
        along, across = hand_over_slab(self.plant.states[0], self.cutting.motion[0])
        return float(along), float(across)

    def action(self, stylus: Stylus) -> NDArray[np.float32]:
        """Return the environment's action: speed, and turn toward the hand."""
        speed, turn = steered_toward(
            self.plant.states[0], self.cutting.motion[0], (stylus.position, stylus.across), PLAYED_HAND.motor_lag,
            PLAYED_HAND.acceleration,
        )  # fmt: skip
        return to_path_action(float(speed), stylus.angle, float(turn))

    def simple_hand(self) -> ScriptedDevice:
        """Return a scripted hand that follows the line by the tip."""
        return watching_hand(self._tip, self.target_length, line=self.cutting.line)

    def _sampled(self) -> tuple[float, ...]:
        return *self.cutting.blade_place, _LATERAL.scale * float(self._observation[_AT])

    @property
    def map_words(self) -> str:
        """Path of the cut so far in words."""
        found = self.cutting.errors
        mean, largest = found["mean_distance_mm"], found["largest_distance_mm"]
        area = found["area_mm2"]
        return f"Path: {mean:.1f} mm off the line in the mean, {largest:.1f} mm at most; {area:.0f} mm² between them."
