"""Specimen seen from above: a lattice that follows the displacement of the finite-element model."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from cutenv._base.arrays import Array
from cutenv.tissue.cut_model import CutModel

_WIDEST = 0.0025  # [m] half the gap of the widest cut: illustration
_GAP_PER_LENGTH = 0.05  # [1] half the gap over the cut's length, while it is short: illustration
_FACE_STEP = 0.5e-3  # [m] between the points of a drawn cut face


class Slab:
    """Lattice of a specimen, displaced according to the finite-element model.

    The lattice follows the straight lines between element corners, which include the model's tip. It has two sides,
    left and right of the cut line, where they meet. A place is (across, along) in metres: across from -x to +x, along
    from the clamp.

    Parameters
    ----------
    model : CutModel
        Finite-element model of the specimen; its fields are computed once and kept by it.
    subdivisions : tuple of int
        Cells of the lattice for one element, across and along.

    Attributes
    ----------
    rest : ndarray, shape (2, n_across, n_along, 2)
        Places of the lattice without load [m], the left side first.
    """

    def __init__(self, model: CutModel, subdivisions: tuple[int, int] = (3, 3)) -> None:
        assert model.divisions is not None  # set by the model
        self.model = model
        self.subdivisions = subdivisions
        across, along = model.divisions[:2]
        # Of bricks, only the upper face is visible: the last layer, and there the last 4 of 8 corners.
        corners = model.elements.reshape(across, along, -1)[:, :, -4:]
        sides = []
        weights = []
        for first in (0, across // 2):
            i, s = _lattice(first, across // 2, subdivisions[0])
            j, t = _lattice(0, along, subdivisions[1])
            sides.append(corners[i[:, None], j[None, :]])
            s, t = s[:, None], t[None, :]
            weights.append(np.stack([(1 - s) * (1 - t), s * (1 - t), s * t, (1 - s) * t], axis=-1))
        nodes, shares = np.stack(sides), np.stack(weights)
        self._shape = nodes.shape[:-1]
        starts = np.arange(0, nodes.size + 1, nodes.shape[-1])
        # One product maps nodes to the lattice, ten times faster than picking corners for every picture.
        self._from_nodes = csr_array((shares.ravel(), nodes.ravel(), starts), shape=(len(starts) - 1, model.n_nodes))
        self.rest: Array = self.on_lattice(model.nodes[:, :2])
        self._along: Array = self.rest[0, -1, :, 1].copy()

    def on_lattice(self, nodal: Array) -> Array:
        """Interpolate values at the nodes, shape (n_nodes, k), to the lattice, shape (2, n_across, n_along, k)."""
        values: Array = np.asarray(self._from_nodes @ nodal)
        return values.reshape(*self._shape, nodal.shape[1])

    def displacement(self, tip: float, lag: float) -> Array:
        """Return the lattice's displacement for a tip with rest position ``tip`` that the blade holds ``lag`` ahead.

        Returns
        -------
        ndarray, shape (2, n_across, n_along, 2)
            (across, along) [m].
        """
        # The tip moves by F/(kappa E B), which the law calls x - a; only that product matters here.
        field = self.model.displacement(tip, self.model.stiffness(tip) * lag, modulus=1.0, thickness=1.0)
        return self.on_lattice(field[:, :2])

    def opened(self, places: Array, tip: float) -> Array:
        """Return ``places`` of the lattice with the cut drawn open, which is not part of the model: an illustration."""
        half = 0.5 * self.model.width
        away = (1.0 - np.abs(self.rest[..., 0]) / half) ** 2
        shift = half_gap(self.rest[..., 1], tip) * away
        drawn = places.copy()
        drawn[0, ..., 0] -= shift[0]
        drawn[1, ..., 0] += shift[1]
        return drawn

    def cut_outline(self, displacement: Array, tip: float) -> Array:
        """Return the outline of the cut, drawn open: along its left face to the tip and back, shape (n, 2) [m]."""
        count = max(round(tip / _FACE_STEP), 2) + 1
        y = 0.5 * tip * (1.0 - np.cos(np.linspace(0.0, np.pi, count)))  # denser at the rounded ends
        gap = half_gap(y, tip)
        left, right = (
            np.stack([sign * gap, y + self._at(displacement[side, inner, :, 1], y)], axis=-1)
            for side, inner, sign in ((0, -1, -1.0), (1, 0, 1.0))
        )
        return np.concatenate([left, right[::-1]])

    def line_across(self, displacement: Array, along: float) -> Array:
        """Return the places of a straight line across the undisplaced tissue at ``along`` [m], shape (n, 2) [m]."""
        k = int(np.clip(np.searchsorted(self._along, along), 1, len(self._along) - 1))
        w = (along - self._along[k - 1]) / (self._along[k] - self._along[k - 1])
        places = self.rest + displacement
        line: Array = (1.0 - w) * places[:, :, k - 1] + w * places[:, :, k]
        line = line.reshape(-1, 2)
        return line

    def _at(self, values: Array, along: Array) -> Array:
        found: Array = np.interp(along, self._along, values)
        return found


@lru_cache(maxsize=4)
def drawn_slab_of(model: CutModel) -> Slab:
    """Return the slab of a model; it is cached."""
    return Slab(model)


def half_gap(along: Array, tip: float) -> Array:
    """Return half the gap [m] of a cut drawn open as an ellipse from the clamp to ``tip`` [m]; zero elsewhere."""
    if tip <= 0.0:
        return np.zeros_like(along)
    t = np.clip(along / tip, 0.0, 1.0)
    gap: Array = min(_WIDEST, _GAP_PER_LENGTH * tip) * 2.0 * np.sqrt(t * (1.0 - t))
    return gap


def _lattice(first: int, count: int, subdivisions: int) -> tuple[NDArray[np.int64], Array]:
    """Return element and place within it (0 to 1) of each lattice line over ``count`` elements from ``first``."""
    place = np.arange(count * subdivisions + 1) / subdivisions
    element = np.minimum(place.astype(np.int64), count - 1)
    return first + element, place - element
