"""One piece of tissue, sampled from the measured spread.

It has a surface. The mean tissue is the one that a rig assumes; a worn blade meets one that resists more.
"""

from __future__ import annotations

import dataclasses
import json
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from cutenv._base.arrays import Array, Struct, StructArray
from cutenv._base.validation import array_in_range, check_parameters, in_range, one_of, parameter
from cutenv._engine.jit import njit, njit_inline
from cutenv._engine.randomness import SURFACE, Key, check_key
from cutenv.sim.tissue.description import TissueDescription, checked_fields, measured_liver
from cutenv.sim.tissue.grid import LENGTH, N_POINTS, POINTS_PER_METRE, SPACING, field_modes, lognormal_sigma
from cutenv.sim.tissue.slab import DEPTHS, at_depth, stiffness_along
from cutenv.sim.tissue.specimen_kernels import (
    add_vessels,
    bulge_of,
    is_vascular,
    lognormal,
    sample_all_profiles,
    sampler,
    smooth_field,
    tissue_modes,
)

if TYPE_CHECKING:
    from cutenv.sim.tissue.cut_model import CutModel

__all__ = ["CLASSES", "LENGTH", "N_POINTS", "POINTS_PER_METRE", "SPACING", "SPECIMEN_SCHEMA", "Specimen", "draw_liver"]


CLASSES = ("uniform", "liver", "vascular", "mixed")
SPECIMEN_SCHEMA = "cutenv-specimen/2"


@dataclass(frozen=True, kw_only=True, eq=False)
class Specimen:
    """Slab of tissue along a 15 cm cut from its clamp.

    Parameters
    ----------
    modulus : array, shape (301,)
        Modulus of the material, every 0.5 mm, for ``tissue``'s finite-element model [Pa].  The local effective modulus
        measured at a point is r K/(kappa B): K averages the neighbourhood, and is not proportional to B.
    fracture_resistance : array, shape (301,)
        Fracture resistance, of the measured kind: its share of friction included [J/m2].
    depth : array, shape (301,)
        Depth of cut B, up to ``thickness`` [m].
    thickness : float
        Thickness T of the slab [m].
    friction_per_depth : float
        Friction on the moving blade per depth of cut [N/m].
    inclined_ratio : float
        LEM of this cut at 45 degrees relative to ``tissue``'s, for the same LEM at 90 degrees [1].
    tissue : TissueDescription
        Tissue from which it was sampled; gives speed dependence, friction share and eta90.
    specimen_class : str
        "uniform", "liver" or "vascular".
    """

    modulus: Array
    fracture_resistance: Array
    depth: Array
    thickness: float
    friction_per_depth: float
    tissue: TissueDescription
    inclined_ratio: float = 1.0
    specimen_class: str = "liver"

    def __post_init__(self) -> None:
        one_of("specimen_class", self.specimen_class, CLASSES[:3])
        in_range("friction_per_depth", self.friction_per_depth, 0.0, 1e5, "N/m", "0.4 N/cm is 40.")
        in_range("inclined_ratio", self.inclined_ratio, 0.01, 100.0, "1", "1 is the mean tissue.")
        in_range("thickness", self.thickness, 1e-4, 0.1, "m", "2.5 cm is 0.025.")
        ranges = {
            "modulus": (100.0, 1e9, "Pa", "48.4 kPa is 48400."),
            "fracture_resistance": (1.0, 1e6, "J/m2", "0.211 kJ/m2 is 211."),
            "depth": (1e-4, self.thickness, "m", "A cut is no deeper than the slab is thick; 2 cm is 0.02."),
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
        thickness: float | None = None,
        friction_share: float | None = None,
        tissue: TissueDescription | None = None,
    ) -> Specimen:
        """Make a uniform specimen: modulus [Pa], fracture resistance [J/m2], depth [m].

        By default it has the friction share of ``tissue``, and is cut through: a slice as thick as the cut is deep.
        """
        tissue = tissue or measured_liver()
        if friction_share is not None:
            tissue = dataclasses.replace(tissue, friction_share=friction_share)
        in_range("fracture_resistance", fracture_resistance, 1.0, 1e6, "J/m2", "0.211 kJ/m2 is 211.")
        in_range("depth", depth, 1e-4, 0.1, "m", "2 cm is 0.02.")
        ones = np.ones(N_POINTS)
        return cls(
            modulus=modulus * ones,
            fracture_resistance=fracture_resistance * ones,
            depth=depth * ones,
            thickness=depth if thickness is None else thickness,
            friction_per_depth=tissue.friction_share * fracture_resistance,
            tissue=tissue,
            specimen_class="uniform",
        )

    @classmethod
    def mean(cls, tissue: TissueDescription | None = None) -> Specimen:
        """Make the mean specimen of :meth:`draw`, with a real bulge."""
        tissue = tissue or measured_liver()
        ones = np.ones(N_POINTS)
        return cls(
            modulus=tissue.modulus * ones,
            fracture_resistance=tissue.fracture_resistance * ones,
            depth=bulge_of(tissue),
            thickness=tissue.thickness,
            friction_per_depth=tissue.nominal_friction_per_depth,
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
        """Sample a specimen: liver, cut, and variation along the cut.

        Parameters
        ----------
        rng : numpy.random.Generator
            The only source of randomness; :func:`cutenv._engine.randomness.generator` makes one from a seed and an
            episode.
        specimen_class : {"uniform", "liver", "vascular", "mixed"}
            ``uniform`` has no spread, the mean values of ``tissue`` and its mean depth; ``vascular`` adds 1 or 2 tough
            inclusions; ``mixed`` is ``liver`` or ``vascular``, half each.  ValueError for another one.
        tissue : TissueDescription, optional
            Default: the measured pig liver.
        liver_factor : float, optional
            Factor from :func:`draw_liver`, to sample several cuts of one liver; by default a liver is sampled too.
        """
        _check_generator(rng)
        if liver_factor is not None:
            in_range("liver_factor", liver_factor, 0.01, 100.0, "1", "How much stiffer than the mean: 1.2 is 20 %.")
        seed, episode = rng.integers(2**64, size=2, dtype=np.uint64).tolist()
        return cls.drawn(seed, episode, specimen_class=specimen_class, tissue=tissue, liver_factor=liver_factor)

    @classmethod
    def drawn(
        cls,
        seed: int,
        episode: int = 0,
        *,
        specimen_class: str = "liver",
        tissue: TissueDescription | None = None,
        liver_factor: float | None = None,
    ) -> Specimen:
        """Return a random key's specimen, the same in environments and batches.

        ``seed`` and ``episode``, 0 to 2**64 - 1, are the key of the environment; for the others see :meth:`draw`.
        """
        check_key(seed, episode)
        key = np.uint64(seed), np.uint64(episode)
        tissue = tissue or measured_liver()
        one_of("specimen_class", specimen_class, CLASSES)
        if specimen_class == "uniform":
            return cls.homogeneous(
                modulus=tissue.modulus,
                fracture_resistance=tissue.fracture_resistance,
                depth=tissue.mean_depth,
                thickness=tissue.thickness,
                tissue=tissue,
            )
        if specimen_class == "mixed":
            specimen_class = "vascular" if is_vascular(*key) else "liver"
        profiles = np.empty((2, N_POINTS))
        friction, inclined_ratio = sample_all_profiles(
            key, liver_factor or 0.0, sampler(tissue), tissue_modes(tissue), profiles
        )
        if specimen_class == "vascular":
            add_vessels(key, profiles[1])
        return cls(
            modulus=profiles[0],
            fracture_resistance=profiles[1],
            depth=bulge_of(tissue),
            thickness=tissue.thickness,
            friction_per_depth=friction,
            tissue=tissue,
            inclined_ratio=inclined_ratio,
            specimen_class=specimen_class,
        )

    def cut_model(self) -> CutModel:
        """Return the finite-element model to which the moduli belong."""
        return self.tissue.cut_model()

    def stiffness(self) -> Array:
        """Return K with the tip at each point, (301,) [N/m]."""
        return stiffness_along(self.tissue.slab(), self.modulus, self.depth, self.thickness)

    def loading_ratio(self, speed: float, angle: float) -> float:
        """Return r [1], the force's rise over that without crack growth.

        ``speed`` is in m/s and ``angle`` in rad.  The local effective modulus measured by an exact slope is r K/(kappa
        B).
        """
        modulus = self.tissue.local_effective_modulus(speed, angle, self.inclined_ratio)
        return min(1.0, modulus / self.tissue.intercept_90)

    def fracture_force(self) -> Array:
        """Return R B without R's share of friction, (301,) [N]."""
        return (1.0 - self.tissue.friction_share) * self.fracture_resistance * self.depth

    def to_json(self) -> str:
        """Return JSON text, which :meth:`from_json` reads back exactly."""
        content: dict[str, Any] = {field.name: getattr(self, field.name) for field in dataclasses.fields(self)}
        for name in ("modulus", "fracture_resistance", "depth"):
            content[name] = content[name].tolist()
        content["tissue"] = json.loads(self.tissue.to_json())
        return json.dumps({"schema": SPECIMEN_SCHEMA, **content})

    @classmethod
    def from_json(cls, text: str) -> Specimen:
        """Parse the text of :meth:`to_json`; raise ValueError if invalid."""
        content = checked_fields(text, SPECIMEN_SCHEMA, {field.name for field in dataclasses.fields(cls)})
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
    """Sample a liver's stiffness relative to the mean [1]."""
    _check_generator(rng)
    sigma = lognormal_sigma((tissue or measured_liver()).modulus_between_liver_cv)
    return float(lognormal(float(rng.standard_normal()), sigma))


def _check_generator(rng: np.random.Generator) -> None:
    if not isinstance(rng, np.random.Generator):
        raise TypeError(
            f"rng = {rng!r} must be a numpy.random.Generator; cutenv._engine.randomness.generator(seed) makes one."
        )


_STEPS = len(DEPTHS) - 1

NOMINAL: np.dtype[Any] = np.dtype(
    (
        np.record,
        [
            ("stiffness", "f8", (N_POINTS, _STEPS + 1)),  # K with the tip at each point, by depth of cut [N/m]
            ("thickness", "f8"),  # of the slab, the deepest cut [m]
            ("toughness_per_depth", "f8"),  # fracture part of R [N/m]
            ("friction_per_depth", "f8"),  # on a moving blade [N/m]
        ],
    )
)
"""Structured dtype of the mean tissue."""


@lru_cache(maxsize=8)
def nominal_tissue(tissue: TissueDescription) -> StructArray:
    """Return the :data:`NOMINAL` of a tissue, shape (1,), read-only."""
    nominal = np.zeros(1, NOMINAL)
    nominal["thickness"] = tissue.thickness
    nominal["toughness_per_depth"] = (1.0 - tissue.friction_share) * tissue.fracture_resistance
    nominal["friction_per_depth"] = tissue.nominal_friction_per_depth
    _fill(nominal, tissue.slab(), tissue.modulus, tissue.thickness)
    nominal.setflags(write=False)
    return nominal


@njit
def _fill(nominal: StructArray, slabs: StructArray, modulus: float, thickness: float) -> None:
    stiffness, slab = nominal[0].stiffness, slabs[0]
    for i in range(N_POINTS):
        for k in range(_STEPS + 1):
            effective_depth, _ = at_depth(slab, i, thickness * k / _STEPS, thickness)
            stiffness[i, k] = modulus * slab.kappa[i] * effective_depth


@njit_inline
def nominal_stiffness(nominal: Struct, i: int, depth: float) -> float:
    """Return mean K [N/m] at point ``i`` for ``depth`` [m]."""
    level = min(depth / nominal.thickness, 1.0) * _STEPS
    k = min(int(level), _STEPS - 1)
    stiffness = nominal.stiffness
    low = stiffness[i, k]
    K: float = low + (level - k) * (stiffness[i, k + 1] - low)
    return K


_MIN_DEPTH = 1e-3  # depth of cut at level 0 [m]: that of the mean bulge at the clamp
_FIRST = np.int64(0)  # not a literal, for which Numba would compile the function again


@dataclass(frozen=True, kw_only=True)
class SurfaceSpread:
    """Spread of the surface between slices.

    Without it every slice has the same surface, and a policy could memorise it and ignore the measurement.
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
        """Return modes of surface deviation along a slice, (n_modes, 301)."""
        return field_modes(N_POINTS, SPACING, self.surface_length)

    def of(self, specimen: Specimen, seed: int, episode: int) -> Specimen:
        """Return a specimen with a random surface; uniform ones have none."""
        if self.surface_spread == 0.0 or specimen.specimen_class == "uniform":
            return specimen
        depth = specimen.depth.copy()
        key = np.uint64(seed), np.uint64(episode)
        vary_surface(key, self.surface_spread, specimen.thickness, self.modes(), depth)
        return dataclasses.replace(specimen, depth=depth)


@njit
def vary_surface(key: Key, spread: float, thickness: float, modes: Array, depth: Array) -> None:
    """Vary a slice's ``depth`` of cut at level 0, (301,), within its ``thickness`` [m]."""
    deviation = np.empty(N_POINTS)
    smooth_field(key, SURFACE, _FIRST, modes, deviation)
    for i in range(N_POINTS):
        depth[i] = min(max(depth[i] + spread * deviation[i], min(depth[i], _MIN_DEPTH)), thickness)


@dataclass(frozen=True, kw_only=True)
class BladeWear:
    """Linear rise of R with the length cut: R (1 + ``blade_wear`` (``blade_used`` + y)).

    The thesis used one kind of blade, No. 10 of stainless steel, and tells nothing of its wear or of when it was
    changed.  A blunter edge takes more force to start and to carry on a crack; here both rise alike.
    """

    blade_wear: float = parameter(
        0.0, unit="1/m", low=0.0, high=10.0, provenance="assumed",
        source="off; rise of R for each metre that the blade has cut: nothing measured it", sensitivity=(0.0, 1.0),
    )  # fmt: skip
    blade_used: float = parameter(
        0.0, unit="m", low=0.0, high=100.0, provenance="choice",
        source="a new blade; length that it has cut before",
    )  # fmt: skip

    def __post_init__(self) -> None:
        check_parameters(self)

    def factors(self) -> Array:
        """Return fracture resistance over a new blade's, shape (301,) [1]."""
        return np.asarray(1.0 + self.blade_wear * (self.blade_used + SPACING * np.arange(N_POINTS)))

    def of(self, specimen: Specimen) -> Specimen:
        """Return the specimen as this blade meets it; itself without wear."""
        if self.blade_wear == 0.0:
            return specimen
        return dataclasses.replace(specimen, fracture_resistance=specimen.fracture_resistance * self.factors())
