"""Constants of an episode by keyword: of drive, sensor, law, task or lab."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from cutenv._base.validation import check_parameters, one_of, parameter, unexpected_keyword
from cutenv.sim.cutting.drive import DRIVES, Drive, Rig
from cutenv.sim.cutting.dtypes import LawParameters
from cutenv.sim.cutting.sensor import SensorParameters
from cutenv.sim.tissue.description import TissueDescription
from cutenv.sim.tissue.grid import field_modes
from cutenv.sim.tissue.specimen import N_POINTS, SPACING, BladeWear
from cutenv.task.beginning import measure_depth
from cutenv.task.reward import Limits, RewardWeights

_PREFIX = "weight_"
T = TypeVar("T")


@dataclass(frozen=True, kw_only=True)
class Knowledge:
    """Quantities that the lab measures before the cut."""

    depth_noise: float = parameter(
        0.5e-3, unit="m", low=0.0, high=0.01, provenance="assumed",
        source="a depth profile from images of the blade, thesis 3.4; six times the error on rendered video (page "
        "Depth of cut from video): blood, other cameras, calipers", sensitivity=(0.0, 2e-3),
    )  # fmt: skip
    depth_noise_length: float = parameter(
        0.010, unit="m", low=0.002, high=0.1, provenance="assumed", source="correlation of its error along the cut"
    )

    def __post_init__(self) -> None:
        check_parameters(self)

    def depth_modes(self) -> NDArray[np.float64]:
        """Return modes of a specimen's depth error, (n_modes, 301)."""
        return field_modes(N_POINTS, SPACING, self.depth_noise_length)

    def measure_depth(self, depth: NDArray[np.float64], seed: int, episode: int) -> NDArray[np.float64]:
        """Return the measured depth, (301,) [m]: true depth plus smooth error."""
        measured = np.empty(N_POINTS)
        key = np.uint64(seed), np.uint64(episode)
        measure_depth(key, self.depth_noise, self.depth_modes(), depth, measured)
        return measured


def rig_constants(rig: str | Path, *, drive: str = "rig") -> dict[str, float]:
    """Return keywords that make the simulator like a rig file, SI.

    Those are the values that ``cutenv rig identify --write`` has put there, the top speed, and the sensor's delay where
    the file states one.  Of a rig under PD position control, which ``drive="pd"`` simulates, the gains are among them.
    ValueError or FileNotFoundError if the file cannot be read, nothing was identified, the simulator does not accept a
    value, or the blade is not driven by a rig.
    """
    from cutenv.rig.config.identified import environment_arguments
    from cutenv.rig.operation.suitability import simulator_keywords
    from cutenv.rig.toml_file import read_rig_file

    if drive == "hand":
        raise ValueError(f'rig = {str(rig)!r} is for a motor, and drive = "{drive}" has none: leave one of them out.')
    settings = read_rig_file(rig)
    control = settings.position_control
    if (control is None) == (drive == "pd"):
        own, kind = ("no section", "rig") if control is None else ("the section", "pd")
        raise ValueError(
            f'rig = {str(rig)!r} has {own} [position_control], and drive is "{drive}": give drive="{kind}".'
        )
    if not environment_arguments(settings.identified, control):
        raise ValueError(f"{rig}: nothing in it was identified yet. Run 'cutenv rig identify {rig} --write' first.")
    measured = simulator_keywords(settings)
    try:
        Constants.from_keywords(measured, drive=drive)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{rig}: [identified] {error}") from None
    return measured


def _kinds(drive: str) -> dict[str, Any]:
    return {
        "drive": DRIVES[one_of("drive", drive, DRIVES)],
        "sensor": SensorParameters,
        "wear": BladeWear,
        "law": LawParameters,
        "weights": RewardWeights,
        "limits": Limits,
        "knowledge": Knowledge,
    }


def keyword_owners(drive: str = "rig") -> dict[str, tuple[str, str]]:
    """Return group and field of every keyword of an environment that is one of its constants."""
    return {
        (_PREFIX if group == "weights" else "") + field.name: (group, field.name)
        for group, kind in _kinds(drive).items()
        for field in dataclasses.fields(kind)
    }


@dataclass(frozen=True, kw_only=True)
class Constants:
    """Constants of an episode, except those of the specimen."""

    drive: Drive = dataclasses.field(default_factory=Rig)
    sensor: SensorParameters = dataclasses.field(default_factory=SensorParameters)
    wear: BladeWear = dataclasses.field(default_factory=BladeWear)
    law: LawParameters = dataclasses.field(default_factory=LawParameters)
    weights: RewardWeights = dataclasses.field(default_factory=RewardWeights)
    limits: Limits = dataclasses.field(default_factory=Limits)
    knowledge: Knowledge = dataclasses.field(default_factory=Knowledge)

    @classmethod
    def from_keywords(
        cls, keywords: Mapping[str, float], *, drive: str = "rig", others: Iterable[str] = (), of: str = "Constants"
    ) -> Constants:
        """Sort flat ``keywords`` (weights as ``weight_<term>``) into their groups.

        ``others`` are the keywords that the caller, ``of``, handles itself; they are suggested for a misspelt name too.
        TypeError names an unknown keyword in Python's words (and the nearest), or a value that is no number, ValueError
        one out of range.
        """
        kinds = _kinds(drive)
        owner = keyword_owners(drive)
        chosen: dict[str, dict[str, float]] = {group: {} for group in kinds}
        tissue = {field.name for field in dataclasses.fields(TissueDescription)}
        for keyword, value in keywords.items():
            if keyword in tissue and keyword not in owner:
                raise unexpected_keyword(
                    of, keyword, cure="It belongs to the tissue: pass tissue=FILE, a TissueDescription as JSON."
                )
            if keyword not in owner:
                raise unexpected_keyword(of, keyword, sorted([*owner, *others]))
            group, name = owner[keyword]
            chosen[group][name] = value
        try:
            weights = RewardWeights(**chosen.pop("weights"))
        except (TypeError, ValueError) as error:
            raise type(error)(f"{_PREFIX}{error}") from None
        return cls(weights=weights, **{group: kinds[group](**own) for group, own in chosen.items()})
