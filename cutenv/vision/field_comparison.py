"""Displacement field of beads against the model's (thesis, section 7.3)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cutenv._base.arrays import Array
from cutenv.tissue.cut_model import CutModel
from cutenv.trace import Trace
from cutenv.vision.bead_tracks import BeadRises, BeadTracks
from cutenv.vision.filmed_measurement import FilmedMeasurement, measure_filmed_cut

NEAR = 0.02
"""Distance from the cut line up to which a bead counts as near [m]."""

_LEAST_CORRELATION = 0.5


@dataclass(frozen=True, kw_only=True)
class BeadRow:
    """One bead, as in Table 7.1: means over the ramps; lengths in metres.

    Attributes
    ----------
    bead : int
        Its number.
    across, along : float
        Place before the cut: from the cut line, and from the clamp [m].
    ramps : int
        Number of ramps in which it was seen.
    computed, measured : float
        Mean size of its displacement by the model, and as tracked [m].
    rms : float
        Root mean square of the difference of both, as vectors [m].
    """

    bead: int
    across: float
    along: float
    ramps: int
    computed: float
    measured: float
    rms: float


@dataclass(frozen=True, kw_only=True, eq=False)
class FieldComparison:
    """Displacements of beads, tracked and computed, one row for each bead in each ramp.

    Attributes
    ----------
    rises : BeadRises
        The rows: ramp, bead, place, displacement as tracked.
    measured, computed : ndarray, shape (n, dim)
        Displacement from start to end of the ramp [m], in the dimensions of the model.
    flags : tuple of str
        Remarks on what weakens the comparison.
    """

    rises: BeadRises
    measured: Array
    computed: Array
    flags: tuple[str, ...]

    @property
    def near(self) -> NDArray[np.bool_]:
        """Mask of the rows whose bead lies within :data:`NEAR` of the cut line."""
        return np.asarray(np.abs(self.rises.place[:, 0]) <= NEAR)

    @property
    def far(self) -> NDArray[np.bool_]:
        """Mask of the other rows."""
        return ~self.near

    def rms(self, rows: NDArray[np.bool_] | None = None) -> float:
        """Return the root mean square of the difference as a vector [m], of all rows or some; nan for none."""
        difference = (self.computed - self.measured)[slice(None) if rows is None else rows]
        return float(np.sqrt((difference**2).sum(axis=1).mean())) if len(difference) else float("nan")

    @property
    def noise(self) -> float:
        """Part of the RMS that the tracks' own covariance explains [m]."""
        dim = self.measured.shape[1]
        return float(np.sqrt(np.trace(self.rises.covariance[:, :dim, :dim], axis1=1, axis2=2).mean()))

    @property
    def slope(self) -> float:
        """Slope of the line through the origin of measured against computed displacement [1], all components."""
        squares = float((self.computed**2).sum())
        return float((self.computed * self.measured).sum()) / squares if squares > 0.0 else float("nan")

    @property
    def correlation(self) -> float:
        """Correlation of measured and computed displacement [1], all components; 0 if nothing moved."""
        if np.ptp(self.computed) == 0.0 or np.ptp(self.measured) == 0.0:
            return 0.0
        return float(np.corrcoef(self.computed.ravel(), self.measured.ravel())[0, 1])

    def table(self, ramp: int | None = None) -> list[BeadRow]:
        """Return the rows bead by bead, of one ramp (as the thesis's Table 7.1) or as means over all."""
        rows = []
        for bead in np.unique(self.rises.bead):
            own = self.rises.bead == bead
            if ramp is not None:
                own &= self.rises.ramp == ramp
            if not own.any():
                continue
            across, along = self.rises.place[own][0, :2]
            computed, measured = (np.linalg.norm(u[own], axis=1).mean() for u in (self.computed, self.measured))
            rows.append(
                BeadRow(
                    bead=int(bead),
                    across=float(across),
                    along=float(along),
                    ramps=int(own.sum()),
                    computed=float(computed),
                    measured=float(measured),
                    rms=self.rms(own),
                )
            )
        return rows


def compare_field(measured: FilmedMeasurement, borders: ArrayLike = (), moduli: ArrayLike = (1.0,)) -> FieldComparison:
    """Compare the beads of a measured cut with the model, driven by the displacement of the tip.

    Parameters
    ----------
    measured : FilmedMeasurement
        Cut, see :func:`~cutenv.vision.filmed_measurement.measure_filmed_cut`.
    borders, moduli : array_like
        Zones along the cut, see `cutenv.tissue.zoned_model`; only the ratios of the moduli count. By default one zone.
    """
    slab, rises = measured.slab, measured.rises
    zoned, dim = slab.zoned(borders, moduli), slab.model.dim
    computed = np.empty((len(rises), dim))
    for number, load in enumerate(rises.ramps):
        own = rises.ramp == number
        computed[own] = slab.rise_by_displacement(zoned, rises.place[own][:, :dim], load)
    compared = FieldComparison(rises=rises, measured=rises.rise[:, :dim], computed=computed, flags=rises.flags)
    if compared.correlation >= _LEAST_CORRELATION:
        return compared
    flag = (
        f"beads do not move as the model does (correlation {compared.correlation:.2f}): tracks of another cut, or of a "
        "mirrored camera?"
    )
    return replace(compared, flags=(*compared.flags, flag))


def compare_displacements(
    tracks: BeadTracks,
    trace: Trace,
    model: CutModel,
    *,
    thickness: float | None = None,
    zones: tuple[ArrayLike, ArrayLike] = ((), (1.0,)),
) -> FieldComparison:
    """Compare the displacements of beads with those of the model, ramp by ramp: the thesis's Table 7.1 for any tracks.

    Parameters
    ----------
    tracks, trace, model, thickness
        See :func:`measure_filmed_cut`.
    zones : tuple of array_like
        Borders and moduli of zones along the cut, as `zones_as_measured` returns them; by default one zone.

    Returns
    -------
    FieldComparison

    Raises
    ------
    ValueError
        See :func:`measure_filmed_cut`.
    """
    return compare_field(measure_filmed_cut(tracks, trace, model, thickness=thickness), *zones)
