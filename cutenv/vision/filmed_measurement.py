"""Modulus of the tissue of one cut, measured twice: by force and blade, and by force and beads."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.stats import t as student

from cutenv._base.arrays import Array, Indices
from cutenv._base.validation import in_range
from cutenv.measurement import DepthProfile, ModulusEstimate, estimate_local_effective_moduli
from cutenv.tissue.cut_model import CutModel
from cutenv.tissue.slab import effective_depth
from cutenv.tissue.varying_modulus import zoned_model
from cutenv.trace import Trace
from cutenv.vision.bead_tracks import BeadRises, BeadTracks, RampLoad, bead_rises


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


MODEL_ERROR = 0.03
"""Error of the model as a share of a displacement, or of a stiffness [1]."""

_LEVEL = 0.95
_LEAST_SD = 1e-6  # of a displacement [m]
_FEWEST_BEADS = 3  # for a modulus of one ramp
_CLEAR = 3.0  # standard errors by which a compliance must differ from zero
_FIRST_TIP = 0.01  # [m] from the clamp: nearer to it the field of a force is too small to tell a modulus


@dataclass(frozen=True, kw_only=True, eq=False)
class ImageModuli:
    """Moduli by beads of one cut; arrays of shape (n_ramps,).

    Attributes
    ----------
    ramp : ndarray of int64
        Number of the ramp.
    position : ndarray
        Tip [m].
    modulus : ndarray
        Modulus of the material [Pa] with which the ramp's force moves the model's points as the beads moved.
    standard_error : ndarray
        Its standard error [Pa], from the scatter of the beads.
    """

    ramp: Indices
    position: Array
    modulus: Array
    standard_error: Array


@dataclass(frozen=True, kw_only=True)
class MeanModulus:
    """Mean modulus of a cut [Pa], its 95 % interval by the scatter of its ramps, and their number."""

    mean: float
    low: float
    high: float
    ramps: int

    @classmethod
    def of(cls, moduli: ArrayLike) -> MeanModulus:
        """Return mean and interval of moduli [Pa]; an interval needs two, and is (0, inf) for one."""
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
        """Modulus of the material at each ramp, from force and motion of the blade [Pa], shape (n_ramps,).

        That is the LEM over its loading ratio, and in a slab that is not cut through over the effect of the rest.
        """
        stiffness = np.array([load.stiffness for load in self.rises.ramps])
        return np.asarray(stiffness / self.slab.stiffness(self.slab.zoned([], [1.0]), self.tips))

    def by_image(self) -> ImageModuli:
        """Return the modulus at each ramp, from force and motion of the beads and the place of the tip.

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
        ramp, position, modulus, error = (np.array(values) for values in zip(*found, strict=True))
        return ImageModuli(ramp=ramp, position=position, modulus=modulus, standard_error=error)


def weights_of(rises: BeadRises, dim: int) -> Array:
    """Return the inverse covariance of each row, shape (n, dim, dim) [1/m2], with the model's own error.

    A mesh is wrong by a few per cent of a displacement, most next to the blade: 3 % of the row's are added, so that
    many frames of a bead there do not outweigh all others.
    """
    own = rises.covariance[:, :dim, :dim]
    model = (MODEL_ERROR * np.linalg.norm(rises.rise[:, :dim], axis=1)) ** 2 + _LEAST_SD**2
    return np.asarray(np.linalg.inv(own + model[:, np.newaxis, np.newaxis] * np.eye(dim)))


def zones_as_measured(moduli: ModulusEstimate) -> tuple[Array, Array]:
    """Return borders [m] and moduli [Pa] of zones, one for each loading segment, as the thesis partitioned its model.

    Segments of nearly one place, closer than 1 mm, make one zone.
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

    Returns
    -------
    FilmedMeasurement

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
