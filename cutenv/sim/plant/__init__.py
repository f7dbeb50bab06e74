"""Plants: one interface to simulator, replayed record and rig."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cutenv._base.imports import import_when_used
from cutenv.sim.plant.protocol import Leg, Plant, forward_backward, run, to_trace
from cutenv.sim.plant.replay import ReplayPlant
from cutenv.sim.plant.simulator import SimulatedPlant

if TYPE_CHECKING:
    from cutenv.sim.plant.freehand_plant import FreehandPlant
    from cutenv.sim.plant.third_axis_plants import DescendingPlant, SteeredPlant

__all__ = [
    "DescendingPlant",
    "FreehandPlant",
    "Leg",
    "Plant",
    "ReplayPlant",
    "SimulatedPlant",
    "SteeredPlant",
    "forward_backward",
    "run",
    "to_trace",
]

# A straight cut at its own depth needs neither the law of depth nor that of the plane.
__getattr__ = import_when_used(
    __name__,
    {
        "DescendingPlant": "cutenv.sim.plant.third_axis_plants",
        "FreehandPlant": "cutenv.sim.plant.freehand_plant",
        "SteeredPlant": "cutenv.sim.plant.third_axis_plants",
    },
)
