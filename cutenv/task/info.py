"""Layout of `info`: hidden state, energies, reward terms, limit breaches. For people and tests, never for policies."""

from __future__ import annotations

from cutenv._base.arrays import Struct, StructArray
from cutenv._engine.jit import njit, njit_inline
from cutenv.cutting.law import initiation_excess
from cutenv.cutting.simulate import ENERGIES, account
from cutenv.task.episode_dtypes import TERMS
from cutenv.tissue.grid import N_POINTS, POINTS_PER_METRE

TRUTH = (
    "tip_m",
    "blade_m",
    "fracture_resistance_J_m2",
    "modulus_Pa",
    "initiation_excess",
    "units",
    "uncontrolled_m",
    "target_length_m",
)
"""The hidden state: tip, blade, resistance and modulus at the tip, eta, number and length of runs, target."""
COST = ("force_N", "overshoot_m")
"""Limit breaches: largest force above the limit in the step, overshoot of the tip so far."""

GROUPS = {"truth": TRUTH, "energy": ENERGIES, "reward_terms": TERMS, "cost": COST}
"""Groups of numbers in `info`, in SI units and this order, followed by the flag for a speed out of range."""
INFO_SIZE = sum(len(names) for names in GROUPS.values()) + 1
"""Number of values in `info`."""

INT_FIELDS = ("end", "units", "out_of_range")
"""Integer values: the end as an index in ENDS, number of runs so far, updates of the step out of range."""

_ENERGY = len(TRUTH)
_TERMS = _ENERGY + len(ENERGIES)
_COST = _TERMS + len(TERMS)
INFO_FIELDS = tuple(
    (group, names, slice(first, first + len(names)))
    for (group, names), first in zip(GROUPS.items(), (0, _ENERGY, _TERMS, _COST), strict=True)
)
"""Group, names and slice of each group in the array of values."""


@njit_inline
def fill_info(
    state: Struct,
    profile: Struct,
    law: Struct,
    task: Struct,
    progress: Struct,
    modulus: StructArray,
    resistance: StructArray,
    terms: StructArray,
    told: StructArray,
) -> None:
    """Fill ``told``, shape (30,); ``modulus`` [Pa] and ``resistance`` [J/m2] are the specimen's, shape (301,)."""
    place = min(int(state.tip * POINTS_PER_METRE + 0.5), N_POINTS - 1)
    told[0] = state.tip
    told[1] = state.blade
    told[2] = resistance[place]
    told[3] = modulus[place]
    told[4] = initiation_excess(law, state.pushing)
    told[5] = state.units
    told[6] = state.uncontrolled
    told[7] = task.target
    account(state, profile, told[_ENERGY:_TERMS])
    for k in range(len(terms)):
        told[_TERMS + k] = terms[k]
    told[_COST] = progress.over_limit
    told[_COST + 1] = progress.overshoot
    told[_COST + 2] = progress.out_of_range


@njit
def fill_info_of_one(
    cuts: StructArray,
    episodes: StructArray,
    modulus: StructArray,
    resistance: StructArray,
    terms: StructArray,
    told: StructArray,
) -> None:
    """Fill ``told`` for one cut and its episode, shape (1,) each, by :func:`fill_info`."""
    c, e = cuts[0], episodes[0]
    fill_info(c.state, c.profile, c.law, e.task, e.progress, modulus, resistance, terms, told)
