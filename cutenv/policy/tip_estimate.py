"""The crack tip estimated from observations: blade position less elastic force over stiffness, K.

While the blade advances, the force locates the tip only for a known stiffness and friction: at first those of the mean
tissue.  While the blade draws back, nothing is cut, and the force falls along a straight line.  Its slope is K at the
tip; friction is half of the drop by which the line lies below the force before the blade turned; where only friction
is left, there is the tip.  So a return stroke of two millimetres measures stiffness and friction of this tissue.
"""

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
from cutenv.task.tip_estimation import PRESLIDING, dragged
from cutenv.task_quantities import SHALLOWEST
from cutenv.tissue.description import TissueDescription, measured_liver
from cutenv.tissue.grid import N_POINTS, SPACING
from cutenv.tissue.nominal import nominal_stiffness, nominal_tissue

_ITERATIONS = 3  # of a = x - F/K(a): converges by K'(x - a)/K each time
_STEADY = -0.002  # [m/s], speed below which a blade draws back steadily
_FORWARD = 0.0005  # [m/s], speed above which friction opposes an advance
_SETTLED = 0.0006  # [m] of retreat after which the delayed force no longer contains the earlier friction
_FLAT, _FLAT_OVER = 0.10, 0.0004  # [N], [m]: pure friction changes by less than this over this distance
_STEEP = 0.15  # [N] above friction: still elastic
_SPAN = 0.0006  # [m], shortest distance over which a slope is fitted
_SOFTEST, _STIFFEST = 0.25, 4.0  # multiples of the mean tissue's stiffness that are believed
_SMOOTHEST, _ROUGHEST = 0.2, 4.0  # and of its friction
_BACK = 0.003  # [m] by which a located tip may be behind an earlier one
_CUTTING_FROM = 0.015  # [m], position of the blade from which the force shows the resistance to cutting
_BELIEVED_FOR = 0.005  # [m] of cut that count as much as the mean tissue's resistance

CUT_MEMORY: np.dtype[Any] = np.dtype(
    (
        np.record,
        [
            ("depths", "f8", (N_POINTS,)),  # depth of cut as far as the blade has been [m]
            ("passed", "i8"),  # number of these that are known
            ("bristle", "f8"),  # deflection of the friction bristles [m]
            ("position", "f8"),  # of the blade at the last observation [m]
            ("furthest", "f8"),  # of the blade so far [m]
            ("pushed", "f8"),  # force at the last observation of an advance [N]
            ("pushed_at", "f8"),  # position there [m]
            ("steady", "i8"),  # number of observations for which the blade has drawn back
            ("back_from", "f8"),  # position at which the retreat began [m]
            ("flat_at", "f8"),  # position at the last observation, or the last one at least _FLAT_OVER away [m]
            ("flat_force", "f8"),  # force there [N]
            ("count", "i8"),  # number of readings during elastic retreat; then their moments about back_from
            ("x", "f8"),
            ("F", "f8"),
            ("xx", "f8"),
            ("xF", "f8"),
            ("nearest", "f8"),  # shortest distance of those readings from back_from [m]
            ("resisted", "f8"),  # integral of elastic force per depth over new ground [N]
            ("ground", "f8"),  # length of that ground [m]
            ("friction_known", "i8"),  # 1 once the blade has moved against nothing but friction
            ("friction_per_depth", "f8"),  # measured, or of the mean tissue [N/m]
            ("stiffness_ratio", "f8"),  # measured K over that of the mean tissue, at the tip [1]
            ("probed", "i8"),  # 1 once the tip has been located by drawing back
            ("located", "f8"),  # located tip [m]
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
    memory["friction_per_depth"] = nominal_tissue(tissue)["friction_per_depth"]
    memory["stiffness_ratio"] = 1.0
    memory.setflags(write=False)
    return memory


@njit
def _estimate_all(memory: StructArray, nominals: StructArray, seen: StructArray, estimates: StructArray) -> None:
    for n in range(len(memory)):
        estimate_cut(
            memory[n], nominals[0], max(seen[n, POSITION_COLUMN], 0.0), seen[n, SPEED_COLUMN],
            max(seen[n, DEPTH_COLUMN], SHALLOWEST), seen[n, FORCE_COLUMN], seen[n, FORCE_MEAN_COLUMN], estimates[n],
        )  # fmt: skip


@njit_internal
def estimate_cut(
    memory: Struct,
    nominal: Struct,
    position: float,
    speed: float,
    depth: float,
    force: float,
    mean_force: float,
    estimate: Struct,
) -> None:
    """Fill ``estimate`` from an observation, and remember what it shows.

    Parameters
    ----------
    memory, nominal : Record
        :data:`CUT_MEMORY`, changed in place; :data:`cutenv.tissue.nominal.NOMINAL`.
    position, speed, depth : float
        Of the blade [m], [m/s]; depth of cut there [m].
    force, mean_force : float
        Measured force, and its mean since the last observation [N].
    estimate : Record
        :data:`CUT_ESTIMATE`, filled.
    """
    memory.passed = remember_depth(memory.depths, memory.passed, position, depth)
    memory.bristle = dragged(memory.bristle, position - memory.position)
    memory.position = position
    _learn_from_retreat(memory, nominal, position, speed, force, depth)
    new_ground = position - max(memory.furthest, _CUTTING_FROM)
    memory.furthest = max(memory.furthest, position)

    mobilised = memory.bristle / PRESLIDING * depth
    elastic = max(force - mobilised * memory.friction_per_depth, 0.0)
    ratio = memory.stiffness_ratio
    tip = max(_tip_behind(memory, nominal, elastic / ratio), memory.located)
    estimate.tip = tip
    estimate.nominal_tip = _tip_behind(memory, nominal, max(force - mobilised * nominal.friction_per_depth, 0.0))
    estimate.elastic = elastic
    estimate.stiffness = ratio * _stiffness_behind(memory, nominal, tip)
    if new_ground > 0.0:
        memory.resisted += max(mean_force - mobilised * memory.friction_per_depth, 0.0) / depth * new_ground
        memory.ground += new_ground
    resistance = (memory.resisted + _BELIEVED_FOR * nominal.toughness_per_depth) / (memory.ground + _BELIEVED_FOR)
    estimate.resistance = resistance
    # At fixed blade and constant K, the energy of a run of length l is F l - K l^2/2 = R B l.
    estimate.run = 2.0 * max(elastic - resistance * depth, 0.0) / estimate.stiffness


@njit_internal
def remember_depth(depths: StructArray, passed: int, position: float, depth: float) -> int:
    """Fill ``depths``, shape (301,) [m], up to the blade, by linear interpolation since the last observation.

    ``passed`` is the number of grid points that the blade had passed; returns the number passed now.
    """
    reached = min(round(position / SPACING), len(depths) - 1) + 1
    before = depths[passed - 1] if passed > 0 else depth
    for k in range(passed, reached):
        depths[k] = before + (depth - before) * (k + 1 - passed) / (reached - passed)
    return max(passed, reached)


@njit_internal
def _stiffness_behind(memory: Struct, nominal: Struct, tip: float) -> float:
    """Return K [N/m] of the mean tissue for a ``tip`` [m] behind the blade."""
    place = min(max(round(tip / SPACING), 0), memory.passed - 1)
    K: float = nominal_stiffness(nominal, place, memory.depths[place])
    return K


@njit_internal
def _tip_behind(memory: Struct, nominal: Struct, elastic: float) -> float:
    """Return the tip [m] at which the mean tissue would hold the blade with the force ``elastic`` [N]."""
    tip: float = memory.position
    for _ in range(_ITERATIONS):
        tip = memory.position - elastic / _stiffness_behind(memory, nominal, tip)
    return max(tip, 0.0)


@njit_internal
def _learn_from_retreat(
    memory: Struct, nominal: Struct, position: float, speed: float, force: float, depth: float
) -> None:
    """Update stiffness, friction and located tip from the force while the blade draws back."""
    if speed > _FORWARD:
        memory.pushed, memory.pushed_at = force, position
    if speed < _STEADY:
        if memory.steady == 0:
            memory.back_from = position
            memory.count = 0
            memory.x = memory.F = memory.xx = memory.xF = 0.0
        memory.steady += 1
    else:
        memory.steady = 0
    drawn_back = memory.back_from - position
    if memory.steady > 1 and drawn_back > _SETTLED:
        fell = memory.flat_force - force
        if force < 0.0 and fell < _FLAT and memory.flat_at - position > _FLAT_OVER:
            memory.friction_per_depth = -force / depth
            memory.friction_known = 1
            _locate_tip(memory, nominal, depth)
        elif force > _STEEP - memory.friction_per_depth * depth:
            memory.count += 1
            memory.x += drawn_back
            memory.F += force
            memory.xx += drawn_back**2
            memory.xF += drawn_back * force
            if memory.count == 1:
                memory.nearest = drawn_back
            if memory.count > 1 and drawn_back - memory.nearest > _SPAN:
                _locate_tip(memory, nominal, depth)
    if memory.steady <= 1 or memory.flat_at - position > _FLAT_OVER:  # whatever the decision rate
        memory.flat_at = position
        memory.flat_force = force


@njit_internal
def _locate_tip(memory: Struct, nominal: Struct, depth: float) -> None:
    """Locate the tip: extrapolate the straight line of the force down to friction."""
    n = memory.count
    if n < 2:
        return
    spread = memory.xx - memory.x**2 / n
    slope = (memory.x * memory.F / n - memory.xF) / max(spread, 1e-12)  # fall of the force over the retreat [N/m]
    if slope <= 0.0:
        return
    mean_x, mean_F = memory.x / n, memory.F / n
    friction_per_depth = memory.friction_per_depth
    if memory.friction_known == 0:  # the line lies below the force before the turn by friction both ways
        drop = memory.pushed - (mean_F + slope * (mean_x - (memory.back_from - memory.pushed_at)))
        believed = nominal.friction_per_depth
        friction_per_depth = min(max(0.5 * drop / depth, _SMOOTHEST * believed), _ROUGHEST * believed)
    tip = memory.back_from - mean_x - (mean_F + friction_per_depth * depth) / slope
    ratio = slope / _stiffness_behind(memory, nominal, tip)
    if _SOFTEST < ratio < _STIFFEST and tip > memory.located - _BACK:
        memory.friction_per_depth = friction_per_depth
        memory.located = tip
        memory.stiffness_ratio = ratio
        memory.probed = 1
