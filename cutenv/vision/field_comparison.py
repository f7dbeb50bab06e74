"""Beads against the model (thesis, section 7.3).

Displacements are compared, and moduli of zones, by force too; what is unknown is named. The modulus of the tissue of
one cut is measured twice: by force and blade, and by force and beads.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import least_squares
from scipy.stats import norm
from scipy.stats import t as student

from cutenv._base.arrays import Array, Indices
from cutenv._base.validation import array_in_range, in_range, one_of
from cutenv.records.measurement import DepthProfile, ModulusEstimate, estimate_local_effective_moduli
from cutenv.sim.tissue.cut_model import CutModel
from cutenv.sim.tissue.slab import effective_depth, zoned_model
from cutenv.sim.trace import Trace
from cutenv.vision.bead_tracks import BeadRises, BeadTracks, RampLoad, bead_rises


@dataclass(frozen=True, kw_only=True, eq=False)
class SlabModel:
    """Finite-element model of one slab, with its depth of cut.

    Raises ValueError if the thickness is out of range.
    """

    model: CutModel  # elements, formulation, size and lines; of a uniform modulus
    depth: DepthProfile  # depth of cut along the line
    # thickness of the slab [m], 0.1 mm to 0.5 m. By default the slab is cut through: everywhere as thick as the cut is
    # deep. Bricks have the thickness of the model
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
        """Return a `zoned_model` with a modulus for each zone [Pa].

        Its methods take modulus 1.
        """
        return zoned_model(self.model, borders, moduli, depth=self.depth.at if self._cut_through else None)

    def stiffness(self, zoned: CutModel, tip: Array) -> Array:
        """Return blade force over tip displacement [N/m], shaped like ``tip`` [m]."""
        a = np.clip(tip, 0.0, zoned.length)
        if self._cut_through or zoned.dim == 3:
            return np.asarray(zoned.stiffness(a)) * self._thickness
        return np.asarray(zoned.stiffness(a)) * effective_depth(a, self.depth.at(a), self._thickness)

    def rise_by_force(self, zoned: CutModel, points: Array, load: RampLoad) -> Array:
        """Return points' displacement [m], shape (n, dim), by a ramp's force."""
        start, end = (
            zoned.displacement_at(points, self._inside(a), force=f, modulus=1.0, thickness=self._thickness)
            for a, f in zip(load.tip, load.force, strict=True)
        )
        return end - start

    def rise_by_displacement(self, zoned: CutModel, points: Array, load: RampLoad) -> Array:
        """Return points' displacement by the tip's, for ratios of moduli."""
        start, end = (
            zoned.displacement_at(points, self._inside(a), tip_displacement=u)
            for a, u in zip(load.tip, load.displacement, strict=True)
        )
        return end - start

    def _inside(self, tip: float) -> float:
        return min(max(float(tip), 0.0), self.model.length)

    def contains(self, places: Array) -> NDArray[np.bool_]:
        """Return a mask of places [m], shape (n, 3), inside the model.

        Plane models ignore height.
        """
        nodes, points = self.model.nodes, places[:, : self.model.dim]
        return np.asarray(((points >= nodes.min(axis=0)) & (points <= nodes.max(axis=0))).all(axis=1))


MODEL_ERROR = 0.03  # error of the model as a share of a displacement, or of a stiffness [1]

_LEVEL = 0.95
_LEAST_SD = 1e-6  # of a displacement [m]
_FEWEST_BEADS = 3  # for a modulus of one ramp
_CLEAR = 3.0  # standard errors by which a compliance must differ from zero
_FIRST_TIP = 0.01  # [m] from the clamp: nearer to it the field of a force is too small to tell a modulus


@dataclass(frozen=True, eq=False)
class ImageModuli:
    """Moduli by beads of one cut; arrays of shape (n_ramps,)."""

    ramp: Indices
    position: Array  # tip [m]
    modulus: Array  # of the material [Pa], with which the ramp's force moves the model as the beads moved
    standard_error: Array  # its standard error [Pa], from the scatter of the beads


@dataclass(frozen=True, kw_only=True)
class MeanModulus:
    """Mean modulus of a cut with its 95 % interval [Pa]."""

    mean: float
    low: float
    high: float
    ramps: int

    @classmethod
    def of(cls, moduli: ArrayLike) -> MeanModulus:
        """Return mean and interval of moduli [Pa], (0, inf) for one."""
        E = np.asarray(moduli, dtype=np.float64)
        mean = float(E.mean())
        if len(E) < 2:
            return cls(mean=mean, low=0.0, high=float("inf"), ramps=len(E))
        half = float(student.ppf(0.5 + _LEVEL / 2, len(E) - 1) * E.std(ddof=1) / np.sqrt(len(E)))
        return cls(mean=mean, low=mean - half, high=mean + half, ramps=len(E))


@dataclass(frozen=True, kw_only=True, eq=False)
class FilmedMeasurement:
    """One cut, measured by its force and by its beads.

    Attributes
    ----------
    slab : SlabModel
        Model of the slab.
    moduli : ModulusEstimate
        Local effective moduli by the force.
    rises : BeadRises
        Displacements of the beads inside the model.
    """

    slab: SlabModel
    moduli: ModulusEstimate
    rises: BeadRises

    @property
    def tips(self) -> Array:
        """Tip at each ramp, its mean [m], shape (n_ramps,)."""
        return np.array([load.tip.mean() for load in self.rises.ramps])

    @property
    def by_force(self) -> Array:
        """Material modulus at each ramp by blade force [Pa], shape (n_ramps,).

        That is the LEM over its loading ratio, and in a slab that is not cut through over the effect of the rest.
        """
        stiffness = np.array([load.stiffness for load in self.rises.ramps])
        return np.asarray(stiffness / self.slab.stiffness(self.slab.zoned([], [1.0]), self.tips))

    def by_image(self) -> ImageModuli:
        """Return the modulus at each ramp by beads and force.

        Generalised least squares: the displacement by the ramp's force at unit modulus, over the modulus. Ramps with
        the tip within 1 cm of the clamp, with fewer than 3 beads, or whose beads do not clearly move, are left out.

        Raises
        ------
        ValueError
            If no ramp is left.
        """
        unit, dim = self.slab.zoned([], [1.0]), self.slab.model.dim
        found = []
        for number, load in enumerate(self.rises.ramps):
            own = self.rises.ramp == number
            if own.sum() < _FEWEST_BEADS or load.tip.mean() < _FIRST_TIP:
                continue
            computed = self.slab.rise_by_force(unit, self.rises.place[own][:, :dim], load)
            root = np.linalg.cholesky(weights_of(self.rises, dim)[own])
            g, d = (np.einsum("nji,nj->ni", root, u).ravel() for u in (computed, self.rises.rise[own][:, :dim]))
            compliance = float(g @ d / (g @ g))  # 1 / E
            scatter = float(((d - compliance * g) ** 2).sum()) / (len(g) - 1)
            doubt = float(np.sqrt(max(scatter, 1.0) / (g @ g)))
            if compliance > _CLEAR * doubt:
                found.append((number, load.tip.mean(), 1.0 / compliance, doubt / compliance**2))
        if not found:
            raise ValueError(
                "no ramp tells a modulus by its beads: 3 of them must be seen to move, the tip 1 cm from the clamp."
            )
        return ImageModuli(*map(np.array, zip(*found, strict=True)))


def weights_of(rises: BeadRises, dim: int) -> Array:
    """Return inverse covariances with model error [1/m2], (n, dim, dim).

    A mesh is wrong by a few per cent of a displacement, most next to the blade: 3 % of the row's are added, so that
    many frames of a bead there do not outweigh all others.
    """
    own = rises.covariance[:, :dim, :dim]
    model = (MODEL_ERROR * np.linalg.norm(rises.rise[:, :dim], axis=1)) ** 2 + _LEAST_SD**2
    return np.asarray(np.linalg.inv(own + model[:, np.newaxis, np.newaxis] * np.eye(dim)))


def zones_as_measured(moduli: ModulusEstimate) -> tuple[Array, Array]:
    """Return zones' borders [m] and moduli [Pa], one per loading segment.

    The thesis partitioned its model so. Segments of nearly one place, closer than 1 mm, make one zone.
    """
    order = np.argsort(moduli.position)
    place, modulus = moduli.position[order], moduli.modulus[order]
    zone = np.concatenate(([0], np.cumsum(np.diff(place) > 1e-3)))
    n = np.bincount(zone)
    place, modulus = np.bincount(zone, place) / n, np.bincount(zone, modulus) / n
    return 0.5 * (place[1:] + place[:-1]), modulus


def measure_filmed_cut(
    tracks: BeadTracks, trace: Trace, model: CutModel, *, thickness: float | None = None
) -> FilmedMeasurement:
    """Measure one cut by its force and by its beads.

    Parameters
    ----------
    tracks : BeadTracks
        Tracks on the clock of the record.
    trace : Trace
        Record of the same cut, with position, angle and depth; force in newtons.
    model : CutModel
        Model to which the moduli shall belong, of a uniform modulus.
    thickness : float, optional
        Thickness of the slab [m]; by default it is cut through.

    Raises
    ------
    ValueError
        If the record lacks what is needed, the times do not overlap, or no bead was seen inside the model.
    """
    by = "measure_filmed_cut"
    trace.require_newtons(by=by)
    trace.require("position", "depth", by=by)
    slab = SlabModel(model=model, depth=DepthProfile.recorded(trace, by=by), thickness=thickness)
    moduli = estimate_local_effective_moduli(trace, model)
    rises = bead_rises(tracks, trace, moduli)
    inside = slab.contains(rises.place)
    outside = np.unique(rises.bead[np.logical_not(inside)])
    if not inside.any():
        raise ValueError(
            f"all {len(outside)} beads lie outside the model, {model.width:g} m wide and {model.length:g} m long: "
            "places are in metres, x from the cut line, y from the clamp."
        )
    flags = [f"{len(outside)} beads lie outside the model and are left out"] if len(outside) else []
    return FilmedMeasurement(slab=slab, moduli=moduli, rises=rises.select(inside, *flags))


NEAR = 0.02  # distance from the cut line up to which a bead counts as near [m]

_LEAST_CORRELATION = 0.5


@dataclass(frozen=True)
class BeadRow:
    """One bead, as in Table 7.1.

    Means over the ramps; lengths in metres.
    """

    bead: int
    across: float  # place before the cut: from the cut line, and from the clamp [m]
    along: float
    ramps: int  # number of ramps in which it was seen
    computed: float  # mean size of its displacement by the model, and as tracked [m]
    measured: float
    rms: float  # root mean square of the difference of both, as vectors [m]


@dataclass(frozen=True, kw_only=True, eq=False)
class FieldComparison:
    """Displacements of beads, tracked and computed.

    There is one row for each bead in each ramp.

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
        """Mask of rows with beads within :data:`NEAR` of the line."""
        return np.asarray(np.abs(self.rises.place[:, 0]) <= NEAR)

    @property
    def far(self) -> NDArray[np.bool_]:
        """Mask of the other rows."""
        return ~self.near

    def rms(self, rows: NDArray[np.bool_] | None = None) -> float:
        """Return the root mean square vector difference [m], nan without rows."""
        difference = (self.computed - self.measured)[slice(None) if rows is None else rows]
        return float(np.sqrt((difference**2).sum(axis=1).mean())) if len(difference) else float("nan")

    @property
    def noise(self) -> float:
        """Part of the RMS that the tracks' own covariance explains [m]."""
        dim = self.measured.shape[1]
        return float(np.sqrt(np.trace(self.rises.covariance[:, :dim, :dim], axis1=1, axis2=2).mean()))

    @property
    def slope(self) -> float:
        """Slope of measured over computed displacement through the origin [1]."""
        squares = float((self.computed**2).sum())
        return float((self.computed * self.measured).sum()) / squares if squares > 0.0 else float("nan")

    @property
    def correlation(self) -> float:
        """Correlation of measured and computed displacement [1], 0 without motion."""
        if np.ptp(self.computed) == 0.0 or np.ptp(self.measured) == 0.0:
            return 0.0
        return float(np.corrcoef(self.computed.ravel(), self.measured.ravel())[0, 1])

    def table(self, ramp: int | None = None) -> list[BeadRow]:
        """Return rows by bead, of one ramp or averaged (thesis, Table 7.1)."""
        rows = []
        for bead in np.unique(self.rises.bead):
            own = self.rises.bead == bead
            if ramp is not None:
                own &= self.rises.ramp == ramp
            if not own.any():
                continue
            across, along = self.rises.place[own][0, :2]
            computed, measured = (np.linalg.norm(u[own], axis=1).mean() for u in (self.computed, self.measured))
            place, size = (float(across), float(along)), (float(computed), float(measured))
            rows.append(BeadRow(int(bead), *place, int(own.sum()), *size, self.rms(own)))
        return rows


def compare_field(measured: FilmedMeasurement, borders: ArrayLike = (), moduli: ArrayLike = (1.0,)) -> FieldComparison:
    """Compare beads with the model, driven by the tip's displacement.

    Parameters
    ----------
    measured : FilmedMeasurement
        Cut, see :func:`~cutenv.vision.field_comparison.measure_filmed_cut`.
    borders, moduli : array_like
        Zones along the cut, see `cutenv.sim.tissue.slab`; only the ratios of the moduli count. By default
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
    """Compare bead displacements with the model's by ramp (thesis, Table 7.1).

    Parameters
    ----------
    tracks, trace, model, thickness
        See :func:`measure_filmed_cut`.
    zones : tuple of array_like
        Borders and moduli of zones along the cut, as `zones_as_measured` returns them; by default one zone.

    Raises
    ------
    ValueError
        See :func:`measure_filmed_cut`.
    """
    return compare_field(measure_filmed_cut(tracks, trace, model, thickness=thickness), *zones)


PRIOR_SD = 0.5
"""Default standard deviation of the prior of log E: liver varies by 0.2 to 0.5 of its modulus along a cut."""

_MIN_VARIANCE_REMOVED = (
    0.75  # share of a zone's prior variance that the data must remove for its modulus to count as measured
)
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
    """Return borders of equal zones up to the last tip [m].

    Borders are on edges of the model's elements. The last zone reaches on to the free end.

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
    """Estimate moduli of zones from bead displacements and blade stiffness.

    Least squares for the logarithms of the moduli: every bead's displacement in every ramp against that by the ramp's
    force, every ramp's force over displacement against that of the model, and a prior. All zones count for every ramp,
    because the model is that of the whole slab.

    Parameters
    ----------
    measured : FilmedMeasurement
        The cut, see :func:`~cutenv.vision.field_comparison.measure_filmed_cut`.
    borders : array_like of shape (k - 1,)
        Borders between the zones [m], see :func:`even_borders`.
    prior : array_like, optional
        Expected modulus of each zone, or one for all [Pa]. By default the mean by force.
    prior_sd : float
        Standard deviation of log E about the prior [1], 0.01 to 5.
    data : {"both", "beads", "force"}
        Data that are used; to see what each tells alone.

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
    """Residuals in standard deviations as a function of the moduli [Pa]."""

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
    """Return in words the zones that the data cannot determine."""
    edges = np.concatenate(([0.0], borders, [length]))
    names = [f"zone {i + 1} ({100 * a:.1f} to {100 * b:.1f} cm)" for i, (a, b) in enumerate(pairwise(edges))]
    said = []
    unmeasured = learned < _MIN_VARIANCE_REMOVED
    for i in np.flatnonzero(unmeasured):
        said.append(f"{names[i]}: {100 * (1 - learned[i]):.0f} % of its variance is still the prior's")
    strength, directions = np.linalg.eigh(information)
    for value, direction in zip(strength, directions.T, strict=True):
        zones = [i for i in np.flatnonzero(np.abs(direction) >= _LEADING) if not unmeasured[i]]
        if value < _LEAST_INFORMATION and len(zones) > 1:
            listed = ", ".join(str(i + 1) for i in zones)
            said.append(f"the ratio of zones {listed}: told only together")
    return tuple(said)
