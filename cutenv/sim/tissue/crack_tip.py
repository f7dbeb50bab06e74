"""The crack tip estimated from what a rig measures.

Blade position less elastic force over stiffness, K.

While the blade advances, the force locates the tip only for a known stiffness and friction: at first those of the mean
tissue.  While the blade draws back, nothing is cut, and the force falls along a straight line.  Its slope is K at the
tip; friction is half of the drop by which the line lies below the force before the blade turned; where only friction
is left, there is the tip.  So a return stroke of two millimetres measures stiffness and friction of this tissue.

Scripts and agents estimate it at every decision (:func:`follow_tip`), rigs and scores every 20 ms (:func:`assess_tip`).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from cutenv._base.arrays import Array, Struct, StructArray
from cutenv._engine.jit import njit, njit_inline, njit_internal
from cutenv.sim.tissue.grid import SPACING

ESTIMATED_EVERY = 0.020
"""Time between two readings from which a tip that never goes back is estimated, longer than the sensor's noise [s]."""
PRESLIDING = 50e-6  # motion over which friction is taken to reverse [m]
_ITERATIONS = 3  # of a = x - F/K(a): converges by K'(x - a)/K each time
_STEADY = -0.002  # [m/s], speed below which a blade draws back steadily
_FORWARD = 0.0005  # [m/s], speed above which friction opposes an advance
_SETTLED = 0.0006  # [m] of retreat after which the delayed force no longer contains the earlier friction
_FLAT, _FLAT_OVER = 0.10, 0.0004  # [N], [m]: pure friction changes by less than this over this distance
_STEEP = 0.15  # [N] above friction: still elastic
_SPAN = 0.0006  # [m], shortest distance over which a slope is fitted
_SOFTEST, _STIFFEST = 0.25, 4.0  # multiples of the mean tissue's stiffness that are believed
_SMOOTHEST, _ROUGHEST = 0.2, 4.0  # and of its friction
_SETTLE = 0.050  # [s] for which friction must have kept its direction, because the measured force is delayed
_OPEN = 0.002  # [m] behind a located tip where the blade feels nothing but friction, which tells no more of the tip
_BACK = 0.003  # [m] by which a located tip may be behind an earlier one

TIP_FIELDS: list[tuple[str, str]] = [
    ("bristle", "f8"),  # deflection of the friction bristles [m]
    ("position", "f8"),  # of the blade at the last reading [m]
    ("pushed", "f8"),  # force at the last reading of an advance [N]
    ("pushed_at", "f8"),  # position there [m]
    ("steady", "i8"),  # number of readings for which the blade has drawn back
    ("back_from", "f8"),  # position at which the retreat began [m]
    ("flat_at", "f8"),  # position at the last reading, or the last one at least _FLAT_OVER away [m]
    ("flat_force", "f8"),  # force there [N]
    ("count", "i8"),  # number of readings during elastic retreat; then their moments about back_from
    ("x", "f8"),
    ("F", "f8"),
    ("xx", "f8"),
    ("xF", "f8"),
    ("nearest", "f8"),  # shortest distance of those readings from back_from [m]
    ("friction_known", "i8"),  # 1 once the blade has moved against nothing but friction
    ("friction_per_depth", "f8"),  # measured, or of the mean tissue [N/m]
    ("stiffness_ratio", "f8"),  # measured K over that of the mean tissue, at the tip [1]
    ("probed", "i8"),  # 1 once the tip has been located by drawing back
    ("located", "f8"),  # located tip [m]
]
"""Fields of a structured dtype that remembers what is known of a tip; begin with 0 and :func:`believe_mean`."""

ASSESSED_TIP: np.dtype[Any] = np.dtype(
    (
        np.record,
        [
            *TIP_FIELDS,
            ("tip", "f8"),  # so far [m]
            ("settled", "f8"),  # time for which friction has kept its direction [s]
        ],
    )
)
"""Structured dtype of what is remembered of a tip that never goes back."""


class MeanTissue(NamedTuple):
    """Mean tissue, with which an estimate begins."""

    stiffness: StructArray  # K with the tip at each grid point [N/m], (301,)
    passed: int  # number of points from the clamp on, at least 1, at which it is known
    friction_per_depth: float  # on a moving blade [N/m]


class BladeReading(NamedTuple):
    """Position [m], speed [m/s], depth of cut there [m] and measured force [N]."""

    position: float
    speed: float
    depth: float
    force: float


def believe_mean(memory: StructArray, friction_per_depth: float) -> None:
    """Initialise :data:`TIP_FIELDS` records with mean stiffness and friction [N/m]."""
    memory["friction_per_depth"] = friction_per_depth
    memory["stiffness_ratio"] = 1.0


@njit_inline
def dragged(bristle: float, moved: float) -> float:
    """Return the bristles' deflection [m], limited to the presliding length."""
    return min(max(bristle + moved, -PRESLIDING), PRESLIDING)


@njit_internal
def follow_tip(memory: Struct, mean: MeanTissue, reading: BladeReading) -> tuple[float, float]:
    """Estimate tip [m] and elastic force [N], and update ``memory``, :data:`TIP_FIELDS`."""
    memory.bristle = dragged(memory.bristle, reading.position - memory.position)
    memory.position = reading.position
    _learn_from_retreat(memory, mean, reading)
    elastic = max(reading.force - memory.bristle / PRESLIDING * reading.depth * memory.friction_per_depth, 0.0)
    tip = tip_behind(mean, reading.position, elastic / memory.stiffness_ratio)
    return max(tip, memory.located), elastic


@njit_internal
def assess_tip(memory: Struct, mean: MeanTissue, reading: BladeReading) -> float:
    """Update ``memory.tip`` with a reading 20 ms after the last one.

    Return by how much it grew [m].

    A cut never heals, so the tip never goes back, except to where drawing back locates it, which is no growth.
    ``memory`` is :data:`ASSESSED_TIP`, changed in place.
    """
    bristle, located, before, position = memory.bristle, memory.located, memory.tip, reading.position
    if memory.probed == 1 and position < located - _OPEN:  # and the depth is no longer that of the tip
        memory.bristle, memory.position = dragged(bristle, position - memory.position), position
        return 0.0
    tip, elastic = follow_tip(memory, mean, reading)
    memory.settled = memory.settled + ESTIMATED_EVERY if memory.bristle == bristle else 0.0
    if memory.located != located:
        memory.tip = memory.located
        return 0.0
    if elastic > 0.0 and memory.settled >= _SETTLE:
        memory.tip = max(before, tip)
    return float(memory.tip - before)


@njit
def assess_tips(memories: StructArray, taught: StructArray, mean: MeanTissue, readings: Array, tips: Array) -> None:
    """Fill ``tips`` [m] by :func:`assess_tip` for ``readings`` every 20 ms.

    The columns are the fields of :class:`BladeReading`; ``memories`` has shape (1,), and so has ``taught``, which is
    given as zeros and filled with what was remembered at the first return stroke.
    """
    memory, first = memories[0], taught
    for k in range(len(readings)):
        position, speed, depth, force = readings[k, 0], readings[k, 1], readings[k, 2], readings[k, 3]
        assess_tip(memory, mean, BladeReading(max(position, 0.0), speed, depth, force))
        tips[k] = memory.tip
        if memory.probed == 1 and (first[0].probed == 0 or memory.back_from == first[0].back_from):
            first[0] = memory


@njit_internal
def stiffness_behind(mean: MeanTissue, tip: float) -> float:
    """Return mean K [N/m] for a ``tip`` [m] behind the blade."""
    K: float = mean.stiffness[min(max(round(tip / SPACING), 0), mean.passed - 1)]
    return K


@njit_internal
def tip_behind(mean: MeanTissue, position: float, elastic: float) -> float:
    """Return the tip [m] at which mean tissue exerts ``elastic`` [N]."""
    tip = position
    for _ in range(_ITERATIONS):
        tip = position - elastic / stiffness_behind(mean, tip)
    return max(tip, 0.0)


@njit_internal
def _learn_from_retreat(memory: Struct, mean: MeanTissue, reading: BladeReading) -> None:
    """Update stiffness, friction and tip from a retreating blade's force."""
    position, speed, depth, force = reading.position, reading.speed, reading.depth, reading.force
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
            _locate_tip(memory, mean, depth)
        elif force > _STEEP - memory.friction_per_depth * depth:
            memory.count += 1
            memory.x += drawn_back
            memory.F += force
            memory.xx += drawn_back**2
            memory.xF += drawn_back * force
            if memory.count == 1:
                memory.nearest = drawn_back
            if memory.count > 1 and drawn_back - memory.nearest > _SPAN:
                _locate_tip(memory, mean, depth)
    if memory.steady <= 1 or memory.flat_at - position > _FLAT_OVER:  # whatever the rate of readings
        memory.flat_at = position
        memory.flat_force = force


@njit_internal
def _locate_tip(memory: Struct, mean: MeanTissue, depth: float) -> None:
    """Locate the tip by extrapolating the force's line to friction."""
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
        believed = mean.friction_per_depth
        friction_per_depth = min(max(0.5 * drop / depth, _SMOOTHEST * believed), _ROUGHEST * believed)
    tip = max(memory.back_from - mean_x - (mean_F + friction_per_depth * depth) / slope, 0.0)  # no cut before the clamp
    ratio = slope / stiffness_behind(mean, tip)
    if _SOFTEST < ratio < _STIFFEST and tip > memory.located - _BACK:
        memory.friction_per_depth = friction_per_depth
        memory.located = tip
        memory.stiffness_ratio = ratio
        memory.probed = 1
