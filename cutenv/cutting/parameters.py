"""Constants of the cutting law that do not depend on the specimen, and the structured arrays made from specimens."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np

from cutenv._base.arrays import StructArray
from cutenv._base.validation import check_parameters, parameter
from cutenv.cutting.dtypes import LAW, PROFILE
from cutenv.tissue.crack_tip import PRESLIDING
from cutenv.tissue.effective_modulus import end_of_fall
from cutenv.tissue.specimen import Specimen


@dataclass(frozen=True, kw_only=True)
class LawParameters:
    """Constants of :mod:`cutenv.cutting.law`; those of the tissue are in ``TissueDescription``."""

    debt_length: float = parameter(
        1.5e-3, unit="m", low=1e-5, high=0.02, provenance="assumed",
        source="growth below R may borrow the fracture energy of this length, no more", sensitivity=(0.5e-3, 3e-3),
    )  # fmt: skip
    growth_step: float = parameter(
        10e-6, unit="m", low=1e-7, high=1e-3, provenance="choice", source="far below a unit of 2 to 12 mm"
    )
    friction_per_depth_speed: float = parameter(
        0.0, unit="N s/m2", low=0.0, high=1e5, provenance="assumed", source="off: no measurement separates it"
    )

    presliding_length: float = parameter(
        PRESLIDING, unit="m", low=1e-6, high=1e-3, provenance="assumed",
        source="well below strokes and lags of millimetres, above the 25 um of a millisecond at full speed",
        sensitivity=(20e-6, 100e-6),
    )  # fmt: skip

    relaxing_share: float = parameter(
        0.0, unit="1", low=0.0, high=0.9, provenance="assumed",
        source="off: the measured moduli fall with speed, those of a relaxing tissue rise", sensitivity=(0.2, 0.6),
    )  # fmt: skip
    creep_time: float = parameter(
        1.86, unit="s", low=0.1, high=1e3, provenance="measured",
        source="Kerdok et al. (J. Biomech. 39, 2221, 2006): creep of whole porcine livers, 1.86 and 51.3 s",
        sensitivity=(1.86, 51.3),
    )  # fmt: skip

    def __post_init__(self) -> None:
        check_parameters(self)


def profile_records(specimens: list[Specimen]) -> StructArray:
    """Return stiffness, toughness and depth along each specimen as a :data:`PROFILE` array, shape (n,)."""
    profiles = np.zeros(len(specimens), PROFILE)
    for profile, specimen in zip(profiles, specimens, strict=True):
        profile["stiffness"] = specimen.stiffness()
        profile["toughness"] = specimen.fracture_force()
        profile["depth"] = specimen.depth
    return profiles


def law_records(specimens: list[Specimen], parameters: LawParameters | None = None) -> StructArray:
    """Return the law's constants for each specimen as a :data:`LAW` array, shape (n,)."""
    parameters = parameters or LawParameters()
    laws = np.zeros(len(specimens), LAW)
    for law, specimen in zip(laws, specimens, strict=True):
        tissue = specimen.tissue
        law["quasi_static_modulus"] = tissue.intercept_90
        for name in ("intercept_90", "speed_min", "speed_max", "eta90"):
            law[name] = getattr(tissue, name)
        if not tissue.falls_90:
            law["slope_90"] = tissue.slope_90
        for number, (share, start, end) in enumerate(tissue.falls_90, start=1):
            law[f"fall_{number}"] = -tissue.slope_90 * end_of_fall(tissue.falls_90) * share
            law[f"fall_{number}_from"], law[f"fall_{number}_per"] = start, 1.0 / (end - start)
        for name in ("intercept_45", "slope_45"):
            law[name] = specimen.inclined_ratio * getattr(tissue, name)
        law["friction_per_depth"] = specimen.friction_per_depth
        for field in dataclasses.fields(parameters):
            law[field.name] = getattr(parameters, field.name)
        law["per_presliding_length"] = 1.0 / parameters.presliding_length
    return laws
