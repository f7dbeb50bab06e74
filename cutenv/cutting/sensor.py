"""The force sensor: delay, drift, noise, resolution and tare, shared by the simulator and the rig's emulator."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from cutenv._base.arrays import Struct, StructArray
from cutenv._base.parameter import check_parameters, parameter
from cutenv._base.validation import array_in_range
from cutenv._engine.jit import njit, njit_inline, njit_internal
from cutenv._engine.randomness import SENSOR_DRIFT, SENSOR_NOISE, four_normals_at, normal_at
from cutenv.cutting.dtypes import TICK

_LONGEST_DELAY = 64  # ticks that the delay line holds, a power of two
WRAP = _LONGEST_DELAY - 1
"""Bit mask from a tick to its index in the delay line."""
_ROOT_TICK = math.sqrt(TICK)  # square roots are rounded alike on every machine, powers are not

SENSOR: np.dtype[Any] = np.dtype(
    (
        np.record,
        [
            ("noise", "f8"),  # standard deviation [N]
            ("resolution", "f8"),  # [N]; 0: continuous
            ("drift", "f8"),  # standard deviation of a random walk after one second [N]
            ("delay", "i8"),  # [ticks]
            ("seed", "u8"),
            ("episode", "u8"),
            ("offset", "f8"),  # drift so far [N]
            ("tare", "f8"),  # subtracted from every reading [N]
            ("line", "f8", (_LONGEST_DELAY,)),  # delay line of forces [N], newest at tick modulo length
            ("block", "i8"),  # block of four ticks whose noise is cached
            ("standard_noise", "f8", (4,)),
        ],
    )
)
"""Parameters and memory of one sensor."""


@njit
def measure(sensor: Struct, force: float, tick: int) -> float:
    """Return the reading [N] at update ``tick`` (from 0 at reset, each tick once) for a true ``force`` [N]."""
    standard = standard_noise(sensor, tick) if sensor.noise > 0.0 else 0.0
    felt = delayed_force(sensor.line, sensor.delay, force, tick) + wandered(sensor, tick) - sensor.tare
    return as_read(felt, sensor.noise, standard, sensor.resolution)


@njit_inline
def delayed_force(line: StructArray, delay: int, force: float, tick: int) -> float:
    """Push ``force`` [N] into the delay line at update ``tick``; return the force that comes out."""
    line[tick & WRAP] = force
    out: float = line[(tick - delay) & WRAP] if tick >= delay else 0.0
    return out


@njit_internal
def wandered(sensor: Struct, tick: int) -> float:
    """Advance the random walk of the sensor's zero to update ``tick``; return the drift [N]."""
    if sensor.drift > 0.0:
        sensor.offset += sensor.drift * _ROOT_TICK * normal_at(sensor.seed, sensor.episode, SENSOR_DRIFT, tick)
    return sensor.offset  # type: ignore[no-any-return]


@njit_inline
def as_read(force: float, noise: float, standard: float, resolution: float) -> float:
    """Return the reading [N] of a ``force`` [N]: plus noise times a ``standard`` normal number, then quantised."""
    reading = force + noise * standard
    if resolution > 0.0:
        return resolution * np.floor(reading / resolution + 0.5)  # type: ignore[no-any-return]
    return reading


@njit_internal
def standard_noise(sensor: Struct, tick: int) -> float:
    """Return the standard normal number of (seed, episode, tick), from a cached block of four."""
    block = tick >> 2
    kept = sensor.standard_noise
    if block != sensor.block:
        kept[0], kept[1], kept[2], kept[3] = four_normals_at(sensor.seed, sensor.episode, SENSOR_NOISE, block)
        sensor.block = block
    return kept[tick & 3]  # type: ignore[no-any-return]


@dataclass(frozen=True, kw_only=True)
class SensorParameters:
    """One axis of a force sensor sampled at 1 kHz."""

    force_noise: float = parameter(
        0.02, unit="N", low=0.0, high=10.0, provenance="assumed",
        source="below the sensor's resolution", sensitivity=(0.0, 0.1),
    )  # fmt: skip
    force_resolution: float = parameter(
        0.05, unit="N", low=0.0, high=10.0, provenance="measured",
        source="thesis 3.1: worst case of the six-axis sensor in the cutting plane", sensitivity=(0.0, 0.1),
    )  # fmt: skip
    force_delay: float = parameter(
        0.010, unit="s", low=0.0, high=(_LONGEST_DELAY - 1) * TICK, provenance="assumed",
        source="filter and transport of a networked sensor", sensitivity=(0.0, 0.030),
    )  # fmt: skip
    force_drift: float = parameter(
        0.0, unit="N/s^0.5", low=0.0, high=1.0, provenance="assumed",
        source="off; a random walk when wanted", sensitivity=(0.0, 0.05),
    )  # fmt: skip

    def __post_init__(self) -> None:
        check_parameters(self)


class Sensor:
    """A force sensor with a memory: pass it the true force once a millisecond, read the force that a rig would measure.

    Parameters
    ----------
    parameters : SensorParameters, optional
        Noise, resolution, delay, drift.
    seed, episode : int
        Key of the noise: the same key and tick give the same noise, in any order and any batch.
    """

    def __init__(self, parameters: SensorParameters | None = None, *, seed: int = 0, episode: int = 0) -> None:
        self.parameters = parameters or SensorParameters()
        self.tick = 0
        self._records = sensor_records([self.parameters], [seed], [episode])

    def measure(self, force: float) -> float:
        """Return the reading [N] of this millisecond for a true ``force`` [N]."""
        reading = measure(self._records[0], float(force), self.tick)
        self.tick += 1
        return reading

    def tare(self, reading: float) -> None:
        """Make ``reading`` [N] the new zero."""
        self._records["tare"] += reading


def sensor_records(parameters: list[SensorParameters], seeds: list[int], episodes: list[int]) -> StructArray:
    """Return new sensors as a structured array for the compiled law, shape (n,)."""
    for name, keys in (("seed", seeds), ("episode", episodes)):
        array_in_range(name, keys, 0, 2**64, "1", "Give whole numbers from 0.")
    sensors = np.zeros(len(parameters), SENSOR)
    sensors["noise"] = [p.force_noise for p in parameters]
    sensors["resolution"] = [p.force_resolution for p in parameters]
    sensors["drift"] = [p.force_drift for p in parameters]
    sensors["delay"] = [round(p.force_delay / TICK) for p in parameters]
    sensors["seed"] = seeds
    sensors["episode"] = episodes
    sensors["block"] = -1
    return sensors
