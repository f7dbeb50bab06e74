"""Sampling of specimens from the measured spread, compiled.

It serves one environment or a batch of thousands.

Every number is a pure function of a key (seed and episode), of its stream and of its counter (see
:mod:`cutenv._engine.randomness`): a batch samples the same specimens as a single environment, in whatever order.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cutenv._base.arrays import Array, Struct
from cutenv._engine.elementary import exp, tanh
from cutenv._engine.jit import njit, njit_internal
from cutenv._engine.randomness import (
    CLASS_DRAW,
    CUT,
    MODULUS_FIELD,
    RESISTANCE_FIELD,
    TASK,
    VESSELS,
    Integer,
    Key,
    normal_at,
    uniform_at,
)
from cutenv.sim.tissue.description import TissueDescription
from cutenv.sim.tissue.grid import LENGTH, N_POINTS, SPACING, bulge, field_modes, lognormal_sigma
from cutenv.sim.tissue.slab import SLAB, partial_depth

INCLUSION_FACTOR = (1.5, 2.5)  # toughness of an inclusion over that of its surroundings (assumed)
INCLUSION_LENGTH = (0.002, 0.005)  # length of an inclusion [m] (assumed)
INCLUSION_PLACE = (0.015, 0.095)  # position of an inclusion's centre, where cuts of 60 to 100 mm can meet it [m]
_INCLUSION_EDGE = 0.25e-3  # [m], width of the transition at either end
_EDGES = 20.0  # edge widths beyond which tanh is 1 to the last digit
_INCLUSIONS = 2  # largest number
_FIRST = np.int64(0)  # not a literal, for which Numba would compile a separate version


SAMPLER: np.dtype[Any] = np.dtype(
    (
        np.record,
        [
            ("modulus", "f8"),  # mean [Pa]
            ("modulus_liver_sigma", "f8"),  # SD of logarithms: between livers, between cuts, within a cut
            ("modulus_cut_sigma", "f8"),
            ("modulus_within_sigma", "f8"),
            ("inclined_cut_sigma", "f8"),
            ("resistance", "f8"),  # mean [J/m2]
            ("resistance_cut_sigma", "f8"),
            ("resistance_within_sigma", "f8"),
            ("friction_share", "f8"),
            ("depth", "f8", (N_POINTS,)),  # B [m]
            ("effective_depth", "f8", (N_POINTS,)),  # T g [m]
            ("share", "f8", (N_POINTS,)),  # c of that depth [1], see cutenv.sim.tissue.slab
            ("slab", SLAB),
        ],
    )
)
"""Structured dtype of the distribution from which one tissue's specimens are sampled."""


class MaterialProfiles(NamedTuple):
    """Material modulus [Pa] and fracture resistance [J/m2] profiles, each (301,)."""

    modulus: Array
    fracture_resistance: Array


@lru_cache(maxsize=8)
def sampler(tissue: TissueDescription) -> NDArray[Any]:
    """Return the :data:`SAMPLER` of a tissue, shape (1,), read-only."""
    record = np.zeros(1, SAMPLER)
    record["modulus"] = tissue.modulus
    record["modulus_liver_sigma"] = lognormal_sigma(tissue.modulus_between_liver_cv)
    record["modulus_cut_sigma"] = lognormal_sigma(tissue.modulus_between_cut_cv)
    record["modulus_within_sigma"] = lognormal_sigma(tissue.modulus_within_cut_cv)
    record["inclined_cut_sigma"] = lognormal_sigma(tissue.inclined_between_cut_cv)
    record["resistance"] = tissue.fracture_resistance
    record["resistance_cut_sigma"] = lognormal_sigma(tissue.fracture_between_cut_cv)
    record["resistance_within_sigma"] = lognormal_sigma(tissue.fracture_within_cut_cv)
    record["friction_share"] = tissue.friction_share
    record["depth"] = bulge_of(tissue)
    slab = record["slab"] = tissue.slab()
    recipe = record[0]
    partial_depth(slab, recipe["depth"], tissue.thickness, recipe["effective_depth"], recipe["share"])
    record.setflags(write=False)
    return record


@lru_cache(maxsize=8)
def bulge_of(tissue: TissueDescription) -> Array:
    """Return a sampled specimen's depth of cut, (301,) [m]."""
    depth = bulge(
        np.arange(N_POINTS) * SPACING,
        edge=tissue.edge_depth,
        crown=tissue.crown_depth,
        rise_length=tissue.rise_length,
        length=LENGTH,
    ).round(9)  # to a nanometre: powers differ in the last digits between machines
    depth.setflags(write=False)
    return depth


def tissue_modes(tissue: TissueDescription) -> Array:
    """Return modes of a specimen's random fields, (n_modes, 301)."""
    return field_modes(N_POINTS, SPACING, tissue.correlation_length)


@njit
def lognormal(normal: float, sigma: float) -> float:
    """Return a lognormal number of mean 1 from a normal one."""
    return exp(sigma * normal - 0.5 * sigma**2)


@njit_internal
def smooth_field(key: Key, stream: Integer, first: Integer, modes: Array, field: Array) -> None:
    """Fill ``field``, (301,), with a unit Gaussian field from normal numbers."""
    seed, episode = key
    field[:] = 0.0
    for k in range(modes.shape[0]):
        z = normal_at(seed, episode, stream, first + k)
        for i in range(modes.shape[1]):
            field[i] += modes[k, i] * z


@njit
def is_vascular(seed: Integer, episode: Integer) -> bool:
    """Return True if a mixed-class specimen has vessels (half do)."""
    return uniform_at(seed, episode, TASK, CLASS_DRAW) < 0.5


@njit_internal
def sample_profiles(
    key: Key, liver_factor: float, recipe: Struct, modes: Array, profiles: MaterialProfiles
) -> tuple[float, float]:
    """Sample a specimen into ``profiles``.

    Return its friction per depth [N/m] and its ``inclined_ratio`` [1].  ``key`` is seed and episode, ``liver_factor``
    the stiffness of the liver relative to the mean, 0 to sample it too, ``recipe`` a :data:`SAMPLER`, and ``modes``
    those of the random fields, (n_modes, 301).
    """
    seed, episode = key
    modulus, resistance = profiles.modulus, profiles.fracture_resistance
    liver = liver_factor
    if liver == 0.0:
        liver = lognormal(normal_at(seed, episode, CUT, _FIRST), recipe.modulus_liver_sigma)
    cut = lognormal(normal_at(seed, episode, CUT, _FIRST + 1), recipe.modulus_cut_sigma)
    mean_modulus = recipe.modulus * liver * cut
    cut = lognormal(normal_at(seed, episode, CUT, _FIRST + 2), recipe.resistance_cut_sigma)
    mean_resistance = recipe.resistance * cut
    smooth_field(key, MODULUS_FIELD, _FIRST, modes, modulus)
    smooth_field(key, RESISTANCE_FIELD, _FIRST, modes, resistance)
    for i in range(N_POINTS):
        modulus[i] = mean_modulus * lognormal(modulus[i], recipe.modulus_within_sigma)
        resistance[i] = mean_resistance * lognormal(resistance[i], recipe.resistance_within_sigma)
    inclined = lognormal(normal_at(seed, episode, CUT, _FIRST + 3), recipe.inclined_cut_sigma)
    return recipe.friction_share * mean_resistance, inclined


@njit_internal
def _between(limits: tuple[float, float], key: Key, counter: Integer) -> float:
    return limits[0] + (limits[1] - limits[0]) * uniform_at(key[0], key[1], VESSELS, counter)


@njit
def add_vessels(key: Key, resistance: Array) -> None:
    """Multiply ``resistance`` by one or two inclusions' factors (larger on overlap)."""
    count = 1 + int(_INCLUSIONS * uniform_at(key[0], key[1], VESSELS, _FIRST))
    factor = np.ones(N_POINTS)
    for vessel in range(count):
        half = 0.5 * _between(INCLUSION_LENGTH, key, _FIRST + 3 * vessel + 1)
        centre = _between(INCLUSION_PLACE, key, _FIRST + 3 * vessel + 2)
        excess = _between(INCLUSION_FACTOR, key, _FIRST + 3 * vessel + 3) - 1.0
        reach = half + _EDGES * _INCLUSION_EDGE
        for i in range(max(int((centre - reach) / SPACING), 0), min(int((centre + reach) / SPACING) + 2, N_POINTS)):
            y = i * SPACING - centre
            inside = 0.5 * (tanh((y + half) / _INCLUSION_EDGE) - tanh((y - half) / _INCLUSION_EDGE))
            factor[i] = max(factor[i], 1.0 + excess * inside)
    for i in range(N_POINTS):
        resistance[i] *= factor[i]


@njit
def sample_all_profiles(
    key: Key, liver_factor: float, recipes: Array, modes: Array, profiles: Array
) -> tuple[float, float]:
    """Call :func:`sample_profiles` with arrays, faster than records from Python."""
    return sample_profiles(key, liver_factor, recipes[0], modes, MaterialProfiles(profiles[0], profiles[1]))
