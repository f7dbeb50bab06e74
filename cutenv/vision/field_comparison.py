"""Beads against the model (thesis, section 7.3): displacements; moduli of zones by force too, and what is unknown."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import least_squares
from scipy.stats import norm

from cutenv._base.arrays import Array
from cutenv._base.validation import array_in_range, in_range, one_of
from cutenv.tissue.cut_model import CutModel
from cutenv.trace import Trace
from cutenv.vision.bead_tracks import BeadRises, BeadTracks
from cutenv.vision.filmed_measurement import MODEL_ERROR, FilmedMeasurement, measure_filmed_cut, weights_of

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
        Zones along the cut, see `cutenv.tissue.varying_modulus`; only the ratios of the moduli count. By default
        one zone.
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


PRIOR_SD = 0.5
"""Default standard deviation of the prior of log E: liver varies by 0.2 to 0.5 of its modulus along a cut."""

_LEVEL = 0.95
_TOLD = 0.75  # share of a zone's prior variance that the data must remove for its modulus to count as told
_LEADING = 0.3  # weight from which a zone is named in a combination
_LEAST_INFORMATION = 3.0  # of a combination, in prior variances: below it the prior says more than a quarter


@dataclass(frozen=True, kw_only=True, eq=False)
class ZoneModuli:
    """Moduli of zones along the cut; arrays of shape (k,).

    Attributes
    ----------
    borders : ndarray, shape (k - 1,)
        Borders between the zones [m].
    modulus, low, high : ndarray
        Modulus of each zone and its 95 % interval [Pa], which contains 3 % for the error of the model itself.
    prior : ndarray
        Modulus that was expected [Pa].
    learned : ndarray
        Share of each zone's prior variance that the data removed [1]: 1 if the data say all, 0 if nothing.
    covariance : ndarray, shape (k, k)
        Covariance of the logarithms of the moduli [1].
    scatter : float
        Root mean square of the residuals in standard deviations [1]; intervals are widened by it if above 1.
    unknown : tuple of str
        Zones, and combinations of zones, that the data cannot tell; empty if there are none.
    flags : tuple of str
        Remarks on what weakens the estimate.
    """

    borders: Array
    modulus: Array
    low: Array
    high: Array
    prior: Array
    learned: Array
    covariance: Array
    scatter: float
    unknown: tuple[str, ...]
    flags: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.modulus)


def even_borders(measured: FilmedMeasurement, zones: int) -> Array:
    """Return borders of about equally long zones up to the last tip [m], on edges of the model's elements.

    The last zone reaches on to the free end.

    Raises
    ------
    ValueError
        If there are more zones than centimetres of cut.
    """
    last = float(measured.tips.max())
    row = measured.slab.model.tips[0]
    most = max(1, int(last / row))
    if not 1 <= zones <= most:
        raise ValueError(
            f"zones = {zones}: a cut of {100 * last:.1f} cm on elements of {100 * row:g} cm has 1 to {most}."
        )
    return np.asarray(np.rint(np.linspace(0.0, last / row, zones + 1)[1:-1]) * row)


def estimate_zone_moduli(
    measured: FilmedMeasurement,
    borders: ArrayLike,
    *,
    prior: ArrayLike | None = None,
    prior_sd: float = PRIOR_SD,
    data: Literal["both", "beads", "force"] = "both",
) -> ZoneModuli:
    """Estimate the moduli of zones from the displacements of beads and the stiffness at the blade together.

    Least squares for the logarithms of the moduli: every bead's displacement in every ramp against that by the ramp's
    force, every ramp's force over displacement against that of the model, and a prior. All zones count for every ramp,
    because the model is that of the whole slab.

    Parameters
    ----------
    measured : FilmedMeasurement
        The cut, see :func:`~cutenv.vision.filmed_measurement.measure_filmed_cut`.
    borders : array_like of shape (k - 1,)
        Borders between the zones [m], see :func:`even_borders`.
    prior : array_like, optional
        Expected modulus of each zone, or one for all [Pa]. By default the mean by force.
    prior_sd : float
        Standard deviation of log E about the prior [1], 0.01 to 5.
    data : {"both", "beads", "force"}
        Data that are used; to see what each tells alone.

    Returns
    -------
    ZoneModuli

    Raises
    ------
    ValueError
        If borders do not fit the model, or a value is out of range.

    Notes
    -----
    In units of the prior the data's information has eigenvalues; a combination of zones whose eigenvalue is below 3
    is known by the prior for a quarter or more, and named in ``unknown``.
    """
    one_of("data", data, ("both", "beads", "force"))
    k = np.size(borders) + 1
    sd = in_range("prior_sd", prior_sd, 0.01, 5.0, "1", "It is of the logarithm: 0.5 is half or twice the modulus.")
    expected = float(np.mean(measured.by_force)) if prior is None else prior
    centre = np.log(array_in_range("prior", np.broadcast_to(expected, k), 1.0, 1e6, "Pa", "48.4 kPa is 48400."))
    misfits = _Residuals(measured, np.atleast_1d(np.asarray(borders, dtype=np.float64)), data)

    def residuals(z: Array) -> Array:  # z: log E in units of the prior
        return np.concatenate((misfits(np.exp(centre + sd * z)), z))

    bound = np.minimum((np.log(1e6) - centre) / sd, 8.0) - 1e-6
    found = least_squares(residuals, np.zeros(k), bounds=(-bound, bound), xtol=1e-6, ftol=1e-6)
    misfit, slopes = found.fun[:-k], np.asarray(found.jac)[:-k]
    scatter = float(np.sqrt((misfit**2).sum() / max(len(misfit) - k, 1)))
    information = slopes.T @ slopes / max(scatter, 1.0) ** 2
    covariance = np.linalg.inv(information + np.eye(k))
    learned = 1.0 - np.diag(covariance)
    # The model's error is the same in every ramp: many beads do not make it smaller.
    covariance = sd**2 * covariance + MODEL_ERROR**2 * np.eye(k)
    log_E = centre + sd * found.x
    half = norm.ppf(0.5 + _LEVEL / 2) * np.sqrt(np.diag(covariance))
    return ZoneModuli(
        borders=misfits.borders,
        modulus=np.exp(log_E),
        low=np.exp(log_E - half),
        high=np.exp(log_E + half),
        prior=np.exp(centre),
        learned=learned,
        covariance=covariance,
        scatter=scatter,
        unknown=_unknown(information, learned, misfits.borders, measured.slab.model.length),
        flags=measured.rises.flags,
    )


class _Residuals:
    """Difference of data and model in standard deviations, as a function of the moduli [Pa]."""

    def __init__(self, measured: FilmedMeasurement, borders: Array, data: str) -> None:
        self.slab, self.rises, self.borders = measured.slab, measured.rises, borders
        self.beads, self.force = data != "force", data != "beads"
        ramps = self.rises.ramps
        self.root = np.linalg.cholesky(weights_of(self.rises, self.slab.model.dim))
        self.tips = measured.tips
        self.stiffness = np.array([load.stiffness for load in ramps])
        self.force_sd = np.hypot([load.relative_error for load in ramps], MODEL_ERROR)

    def __call__(self, moduli: Array) -> Array:
        zoned, dim = self.slab.zoned(self.borders, moduli), self.slab.model.dim
        parts = []
        if self.force:
            parts.append(np.log(self.slab.stiffness(zoned, self.tips) / self.stiffness) / self.force_sd)
        if self.beads:
            for number, load in enumerate(self.rises.ramps):
                own = self.rises.ramp == number
                computed = self.slab.rise_by_force(zoned, self.rises.place[own][:, :dim], load)
                difference = computed - self.rises.rise[own][:, :dim]
                parts.append(np.einsum("nji,nj->ni", self.root[own], difference).ravel())
        return np.concatenate(parts)


def _unknown(information: Array, learned: Array, borders: Array, length: float) -> tuple[str, ...]:
    """Return what the data cannot tell, in words: single zones, then combinations of zones that are told together."""
    edges = np.concatenate(([0.0], borders, [length]))
    names = [f"zone {i + 1} ({100 * a:.1f} to {100 * b:.1f} cm)" for i, (a, b) in enumerate(pairwise(edges))]
    said = []
    untold = learned < _TOLD
    for i in np.flatnonzero(untold):
        said.append(f"{names[i]}: {100 * (1 - learned[i]):.0f} % of its variance is still the prior's")
    strength, directions = np.linalg.eigh(information)
    for value, direction in zip(strength, directions.T, strict=True):
        zones = [i for i in np.flatnonzero(np.abs(direction) >= _LEADING) if not untold[i]]
        if value < _LEAST_INFORMATION and len(zones) > 1:
            listed = ", ".join(str(i + 1) for i in zones)
            said.append(f"the ratio of zones {listed}: told only together")
    return tuple(said)
