"""Source of an environment's specimens: measured liver, another tissue, a given one."""

from __future__ import annotations

import json
from pathlib import Path

from cutenv.sim.tissue import description, specimen
from cutenv.sim.tissue.description import TissueDescription, measured_liver
from cutenv.sim.tissue.specimen import Specimen


class TissueSource:
    """Source of an environment's specimens: liver as measured, or a file.

    The file is a tissue description (``TissueDescription.to_json``), from which specimens are drawn, or a specimen
    (``Specimen.to_json``), which is cut in every episode.  ValueError or FileNotFoundError if it is missing, or
    neither.
    """

    def __init__(self, path: str | Path | None) -> None:
        self.tissue: TissueDescription | None = None
        self.specimen: Specimen | None = None
        if path is None:
            return
        if not isinstance(path, (str, Path)):
            raise TypeError(
                f"tissue = {str(path)[:60]} must be the path of a tissue or specimen JSON (to_json writes one)."
            )
        file = Path(path)
        if not file.is_file():
            raise FileNotFoundError(
                f"tissue = {str(path)!r}: no such file; give the path of a tissue or specimen JSON."
            )
        text = file.read_text(encoding="utf-8")
        try:
            schema = json.loads(text)["schema"]
        except (json.JSONDecodeError, KeyError, TypeError):
            schema = None
        if schema == specimen.SPECIMEN_SCHEMA:
            self.specimen = Specimen.from_json(text)
        elif schema == description.TISSUE_SCHEMA:
            self.tissue = TissueDescription.from_json(text)
        else:
            raise ValueError(
                f"tissue = {str(path)!r} is neither a tissue ({description.TISSUE_SCHEMA}) nor a specimen "
                f"({specimen.SPECIMEN_SCHEMA}): its schema is {schema!r}."
            )

    @property
    def description(self) -> TissueDescription:
        """Tissue that the specimens are of."""
        return self.specimen.tissue if self.specimen is not None else self.tissue or measured_liver()

    def words(self, specimen_class: str) -> str:
        """Name the specimens: "liver", or "liver of my_tissue" with a tissue file."""
        other = self.tissue is not None or self.specimen is not None
        return f"{specimen_class} of {self.description.name}" if other else specimen_class

    def drawn(self, seed: int, episode: int, specimen_class: str) -> Specimen:
        """Return the specimen with that key and ``specimen_class``."""
        return Specimen.drawn(seed, episode, specimen_class=specimen_class, tissue=self.tissue)
