"""Plants: one interface for the simulator, a replayed record and a rig."""

from cutenv.plant.descending_plant import DescendingPlant
from cutenv.plant.freehand_plant import FreehandPlant
from cutenv.plant.interface import Plant
from cutenv.plant.protocol import Leg, forward_backward, run, to_trace
from cutenv.plant.replay import ReplayPlant
from cutenv.plant.simulator import SimulatedPlant
from cutenv.plant.steered_plant import SteeredPlant

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
