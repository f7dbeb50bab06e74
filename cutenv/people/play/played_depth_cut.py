"""Cut by a person along a wanted depth.

An episode of ``cutenv/DepthCut-v1`` at 1 kHz.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cutenv.envs.depth_cut import DepthCutEnv
from cutenv.people.play.devices import ScriptedDevice, watching_hand
from cutenv.people.play.hand_model import descent_toward
from cutenv.people.play.haptics import Stylus
from cutenv.people.play.played_cut import PlayedCut
from cutenv.sim.tissue.grid import depth_below


class PlayedDepthCut(PlayedCut):
    """Cut of one specimen by a hand along a wanted depth.

    The blade goes to the level that is asked for.

    It is an episode of ``DepthCutEnv(drive="hand", control_hz=1000)`` with the same seed.  Along the cut the hand holds
    the blade by a spring; up and down the blade is led as a drive leads it.
    """

    environment = DepthCutEnv
    channels = ("height", "vertical_force")
    third = "level"

    def __init__(self, **keywords: Any) -> None:
        super().__init__(**keywords)
        self._start = self.level

    @property
    def level(self) -> float:
        """Level of the blade's lower end [m], 0 at the specimen's profile."""
        return float(self.cutting.motion["level"][0])

    def wanted_level(self, position: float) -> float:
        """Return the wanted floor's level above the starting blade's [m]."""
        return float(depth_below(self.cutting.shown_depth.wanted, position)) - self._start

    def action(self, stylus: Stylus) -> NDArray[np.float32]:
        """Return the environment's action, with descent to the wanted level."""
        descent = descent_toward(self.level, self._start + stylus.level)
        return np.append(super().action(stylus), np.float32(np.clip(descent, -1.0, 1.0)))

    def simple_hand(self) -> ScriptedDevice:
        """Return a scripted hand that keeps the wanted depth."""
        return watching_hand(self._tip, self.target_length, level=self.wanted_level)

    def _sampled(self) -> tuple[float, ...]:
        return self.level, float(self.cutting.across[0])

    @property
    def map_words(self) -> str:
        """Depth of the cut so far in words."""
        found = self.cutting.errors
        opened = found["layer_mm"]
        below = f"{opened:.1f} mm into the layer below" if opened > 0.0 else "the layer below is not opened"
        return f"Depth: {found['mean_error_mm']:.1f} mm off the wanted one in the mean; {below}."
