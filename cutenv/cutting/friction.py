"""Friction on the blade's faces: a spring until they slip, as Dahl's and elastic-plastic models have it.

Tissue sticks to a blade at rest and is drawn along by the first tenth of a millimetre of its motion, elastically, as if
by bristles; only then it slips.  So friction turns over a length, not at once, when the motion does, and a hand that
trembles by a micrometre feels a spring and no rattle.  A blade that has come to rest is still held by its bristles.
"""

from __future__ import annotations

from typing import NamedTuple

from cutenv.compiled import inlined
from cutenv.cutting.records import Record

_TWELFTH = 1.0 / 12.0
# Multiplied by, as with the presliding length's inverse: rows of cuts wait for a division.


class Grip(NamedTuple):
    """Friction as a spring and a slider, for a blade that a mass moves."""

    held: float
    """Force of the bristles now [N], against forward motion."""
    limit: float
    """Force at which they slip [N]."""
    stiffness: float
    """Stiffness until they slip [N/m]."""
    damping: float
    """Force per speed of the part that grows with speed [N s/m]."""


@inlined
def grip(law: Record, depth: float, bristle: float) -> Grip:
    """Friction of a blade ``depth`` [m] deep, its bristles deflected by ``bristle`` [m]."""
    limit = law.friction_per_depth * depth
    stiffness = limit * law.per_presliding_length
    return Grip(stiffness * bristle, limit, stiffness, law.friction_per_depth_speed * depth)


@inlined
def deflected(law: Record, bristle: float, dx: float) -> float:
    """The bristles' deflection [m] after a motion of the blade by ``dx`` [m]: up to the presliding length."""
    deflection: float = min(max(bristle + dx, -law.presliding_length), law.presliding_length)
    return deflection


@inlined
def friction_force(law: Record, depth: float, bristle: float, speed: float) -> float:
    """Force [N] against forward motion: proportional to depth, and optionally with a part proportional to speed."""
    force: float = (
        law.friction_per_depth * (bristle * law.per_presliding_length) + law.friction_per_depth_speed * speed
    ) * depth
    return force


@inlined
def friction_work(
    law: Record, depth: float, next_depth: float, bristle: float, next_bristle: float, dx: float, speed: float
) -> float:
    """Work [J] against friction over a motion ``dx`` [m] from ``depth`` to ``next_depth`` [m].

    Of bristles that do not slip it is the integral of their force for a depth that changes in a straight line, so that
    back and forth, in whatever steps, they give back what they took.
    """
    stretch, mean_depth = next_bristle - bristle, 0.5 * (depth + next_depth)
    slip = abs(dx - stretch)
    sprung = 0.5 * (bristle + next_bristle) * mean_depth + _TWELFTH * stretch * (next_depth - depth)
    rubbed = law.friction_per_depth * (sprung * stretch * law.per_presliding_length + mean_depth * slip)
    work: float = rubbed + law.friction_per_depth_speed * mean_depth * speed * dx
    return work
