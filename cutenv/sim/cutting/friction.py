"""Friction on the blade's faces.

A spring until they slip, as in Dahl's and elastoplastic friction models.

Tissue sticks to a blade at rest and follows the first tenth of a millimetre of its motion elastically, as if held by
bristles; only then it slips.  So friction reverses over a length, not at once, when the motion does, and a hand that
trembles by a micrometre meets a spring instead of a rattle.  The bristles still hold a blade that has come to rest.

Where the blade also moves in a second direction, down or aside, friction is one vector: the bristles' deflection has
two components and, as a whole, the limit of one.  So a blade that is drawn is pressed down more easily.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from cutenv._base.arrays import Struct
from cutenv._engine.jit import njit_inline

_TWELFTH = 1.0 / 12.0
_MIN_DEFLECTION = (
    1e-9  # of the presliding length: a smaller deflection across is none, so that it does not fade for ever
)
# Multiplying avoids a division, which would slow the batched loop; likewise the presliding length's inverse.


class Grip(NamedTuple):
    """Friction linearised as spring and slider, for a hand's blade."""

    held: float  # force of the bristles now [N], against forward motion
    limit: float  # force at which they slip [N]
    stiffness: float  # stiffness until they slip [N/m]
    damping: float  # force per speed of the part that grows with speed [N s/m]


@njit_inline
def grip(law: Struct, depth: float, bristle: float) -> Grip:
    """Return friction at ``depth`` [m] and bristle deflection ``bristle`` [m]."""
    limit = law.friction_per_depth * depth
    stiffness = limit * law.per_presliding_length
    return Grip(stiffness * bristle, limit, stiffness, law.friction_per_depth_speed * depth)


@njit_inline
def deflected(law: Struct, bristle: float, dx: float) -> float:
    """Return the bristles' deflection [m], limited to the presliding length."""
    deflection: float = min(max(bristle + dx, -law.presliding_length), law.presliding_length)
    return deflection


@njit_inline
def friction_force(law: Struct, depth: float, bristle: float, speed: float) -> float:
    """Return friction [N] against forward motion, by depth and speed."""
    force: float = (
        law.friction_per_depth * (bristle * law.per_presliding_length) + law.friction_per_depth_speed * speed
    ) * depth
    return force


@njit_inline
def friction_work(
    law: Struct, depths: tuple[float, float], bristles: tuple[float, float], dx: float, speed: float
) -> float:
    """Return friction's work [J] over a motion ``dx`` [m].

    Depths and deflections are before and after it.

    For bristles that do not slip it is the integral of their force over a depth that changes linearly, so that back and
    forth, in steps of any size, they give back the energy that they took.
    """
    mean_depth, stretch = 0.5 * (depths[0] + depths[1]), bristles[1] - bristles[0]
    sprung = _sprung(depths, bristles)
    rubbed = law.friction_per_depth * (sprung * law.per_presliding_length + mean_depth * abs(dx - stretch))
    work: float = rubbed + law.friction_per_depth_speed * mean_depth * speed * dx
    return work


@njit_inline
def _sprung(depths: tuple[float, float], bristles: tuple[float, float]) -> float:
    """Return the integral of depth times deflection over deflection [m3]."""
    (depth, next_depth), (bristle, next_bristle) = depths, bristles
    stretch, mean_depth = next_bristle - bristle, 0.5 * (depth + next_depth)
    return (0.5 * (bristle + next_bristle) * mean_depth + _TWELFTH * stretch * (next_depth - depth)) * stretch


@njit_inline
def deflected_in_plane(law: Struct, bristles: tuple[float, float], motion: tuple[float, float]) -> tuple[float, float]:
    """Return the bristles' deflection along and across after ``motion`` [m].

    What is longer than the presliding length is shortened to it.  Without motion and deflection across it is what
    :func:`deflected` says, to the last bit.
    """
    most = law.presliding_length
    along, across = bristles[0] + motion[0], bristles[1] + motion[1]
    share = most / math.sqrt(max(along * along + across * across, most * most))
    straight = abs(across) < _MIN_DEFLECTION * most
    return deflected(law, bristles[0], motion[0]) if straight else along * share, 0.0 if straight else across * share


@njit_inline
def friction_work_in_plane(
    law: Struct,
    depths: tuple[float, float],
    bristles: tuple[tuple[float, float], tuple[float, float]],
    motion: tuple[float, float],
    speeds: tuple[float, float],
) -> float:
    """Return what :func:`friction_work` returns, for a motion along and across.

    ``bristles`` are the deflections along and across, each before and after the motion; ``speeds`` are in m/s.
    """
    along, across = bristles
    mean_depth = 0.5 * (depths[0] + depths[1])
    slip_along, slip_across = motion[0] - (along[1] - along[0]), motion[1] - (across[1] - across[0])
    sprung = _sprung(depths, along) + _sprung(depths, across)
    slip = math.sqrt(slip_along * slip_along + slip_across * slip_across)
    rubbed = law.friction_per_depth * (sprung * law.per_presliding_length + mean_depth * slip)
    work: float = rubbed + law.friction_per_depth_speed * mean_depth * (speeds[0] * motion[0] + speeds[1] * motion[1])
    return work
