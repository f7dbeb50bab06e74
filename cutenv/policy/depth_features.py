"""Features of a learned policy of ``cutenv/DepthCut-v1``: those of gentle cutting, and those of the depth.

A cut is as deep as the blade is where the crack tip is, some millimetres behind.  So surface and wanted depth are
remembered as the blade passes, and the most useful features are by how much the blade must go down for the depth that
is wanted at the tip and ahead of it; the tip is estimated from the force along the cut, and from both forces
(:mod:`cutenv.policy.tip_estimate`).  Nothing is included that a rig could not know.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from cutenv._base.arrays import Array32, Indices, Struct, StructArray
from cutenv._engine.elementary import tanh
from cutenv._engine.jit import njit, njit_internal
from cutenv.policy.features import Features
from cutenv.policy.interface import DEPTH_COLUMN, FORCE_MEAN_COLUMN, POSITION_COLUMN, SPEED_COLUMN
from cutenv.policy.tip_estimate import feel_two_forces, nothing_felt
from cutenv.task.depth import DEPTH_COMPONENTS, DEPTH_CUT
from cutenv.task.observation import CLIP, COMPONENTS, SCALES
from cutenv.task_quantities import SHALLOWEST
from cutenv.tissue.crack_tip import BladeReading
from cutenv.tissue.description import measured_liver
from cutenv.tissue.grid import N_POINTS, SPACING
from cutenv.tissue.specimen import nominal_tissue

_FIRST = len(COMPONENTS)
_COLUMNS = {one.name: _FIRST + number for number, one in enumerate(DEPTH_COMPONENTS)}
_SCALES = np.array([one.scale for one in DEPTH_CUT.all_components])
_VERTICALS = [_COLUMNS[name] for name in ("vertical", "vertical_mean", "vertical_max")]
_VERTICAL_MEAN, _BLADE_DEPTH, _DESCENT_SPEED, _WANTED = (
    _COLUMNS[name] for name in ("vertical_mean", "blade_depth", "descent_speed", "wanted")
)
_AHEAD = 4  # wanted depths in an observation: at the blade, and at three places ahead of it
_LEADS = (0.0, 0.002, 0.004, 0.007, 0.010)  # distances ahead of the tip at which the error of the depth is told [m]
_LENGTH = 0.002  # [m], scale of errors of the depth
_LAG = 0.010  # [m], scale of the tip's lag
_FINE = 0.0005  # [m], scale of errors that a blade can still correct
_PER_FORCE = 0.002  # [m/N], depth to which a newton presses the floor of the cut
_OBSERVED = len(DEPTH_COMPONENTS)
_FELT = 3  # lag, stiffness and friction by two forces
_OF_DEPTH = _OBSERVED + 2 * len(_LEADS) + 2 * _AHEAD + 1 + _FELT + 2 * len(_LEADS)  # features that depth adds

DEPTH_MEMORY: np.dtype[Any] = np.dtype(
    (
        np.record,
        [
            ("passed", "i8"),  # number of points that the blade has passed
            ("surface", "f8", (N_POINTS,)),  # level of the surface, as measured [m]
            ("wanted", "f8", (N_POINTS,)),  # wanted depth [m]
        ],
    )
)
"""Structured dtype of what the features remember of one cut."""


class DepthFeatures(Features):
    """Features of one cut or many of ``cutenv/DepthCut-v1``: what depth adds to the observation, and what follows.

    Those of gentle cutting, which come first, have the blade's depth as the depth of cut.
    """

    components = len(DEPTH_CUT.all_components)
    added = _OF_DEPTH
    forces = (*Features.forces, *_VERTICALS)

    def __init__(self, count: int = 1, *, history: int = 0, force: bool = True) -> None:
        super().__init__(count, history=history, force=force)
        self._depths, self._felt = np.zeros(int(count), DEPTH_MEMORY), nothing_felt(int(count))

    def forget(self, cuts: int | Indices) -> None:
        """Forget one of the cuts, or several, given by index."""
        super().forget(cuts)
        self._depths["passed"][cuts] = 0
        self._felt[cuts] = nothing_felt(1)[0]

    def seen_along(self, seen: Array32) -> Array32:
        """Return the part of the observations that gentle cutting has, with the blade's depth as the depth of cut."""
        along = seen[:, :_FIRST].copy()
        along[:, DEPTH_COLUMN] = seen[:, _BLADE_DEPTH] * (_SCALES[_BLADE_DEPTH] / SCALES[DEPTH_COLUMN])
        return along

    def add(self, seen: Array32, cuts: Indices, features: Array32) -> None:
        """Fill the features of the depth."""
        add_depth_some(
            self._depths, self._felt, self.estimates, self.memory, nominal_tissue(measured_liver()), cuts,
            seen, features,
        )  # fmt: skip


@njit
def add_depth_some(
    memory: StructArray,
    felt: StructArray,
    estimates: StructArray,
    tips: StructArray,
    nominals: StructArray,
    cuts: StructArray,
    observations: StructArray,
    features: StructArray,
) -> None:
    """Fill the last features, of depth, and update the memory of the n cuts given by index.

    ``estimates`` and ``tips`` are those of all cuts, :data:`~cutenv.policy.tip_estimate.CUT_ESTIMATE` and
    :data:`~cutenv.policy.tip_estimate.CUT_MEMORY`; ``felt`` is :data:`~cutenv.policy.tip_estimate.TWO_FORCES`;
    ``observations`` and ``features`` have shape (n, 22) and (n, size).
    """
    for k in range(len(cuts)):
        n = cuts[k]
        _add_depth(memory[n], felt[n], estimates[n], tips[n].probed, nominals[0], observations[k], features[k])


@njit_internal
def _add_depth(
    memory: Struct, felt: Struct, estimate: Struct, probed: int, nominal: Struct, observation: StructArray,
    features: StructArray,
) -> None:  # fmt: skip
    position = max(observation[POSITION_COLUMN] * _SCALES[POSITION_COLUMN], 0.0)
    surface = observation[DEPTH_COLUMN] * _SCALES[DEPTH_COLUMN]  # depth of a blade at level 0
    blade = observation[_BLADE_DEPTH] * _SCALES[_BLADE_DEPTH]
    level = surface - blade
    _remember_depth(memory, position, surface, observation[_WANTED] * _SCALES[_WANTED])

    first = len(features) - _OF_DEPTH
    k = first
    for i in range(_OBSERVED):
        features[k + i] = observation[_FIRST + i]
    k += _OBSERVED
    k = _add_lower(memory, estimate.tip, level, features, k)
    for i in range(_AHEAD):
        lower = observation[_WANTED + i] * _SCALES[_WANTED + i] - blade
        features[k] = lower / _LENGTH
        features[k + 1] = tanh(lower / _LENGTH)
        k += 2
    pressed = _PER_FORCE * observation[_VERTICAL_MEAN] * _SCALES[_VERTICAL_MEAN]
    features[k] = tanh(pressed / _FINE)

    reading = BladeReading(
        position, observation[SPEED_COLUMN] * _SCALES[SPEED_COLUMN], max(blade, SHALLOWEST),
        observation[FORCE_MEAN_COLUMN] * _SCALES[FORCE_MEAN_COLUMN],
    )  # fmt: skip
    lag = feel_two_forces(
        felt, nominal, reading, observation[_VERTICAL_MEAN] * _SCALES[_VERTICAL_MEAN],
        observation[_DESCENT_SPEED] * _SCALES[_DESCENT_SPEED],
    )  # fmt: skip
    features[k + 1], features[k + 2], features[k + 3] = lag / _LAG, felt.stiffness, felt.friction
    _add_lower(memory, estimate.tip if probed == 1 else position - lag, level, features, k + 1 + _FELT)
    for i in range(first, len(features)):
        features[i] = min(max(features[i], -CLIP), CLIP)


@njit_internal
def _add_lower(memory: Struct, tip: float, level: float, features: StructArray, k: int) -> int:
    """Fill by how much the blade must go down, for a tip [m], from feature ``k`` on; return the next one."""
    for lead in _LEADS:
        i = min(max(int((tip + lead) / SPACING + 0.5), 0), memory.passed - 1)
        lower = level - (memory.surface[i] - memory.wanted[i])
        features[k] = lower / _LENGTH
        features[k + 1] = tanh(lower / _FINE)
        k += 2
    return k


@njit_internal
def _remember_depth(memory: Struct, position: float, surface: float, wanted: float) -> None:
    """Remember surface and wanted depth [m] up to the blade, interpolated since the last point that it passed."""
    passed = memory.passed
    reached = min(int(position / SPACING + 0.5), N_POINTS - 1) + 1
    before = memory.surface[passed - 1] if passed > 0 else surface
    wanted_before = memory.wanted[passed - 1] if passed > 0 else wanted
    for i in range(passed, reached):
        share = (i + 1 - passed) / (reached - passed)
        memory.surface[i] = before + (surface - before) * share
        memory.wanted[i] = wanted_before + (wanted - wanted_before) * share
    memory.passed = max(passed, reached)
