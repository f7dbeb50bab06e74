"""The slab that was filmed: a finite-element model with zones of moduli, of its thickness and depth of cut."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cutenv._base.arrays import Array
from cutenv._base.validation import in_range
from cutenv.measurement import DepthProfile
from cutenv.tissue.cut_model import CutModel
from cutenv.tissue.slab import effective_depth
from cutenv.tissue.zoned_model import zoned_model
from cutenv.vision.bead_rises import RampLoad


@dataclass(frozen=True, kw_only=True, eq=False)
class SlabModel:
    """Finite-element model of one slab, and how deep the cut in it is.

    Parameters
    ----------
    model : CutModel
        Elements, formulation, size and lines; of a uniform modulus.
    depth : DepthProfile
        Depth of cut along the line.
    thickness : float, optional
        Thickness of the slab [m], 0.1 mm to 0.5 m. By default the slab is cut through: everywhere as thick as the cut
        is deep. Bricks have the thickness of the model.

    Raises
    ------
    ValueError
        If the thickness is out of range.
    """

    model: CutModel
    depth: DepthProfile
    thickness: float | None = None

    def __post_init__(self) -> None:
        if self.thickness is not None:
            in_range("thickness", self.thickness, 1e-4, 0.5, "m", "Lengths are in metres: 2.5 cm is 0.025.")

    @property
    def _cut_through(self) -> bool:
        return self.thickness is None and self.model.dim == 2

    @property
    def _thickness(self) -> float:
        return self.model.thickness if self.thickness is None else self.thickness

    def zoned(self, borders: ArrayLike, moduli: ArrayLike) -> CutModel:
        """Return the model with a modulus for each zone [Pa], see `zoned_model`; its methods take modulus 1."""
        return zoned_model(self.model, borders, moduli, depth=self.depth.at if self._cut_through else None)

    def stiffness(self, zoned: CutModel, tip: Array) -> Array:
        """Return blade force over displacement of the tip of a zoned model [N/m], of the shape of ``tip`` [m]."""
        a = np.clip(tip, 0.0, zoned.length)
        if self._cut_through or zoned.dim == 3:
            return np.asarray(zoned.stiffness(a)) * self._thickness
        return np.asarray(zoned.stiffness(a)) * effective_depth(a, self.depth.at(a), self._thickness)

    def rise_by_force(self, zoned: CutModel, points: Array, load: RampLoad) -> Array:
        """Return the displacement of points from start to end of a ramp [m], shape (n, dim), by the ramp's force."""
        start, end = (
            zoned.displacement_at(points, self._inside(a), force=f, modulus=1.0, thickness=self._thickness)
            for a, f in zip(load.tip, load.force, strict=True)
        )
        return end - start

    def rise_by_displacement(self, zoned: CutModel, points: Array, load: RampLoad) -> Array:
        """Return the same by the displacement of the tip: only the ratios of the moduli count."""
        start, end = (
            zoned.displacement_at(points, self._inside(a), tip_displacement=u)
            for a, u in zip(load.tip, load.displacement, strict=True)
        )
        return end - start

    def _inside(self, tip: float) -> float:
        return min(max(float(tip), 0.0), self.model.length)

    def contains(self, places: Array) -> NDArray[np.bool_]:
        """Return a mask of places, shape (n, 3) [m], that lie in the model; for plane ones height does not count."""
        nodes, points = self.model.nodes, places[:, : self.model.dim]
        return np.asarray(((points >= nodes.min(axis=0)) & (points <= nodes.max(axis=0))).all(axis=1))
