"""Plants as a task sees them, scripted motions, and their records.

A plant is the simulator, a replay or a rig. The motions of the blade are constant feed, and the thesis's
forward-backward travel.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from cutenv._base.arrays import Array, StructArray, joined_records
from cutenv._base.validation import in_range
from cutenv.sim.cutting.dtypes import TICK
from cutenv.sim.plant.simulator import check_angle
from cutenv.sim.tissue.grid import depth_below
from cutenv.sim.trace import Trace


class Plant(Protocol):
    """Blade in tissue, driven by commands, with force measured at 1 kHz."""

    @property
    def depth(self) -> NDArray[np.float64]:
        """Measured depth of cut every 0.5 mm, shape (301,) [m]."""
        ...

    def advance(self, speed: float, angle: float, ticks: int) -> StructArray:
        """Command ``speed`` [m/s] and ``angle`` [rad]; return the readings.

        They are :data:`cutenv.sim.cutting.dtypes.READING`, (ticks,), valid until the next call.  Of the fields
        ``true_force``, ``elastic_force``, ``tip`` and ``jump``, those that a plant cannot know are NaN.
        """
        ...


_PATIENCE = 2.0  # multiple of a leg's ideal duration after which a blade that does not arrive is an error
_APPROACH = 0.15  # time of travel [s] at the present speed before the end at which a leg begins to slow down


@dataclass(frozen=True, kw_only=True)
class Leg:
    """One leg of a motion.

    It goes to ``position`` [m] at ``speed`` [m/s] and ``angle`` [rad], then rests for ``dwell`` [s].
    """

    position: float
    speed: float
    angle: float = math.pi / 2
    dwell: float = 0.0

    def __post_init__(self) -> None:
        in_range("position", self.position, 0.0, 0.149, "m", "Lengths are in metres: 80 mm is 0.08.")
        in_range("speed", self.speed, 1e-5, 0.5, "m/s", "Speeds are in m/s: 2.54 cm/s is 0.0254.")
        in_range("dwell", self.dwell, 0.0, 3600.0, "s", "Give the seconds of rest, or 0.")
        check_angle(self.angle)


def forward_backward(
    *, first: float = 0.0254, second: float = 0.0508, speed: float, angle: float = math.pi / 2
) -> list[Leg]:
    """Return legs of the thesis's two forward-backward cycles (section 6.2)."""
    return [Leg(position=target, speed=speed, angle=angle, dwell=0.2) for target in (first, 0.0, second, 0.0)]


def run(plant: Plant, legs: list[Leg]) -> StructArray:
    """Drive ``plant`` through ``legs`` from its present position.

    Return every reading at 1 kHz, (n,), the first at rest.  ValueError if there is no leg, RuntimeError if the blade
    does not reach the end of one.
    """
    if not legs:
        raise ValueError("legs is empty: give at least one Leg.")
    parts: list[StructArray] = [plant.advance(0.0, legs[0].angle, 1).copy()]
    position = float(parts[0]["position"][-1])
    for leg in legs:
        direction = math.copysign(1.0, leg.position - position)
        slowest = min(leg.speed, 1e-3)
        patience = _PATIENCE * abs(leg.position - position) / slowest + 2.0
        elapsed = 0.0
        while (left := direction * (leg.position - position)) > 0.5e-6:
            if elapsed > patience:
                raise RuntimeError(f"the blade stands at {position:.4f} m and does not reach {leg.position:.4f} m")
            # Far away, whole blocks at full speed; near the end, slow down to arrive without overshoot.
            speed = leg.speed if left > _APPROACH * leg.speed + 1e-4 else min(leg.speed, 5.0 * left + 2e-5)
            ticks = 20 if left > 2.0 * _APPROACH * leg.speed + 1e-3 else 1
            parts.append(plant.advance(direction * speed, leg.angle, ticks).copy())
            position = float(parts[-1]["position"][-1])
            elapsed += ticks * TICK
        if leg.dwell > 0.0:
            parts.append(plant.advance(0.0, leg.angle, round(leg.dwell / TICK)).copy())
            position = float(parts[-1]["position"][-1])
    return joined_records(parts)


def to_trace(plant: Plant, readings: StructArray, **metadata: object) -> Trace:
    """Return readings as a recorded trace with the plant's measured depth."""
    return recorded_trace(readings, plant.depth, **metadata)


def recorded_trace(readings: StructArray, depth: Array, **metadata: object) -> Trace:
    """Return readings as a recorded trace with a depth, (301,) [m], without hidden state."""
    position = readings["position"].copy()
    return Trace(
        time=readings["time"].copy(),
        force=readings["force"].copy(),
        position=position,
        speed=readings["speed"].copy(),
        angle=readings["angle"].copy(),
        depth=depth_below(depth, position),
        force_unit="N",
        metadata=dict(metadata),
    )
