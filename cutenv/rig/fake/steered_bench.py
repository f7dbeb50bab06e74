"""Bench of a fake rig with an axis to the side: a specimen along a line, which feels the blade in the plane."""

from __future__ import annotations

from typing import Any

from cutenv.cutting.parameters import LawParameters
from cutenv.cutting.sensor import Sensor, SensorParameters
from cutenv.rig.config.settings import RigSettings
from cutenv.rig.fake.air_plant import AirPlant
from cutenv.rig.tissue_in_plane import TissueInPlane
from cutenv.tissue.lines import CutLine
from cutenv.tissue.specimen import Specimen

_ACROSS = 2**32  # added to the seed of the noise of the force to the side


class SteeredBench(AirPlant):
    """Specimen under the law in the plane, with the simulator's drive and sensor, and a second one to the side.

    Parameters
    ----------
    specimen : Specimen
        Specimen, with the blade at the clamp, in the middle.
    settings : RigSettings
        Settings of a rig with an axis to the side.
    line : CutLine
        Line along which the specimen's profiles lie.
    law, seed, episode
        Constants of the law; key of the sensor's noise.
    **drives
        Drive and sensor, as for :class:`AirPlant`.

    Attributes
    ----------
    tissue : TissueInPlane
        The specimen, with what is hidden on a rig.
    """

    def __init__(
        self, specimen: Specimen, settings: RigSettings, *, line: CutLine, law: LawParameters | None = None,
        sensor: SensorParameters | None = None, seed: int = 0, episode: int = 0, **drives: Any,
    ) -> None:  # fmt: skip
        settings.require_side_axis(by="SteeredBench")
        self.tissue = TissueInPlane(specimen, line, law=law, angle=settings.fixed_angle)
        self._to_side = Sensor(sensor, seed=(seed + _ACROSS) % 2**64, episode=episode)
        self._side_force = 0.0
        super().__init__(settings, sensor=sensor, seed=seed, episode=episode, start=0.0, **drives)

    def _feel(self) -> None:
        x, _, angle = self.motion
        self.tissue.advance(x, self._across["side"].place, angle)
        self._force = self._sensor.measure(self.tissue.force)
        self._side_force = self._to_side.measure(self.tissue.side_force)

    def cross_force(self, axis: str) -> float:
        """Return the measured force of the tissue on the blade, to the right [N]; it feels nothing of a height axis."""
        return self._side_force if axis == "side" else 0.0
