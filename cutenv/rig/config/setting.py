"""Declaration of one line of a rig's file: unit, range and meaning of a field."""

from __future__ import annotations

from dataclasses import field
from typing import Any

from cutenv._base.unit_table import NAMED_UNITS

_Pair = str | tuple[str, str]


def setting(
    default: Any,
    unit: _Pair,
    meaning: str,
    low: float | None = None,
    high: float | None = None,
    *,
    why: str = "",
    example: _Pair = "",
) -> Any:
    """Declare a field that is one line of the file.

    Parameters
    ----------
    default : object
        Default in SI.
    unit : str or (str, str)
        Name in :data:`cutenv._base.unit_table.NAMED_UNITS` of the unit in the file; "1": a count, a ratio, a text. Of a
        pair the first is for a screw, the second for a hinge.
    meaning : str
        Explanation for the comment above the line.
    low, high : float, optional
        Admissible range in SI.
    why : str
        Reason for the default, for the message; the meaning if it needs none.
    example : str or (str, str)
        Plausible value, in the file, of a key that a person has to supply and that has no default.
    """
    units = (unit,) if isinstance(unit, str) else unit
    metadata: dict[str, Any] = {"units": units, "meaning": meaning}
    metadata["examples"] = (example,) if isinstance(example, str) else example
    if low is not None:
        metadata |= {"unit": " or ".join(NAMED_UNITS[each].si for each in units), "low": low, "high": high}
        metadata["source"] = why or meaning
    return field(default=default, metadata=metadata)
