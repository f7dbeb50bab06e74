"""Friction on the blade's faces: a spring until they slip, as in Dahl's and elastoplastic friction models.

Tissue sticks to a blade at rest and follows the first tenth of a millimetre of its motion elastically, as if held by
bristles; only then it slips.  So friction reverses over a length, not at once, when the motion does, and a hand that
trembles by a micrometre meets a spring instead of a rattle.  The bristles still hold a blade that has come to rest.
"""

from __future__ import annotations

from typing import NamedTuple

from cutenv._base.arrays import Struct
from cutenv._engine.jit import njit_inline

_TWELFTH = 1.0 / 12.0
# Multiplying avoids a division, which would slow the batched loop; likewise the presliding length's inverse.


class Grip(NamedTuple):
    """Friction linearised as a spring and a slider, for the blade of a hand, which has a mass."""

    held: float
    """Force of the bristles now [N], against forward motion."""
    limit: float
    """Force at which they slip [N]."""
    stiffness: float
    """Stiffness until they slip [N/m]."""
    damping: float
    """Force per speed of the part that grows with speed [N s/m]."""


@njit_inline
def grip(law: Struct, depth: float, bristle: float) -> Grip:
    """Return the friction of a blade ``depth`` [m] deep whose bristles are deflected by ``bristle`` [m]."""
    limit = law.friction_per_depth * depth
    stiffness = limit * law.per_presliding_length
    return Grip(stiffness * bristle, limit, stiffness, law.friction_per_depth_speed * depth)


@njit_inline
def deflected(law: Struct, bristle: float, dx: float) -> float:
    """Return the bristles' deflection [m] after a motion ``dx`` [m] of the blade, limited to the presliding length."""
    deflection: float = min(max(bristle + dx, -law.presliding_length), law.presliding_length)
    return deflection


@njit_inline
def friction_force(law: Struct, depth: float, bristle: float, speed: float) -> float:
    """Return the force [N] against forward motion: proportional to depth, optionally with a part linear in speed."""
    force: float = (
        law.friction_per_depth * (bristle * law.per_presliding_length) + law.friction_per_depth_speed * speed
    ) * depth
    return force


@njit_inline
def friction_work(
    law: Struct, depths: tuple[float, float], bristles: tuple[float, float], dx: float, speed: float
) -> float:
    """Return the work [J] against friction over a motion ``dx`` [m]; depths and deflections are before and after it.

    For bristles that do not slip it is the integral of their force over a depth that changes linearly, so that back and
    forth, in steps of any size, they give back the energy that they took.
    """
    (depth, next_depth), (bristle, next_bristle) = depths, bristles
    stretch, mean_depth = next_bristle - bristle, 0.5 * (depth + next_depth)
    slip = abs(dx - stretch)
    sprung = 0.5 * (bristle + next_bristle) * mean_depth + _TWELFTH * stretch * (next_depth - depth)
    rubbed = law.friction_per_depth * (sprung * stretch * law.per_presliding_length + mean_depth * slip)
    work: float = rubbed + law.friction_per_depth_speed * mean_depth * speed * dx
    return work
