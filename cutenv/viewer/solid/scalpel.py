"""Model of a No. 10 blade in a No. 3 handle, made of triangles, and its position in the tissue.

In the scalpel's own frame z runs up along the straight part of the edge from the blade's point, y toward the edge (the
direction of the cut, 0 at that straight part), x through the blade's thickness. The measures are common ones, rounded:
they serve the picture, and nothing is computed from them.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cutenv._base.arrays import Array
from cutenv.viewer.solid.solids import Surface, swept

BLADE_LENGTH = 0.0425
"""Length from the point to the end of the tang, in the handle [m]: thesis, section 3.4.1, as in
`cutenv.viewer.scene`."""
CHORD = 0.007
"""Distance from the edge to the back [m]."""
BELLY = 0.013
"""Length over which the edge curves from the point, which is at the back [m]."""
BLADE_THICKNESS = 0.0004
"""Thickness of the blade [m]."""
HANDLE_LENGTH = 0.05
"""Length of the part of the handle that is drawn [m]; a No. 3 handle has about 0.12."""

_BEVEL = 0.0016  # [m] width of the ground bevel
_EDGE_END = 0.031  # [m] from the point to where the blade narrows
_HANDLE_START = 0.034  # [m] from the point
_HANDLE_WIDTH, _HANDLE_THICKNESS = 0.009, 0.0024  # [m]
_NECK_WIDTH = 0.0056  # [m]


class ScalpelPose(NamedTuple):
    """Position of the scalpel's origin along the specimen and above its lower face [m], and its angle [rad]."""

    along: float
    height: float
    angle: float


def edge_outline(count: int = 24) -> Array:
    """Return the edge from the point up, (y, z) [m], shape (count, 2): a quarter ellipse and a line."""
    t = np.linspace(0.0, 0.5 * math.pi, count - 1)
    belly = np.stack([-CHORD * (1.0 - np.sin(t)), BELLY * (1.0 - np.cos(t))], axis=-1)
    return np.concatenate([belly, [[0.0, _EDGE_END]]])


def pose(position: float, angle: float, depth: float) -> ScalpelPose:
    """Return the pose in which the edge meets the surface at ``position`` and the lowest point is ``depth`` below.

    Parameters
    ----------
    position : float
        Position of the edge in the tissue's surface, from the clamp [m].
    angle : float
        Angle of the blade against the surface [rad]; below 90 degrees it leans forward.
    depth : float
        Depth of the cut there [m]; the surface is that much above the specimen's lower face.
    """
    outline = edge_outline(200)
    y, z = (outline @ _turn(angle)).T
    low = int(z.argmin())  # on a blade that leans forward, some way up the belly: from there on the edge only rises
    meets = float(np.interp(depth, z[low:] - z[low], y[low:]))
    return ScalpelPose(along=position - meets, height=-float(z[low]), angle=angle)


def blade() -> Surface:
    """Return the blade, ground on both sides."""
    edge = edge_outline()
    shoulder = np.array([[-0.0012, _EDGE_END + 0.0022], [-0.0012, BLADE_LENGTH]])
    front = np.concatenate([edge, shoulder])
    back = np.full(len(front), -CHORD)
    back[-2:] = -CHORD + 0.0012
    half = 0.5 * BLADE_THICKNESS
    sections = []
    for (y, z), spine in zip(front, back, strict=True):
        ground = max(y - _BEVEL, spine)
        sections.append([(0.0, y, z), (half, ground, z), (half, spine, z), (-half, spine, z), (-half, ground, z)])
    return swept(np.array(sections))


def handle() -> Surface:
    """Return the lower part of the handle: a neck in the blade's slot, which widens to a flat bevelled bar."""
    middle = -0.5 * CHORD
    stations = [
        (_HANDLE_START, 0.55 * _NECK_WIDTH, 0.5 * _HANDLE_THICKNESS),
        (_HANDLE_START + 0.004, _NECK_WIDTH, _HANDLE_THICKNESS),
        (_HANDLE_START + 0.013, _NECK_WIDTH, _HANDLE_THICKNESS),
        (_HANDLE_START + 0.022, _HANDLE_WIDTH, 1.3 * _HANDLE_THICKNESS),
        (_HANDLE_START + HANDLE_LENGTH, _HANDLE_WIDTH, 1.3 * _HANDLE_THICKNESS),
    ]
    return swept(np.array([_bar(middle, width, thickness, z) for z, width, thickness in stations]))


def _bar(middle: float, width: float, thickness: float, z: float) -> list[tuple[float, float, float]]:
    y, x = 0.5 * width, 0.5 * thickness
    inner = 0.7 * y
    corners = [(x, inner), (0.55 * x, y), (-0.55 * x, y), (-x, inner), (-x, -inner), (-0.55 * x, -y), (0.55 * x, -y)]
    return [(a, middle + b, z) for a, b in [*corners, (x, -inner)]]


def _turn(angle: float) -> Array:
    """Return the matrix from (y, z) of the scalpel's frame to (along, height), for multiplication from the right."""
    edge = (math.cos(angle), math.sin(angle))
    forward = (math.sin(angle), -math.cos(angle))
    return np.array([forward, edge])
