"""Virtual records: cuts of known tissue as the rig would have recorded them, together with the truth."""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cutenv._engine.randomness import generator
from cutenv.records.measurement import DepthProfile, Segment
from cutenv.sim.plant import Leg, SimulatedPlant, run, to_trace
from cutenv.sim.tissue import Specimen, measured_fracture_resistance, measured_liver
from cutenv.sim.tissue.specimen import N_POINTS, SPACING
from cutenv.sim.tissue.tables import table
from cutenv.sim.trace import Trace

INCH = 0.0254  # [m]
SPEEDS = (0.001, 0.0127, 0.0254)  # slow, intermediate and normal cutting of chapter 3 [m/s]
SEVEN_SPEEDS = tuple(float(v) / 100 for v in table("5.6")["speed_cm_s"])  # of chapter 5 [m/s]
ANGLES_DEG = (90.0, 45.0)
DWELL = 0.2  # at every turning point [s]
PLACES = np.arange(N_POINTS) * SPACING

Array = NDArray[np.float64]


class VirtualCut(NamedTuple):
    """A record, with the truth that no rig could have recorded."""

    trace: Trace
    specimen: Specimen
    readings: NDArray[np.void]  # READING at 1 kHz, tip and true force included
    energy: dict[str, float]  # at the end [J]

    @property
    def tip(self) -> Array:
        """Crack tip at every instant [m]."""
        return np.asarray(self.readings["tip"])

    def forward(self) -> VirtualCut:
        """Return the same cut, as if the record had ended where the blade turned."""
        stop = int(np.argmax(self.trace.position)) + 1
        return self._replace(trace=self.trace.select(slice(stop)), readings=self.readings[:stop])

    def true_moduli(self, segments: Sequence[Segment]) -> Array:
        """Return the LEM [Pa] by an exact slope at each segment's tip, speed and angle."""
        return true_moduli(self.specimen, [float(self.tip[s.samples].mean()) for s in segments], segments)

    def true_resistance(self) -> float:
        """Return the true R [J/m2], friction's share included, mean over the area that was cut."""
        return true_resistance(self.specimen, float(self.tip.max()))

    def debt(self) -> float:
        """Return what the law still owes at the end, or has lost, per area [J/m2]: no measurement can know it."""
        area = DepthProfile.recorded(self.trace, by="a virtual cut").area(0.0, float(self.tip.max()))
        return (self.energy["ledger"] + self.energy["loss"]) / area


def true_moduli(specimen: Specimen, tips: Sequence[float], segments: Sequence[Segment]) -> Array:
    """Return the LEM [Pa] by an exact slope at each tip [m], and each segment's speed and angle: r K/(kappa B)."""
    r = np.array([specimen.loading_ratio(s.speed or 0.0, s.angle or math.pi / 2) for s in segments])
    K, B = (np.interp(tips, PLACES, values) for values in (specimen.stiffness(), specimen.depth))
    return np.asarray(r * K / (specimen.cut_model().stiffness(tips) * B))


def true_resistance(specimen: Specimen, tip: float) -> float:
    """Return the true R [J/m2], friction's share included, mean over the area up to the tip [m]."""
    share, depth, at = specimen.tissue.friction_share, specimen.depth, np.linspace(0.0, tip, 4001)
    fracture = np.interp(at, PLACES, (1.0 - share) * specimen.fracture_resistance * depth)
    return float(fracture.sum() / np.interp(at, PLACES, depth).sum()) + specimen.friction_per_depth


def specimen(kind: str, *, friction_share: float | None = None) -> Specimen:
    """Make a slice 2 or 1 cm thick that is cut through (``"2 cm"``, ``"1 cm"``), a slab with the bulge, or a liver.

    ``"liver 7"`` is sampled with seed 7.
    """
    tissue = measured_liver()
    if friction_share is not None:
        tissue = dataclasses.replace(tissue, friction_share=friction_share)
    if kind.startswith("liver"):
        return Specimen.draw(generator(int(kind.split()[1])), specimen_class="liver", tissue=tissue)
    if kind == "bulge":
        return Specimen.mean(tissue)
    return Specimen.homogeneous(
        modulus=tissue.intercept_90,
        fracture_resistance=measured_fracture_resistance().mean,
        depth=float(kind.split()[0]) / 100.0,
        tissue=tissue,
    )


@functools.lru_cache(maxsize=32)
def virtual_cut(
    kind: str,
    *,
    speed: float = 0.0127,
    angle_deg: float = 90.0,
    turns: tuple[float, ...] = (0.1, 0.0),
    friction_share: float | None = None,
) -> VirtualCut:
    """Move the blade through ``turns`` [m] at ``speed`` [m/s], measured with noise, resolution and delay.

    It rests before the cut and at each turn.
    """
    tissue = specimen(kind, friction_share=friction_share)
    angle = math.radians(angle_deg)
    plant = SimulatedPlant(tissue, seed=1, angle=angle)
    readings = run(plant, [Leg(position=x, speed=speed, angle=angle, dwell=DWELL) for x in (0.0, *turns)])
    return VirtualCut(trace=to_trace(plant, readings), specimen=tissue, readings=readings, energy=plant.energy())


def cm_s(speed: float) -> str:
    """Format a speed in the thesis's unit."""
    return f"{100 * speed:g} cm/s"
