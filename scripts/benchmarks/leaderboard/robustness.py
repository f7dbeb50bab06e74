"""Robustness of policies to constants that differ from training: each constant at both ends of its sweep range.

No policy is trained for it or informed: a wrong assumption has the same effect as it would have on a rig.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cutenv._base.output import atomic_write
from cutenv._base.validation import parameter_table
from cutenv.envs.constants import Knowledge
from cutenv.sim.cutting.drive import Rig
from cutenv.sim.cutting.dtypes import LawParameters
from cutenv.sim.cutting.sensor import SensorParameters
from cutenv.sim.tissue import measured_liver
from cutenv.sim.tissue.description import TissueDescription
from cutenv.task.reward import Limits


@dataclass(frozen=True)
class Setting:
    """One constant at one end of its range."""

    constant: str
    unit: str
    default: float
    value: float
    of_tissue: bool

    @property
    def name(self) -> str:
        """Name of the setting's file."""
        return f"{self.constant}={self.value:.4g}"

    def arguments(self, folder: Path) -> dict[str, Any]:
        """Return the environment's keyword arguments; a tissue is written to ``folder``, from which it is loaded."""
        if not self.of_tissue:
            return {self.constant: self.value}
        path = folder / f"{self.name}.json"
        tissue = dataclasses.replace(measured_liver(), **{self.constant: self.value})
        with atomic_write(path) as part:
            part.write_text(tissue.to_json())
        return {"tissue": str(path)}


def settings() -> Iterator[Setting]:
    """Yield every constant of the parameter table that has a sweep range, at both ends that differ from its default."""
    liver = measured_liver()
    for group in (Rig, SensorParameters, Limits, Knowledge, LawParameters, TissueDescription):
        of_tissue = group is TissueDescription
        for row in parameter_table(group):
            default = getattr(liver, row["name"]) if of_tissue else row["default"]
            for value in row["sensitivity"] or ():
                if abs(value - default) > 1e-9 * max(abs(value), abs(default)):
                    yield Setting(row["name"], row["unit"], default, value, of_tissue)
