"""Specimen seen from above, as the finite-element model displaces it."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from cutenv._base.arrays import Array
from cutenv.display.viewer.scene_parts import HALF_GAP, OPENED_ASIDE
from cutenv.sim.tissue.cut_model import CutModel


class Slab:
    """Lattice of a specimen, displaced by the finite-element model.

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
        """Interpolate nodal values, (n_nodes, k), to (2, n_across, n_along, k)."""
        values: Array = np.asarray(self._from_nodes @ nodal)
        return values.reshape(*self._shape, nodal.shape[1])

    def displacement(self, tip: float, lag: float) -> Array:
        """Return the lattice's displacement for a tip held ``lag`` ahead.

        The tip's rest position is ``tip``.

        Returns
        -------
        ndarray, shape (2, n_across, n_along, 2)
            (across, along) [m].
        """
        # The tip moves by F/(kappa E B), which the law calls x - a; only that product matters here.
        field = self.model.displacement(tip, self.model.stiffness(tip) * lag, modulus=1.0, thickness=1.0)
        return self.on_lattice(field[:, :2])

    def opened(self, places: Array, tip: float) -> Array:
        """Return lattice places with the cut drawn open, beyond the model."""
        shift = self._aside(self.rest[..., 0], self.rest[..., 1], tip)
        drawn = places.copy()
        drawn[0, ..., 0] -= shift[0]
        drawn[1, ..., 0] += shift[1]
        return drawn

    def carried(self, displacement: Array, tip: float, side: Array, places: Array) -> Array:
        """Return drawn places of tissue at rest: displaced, cut open.

        Parameters
        ----------
        displacement : ndarray, shape (2, n_across, n_along, 2)
            Displacement of the lattice [m].
        tip : float
            Tip of the cut at rest [m].
        side : ndarray, shape (n,)
            Side of the cut line, -1 or 1: on it there are two places.
        places : ndarray, shape (n, 2)
            (across, along) at rest [m].

        Returns
        -------
        ndarray, shape (n, 2)
            (across, along) [m].
        """
        right = (side > 0).astype(np.int64)
        x, y = places.T
        lines = self.rest[:, :, 0, 0]
        i = np.where(right > 0, _interval(lines[1], x), _interval(lines[0], x))
        j = _interval(self._along, y)
        s = ((x - lines[right, i]) / (lines[right, i + 1] - lines[right, i]))[:, None]
        t = ((y - self._along[j]) / (self._along[j + 1] - self._along[j]))[:, None]
        d = displacement
        moved = (1 - t) * ((1 - s) * d[right, i, j] + s * d[right, i + 1, j])
        moved += t * ((1 - s) * d[right, i, j + 1] + s * d[right, i + 1, j + 1])
        drawn: Array = places + moved
        drawn[:, 0] += side * self._aside(x, y, tip)
        return drawn

    def _aside(self, across: Array, along: Array, tip: float) -> Array:
        """Return the open cut's sideways push at each place [m]."""
        away: Array = OPENED_ASIDE({"across": across, "half_width": 0.5 * self.model.width})
        gap: Array = HALF_GAP({"along": along, "tip": max(tip, 0.0)})
        return gap * away

    def line_across(self, displacement: Array, along: float) -> Array:
        """Return a displaced line across at ``along`` [m], shape (n, 2) [m]."""
        k = int(np.clip(np.searchsorted(self._along, along), 1, len(self._along) - 1))
        w = (along - self._along[k - 1]) / (self._along[k] - self._along[k - 1])
        places = self.rest + displacement
        line: Array = (1.0 - w) * places[:, :, k - 1] + w * places[:, :, k]
        line = line.reshape(-1, 2)
        return line


drawn_slab_of = lru_cache(maxsize=4)(Slab)
"""Slab of a model; it is cached."""


def _interval(lines: Array, places: Array) -> NDArray[np.int64]:
    """Return each place's interval number between ascending ``lines``."""
    found: NDArray[np.int64] = np.clip(np.searchsorted(lines, places, side="right") - 1, 0, len(lines) - 2)
    return found


def _lattice(first: int, count: int, subdivisions: int) -> tuple[NDArray[np.int64], Array]:
    """Return element and place in it (0 to 1) of lattice lines."""
    place = np.arange(count * subdivisions + 1) / subdivisions
    element = np.minimum(place.astype(np.int64), count - 1)
    return first + element, place - element
