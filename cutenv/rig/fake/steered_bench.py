"""Bench of a fake rig with an axis to the side: a specimen along a line, which feels the blade in the plane."""

from __future__ import annotations

from cutenv.cutting.drive import Drive
from cutenv.cutting.parameters import LawParameters
from cutenv.cutting.sensor import Sensor, SensorParameters
from cutenv.rig.config.laid import Laid
from cutenv.rig.config.settings import RigSettings
from cutenv.rig.fake.air_plant import AirPlant
from cutenv.rig.tissue_in_plane import TissueInPlane
from cutenv.tissue.lines import straight

_ACROSS = 2**32  # added to the seed of the noise of the force to the side


class SteeredBench(AirPlant):
    """Specimen under the law in the plane, with the simulator's drive and sensor, and a second one to the side.

    Parameters
    ----------
    laid : Laid
        Specimen along its line, with the blade at the clamp, in the middle; its key selects the sensor's noise.
    settings : RigSettings
        Settings of a rig with an axis to the side.
    drive, sensor, law
        As for :class:`cutenv.plant.SimulatedPlant`.

    Attributes
    ----------
    tissue : TissueInPlane
        The specimen, with what is hidden on a rig.
    """

    def __init__(
        self, laid: Laid, settings: RigSettings, *, drive: Drive | None = None, sensor: SensorParameters | None = None,
        law: LawParameters | None = None,
    ) -> None:  # fmt: skip
        settings.require_side_axis(by="SteeredBench")
        self.tissue = TissueInPlane(laid.drawn(), laid.line or straight(), law=law, angle=settings.fixed_angle)
        self._to_side = Sensor(sensor, seed=(laid.seed + _ACROSS) % 2**64, episode=laid.episode)
        self._side_force = 0.0
        along = Sensor(sensor, seed=laid.seed, episode=laid.episode)
        super().__init__(settings, drive=drive, sensor=along, start=0.0)

    def _feel(self) -> None:
        x, _, angle = self.motion
        self.tissue.advance(x, self._across["side"].place, angle)
        self._force = self._sensor.measure(self.tissue.force)
        self._side_force = self._to_side.measure(self.tissue.side_force)

    def cross_force(self, axis: str) -> float:
        """Return the measured force of the tissue on the blade, to the right [N]; it feels nothing of a height axis."""
        return self._side_force if axis == "side" else 0.0
