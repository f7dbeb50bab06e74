"""Provenance of a calibrated tissue's numbers: method, interval, and what was not measured."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, get_args

from cutenv._base.parameter import ParameterProvenance
from cutenv._base.validation import one_of


@dataclass(frozen=True, kw_only=True)
class Evidence:
    """Provenance of one number of a tissue description.

    Attributes
    ----------
    name : str
        Name of the field of :class:`~cutenv.tissue.TissueDescription`.
    provenance : {"measured", "derived", "assumed", "choice"}
        "assumed" if the records do not determine it.
    how : str
        Procedure, or reason why it is assumed, in words.
    low, high : float or None
        Ends of the 95 % interval, in the field's unit; None where nothing was measured.
    """

    name: str
    provenance: ParameterProvenance
    how: str
    low: float | None = None
    high: float | None = None

    def __post_init__(self) -> None:
        one_of("provenance", self.provenance, get_args(ParameterProvenance))
        for what, text in (("name", self.name), ("how", self.how)):
            if not isinstance(text, str) or not text:
                raise ValueError(f"evidence's {what} = {text!r} must be text.")
        ends = [end for end in (self.low, self.high) if end is not None]
        if len(ends) == 1 or not all(isinstance(end, (int, float)) and math.isfinite(end) for end in ends):
            raise ValueError(
                f"evidence of {self.name}: low = {self.low!r} and high = {self.high!r} are not an interval."
            )
        if ends and ends[0] > ends[1]:
            raise ValueError(f"evidence of {self.name}: low = {self.low:g} is above high = {self.high:g}.")


@dataclass(frozen=True, kw_only=True)
class TissueCalibration:
    """Records and evidence from which a tissue description was made.

    Attributes
    ----------
    cuts, specimens : int
        Number of cuts, and of pieces of tissue (for example livers).
    evidence : tuple of Evidence
        Evidence for each number that was to be determined.
    notes : tuple of str
        Notes for users of the numbers.
    """

    cuts: int
    specimens: int
    evidence: tuple[Evidence, ...]
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for what, number in (("cuts", self.cuts), ("specimens", self.specimens)):
            if isinstance(number, bool) or not isinstance(number, int) or number < 1:
                raise ValueError(f"calibration: {what} = {number!r} must be a whole number, 1 or more.")
        if self.specimens > self.cuts:
            raise ValueError(f"calibration: {self.specimens} specimens cannot come from {self.cuts} cuts.")
        names = [each.name for each in self.evidence]
        if len(set(names)) < len(names):
            twice = next(name for name in names if names.count(name) > 1)
            raise ValueError(f"calibration: evidence of {twice} is given twice.")
        if not all(isinstance(note, str) for note in self.notes):
            raise ValueError(f"calibration: notes = {self.notes!r} must be texts.")

    @property
    def not_measured(self) -> tuple[str, ...]:
        """Names of the fields that the records do not determine."""
        return tuple(each.name for each in self.evidence if each.provenance in ("assumed", "choice"))

    def of(self, name: str) -> Evidence:
        """Return the evidence for one field.

        Raises
        ------
        ValueError
            If there is none.
        """
        one_of("field", name, [each.name for each in self.evidence])
        return next(each for each in self.evidence if each.name == name)

    @classmethod
    def from_content(cls, content: Any) -> TissueCalibration:
        """Build a calibration from the JSON content of :func:`dataclasses.asdict`.

        Raises
        ------
        ValueError
            If a field is missing or unknown, or its value is invalid.
        """
        try:
            evidence = tuple(Evidence(**each) for each in content["evidence"])
            rest = {name: value for name, value in content.items() if name not in ("evidence", "notes")}
            if not isinstance(content["notes"], list):
                raise TypeError(f"notes = {content['notes']!r} is not a list")
            return cls(evidence=evidence, notes=tuple(content["notes"]), **rest)
        except (TypeError, KeyError, AttributeError) as error:
            raise ValueError(f"calibration is not what cutenv calibrate writes ({error}); calibrate again.") from None
