"""Plane of a cut along which the blade also moves up and down: floor of the cut, wanted depth, layer below.

It is seen where the near half of the specimen is taken off.  Its rows of points run along the cut line and move with
the finite-element field; the open cut, an illustration, closes toward its floor.
"""

from __future__ import annotations

import numpy as np

from cutenv._base.arrays import Array
from cutenv.viewer.scene_parts import BELOW
from cutenv.viewer.solid.shown_cut import ShownCut

BOTTOM = -BELOW
"""Height of the specimen's lower face, as the side view draws it [m]."""
PLANE_ROWS = ("floor", "layer", "below layer", "wanted", "below wanted")
"""Rows of points, in order."""
_LAYER_ASIDE, _WANTED_ASIDE = 0.05e-3, 0.1e-3  # toward the near half, so that one is drawn upon the other [m]
_LINE = 0.6e-3  # thickness of the wanted depth's line [m]


def plane_rows(cut: ShownCut, along: Array, surface: Array) -> Array:
    """Return the rows' points without load, (across, along, up) [m], shape (5, n, 3).

    Parameters
    ----------
    cut : ShownCut
        With height.  Without a wanted depth or a layer, their rows lie at the lower face, and are not to be drawn.
    along, surface : array, shape (n,)
        Positions from the clamp, and height of the surface there [m].
    """
    assert cut.floor is not None
    floor = np.maximum(surface - cut.floor.at(along), BOTTOM)
    layer = np.full_like(along, BOTTOM) if cut.layer is None else np.maximum(surface - cut.layer, BOTTOM)
    wanted = np.full_like(along, BOTTOM)
    if cut.wanted is not None:
        wanted = np.maximum(surface - cut.wanted.at(along), BOTTOM + 0.5 * _LINE)
    heights = floor, layer, np.full_like(along, BOTTOM), wanted + 0.5 * _LINE, wanted - 0.5 * _LINE
    aside = 0.0, _LAYER_ASIDE, _LAYER_ASIDE, _WANTED_ASIDE, _WANTED_ASIDE
    return np.stack([
        np.column_stack([np.full_like(along, x), along, z]) for x, z in zip(aside, heights, strict=True)
    ])  # fmt: skip
