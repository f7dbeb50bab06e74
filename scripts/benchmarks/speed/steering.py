"""Speed of the law in the plane: bare physics in a batch along a drawn line, beside that of GentleCut-v1."""

from __future__ import annotations

import numpy as np

from cutenv.sim.cutting.dtypes import profile_records
from cutenv.sim.cutting.motion import NOTHING
from cutenv.sim.cutting.steering import STEERED, steering_records
from cutenv.sim.tissue.lines import CutLine, half_ellipse, straight
from scripts.benchmarks.speed.measured import Measured
from scripts.benchmarks.speed.vertical_motion import (
    ANGLE,
    COUNT,
    ROUNDS,
    BareRates,
    Commands,
    cuts_of,
    lines_beside_gentle,
    rates_beside_gentle,
    tissue,
)


def _turning(rate: float) -> Commands:
    return lambda step, rng, count: np.tile((0.01, ANGLE, rate), (count, 1))


MOTIONS: dict[str, Commands] = {
    "on": _turning(0.0),
    "in a bend": _turning(-0.19),  # that of half an excision at its summit
    "at random": lambda step, rng, count: rng.uniform((-0.002, 0.8, -1.0), (0.02, 1.57, 1.0), (count, 3)),
}


def steered_rates(line: CutLine, motion: Commands, count: int = COUNT, rounds: int = ROUNDS) -> BareRates:
    """Measure ``count`` cuts along one line."""
    specimens = tissue(count)
    profiles = profile_records(specimens[:64])  # the others are repetitions
    steerings = np.resize(steering_records(specimens[:64], [line] * len(profiles), profiles), count)
    profiles = np.resize(profiles, count)
    cuts = cuts_of(specimens, profiles, steerings, np.zeros(1, NOTHING))
    return rates_beside_gentle(cuts, STEERED, motion, rounds)


def measure() -> Measured:
    """Measure each motion; return the times of an update, and how many times GentleCut-v1's they are."""
    numbers, lines = lines_beside_gentle(
        "on a straight line, where the blade can be steered", {"straight": MOTIONS["on"]},
        lambda motion: steered_rates(straight(), motion),
    )  # fmt: skip
    more, further = lines_beside_gentle(
        "along half an excision", MOTIONS, lambda motion: steered_rates(half_ellipse(), motion)
    )
    return Measured(numbers | more, [*lines, *further])
