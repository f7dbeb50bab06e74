"""Model of a No. 10 blade in a No. 3 handle, made of triangles, and its position in the tissue.

Outline and pose are those of the scene (`cutenv.viewer.scene_parts`); x runs through the blade's thickness.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cutenv.viewer.scene import derived_quantities
from cutenv.viewer.scene_parts import (
    BLADE_LENGTH,
    CHORD,
    EDGE_END,
    HANDLE_START,
    HANDLE_WIDTHS,
    NARROWED,
    blade_edge,
)
from cutenv.viewer.solid.solids import Surface, swept

BLADE_THICKNESS = 0.0004
"""Thickness of the blade [m]."""

_BEVEL = 0.0016  # [m] width of the ground bevel
_HANDLE_THICKNESS = 0.0024  # [m]


class ScalpelPose(NamedTuple):
    """Position of the scalpel's origin along the specimen and above its lower face [m], and its angle [rad]."""

    along: float
    height: float
    angle: float


def pose(position: float, angle: float, depth: float, level: float = 0.0) -> ScalpelPose:
    """Return the pose in which the edge meets the surface at ``position`` and the lowest point is at ``level``.

    Parameters
    ----------
    position : float
        Position of the edge in the tissue's surface, from the clamp [m].
    angle : float
        Angle of the blade against the surface [rad]; below 90 degrees it leans forward.
    depth : float
        Height of the surface there [m]: the depth of the cut of a blade at level 0.
    level : float
        Height of the blade's lower end [m].
    """
    scene = derived_quantities(
        {
            "blade": position,
            "tip": position,
            "angle": angle,
            "level": level,
            "depth_at": lambda along: depth + 0.0 * along,
        }
    )
    return ScalpelPose(along=float(scene["scalpel_along"]), height=float(scene["scalpel_height"]), angle=angle)


def blade() -> Surface:
    """Return the blade, ground on both sides."""
    edge = blade_edge()
    shoulder = np.array([[-NARROWED, EDGE_END + 0.0022], [-NARROWED, BLADE_LENGTH]])
    front = np.concatenate([edge, shoulder])
    back = np.full(len(front), -CHORD)
    back[-2:] += NARROWED
    half = 0.5 * BLADE_THICKNESS
    sections = []
    for (y, z), spine in zip(front, back, strict=True):
        ground = max(y - _BEVEL, spine)
        sections.append([(0.0, y, z), (half, ground, z), (half, spine, z), (-half, spine, z), (-half, ground, z)])
    return swept(np.array(sections))


def handle() -> Surface:
    """Return the lower part of the handle: a neck in the blade's slot, which widens to a flat bevelled bar."""
    middle = -0.5 * CHORD
    thickness = (0.5, 1.0, 1.0, 1.3, 1.3)
    stations = [
        (HANDLE_START + z, width, share * _HANDLE_THICKNESS)
        for (z, width), share in zip(HANDLE_WIDTHS, thickness, strict=True)
    ]
    return swept(np.array([_bar(middle, width, thickness, z) for z, width, thickness in stations]))


def _bar(middle: float, width: float, thickness: float, z: float) -> list[tuple[float, float, float]]:
    y, x = 0.5 * width, 0.5 * thickness
    inner = 0.7 * y
    corners = [(x, inner), (0.55 * x, y), (-0.55 * x, y), (-x, inner), (-x, -inner), (-0.55 * x, -y), (0.55 * x, -y)]
    return [(a, middle + b, z) for a, b in [*corners, (x, -inner)]]
