"""What the numbers of a calibrated tissue rest on: how each was found, how well, and what was not measured."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, get_args

from cutenv.parameter import Provenance
from cutenv.validation import one_of


@dataclass(frozen=True, kw_only=True)
class Evidence:
    """Of one number of a tissue description.

    Attributes
    ----------
    name : str
        The field of :class:`~cutenv.tissue.TissueDescription`.
    provenance : {"measured", "derived", "assumed", "choice"}
        "assumed" stands for what the records do not tell.
    how : str
        By what procedure, or why it is assumed, in words.
    low, high : float or None
        Ends of its 95 % interval, in the field's unit; None where nothing was measured.
    """

    name: str
    provenance: Provenance
    how: str
    low: float | None = None
    high: float | None = None

    def __post_init__(self) -> None:
        one_of("provenance", self.provenance, get_args(Provenance))


@dataclass(frozen=True, kw_only=True)
class Calibration:
    """Of what records a tissue description was made.

    Attributes
    ----------
    cuts, specimens : int
        How many cuts, of how many pieces of tissue (livers, say).
    evidence : tuple of Evidence
        One for each number that the records were asked for.
    notes : tuple of str
        What a user of the numbers must know, in words.
    """

    cuts: int
    specimens: int
    evidence: tuple[Evidence, ...]
    notes: tuple[str, ...] = ()

    @property
    def not_measured(self) -> tuple[str, ...]:
        """Names of the fields that the records do not tell."""
        return tuple(each.name for each in self.evidence if each.provenance in ("assumed", "choice"))

    def of(self, name: str) -> Evidence:
        """The evidence of one field.

        Raises
        ------
        ValueError
            If there is none.
        """
        one_of("field", name, [each.name for each in self.evidence])
        return next(each for each in self.evidence if each.name == name)

    @classmethod
    def from_content(cls, content: Any) -> Calibration:
        """Read what :func:`dataclasses.asdict` and JSON made of one.

        Raises
        ------
        ValueError
            If a field is missing or unknown.
        """
        try:
            evidence = tuple(Evidence(**each) for each in content["evidence"])
            rest = {name: value for name, value in content.items() if name not in ("evidence", "notes")}
            return cls(evidence=evidence, notes=tuple(content["notes"]), **rest)
        except (TypeError, KeyError, AttributeError) as error:
            raise ValueError(f"calibration is not what cutenv calibrate writes ({error}); make it anew.") from None
