"""The force sensor of simulator and emulated rig: delay, drift, noise, resolution, tare."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from cutenv._base.arrays import Struct, StructArray
from cutenv._base.validation import array_in_range, check_parameters, parameter
from cutenv._engine.intrinsics import first_row
from cutenv._engine.jit import njit, njit_inline, njit_internal
from cutenv._engine.randomness import (
    SENSOR_DRIFT,
    SENSOR_NOISE,
    WIDTHS,
    in_layer,
    normal_at,
    normal_at_the_rim,
    words_at,
)
from cutenv.sim.cutting.dtypes import TICK
from cutenv.sim.cutting.row import BLOCK, ONE, take_sensor

_LONGEST_DELAY = 64  # ticks that the delay line holds, a power of two
WRAP = _LONGEST_DELAY - 1  # bit mask from a tick to its index in the delay line
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
        ],
    )
)
"""Parameters and memory of one sensor."""


@njit_inline
def delayed_force(line: StructArray, delay: int, force: float, tick: int) -> float:
    """Push ``force`` [N] into the delay line; return the delayed force."""
    line[tick & WRAP] = force
    out: float = line[(tick - delay) & WRAP] if tick >= delay else 0.0
    return out


@njit_internal
def wandered(sensor: Struct, tick: int) -> float:
    """Advance the zero's random walk to ``tick``; return the drift [N]."""
    if sensor.drift > 0.0:
        sensor.offset += sensor.drift * _ROOT_TICK * normal_at(sensor.seed, sensor.episode, SENSOR_DRIFT, tick)
    return sensor.offset  # type: ignore[no-any-return]


@njit_inline
def as_read(force: float, noise: float, standard: float, resolution: float) -> float:
    """Return a ``force`` [N] with noise, quantised to the resolution."""
    reading = force + noise * standard
    if resolution > 0.0:
        return resolution * np.floor(reading / resolution + 0.5)  # type: ignore[no-any-return]
    return reading


@njit_inline
def feel_row(row: Struct, sensors: StructArray, first: bool) -> None:
    """Measure ``row.force`` of every active cut as ``row.felt``."""
    for n in range(row.taken):
        if row.going[n] == 1:
            row.delayed[n] = delayed_force(sensors[row.cut[n]].line, row.delay[n], row.force[n], row.tick[n] - 1)
    for n in range(row.taken if row.drifting > 0 else 0):
        if row.going[n] == 1:
            row.offset[n] = wandered(sensors[row.cut[n]], row.tick[n] - 1)
    new = 0
    for n in range(len(row.blade)):
        new += 1 if (row.tick[n] - 1) & 3 == 0 else 0
    if new > 0 or first:
        _draw(row)
    for n in range(len(row.blade)):
        k, z0, z1, z2, z3 = (
            (row.tick[n] - 1) & 3, row.normals[0, n], row.normals[1, n], row.normals[2, n], row.normals[3, n],
        )  # fmt: skip
        low, high = z1 if k == 1 else z0, z3 if k == 3 else z2
        row.felt[n] = as_read(
            row.delayed[n] + row.offset[n] - row.tare[n], row.noise[n], high if k > 1 else low, row.resolution[n]
        )


@njit_inline
def _draw(row: Struct) -> None:
    """Draw four milliseconds of sensor noise by the ziggurat method."""
    for n in range(len(row.blade)):
        row.words[0, n], row.words[1, n], row.words[2, n], row.words[3, n] = words_at(
            row.seed[n], row.episode[n], SENSOR_NOISE, (row.tick[n] - 1) >> 2
        )
    for k in range(BLOCK):
        unsettled = 0
        for n in range(len(row.blade)):
            layer, sign, across = in_layer(row.words[k, n])
            x, inner = across * WIDTHS[layer], WIDTHS[layer + 1]
            row.normals[k, n], row.inner[n] = sign * x, inner
            unsettled += 0 if x < inner else 1
        for n in range(row.taken if unsettled > 0 else 0):
            if abs(row.normals[k, n]) >= row.inner[n]:
                layer, sign, _ = in_layer(row.words[k, n])
                tick = BLOCK * ((row.tick[n] - 1) >> 2) + k
                row.normals[k, n] = sign * normal_at_the_rim(
                    layer, abs(row.normals[k, n]), row.seed[n], row.episode[n], SENSOR_NOISE, tick
                )


@njit
def measure(rows: StructArray, sensors: StructArray, force: float, tick: int) -> float:
    """Return the reading [N] of a true ``force`` at ``tick``.

    Ticks count from 0 at reset; each is measured once.  ``rows`` and ``sensors``, (1,), are the memory of the calls: a
    row of one lane (:data:`~cutenv.sim.cutting.row.ONE`), and the sensor.
    """
    row, sensor = first_row(rows), sensors[0]
    take_sensor(row, sensor, 0)
    row.taken, row.going[0], row.cut[0] = 1, 1, 0
    row.drifting = 1 if sensor.drift > 0.0 else 0
    row.tick[0] = tick + 1
    row.force[0] = force
    feel_row(row, sensors, tick == 0)
    return row.felt[0]  # type: ignore[no-any-return]


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
    """A force sensor with a memory.

    Pass it the true force once a millisecond, read the force that a rig would measure.  The same key (seed, episode)
    and tick give the same noise, in any order and any batch.
    """

    def __init__(self, parameters: SensorParameters | None = None, *, seed: int = 0, episode: int = 0) -> None:
        self.parameters = parameters or SensorParameters()
        self.tick = 0
        self._sensors = sensor_records([self.parameters], [seed], [episode])
        self._rows = np.zeros(1, ONE)

    def measure(self, force: float) -> float:
        """Return this millisecond's reading [N] of a true ``force`` [N]."""
        reading: float = measure(self._rows, self._sensors, float(force), self.tick)
        self.tick += 1
        return reading

    def tare(self, reading: float) -> None:
        """Make ``reading`` [N] the new zero."""
        self._sensors["tare"] += reading


def sensor_records(parameters: list[SensorParameters], seeds: list[int], episodes: list[int]) -> StructArray:
    """Return new sensors as records for the law, shape (n,)."""
    for name, keys in (("seed", seeds), ("episode", episodes)):
        array_in_range(name, keys, 0, 2**64, "1", "Give whole numbers from 0.")
    sensors = np.zeros(len(parameters), SENSOR)
    sensors["noise"] = [p.force_noise for p in parameters]
    sensors["resolution"] = [p.force_resolution for p in parameters]
    sensors["drift"] = [p.force_drift for p in parameters]
    sensors["delay"] = [round(p.force_delay / TICK) for p in parameters]
    sensors["seed"] = seeds
    sensors["episode"] = episodes
    return sensors
