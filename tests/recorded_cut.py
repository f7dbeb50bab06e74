"""Virtual records: cuts of known tissue as a rig would have recorded them, and the truth about them."""

from __future__ import annotations

import dataclasses
import functools
import math
from typing import Any, NamedTuple

import numpy as np

from cutenv._engine.randomness import generator
from cutenv.sim.cutting.sensor import SensorParameters
from cutenv.sim.plant.protocol import Leg, run, to_trace
from cutenv.sim.plant.simulator import SimulatedPlant
from cutenv.sim.tissue.description import following_means, tables_only
from cutenv.sim.tissue.specimen import Specimen
from cutenv.sim.trace import Trace
from scripts.validation.thesis.virtual_cuts import true_moduli, true_resistance

TISSUE = tables_only(**following_means(), eta90=0.28)


class RecordedCut(NamedTuple):
    """A trace, and the truth about it."""

    trace: Trace
    specimen: Specimen
    tip: Any  # at every instant [m]

    def forward(self) -> RecordedCut:
        """The same, as if the record had ended where the blade turned."""
        stop = int(np.argmax(self.trace.position)) + 1
        return self._replace(trace=self.trace.select(slice(stop)), tip=self.tip[:stop])

    def true_moduli(self, segments: Any) -> Any:
        """LEM [Pa] that an exact slope shows at each segment's tip, speed and angle."""
        return true_moduli(self.specimen, [self.tip[s.samples].mean() for s in segments], segments)

    def true_resistance(self) -> float:
        """R [J/m2] that the law was given, friction's share included, mean over the area that was cut."""
        return true_resistance(self.specimen, self.tip.max())


def specimen(kind: str, friction_share: float = 0.2) -> Specimen:
    """A homogeneous slice 2 or 1 cm thick that is cut through, a slab with the liver's bulge, or a drawn liver."""
    tissue = dataclasses.replace(TISSUE, friction_share=friction_share)
    if kind == "liver":
        return Specimen.draw(generator(3), specimen_class="liver", tissue=tissue)
    if kind == "bulge":
        return Specimen.mean(tissue)
    return Specimen.homogeneous(
        modulus=tissue.intercept_90,
        fracture_resistance=211.0,
        depth=0.01 if kind == "1 cm" else 0.02,
        tissue=tissue,
    )


def recorded_cut(
    kind: str = "2 cm",
    *,
    speed: float = 0.0127,
    angle_deg: float = 90.0,
    turns: tuple[float, ...] = (0.1, 0.0),
    friction_share: float = 0.2,
    sensor: SensorParameters | None = None,
    rest: float = 0.0,
) -> RecordedCut:
    """Cut through ``turns`` [m] at ``speed`` [m/s], resting 0.2 s at each and ``rest`` [s] before, through a sensor.

    The same cut is made once, however it is asked for.
    """
    return _recorded(kind, speed, angle_deg, turns, friction_share, sensor, rest)


@functools.lru_cache(maxsize=80)  # of 1 to 10 MB: all of one file, whose tests share them
def _recorded(
    kind: str,
    speed: float,
    angle_deg: float,
    turns: tuple[float, ...],
    friction_share: float,
    sensor: SensorParameters | None,
    rest: float,
) -> RecordedCut:
    tissue = specimen(kind, friction_share)
    angle = math.radians(angle_deg)
    plant = SimulatedPlant(tissue, sensor=sensor, seed=1, angle=angle)
    before = [Leg(position=0.0, speed=speed, angle=angle, dwell=rest)] if rest else []
    readings = run(plant, [*before, *(Leg(position=x, speed=speed, angle=angle, dwell=0.2) for x in turns)])
    return RecordedCut(
        trace=to_trace(plant, readings),
        specimen=tissue,
        tip=readings["tip"].copy(),
    )


rested_cut = functools.partial(recorded_cut, rest=0.2)
"""The same with a rest before the cut, which tells the sensor's zero in tissue of any depth."""
