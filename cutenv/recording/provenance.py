"""Provenance of a record: rig, sensor, blade, specimen and its handling, day, operator, consent, calibration."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from datetime import datetime
from typing import Any

from cutenv._base.validation import in_range, one_of
from cutenv.recording.schema import to_json

_TEXTS = ("rig", "sensor", "blade", "specimen")
_LONGEST = 500  # characters
_ROLES = "operator|participant|subject|surgeon|student|trainee|resident|novice|expert|person|user"
# A few letters and a number, a role and a number, or the beginning of a hash: too short for a name.
_CODE = re.compile(
    rf"[a-z]{{0,3}}[-_]?[0-9]{{1,6}}[a-z]?|(?:{_ROLES})[-_]?[0-9]{{1,6}}|(?=.*[0-9])(?=.*[a-f])[0-9a-f]{{8,64}}",
    re.IGNORECASE,
)


@dataclass(frozen=True, kw_only=True)
class TissueHandling:
    """Handling of a piece of tissue before and during its cuts; unknown parts are None.

    Parameters
    ----------
    hours_post_mortem : float, optional
        Time from death to the cut [h], 0 to 1000.
    storage : str, optional
        How it was kept, such as "saline, 4 degrees".
    temperature_C : float, optional
        Temperature at the cut, -5 to 60.
    preconditioning_cycles : int, optional
        Loading cycles before the cut, 0 for none.
    capsule : {"kept", "removed"}, optional
        The organ's capsule.
    fixation : str, optional
        How it was held, such as "nails at the clamp".

    Raises
    ------
    TypeError, ValueError
        If a part has a wrong type or is out of range.
    """

    hours_post_mortem: float | None = None
    storage: str | None = None
    temperature_C: float | None = None
    preconditioning_cycles: int | None = None
    capsule: str | None = None
    fixation: str | None = None

    def __post_init__(self) -> None:
        for name, low, high, unit in (
            ("hours_post_mortem", 0.0, 1000.0, "h"),
            ("temperature_C", -5.0, 60.0, "°C"),
            ("preconditioning_cycles", 0.0, 1e6, "1"),
        ):
            if getattr(self, name) is not None:
                in_range(name, getattr(self, name), low, high, unit, "Leave out what is not known.")
        for name in ("storage", "fixation"):
            _check_text(name, getattr(self, name))
        one_of("capsule", self.capsule, (None, "kept", "removed"))


@dataclass(frozen=True, kw_only=True)
class Provenance:
    """Provenance of a record; unknown parts are None.

    Parameters
    ----------
    rig, sensor, blade, specimen : str, optional
        In your own words, such as ``blade="No. 10, new"``.
    date : str, optional
        ISO 8601, such as ``2026-03-01`` or ``2026-03-01T14:05:00+01:00``.
    operator : str, optional
        Anonymous code: up to three letters or a role, and a number, such as ``P07``.
    consent : bool, optional
        True if the operator agreed to the record's use.
    calibration : mapping, optional
        Calibration of the sensor, in JSON's types: ``{"gain_N_per_V": 4.98, "offset_N": 0.02}``.
    handling : TissueHandling, optional
        What was done with the tissue.

    Raises
    ------
    TypeError
        If a value has a wrong type.
    ValueError
        If a text is empty, the date is invalid, or the operator's code looks like a name.

    Examples
    --------
    >>> origin = Provenance(rig="bench 2", operator="P07", consent=True)
    >>> origin.metadata
    {'rig': 'bench 2', 'operator': 'P07', 'consent': True}
    >>> Provenance.from_metadata({"rig": "bench 2", "trial": 3})
    Provenance(rig='bench 2')
    """

    rig: str | None = None
    sensor: str | None = None
    blade: str | None = None
    specimen: str | None = None
    date: str | None = None
    operator: str | None = None
    consent: bool | None = None
    calibration: Mapping[str, Any] | None = None
    handling: TissueHandling | None = None

    def __post_init__(self) -> None:
        for name in _TEXTS:
            _check_text(name, getattr(self, name))
        if self.date is not None:
            _check_date(self.date)
        if self.operator is not None:
            check_operator(self.operator)
        if not (self.consent is None or isinstance(self.consent, bool)):
            raise TypeError(f"consent must be True, False or None (not known), got {self.consent!r}.")
        if self.calibration is not None:
            object.__setattr__(self, "calibration", _json_copy(self.calibration))
        if not (self.handling is None or isinstance(self.handling, TissueHandling)):
            raise TypeError(
                f"handling must be a TissueHandling, or a mapping in a record's metadata, got {self.handling!r}."
            )

    @property
    def metadata(self) -> dict[str, Any]:
        """Known parts, as metadata of a :class:`cutenv.trace.Trace`."""
        known = {part.name: getattr(self, part.name) for part in fields(self)}
        if self.handling is not None:
            known["handling"] = {name: value for name, value in asdict(self.handling).items() if value is not None}
        return {name: value for name, value in known.items() if value is not None}

    @classmethod
    def from_metadata(cls, metadata: Mapping[str, Any]) -> Provenance:
        """Make the provenance from the parts of a trace's metadata that belong to it.

        Raises
        ------
        TypeError, ValueError
            As for the fields themselves.
        """
        known = {part.name: metadata[part.name] for part in fields(cls) if part.name in metadata}
        if isinstance(known.get("handling"), Mapping):
            for name in known["handling"]:
                one_of("handling", name, [part.name for part in fields(TissueHandling)])
            known["handling"] = TissueHandling(**known["handling"])
        return cls(**known)

    def __repr__(self) -> str:
        return f"Provenance({', '.join(f'{name}={value!r}' for name, value in self.metadata.items())})"


def check_operator(code: object) -> None:
    """Raise an error for a code that may reveal who the operator is.

    Raises
    ------
    TypeError
        If it is not text.
    ValueError
        If it looks like a name, a mail address, a telephone number or a date of birth.
    """
    if not isinstance(code, str):
        raise TypeError(f"operator must be a code such as 'P07', got {code!r}.")
    if not (code.isascii() and _CODE.fullmatch(code)):
        raise ValueError(
            f"operator {code!r} may identify a person. Give a code of up to three letters and a number, such as 'P07', "
            "and keep the list of who is who elsewhere."
        )


def _check_text(name: str, value: object) -> None:
    if value is None:
        return
    if not isinstance(value, str):
        raise TypeError(f"{name} must be text, got {value!r}.")
    if not value.strip() or len(value) > _LONGEST:
        raise ValueError(f"{name} must be a text of 1 to {_LONGEST} characters; leave out what is not known.")


def _check_date(value: object) -> None:
    if not isinstance(value, str):
        raise TypeError(f"date must be text such as '2026-03-01', got {value!r}; a date has .isoformat().")
    try:
        datetime.fromisoformat(value)
    except ValueError:
        raise ValueError(f"date {value!r} is none in ISO 8601. Write it as '2026-03-01'.") from None


def _json_copy(calibration: object) -> Mapping[str, Any]:
    """Return the mapping as it would come back from a file."""
    if not isinstance(calibration, Mapping):
        raise TypeError(f'calibration must map names to values ({{"gain_N_per_V": 5.0}}), got {calibration!r}.')
    try:
        copy: Mapping[str, Any] = json.loads(to_json(dict(calibration)))
    except (TypeError, ValueError) as error:
        raise TypeError(f"calibration {calibration!r} is not what JSON can hold: {error}.") from None
    return copy
