"""The crack tip estimated from observations (:mod:`cutenv.tissue.crack_tip`), and the run that it would make now."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cutenv._base.arrays import Array, Indices, Struct, StructArray
from cutenv._engine.jit import njit, njit_internal
from cutenv.policy.signals import (
    DEPTH_COLUMN,
    FORCE_COLUMN,
    FORCE_MEAN_COLUMN,
    POSITION_COLUMN,
    SPEED_COLUMN,
    in_si,
)
from cutenv.task_quantities import SHALLOWEST
from cutenv.tissue.crack_tip import (
    PRESLIDING,
    TIP_FIELDS,
    BladeReading,
    MeanTissue,
    believe_mean,
    follow_tip,
    stiffness_behind,
    tip_behind,
)
from cutenv.tissue.description import TissueDescription, measured_liver
from cutenv.tissue.grid import N_POINTS, SPACING
from cutenv.tissue.nominal import nominal_stiffness, nominal_tissue

_CUTTING_FROM = 0.015  # [m], position of the blade from which the force shows the resistance to cutting
_BELIEVED_FOR = 0.005  # [m] of cut that count as much as the mean tissue's resistance

CUT_MEMORY: np.dtype[Any] = np.dtype(
    (
        np.record,
        [
            *TIP_FIELDS,
            ("stiffness", "f8", (N_POINTS,)),  # K of the mean tissue as far as the blade has been [N/m]
            ("passed", "i8"),  # number of these that are known
            ("depth", "f8"),  # at the last of them [m]
            ("furthest", "f8"),  # of the blade so far [m]
            ("resisted", "f8"),  # integral of elastic force per depth over new ground [N]
            ("ground", "f8"),  # length of that ground [m]
        ],
    )
)
"""Structured dtype of what an estimate remembers of one cut; begin with :func:`nothing_yet`."""

CUT_ESTIMATE: np.dtype[Any] = np.dtype(
    (
        np.record,
        [
            ("tip", "f8"),  # [m]
            ("nominal_tip", "f8"),  # with stiffness and friction of the mean tissue [m]
            ("stiffness", "f8"),  # K at the tip [N/m]
            ("elastic", "f8"),  # force without friction [N]
            ("resistance", "f8"),  # mean elastic force per depth at which this tissue was cut [N/m]
            ("run", "f8"),  # length that an unstable run would have if it began now [m]
        ],
    )
)
"""Structured dtype of an estimate."""


class TipEstimate:
    """Estimator of the crack tip from observations; it begins with the mean tissue and learns from return strokes.

    An observation contains the depth at the blade; the tip is behind it, where the bulge is thinner.  So the depth
    is stored as the blade passes.

    Parameters
    ----------
    tissue : TissueDescription, optional
        The tissue that the rig assumes; default the measured pig liver.

    Attributes
    ----------
    memory : Records, shape (n,)
        What is known of each cut, :data:`CUT_MEMORY`.
    """

    def __init__(self, tissue: TissueDescription | None = None) -> None:
        self._tissue = tissue or measured_liver()
        self._nominal = nominal_tissue(self._tissue)
        self.reset()

    def reset(self) -> None:
        """Forget the last cut."""
        self.begin(1)

    def begin(self, count: int) -> None:
        """Forget all cuts, and begin ``count``."""
        self.memory = np.repeat(nothing_yet(self._tissue), count)

    def forget(self, cuts: Indices) -> None:
        """Begin those cuts again that are given by index."""
        self.memory[cuts] = nothing_yet(self._tissue)[0]

    def __call__(self, observation: NDArray[np.float32]) -> float:
        """Return the tip [m] for an observation, shape (12,), of the cut since :meth:`reset`."""
        return float(self.tips(in_si(observation)[None])[0])

    def tips(self, seen: Array) -> Array:
        """Return the tips [m], shape (n,), for the observations of all cuts in SI units, shape (n, 12)."""
        tips: Array = self.estimates(seen)["tip"]
        return tips

    def estimates(self, seen: Array) -> StructArray:
        """Return :data:`CUT_ESTIMATE`, shape (n,), for the observations of all cuts in SI units, shape (n, 12)."""
        estimates: StructArray = np.zeros(len(seen), CUT_ESTIMATE)
        _estimate_all(self.memory, self._nominal, seen, estimates)
        return estimates


@lru_cache(maxsize=8)
def nothing_yet(tissue: TissueDescription) -> StructArray:
    """Return the :data:`CUT_MEMORY` of a cut that has not begun, shape (1,), read-only."""
    memory = np.zeros(1, CUT_MEMORY)
    believe_mean(memory, float(nominal_tissue(tissue)["friction_per_depth"][0]))
    memory.setflags(write=False)
    return memory


@njit
def _estimate_all(memory: StructArray, nominals: StructArray, seen: StructArray, estimates: StructArray) -> None:
    for n in range(len(memory)):
        reading = BladeReading(
            max(seen[n, POSITION_COLUMN], 0.0), seen[n, SPEED_COLUMN], max(seen[n, DEPTH_COLUMN], SHALLOWEST),
            seen[n, FORCE_COLUMN],
        )  # fmt: skip
        estimate_cut(memory[n], nominals[0], reading, seen[n, FORCE_MEAN_COLUMN], estimates[n])


@njit_internal
def estimate_cut(memory: Struct, nominal: Struct, reading: BladeReading, mean_force: float, estimate: Struct) -> None:
    """Fill ``estimate`` from an observation, and remember what it shows.

    Parameters
    ----------
    memory, nominal : Record
        :data:`CUT_MEMORY`, changed in place; :data:`cutenv.tissue.nominal.NOMINAL`.
    reading, mean_force : BladeReading, float
        Reading at the observation, and the mean force since the last one [N].
    estimate : Record
        :data:`CUT_ESTIMATE`, filled.
    """
    position, _, depth, force = reading
    remember_stiffness(memory, nominal, position, depth)
    mean = MeanTissue(memory.stiffness, memory.passed, nominal.friction_per_depth)
    tip, elastic = follow_tip(memory, mean, reading)
    new_ground = position - max(memory.furthest, _CUTTING_FROM)
    memory.furthest = max(memory.furthest, position)

    mobilised = memory.bristle / PRESLIDING * depth
    estimate.tip = tip
    estimate.nominal_tip = tip_behind(mean, position, max(force - mobilised * mean.friction_per_depth, 0.0))
    estimate.elastic = elastic
    estimate.stiffness = memory.stiffness_ratio * stiffness_behind(mean, tip)
    if new_ground > 0.0:
        memory.resisted += max(mean_force - mobilised * memory.friction_per_depth, 0.0) / depth * new_ground
        memory.ground += new_ground
    resistance = (memory.resisted + _BELIEVED_FOR * nominal.toughness_per_depth) / (memory.ground + _BELIEVED_FOR)
    estimate.resistance = resistance
    # At fixed blade and constant K, the energy of a run of length l is F l - K l^2/2 = R B l.
    estimate.run = 2.0 * max(elastic - resistance * depth, 0.0) / estimate.stiffness


@njit_internal
def remember_stiffness(memory: Struct, nominal: Struct, position: float, depth: float) -> None:
    """Fill the mean tissue's stiffness up to the blade, with the depth [m] interpolated since the last observation."""
    passed = memory.passed
    reached = min(round(position / SPACING), len(memory.stiffness) - 1) + 1
    before = memory.depth if passed > 0 else depth
    for k in range(passed, reached):
        memory.depth = before + (depth - before) * (k + 1 - passed) / (reached - passed)
        memory.stiffness[k] = nominal_stiffness(nominal, k, memory.depth)
    memory.passed = max(passed, reached)
