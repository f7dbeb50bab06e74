"""Speed of the law where the blade also moves up and down: bare physics in a batch, beside that of GentleCut-v1."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cutenv._base.arrays import StructArray
from cutenv._engine.parallel import make_queue
from cutenv.sim.cutting.descent import DESCENDING, descent_records, layered_profiles, shared_record
from cutenv.sim.cutting.drive import Rig
from cutenv.sim.cutting.dtypes import law_records, new_state
from cutenv.sim.cutting.motion import NOTHING, STRAIGHT, Motion
from cutenv.sim.cutting.sensor import SensorParameters, sensor_records
from cutenv.sim.cutting.simulate import Physics, hold_some
from cutenv.sim.tissue import Layers, Specimen
from cutenv.sim.tissue.specimen import LENGTH, SPACING
from scripts.benchmarks.speed.measured import Measured, Number

COUNT, TICKS = 1024, 20
_LAYERS = Layers(capsule_thickness=5e-4, capsule_modulus=5.0, boundary=0.017, deep_toughness=3.0, deep_modulus=2.0)
ANGLE = math.radians(60.0)
WARM_UP, _STEPS, ROUNDS = 25, 25, 40

Commands = Callable[[int, np.random.Generator, int], NDArray[np.float64]]
"""Speed [m/s], angle [rad] and a third command of n cuts in a step of 20 ms, shape (n, 3), by its number."""


def _steady(downwards: Callable[[int], float]) -> Commands:
    return lambda step, rng, count: np.tile((0.01, ANGLE, downwards(step)), (count, 1))


MOTIONS: dict[str, Commands] = {
    "at level 0": _steady(lambda step: 0.0),
    "at a constant level above it": _steady(lambda step: -0.005 if step < WARM_UP - 10 else 0.0),
    "at random": lambda step, rng, count: rng.uniform((-0.002, 0.8, -0.003), (0.02, 1.57, 0.005), (count, 3)),
    "pressing down": _steady(lambda step: 0.004),
}


class BareRates(NamedTuple):
    """Updates per second of one core's own time, so that other programs disturb little; the best of many rounds."""

    own: float
    gentle: float  # those of GentleCut-v1, under the same commands along the cut


def tissue(count: int) -> list[Specimen]:
    """Return ``count`` specimens, of which 64 differ."""
    drawn = [Specimen.drawn(number) for number in range(min(count, 64))]
    return [drawn[number % len(drawn)] for number in range(count)]


def cuts_of(specimens: list[Specimen], profiles: StructArray, motions: StructArray, shared: StructArray) -> Physics:
    """Return one cut for each specimen, at its start."""
    count = len(specimens)
    return Physics(
        new_state(count, ANGLE), profiles, law_records(specimens),
        np.repeat(Rig().records(travel=LENGTH - SPACING), count),
        sensor_records([SensorParameters()] * count, [0] * count, range(count)), motions, shared,
    )  # fmt: skip


def rates_beside_gentle(cuts: Physics, motion: Motion, commanded: Commands, rounds: int = ROUNDS) -> BareRates:
    """Measure copies of cuts with a motion, and without one; each round begins at the same place."""
    count = len(cuts.states)
    steps = [commanded(step, np.random.default_rng(step), count) for step in range(WARM_UP + _STEPS)]
    straight = cuts._replace(motions=np.zeros(count, NOTHING), shared=np.zeros(1, NOTHING))
    felt = np.empty((count, 2))
    best = [math.inf, math.inf]
    for _ in range(rounds):
        for k, (begun, hold) in enumerate(((cuts, hold_some(motion)), (straight, hold_some(STRAIGHT)))):
            own = Physics(*(part.copy() for part in begun))
            for number, commands in enumerate(steps):
                if number == WARM_UP:
                    start = time.thread_time()
                hold(make_queue(count), 0, own, commands, TICKS, felt)
            best[k] = min(best[k], time.thread_time() - start)
    return BareRates(*(count * TICKS * _STEPS / seconds for seconds in best))


def descending_rates(motion: Commands, count: int = COUNT, rounds: int = ROUNDS) -> BareRates:
    """Measure ``count`` cuts through layers."""
    specimens = tissue(count)
    tissue_of_all, descents = specimens[0].tissue, descent_records(specimens, _LAYERS)
    profiles = layered_profiles(descents, tissue_of_all.slab())
    cuts = cuts_of(specimens, profiles, descents, shared_record(tissue_of_all))
    return rates_beside_gentle(cuts, DESCENDING, motion, rounds)


def lines_beside_gentle(
    what: str, motions: Mapping[str, Commands], rates: Callable[[Commands], BareRates]
) -> tuple[dict[str, Number], list[str]]:
    """Measure each motion; return the rates, how many times GentleCut-v1's time they take, and lines of both."""
    numbers: dict[str, Number] = {}
    lines = [
        f"bare physics {what}, {COUNT} cuts on one core, beside",
        "  GentleCut-v1's under the same commands along the cut; time of that core",
        "                                  ns an update   GentleCut-v1   times",
    ]
    for name, motion in motions.items():
        found = rates(motion)
        times = found.gentle / found.own
        numbers[f"updates {name}"] = Number(found.own, "1/s")
        numbers[f"times GentleCut-v1 {name}"] = Number(times, "1")
        lines.append(f"  {name:32s}{1e9 / found.own:12.0f}{1e9 / found.gentle:15.0f}{times:8.1f}")
    return numbers, lines


def measure() -> Measured:
    """Measure each motion; return the times of an update, and how many times GentleCut-v1's they are."""
    what = "where the blade also moves up and down, through layers"
    return Measured(*lines_beside_gentle(what, MOTIONS, lambda motion: descending_rates(motion)))
