"""Tissue that a cut moves: the blade carries it along until the crack runs and it springs back."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import map_coordinates

from cutenv.sim.tissue.cut_model import CutModel
from scripts.validation.vision.rendering.lens import Array

_STEP = 2e-3  # of the grid of places [m]
_TURNS = 40  # in which a place at rest settles


@dataclass(frozen=True, kw_only=True, eq=False)
class MovedTissue:
    """Tissue of a finite-element model, whose tip is where a simulated cut has it.

    Clock of the record [s], tip, and its displacement by the blade [m], shape (n,) each.
    """

    model: CutModel
    time: Array
    tip: Array
    lead: Array

    def at_rest(self, now: float) -> Callable[[Array, Array], Array]:
        """Return a map from places x, y [m] to the shift that takes the tissue there back to rest, (2, ...) [m]."""
        tip, lead = (float(np.interp(now, self.time, each)) for each in (self.tip, self.lead))
        x, y = (np.arange(low, high + 1e-9, _STEP) for low, high in ((-0.04, 0.04), (0.0, self.model.length)))
        places = np.stack(np.meshgrid(x, y, indexing="ij"))
        unit = self.model.displacement_at(places.reshape(2, -1).T, tip, tip_displacement=1.0).T.reshape(places.shape)
        shift = np.zeros_like(places)
        for _ in range(_TURNS if lead > 0.0 else 0):  # half of each step: dense tissue ahead of the tip makes it swing
            at = (places + shift - places[:, :1, :1]) / _STEP
            moved = np.stack([map_coordinates(each, at, order=1, mode="nearest") for each in unit])
            shift = 0.5 * (shift - lead * moved)
        first = places[:, 0, 0]

        def shift_at(x: Array, y: Array) -> Array:
            at = np.stack([(x - first[0]) / _STEP, (y - first[1]) / _STEP])
            return np.stack([map_coordinates(each, at, order=1, mode="nearest") for each in shift])

        return shift_at
