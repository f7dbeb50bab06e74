"""Wanted depth of a cut and lower layer, randomly drawn."""

from __future__ import annotations

import numpy as np

from cutenv._base.arrays import Array, Struct
from cutenv._engine.elementary import exp, log
from cutenv._engine.jit import njit_internal
from cutenv._engine.randomness import TASK, WANTED_DRAW, Integer, uniform_at
from cutenv.sim.tissue.grid import N_POINTS, SPACING

AT_LEVEL, UNCHANGING, RAMPED, STEPPED, MIXED_WANTED = range(5)
"""Kinds of wanted depth: the specimen's own profile (a blade that stays at level 0), or a depth below the surface."""
WANTED_KINDS = {"profile": AT_LEVEL, "constant": UNCHANGING, "ramp": RAMPED, "step": STEPPED, "mixed": MIXED_WANTED}
"""Kinds by name; "mixed" draws one of constant, ramp and step."""
SHALLOW, DEEP = 0.006, 0.014
"""Range from which wanted depths are drawn [m]."""
LEAST_CHANGE = 0.003
"""Least difference between the two depths of a ramp or a step [m]."""
STEP_LENGTH = 0.002
"""Length along the cut within which a step changes [m]: a blade takes time to descend."""
LEAST_BELOW, MOST_BELOW = 0.001, 0.004
"""Range of the distance from the deepest wanted place to the layer below [m]."""
TOUGHNESS_RANGE = (0.3, 4.0)
"""Range of that layer's toughness over the tissue's, drawn by its logarithm; assumed."""
MODULUS_RANGE = (0.3, 3.0)
"""Range of that layer's modulus over the tissue's, drawn by its logarithm; assumed."""


@njit_internal
def draw(seed: Integer, episode: Integer, number: int) -> float:
    """Return uniform number ``number`` of a key's wanted depth."""
    return uniform_at(seed, episode, TASK, WANTED_DRAW + np.int64(number))


@njit_internal
def draw_wanted(seed: Integer, episode: Integer, kind: int, target: float, wanted: Array) -> None:
    """Fill ``wanted``, (301,), with depths [m] below the surface, by ``kind``."""
    if kind == MIXED_WANTED:
        kind = UNCHANGING + min(int(3.0 * draw(seed, episode, 0)), 2)
    first = SHALLOW + (DEEP - SHALLOW) * draw(seed, episode, 1)
    least = LEAST_CHANGE if kind != UNCHANGING else 0.0
    shallower, deeper = max(first - least - SHALLOW, 0.0), max(DEEP - first - least, 0.0)
    place = draw(seed, episode, 2) * (shallower + deeper)  # the range of depths that differ enough
    second = first - least - place if place < shallower else first + least + (place - shallower)
    if kind == UNCHANGING:
        second = first
    changes = (0.3 + 0.4 * draw(seed, episode, 3)) * target
    for i in range(N_POINTS):
        x = i * SPACING
        share = x / target if kind == RAMPED else (x - changes) / STEP_LENGTH + 0.5
        wanted[i] = first + min(max(share, 0.0), 1.0) * (second - first)


@njit_internal
def draw_layer(seed: Integer, episode: Integer, wanted: Array, layers: Struct) -> None:
    """Place the lower layer, ``layers.boundary`` [m], below the deepest wanted depth.

    Toughness and modulus are drawn where they are 1, that is not known of the tissue.
    """
    deepest = 0.0
    for i in range(N_POINTS):
        deepest = max(deepest, wanted[i])
    layers.boundary = deepest + LEAST_BELOW + (MOST_BELOW - LEAST_BELOW) * draw(seed, episode, 4)
    if layers.deep_toughness == 1.0:
        layers.deep_toughness = between(TOUGHNESS_RANGE[0], TOUGHNESS_RANGE[1], draw(seed, episode, 5))
    if layers.deep_modulus == 1.0:
        layers.deep_modulus = between(MODULUS_RANGE[0], MODULUS_RANGE[1], draw(seed, episode, 6))


@njit_internal
def between(low: float, high: float, share: float) -> float:
    """Return the number at ``share`` of a logarithmic interval."""
    return low * exp(share * log(high / low))
