"""One piece of tissue, drawn from the measured spread: what stands along the cut line."""

from __future__ import annotations

import dataclasses
import json
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cutenv.tissue.cut_model import CutModel
from cutenv.tissue.description import TissueDescription, checked_fields, measured_liver
from cutenv.tissue.field import field_modes, lognormal_sigma
from cutenv.tissue.thickness import bulge
from cutenv.validation import array_in_range, in_range, one_of

LENGTH = 0.15
"""Length of a specimen [m]."""

# Linear interpolation between points errs by less than 0.1 % of K at the shortest correlation length admitted (15 mm),
# and a specimen's profile fits into 7 kB, inside a first-level cache.
SPACING = 0.5e-3
"""Distance between the points of a specimen's profiles [m]."""

N_POINTS = round(LENGTH / SPACING) + 1
CLASSES = ("uniform", "liver", "vascular", "mixed")
SCHEMA = "cutenv-specimen/1"

_STEEPEST = 0.5  # of K'(x - a)/K at initiation: beyond, the point load no longer averages a smooth neighbourhood
_ATTEMPTS = 1000
_INCLUSION_EDGE = 0.25e-3  # [m], width of the transition at either end of an inclusion
_INCLUSION_FACTOR = (1.5, 2.5)
_INCLUSION_LENGTH = (0.002, 0.005)  # [m]
_INCLUSION_PLACE = (0.015, 0.095)  # [m], where cuts of 60 to 100 mm can meet it

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Specimen:
    """A slice of tissue along its cut line, from the clamp (0) to the free end (15 cm).

    Parameters
    ----------
    modulus : array, shape (301,)
        Local effective modulus at v -> 0 and 90 degrees, of ``tissue``'s finite-element model, every 0.5 mm [Pa].
    fracture_resistance : array, shape (301,)
        Measured kind of resistance, its share of friction included [J/m2].
    depth : array, shape (301,)
        Depth of cut B [m].
    friction_per_depth : float
        Friction on the moving blade per depth of cut [N/m].
    tissue : TissueDescription
        What it was drawn from; gives speed dependence, friction share and eta90.
    specimen_class : str
        "uniform", "liver" or "vascular".
    """

    modulus: Array
    fracture_resistance: Array
    depth: Array
    friction_per_depth: float
    tissue: TissueDescription
    specimen_class: str = "liver"

    def __post_init__(self) -> None:
        one_of("specimen_class", self.specimen_class, CLASSES[:3])
        in_range("friction_per_depth", self.friction_per_depth, 0.0, 1e5, "N/m", "0.4 N/cm is 40.")
        ranges = {
            "modulus": (100.0, 1e9, "Pa", "48.4 kPa is 48400."),
            "fracture_resistance": (1.0, 1e6, "J/m2", "0.211 kJ/m2 is 211."),
            "depth": (1e-4, 0.1, "m", "2 cm is 0.02."),
        }
        for name, (low, high, unit, cure) in ranges.items():
            values = array_in_range(name, getattr(self, name), low, high, unit, cure).copy()
            if values.shape != (N_POINTS,):
                raise ValueError(f"{name} has shape {values.shape}; give {N_POINTS} values, one every {SPACING} m.")
            values.setflags(write=False)
            object.__setattr__(self, name, values)

    @classmethod
    def homogeneous(
        cls,
        *,
        modulus: float,
        fracture_resistance: float,
        depth: float,
        friction_share: float | None = None,
        tissue: TissueDescription | None = None,
    ) -> Specimen:
        """The same everywhere: modulus [Pa], fracture resistance [J/m2], depth [m]; friction share of ``tissue``."""
        tissue = tissue or measured_liver()
        if friction_share is not None:
            tissue = dataclasses.replace(tissue, friction_share=friction_share)
        in_range("fracture_resistance", fracture_resistance, 1.0, 1e6, "J/m2", "0.211 kJ/m2 is 211.")
        ones = np.ones(N_POINTS)
        return cls(
            modulus=modulus * ones,
            fracture_resistance=fracture_resistance * ones,
            depth=depth * ones,
            friction_per_depth=tissue.friction_share * fracture_resistance,
            tissue=tissue,
            specimen_class="uniform",
        )

    @classmethod
    def mean(cls, tissue: TissueDescription | None = None) -> Specimen:
        """The mean of the livers that :meth:`draw` gives: no spread, but the bulge of a real slice."""
        tissue = tissue or measured_liver()
        resistance = tissue.fracture_resistance * tissue.fracture_scale
        ones = np.ones(N_POINTS)
        return cls(
            modulus=tissue.intercept_90 * tissue.modulus_scale * ones,
            fracture_resistance=resistance * ones,
            depth=_bulge_of(tissue),
            friction_per_depth=tissue.friction_share * resistance,
            tissue=tissue,
        )

    @classmethod
    def draw(
        cls,
        rng: np.random.Generator,
        *,
        specimen_class: str = "liver",
        tissue: TissueDescription | None = None,
        liver_factor: float | None = None,
    ) -> Specimen:
        """Draw a specimen: a liver, a cut within it, and the places along the cut.

        Parameters
        ----------
        rng : numpy.random.Generator
            The only source of chance; :func:`cutenv.randomness.generator` makes one from a seed and an episode.
        specimen_class : {"uniform", "liver", "vascular", "mixed"}
            ``uniform`` has no spread, the mean values of ``tissue`` and its mean depth; ``vascular`` adds 1 or 2 tough
            inclusions; ``mixed`` is ``liver`` or ``vascular``, half each.
        tissue : TissueDescription, optional
            Default: the measured pig liver.
        liver_factor : float, optional
            Of :func:`draw_liver`, to draw several cuts of one liver; else a liver is drawn too.

        Raises
        ------
        ValueError
            If the class is unknown, or the tissue is so uneven that no smooth enough specimen is found.
        """
        _check_generator(rng)
        tissue = tissue or measured_liver()
        one_of("specimen_class", specimen_class, CLASSES)
        if specimen_class == "uniform":
            return cls.homogeneous(
                modulus=tissue.intercept_90,
                fracture_resistance=tissue.fracture_resistance,
                depth=tissue.mean_depth,
                tissue=tissue,
            )
        if specimen_class == "mixed":
            specimen_class = "vascular" if rng.random() < 0.5 else "liver"
        for _ in range(_ATTEMPTS):
            specimen = cls._draw_once(rng, specimen_class, tissue, liver_factor)
            if specimen.steepness() <= _STEEPEST:
                return specimen
        raise ValueError(
            f"no specimen of {tissue.name!r} in {_ATTEMPTS} draws has K'(x - a)/K below {_STEEPEST}: "
            "reduce the within-cut spread or the fracture resistance, or lengthen the correlation or the rise."
        )

    @classmethod
    def _draw_once(
        cls, rng: np.random.Generator, specimen_class: str, tissue: TissueDescription, liver_factor: float | None
    ) -> Specimen:
        factor = draw_liver(rng, tissue) if liver_factor is None else liver_factor
        modulus = (
            tissue.intercept_90
            * tissue.modulus_scale
            * factor
            * _lognormal(rng.standard_normal(), tissue.modulus_between_cut_cv)
            * _lognormal(_smooth_field(rng, tissue), tissue.modulus_within_cut_cv)
        )
        mean_resistance = (
            tissue.fracture_resistance
            * tissue.fracture_scale
            * _lognormal(rng.standard_normal(), tissue.fracture_between_cut_cv)
        )
        resistance = mean_resistance * _lognormal(_smooth_field(rng, tissue), tissue.fracture_within_cut_cv)
        if specimen_class == "vascular":
            resistance = resistance * _inclusions(rng)
        return cls(
            modulus=modulus,
            fracture_resistance=resistance,
            depth=_bulge_of(tissue),
            friction_per_depth=float(tissue.friction_share * mean_resistance),
            tissue=tissue,
            specimen_class=specimen_class,
        )

    def cut_model(self) -> CutModel:
        """The finite-element model to which the moduli belong."""
        return self.tissue.cut_model()

    def stiffness(self) -> Array:
        """K = E0 kappa B at each point, shape (301,) [N/m]."""
        return self.modulus * unit_stiffness(self.tissue) * self.depth

    def fracture_force(self) -> Array:
        """R B at each point, R without its share of friction, shape (301,) [N]."""
        return (1.0 - self.tissue.friction_share) * self.fracture_resistance * self.depth

    def steepness(self) -> float:
        """Largest K'(x - a)/K along the line when the force initiates growth at 90 degrees [1]."""
        K = self.stiffness()
        lag = (1.0 + self.tissue.eta90) * self.fracture_force() / K
        return float(np.max(np.gradient(K, SPACING) * lag / K))

    def to_json(self) -> str:
        """JSON text, read back exactly by :meth:`from_json`."""
        content: dict[str, Any] = {field.name: getattr(self, field.name) for field in dataclasses.fields(self)}
        for name in ("modulus", "fracture_resistance", "depth"):
            content[name] = content[name].tolist()
        content["tissue"] = json.loads(self.tissue.to_json())
        return json.dumps({"schema": SCHEMA, **content})

    @classmethod
    def from_json(cls, text: str) -> Specimen:
        """Read :meth:`to_json`'s text; ValueError for another schema, unknown or missing fields, bad values."""
        content = checked_fields(text, SCHEMA, {field.name for field in dataclasses.fields(cls)})
        content["tissue"] = TissueDescription.from_json(json.dumps(content["tissue"]))
        return cls(**content)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Specimen):
            return NotImplemented
        mine, theirs = (
            [getattr(specimen, field.name) for field in dataclasses.fields(self)] for specimen in (self, other)
        )
        return all(np.array_equal(a, b) for a, b in zip(mine, theirs, strict=True))

    __hash__ = None  # type: ignore[assignment]


def draw_liver(rng: np.random.Generator, tissue: TissueDescription | None = None) -> float:
    """How much stiffer than the mean one liver is [1]."""
    _check_generator(rng)
    return float(_lognormal(rng.standard_normal(), (tissue or measured_liver()).modulus_between_liver_cv))


def _check_generator(rng: np.random.Generator) -> None:
    if not isinstance(rng, np.random.Generator):
        raise TypeError(f"rng = {rng!r} must be a numpy.random.Generator; cutenv.randomness.generator(seed) makes one.")


@lru_cache(maxsize=8)
def unit_stiffness(tissue: TissueDescription) -> Array:
    """Kappa at each point of a specimen, shape (301,) [1]."""
    kappa: Array = np.asarray(tissue.cut_model().stiffness(np.arange(N_POINTS) * SPACING))
    kappa.setflags(write=False)
    return kappa


@lru_cache(maxsize=8)
def _bulge_of(tissue: TissueDescription) -> Array:
    return bulge(
        np.arange(N_POINTS) * SPACING,
        edge=tissue.edge_depth,
        crown=tissue.crown_depth,
        rise_length=tissue.rise_length,
        length=LENGTH,
    )


def _smooth_field(rng: np.random.Generator, tissue: TissueDescription) -> Array:
    modes = field_modes(N_POINTS, SPACING, tissue.correlation_length)
    return modes @ rng.standard_normal(modes.shape[1])


def _lognormal(normal: Any, cv: float) -> Any:
    """Lognormal number(s) of mean 1 and coefficient of variation ``cv`` from standard normal ones."""
    sigma = lognormal_sigma(cv)
    return np.exp(sigma * normal - 0.5 * sigma**2)


def _inclusions(rng: np.random.Generator) -> Array:
    """Factor on the fracture resistance of 1 or 2 tough inclusions (vessels), shape (301,)."""
    y = np.arange(N_POINTS) * SPACING
    factor = np.ones(N_POINTS)
    for _ in range(int(rng.integers(1, 3))):
        length = rng.uniform(*_INCLUSION_LENGTH)
        centre = rng.uniform(*_INCLUSION_PLACE)
        inside = 0.5 * (
            np.tanh((y - centre + 0.5 * length) / _INCLUSION_EDGE)
            - np.tanh((y - centre - 0.5 * length) / _INCLUSION_EDGE)
        )
        factor = np.maximum(factor, 1.0 + (rng.uniform(*_INCLUSION_FACTOR) - 1.0) * inside)
    return factor
