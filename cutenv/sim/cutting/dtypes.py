"""Structured dtypes that the compiled law reads, and what fills them.

Every field is in SI and radians. Constants of the law that do not depend on the specimen, and arrays made from
specimens, are of these dtypes.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

import numpy as np

from cutenv._base.arrays import StructArray
from cutenv._base.validation import check_parameters, parameter
from cutenv.sim.cutting.law import leaning
from cutenv.sim.tissue.crack_tip import PRESLIDING
from cutenv.sim.tissue.effective_modulus import end_of_fall
from cutenv.sim.tissue.specimen import N_POINTS, Specimen

TICK = 1e-3  # duration of one force update [s] (1 kHz)


def _struct(*fields: tuple[str, str] | tuple[str, str, tuple[int, ...]]) -> np.dtype[Any]:
    return np.dtype((np.record, list(fields)))


PROFILE = _struct(*((name, "f8", (N_POINTS,)) for name in ("stiffness", "toughness", "depth")))
"""Along the cut line: K of the slab [N/m] (:meth:`Specimen.stiffness`); fracture part of R times B [N]; depth B [m]."""

LAW = _struct(
    ("quasi_static_modulus", "f8"),  # LEM for v -> 0 at 90 degrees [Pa]: LEMs enter only as ratios to it
    ("intercept_90", "f8"),  # LEM(v, 90 deg) = intercept + slope v [Pa], [Pa s/m], less
    ("slope_90", "f8"),
    ("fall_1", "f8"),  # fall of the modulus [Pa]
    ("fall_1_from", "f8"),  # speed at which it begins [m/s]
    ("fall_1_per", "f8"),  # inverse of the range of speed over which it falls [s/m]
    ("fall_2", "f8"),  # the same for two further falls
    ("fall_2_from", "f8"),
    ("fall_2_per", "f8"),
    ("fall_3", "f8"),
    ("fall_3_from", "f8"),
    ("fall_3_per", "f8"),
    ("intercept_45", "f8"),
    ("slope_45", "f8"),
    ("speed_min", "f8"),  # measured range of speed [m/s]
    ("speed_max", "f8"),
    ("eta90", "f8"),  # excess of the initiation force at 90 degrees [1]
    ("debt_length", "f8"),  # l of the ledger's floor -R B l [m]
    ("growth_step", "f8"),  # advance per step of unstable growth [m]
    ("friction_per_depth", "f8"),  # [N/m]
    ("friction_per_depth_speed", "f8"),  # [N s/m2]
    ("presliding_length", "f8"),  # motion over which friction rises to its full size [m]
    ("per_presliding_length", "f8"),  # its inverse [1/m]
    ("relaxing_share", "f8"),  # relaxing part of the modulus [1]
    ("creep_time", "f8"),  # time constant of creep [s]
)

DRIVE = _struct(
    ("lag", "f8"),  # time constant of the velocity loop [s]
    ("acceleration", "f8"),  # limit [m/s2]
    ("rotation_rate", "f8"),  # limit [rad/s]
    ("travel", "f8"),  # the blade stays within 0 to travel [m]
    ("mass", "f8"),  # blade and hand, or of a drive under PD control [kg]; 0: a velocity loop, which holds position
    ("coupling_stiffness", "f8"),  # hand to blade, or proportional gain [N/m]
    ("coupling_damping", "f8"),  # hand to blade, or derivative gain [N s/m]
    ("drag", "f8"),  # of a drive under PD control [N s/m]
    ("dead_ticks", "i8"),  # updates between a command and its effect
    ("backlash", "f8"),  # play between the rig's carriage and its blade [m]
)

STATE = _struct(
    ("blade", "f8"),  # x [m]
    ("tip", "f8"),  # a [m]
    ("speed", "f8"),  # v [m/s]
    ("angle", "f8"),  # theta [rad]
    ("lean", "f8"),  # cotangent of theta
    ("pushing", "f8"),  # sin^2 of theta; both stored, because the blade seldom turns
    ("hand", "f8"),  # wanted position under PD control, of a hand, or of the carriage [m]
    ("hand_speed", "f8"),  # [m/s]
    ("target", "f8"),  # commanded speed that has reached the drive [m/s], where there is a dead time
    ("next_target", "f8"),  # pending commanded speed [m/s]
    ("waiting", "i8"),  # updates until it reaches the drive
    ("arrest_ratio", "f8"),  # F/(R B) where an unstable run last came to rest; infinity: nothing has run yet
    ("held_force", "f8"),  # F where the tip last came to rest, after growth or a run [N]
    ("bristle", "f8"),  # deflection of the friction bristles, up to the presliding length [m]
    ("creep", "f8"),  # of relaxing tissue [m]
    ("locked", "f8"),  # energy in the creep [J]
    ("ledger", "f8"),  # energies since reset [J]
    ("work", "f8"),
    ("fracture", "f8"),
    ("friction", "f8"),  # work against friction, elastic energy of the bristles included
    ("loss", "f8"),
    ("uncontrolled", "f8"),  # sum of unstable growth [m]
    ("units", "i8"),  # number of unstable runs
    ("running", "i8"),  # 1 if the crack ran in the last update
    ("tick", "i8"),  # updates since reset
)

READING = _struct(
    ("time", "f8"),
    ("force", "f8"),  # as measured [N]
    ("position", "f8"),  # blade [m]
    ("speed", "f8"),  # [m/s]
    ("angle", "f8"),  # [rad]
    ("true_force", "f8"),  # on the blade, along the line: elastic plus friction [N]
    ("elastic_force", "f8"),  # K (x - a) [N]
    ("tip", "f8"),  # a [m]
    ("jump", "f8"),  # unstable growth during this tick [m]
)


def new_state(count: int, angle: float) -> StructArray:
    """Return initial states, shape (count,): at the clamp, at rest, ``angle`` [rad]."""
    states = np.zeros(count, STATE)
    states["angle"] = angle
    states["lean"], states["pushing"] = leaning(angle)
    states["arrest_ratio"] = np.inf
    return states


@dataclass(frozen=True, kw_only=True)
class LawParameters:
    """Constants of :mod:`cutenv.sim.cutting.law`; those of the tissue are in ``TissueDescription``."""

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
    """Return each specimen's :data:`PROFILE` of stiffness, toughness and depth, shape (n,)."""
    profiles = np.zeros(len(specimens), PROFILE)
    for profile, specimen in zip(profiles, specimens, strict=True):
        profile["stiffness"] = specimen.stiffness()
        profile["toughness"] = specimen.fracture_force()
        profile["depth"] = specimen.depth
    return profiles


def law_records(specimens: list[Specimen], parameters: LawParameters | None = None) -> StructArray:
    """Return the law's constants for each specimen, :data:`LAW`, shape (n,)."""
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
