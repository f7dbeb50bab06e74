"""What the numbers of a calibrated tissue rest on: how each was found, how well, and what was not measured."""

from __future__ import annotations

import math
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
        for what, text in (("name", self.name), ("how", self.how)):
            if not isinstance(text, str) or not text:
                raise ValueError(f"evidence's {what} = {text!r} must be text.")
        ends = [end for end in (self.low, self.high) if end is not None]
        if len(ends) == 1 or not all(isinstance(end, (int, float)) and math.isfinite(end) for end in ends):
            raise ValueError(f"evidence of {self.name}: low = {self.low!r} and high = {self.high!r} are no interval.")
        if ends and ends[0] > ends[1]:
            raise ValueError(f"evidence of {self.name}: low = {self.low:g} is above high = {self.high:g}.")


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

    def __post_init__(self) -> None:
        for what, number in (("cuts", self.cuts), ("specimens", self.specimens)):
            if isinstance(number, bool) or not isinstance(number, int) or number < 1:
                raise ValueError(f"calibration: {what} = {number!r} must be a whole number, 1 or more.")
        if self.specimens > self.cuts:
            raise ValueError(f"calibration: {self.specimens} specimens cannot come of {self.cuts} cuts.")
        names = [each.name for each in self.evidence]
        if len(set(names)) < len(names):
            twice = next(name for name in names if names.count(name) > 1)
            raise ValueError(f"calibration: evidence of {twice} stands there twice.")
        if not all(isinstance(note, str) for note in self.notes):
            raise ValueError(f"calibration: notes = {self.notes!r} must be texts.")

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
            If a field is missing or unknown, or its value is none.
        """
        try:
            evidence = tuple(Evidence(**each) for each in content["evidence"])
            rest = {name: value for name, value in content.items() if name not in ("evidence", "notes")}
            if not isinstance(content["notes"], list):
                raise TypeError(f"notes = {content['notes']!r} is no list")
            return cls(evidence=evidence, notes=tuple(content["notes"]), **rest)
        except (TypeError, KeyError, AttributeError) as error:
            raise ValueError(f"calibration is not what cutenv calibrate writes ({error}); make it anew.") from None
