"""The surface of a drawn slice: the mean bulge of the measured livers, and by how much one slice differs from it."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np

from cutenv._base.arrays import Array
from cutenv._base.parameter import check_parameters, parameter
from cutenv._engine.jit import njit
from cutenv._engine.randomness import SURFACE, Key
from cutenv.tissue.field import field_modes
from cutenv.tissue.grid import N_POINTS, SPACING
from cutenv.tissue.sampling import smooth_field
from cutenv.tissue.specimen import Specimen

_LEAST = 1e-3  # depth of cut at level 0 [m]: that of the mean bulge at the clamp
_FIRST = np.int64(0)  # not a literal, for which Numba would compile the function again


@dataclass(frozen=True, kw_only=True)
class SurfaceSpread:
    """Spread of the surface between slices.

    Without it every slice has the same surface, and who learns that by heart needs no measurement of it.
    """

    surface_spread: float = parameter(
        0.002, unit="m", low=0.0, high=0.01, provenance="assumed",
        source="SD of a slice's surface from the mean bulge: a tenth of the crown; the thesis calls the thickness "
        "naturally varying and gives no number", sensitivity=(0.0, 0.004),
    )  # fmt: skip
    surface_length: float = parameter(
        0.030, unit="m", low=0.005, high=0.2, provenance="assumed", source="correlation of it along the cut",
        sensitivity=(0.015, 0.060),
    )  # fmt: skip

    def __post_init__(self) -> None:
        check_parameters(self)

    def modes(self) -> Array:
        """Return the modes of the deviation along a slice, shape (n_modes, 301)."""
        return field_modes(N_POINTS, SPACING, self.surface_length)

    def of(self, specimen: Specimen, seed: int, episode: int) -> Specimen:
        """Return a drawn specimen with the surface of this random key; one of class uniform has no spread."""
        if self.surface_spread == 0.0 or specimen.specimen_class == "uniform":
            return specimen
        depth = specimen.depth.copy()
        key = np.uint64(seed), np.uint64(episode)
        vary_surface(key, self.surface_spread, specimen.thickness, self.modes(), depth)
        return dataclasses.replace(specimen, depth=depth)


@njit
def vary_surface(key: Key, spread: float, thickness: float, modes: Array, depth: Array) -> None:
    """Let the surface of a slice differ from the mean bulge: ``depth`` of cut at level 0 [m], shape (301,), changed.

    It remains within the slab's ``thickness`` [m].
    """
    deviation = np.empty(N_POINTS)
    smooth_field(key, SURFACE, _FIRST, modes, deviation)
    for i in range(N_POINTS):
        depth[i] = min(max(depth[i] + spread * deviation[i], min(depth[i], _LEAST)), thickness)
