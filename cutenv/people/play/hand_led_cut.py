"""Cut that a person's hand leads: an episode of an environment, whatever advances it."""

from __future__ import annotations

from typing import Any

from cutenv.envs.gentle_cut import GentleCutEnv
from cutenv.people.play.devices import ScriptedDevice, watching_hand
from cutenv.sim.tissue.grid import depth_below


class HandLedCut:
    """Cut that a person's hand leads."""

    environment: type[GentleCutEnv] = GentleCutEnv
    """Environment whose episode it is."""
    third: str = ""
    """Way of the hand besides the position and the angle: "level", "across" or none."""
    _env: GentleCutEnv

    @property
    def cutting(self) -> Any:
        """Episode of this cut."""
        return self._env.cutting

    @property
    def specimen_words(self) -> str:
        """Specimen class, and tissue name unless it is measured pig liver."""
        return self._env.tissue.words(self._env.specimen_class)

    @property
    def target_length(self) -> float:
        """Target length [m]."""
        return float(self.cutting.target_length)

    @property
    def level(self) -> float:
        """Level of the blade's lower end [m], 0 at the specimen's profile, where a depth is wanted."""
        return float(self.cutting.motion["level"][0])

    def wanted_level(self, position: float) -> float:
        """Return the wanted floor's level above that of the blade at the start [m]."""
        return float(depth_below(self.cutting.shown_depth.wanted, position)) - self._start

    _start = 0.0  # level of the blade at the start, where a depth is wanted [m]

    def simple_hand(self) -> ScriptedDevice:
        """Return a scripted hand that watches the tip, and keeps to a wanted depth or line."""
        further: dict[str, Any] = {}
        if self.third == "level":
            further["level"] = self.wanted_level
        elif self.third == "across":
            further["line"] = self.cutting.line
        return watching_hand(lambda: float(self._env.plant.states["tip"][0]), self.target_length, **further)
