"""Calibration of a force sensor by known weights.

Counts, or newtons, against what hangs on it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cutenv._base.validation import in_range
from cutenv.rig.errors import RigError
from cutenv.rig.operation.operator import Operator
from cutenv.rig.operation.recorder import Recorder
from cutenv.rig.plant import RigPlant

GRAVITY = 9.80665  # standard gravity [m/s2]; the local one differs by up to 0.3 %
LISTENED = 2.0  # time over which readings are averaged for each weight [s]
_MIN_READINGS = 10  # readings of a mean
_STEADY = 0.05  # [1] of the step between weights, by which readings may vary: more is a weight that swings


@dataclass(frozen=True, kw_only=True)
class Weighing:
    """Result of a calibration by weights."""

    masses: tuple[float, ...]  # masses, in order [kg]
    counts: tuple[float, ...]  # mean counts, and mean readings by the present calibration [N], for each
    readings: tuple[float, ...]

    @property
    def forces(self) -> tuple[float, ...]:
        """Weights [N]."""
        return tuple(GRAVITY * mass for mass in self.masses)

    @property
    def counts_per_newton(self) -> float:
        """Slope of counts over weight [1/N], signed by the load."""
        return float(np.polyfit(self.forces, self.counts, 1)[0])

    @property
    def gain(self) -> float:
        """Slope of weight over present reading, unsigned [1]."""
        return 1.0 / abs(float(np.polyfit(self.forces, self.readings, 1)[0]))

    @property
    def residual(self) -> float:
        """Greatest distance of a mean from the straight line [N]."""
        slope, offset = np.polyfit(self.forces, self.counts, 1)
        return float(np.abs((np.array(self.counts) - offset) / slope - np.array(self.forces)).max())


def weigh(plant: RigPlant, masses: Sequence[float], operator: Operator) -> Weighing:
    """Ask for each weight, and average readings, without power or motion.

    ``plant`` is open, without power; its present zero does not matter. ``masses`` [kg] are hung on the sensor along the
    cut, 0 for none. Raise ValueError if there are fewer than 2 masses, or all are the same; RigError if the operator
    does not go on, readings are missing, or do not change with the weight.
    """
    checked = [in_range("masses", mass, 0.0, 50.0, "kg", "200 g is 0.2.") for mass in masses]
    if len(set(checked)) < 2:
        raise ValueError(f"masses = {masses}: give two different ones at least, such as 0 g and 500 g.")
    axis = "xyz".index(plant.settings.sensor.cut_axis)
    means, spreads = [], []
    for mass in checked:
        what = f"Hang {1e3 * mass:g} g on the sensor, along the cut" if mass else "Take every weight off the sensor"
        if not operator.ask_ready(f"{what}, and let it rest"):
            raise RigError("the operator has not gone on: nothing was calibrated.")
        recorder = plant.witness = Recorder()
        try:
            plant.clock.sleep_until(plant.clock.now() + max(LISTENED, _MIN_READINGS / plant.settings.sensor.rate))
        finally:
            plant.witness = None
        heard = [(each.counts[axis], each.force[axis]) for each in recorder.forces(-np.inf, np.inf)]
        if len(heard) < _MIN_READINGS // 2:
            raise RigError(f"{len(heard)} readings came within {LISTENED:g} s: is the sensor streaming?")
        means.append(np.mean(heard, axis=0).tolist())
        spreads.append(float(np.std(heard, axis=0)[0]))
    counts, readings = zip(*means, strict=True)
    step = max(counts) - min(counts)
    if step < 20.0 or max(spreads) > _STEADY * step:
        raise RigError(
            f"the readings change by {step:.0f} counts between the weights, and vary by {max(spreads):.0f} at rest. "
            "Does the weight pull along the cut, does it hang still, are the cell's wires on?"
        )
    return Weighing(masses=tuple(checked), counts=counts, readings=readings)
