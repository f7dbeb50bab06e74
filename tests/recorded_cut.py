"""Virtual records: cuts of known tissue as a rig would have recorded them, and the truth about them."""

from __future__ import annotations

import dataclasses
import functools
import math
from typing import Any, NamedTuple

import numpy as np

from cutenv.cutting.sensor import SensorParameters
from cutenv.plant.protocol import Leg, run, to_trace
from cutenv.plant.simulator import SimulatedPlant
from cutenv.randomness import generator
from cutenv.tissue.description import tables_only
from cutenv.tissue.modulus import local_effective_modulus
from cutenv.tissue.specimen import N_POINTS, SPACING, Specimen
from cutenv.tissue.thickness import bulge
from cutenv.trace import Trace

INCH = 0.0254
TISSUE = tables_only(eta90=0.28)
PLACES = np.arange(N_POINTS) * SPACING


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
        """LEM [Pa] that the law was given for each segment's speed, angle and tip."""
        tips = np.array([self.tip[s.samples].mean() for s in segments])
        relative = np.interp(tips, PLACES, self.specimen.modulus) / TISSUE.intercept_90
        return relative * np.array([local_effective_modulus(s.speed, s.angle) for s in segments])

    def true_resistance(self) -> float:
        """R [J/m2] that the law was given, friction's share included, mean over the area that was cut."""
        share, depth = self.specimen.tissue.friction_share, self.specimen.depth
        at = np.linspace(0.0, self.tip.max(), 2000)
        fracture = np.interp(at, PLACES, (1.0 - share) * self.specimen.fracture_resistance * depth)
        return float(fracture.sum() / np.interp(at, PLACES, depth).sum()) + self.specimen.friction_per_depth


def specimen(kind: str, friction_share: float = 0.2) -> Specimen:
    """A homogeneous specimen 2 or 1 cm deep or with the liver's bulge, or a drawn liver."""
    tissue = dataclasses.replace(TISSUE, friction_share=friction_share)
    if kind == "liver":
        return Specimen.draw(generator(3), specimen_class="liver", tissue=tissue)
    even = Specimen.homogeneous(
        modulus=tissue.intercept_90,
        fracture_resistance=211.0,
        depth=0.01 if kind == "1 cm" else 0.02,
        tissue=tissue,
    )
    if kind != "bulge":
        return even
    shape = {"edge": tissue.edge_depth, "crown": tissue.crown_depth, "rise_length": tissue.rise_length}
    return dataclasses.replace(even, depth=bulge(PLACES, **shape, length=PLACES[-1]))


@functools.lru_cache(maxsize=12)  # a slow cut holds 10 MB
def recorded_cut(
    kind: str = "2 cm",
    *,
    speed: float = 0.0127,
    angle_deg: float = 90.0,
    turns: tuple[float, ...] = (0.1, 0.0),
    friction_share: float = 0.2,
    sensor: SensorParameters | None = None,
) -> RecordedCut:
    """Cut through ``turns`` [m] at ``speed`` [m/s], resting 0.2 s at each, felt through a sensor."""
    tissue = specimen(kind, friction_share)
    angle = math.radians(angle_deg)
    plant = SimulatedPlant(tissue, sensor=sensor, seed=1, angle=angle)
    readings = run(plant, [Leg(position=x, speed=speed, angle=angle, dwell=0.2) for x in turns])
    return RecordedCut(
        trace=to_trace(plant, readings),
        specimen=tissue,
        tip=readings["tip"].copy(),
    )
