"""Units as files of other programs state them.

They are in brackets, behind a name, in a row of their own, or in a cell.
"""

from __future__ import annotations

import functools
import re
from typing import NamedTuple

from cutenv.records.schema import FIELD_UNITS

_OTHERS = (  # units of quantities that a record of a cut has no field for
    "%", "mm/mm", "in/in", "m/m", "1/s", "s-1", "Pa", "kPa", "MPa", "GPa", "N/mm2", "N/mm\u00b2", "psi", "ksi", "bar",
    "mbar", "V", "mV", "uV", "kV", "A", "mA", "uA", "\u00b0C", "C", "K", "\u00b0F", "degC", "mV/V", "V/V", "counts",
    "count", "cts", "raw", "adc", "lsb", "bit", "bits", "digits", "dig", "Hz", "kHz", "rpm", "W", "mW", "J", "mJ", "kJ",
    "Nm", "N*m", "N\u00b7m", "Nmm", "N-m", "kNm", "N/mm", "mN/mm", "N/m", "lbf/in", "in-lb", "ft-lb", "m/s2",
    "m/s\u00b2", "g/cm3", "mm/min", "mm\u00b2", "mm2", "N/s", "dB", "mm/s\u00b2", "Ohm", "\u03a9", "kOhm", "uStrain",
    "volt", "volts", "ampere", "amperes", "amp", "watt", "pascal", "celsius", "kelvin",
)  # fmt: skip
_UNITS_OF = {
    "time": FIELD_UNITS["time"],
    "force": FIELD_UNITS["force"][:-1],  # without "1", which is the number of many a channel
    "length": FIELD_UNITS["position"],
    "speed": FIELD_UNITS["speed"],
    "angle": FIELD_UNITS["angle"],
}
QUANTITY_OF = {"position": "length", "depth": "length"}  # quantity of the fields that are not called after theirs
_OWN_CASE = ("MN", "Mn", "nN", "M", "C", "P", "H", "Nm", "mS", "Ms", "T", "D")
"""Spellings that mean another unit, or none, in other letters."""
_BRACKETS = re.compile(r"(.*\S)\s*[\[(<{]([^\[\](){}<>]*)[\])>}]")
_INNER = re.compile(r"(.*[^\s\[(])\s*[\[(]([^\[\]()]*)[\])]\s*([^\s\[\](),;][^\[\]()]*)")


class StatedUnit(NamedTuple):
    """Unit of a column."""

    quantity: str  # "time", "force", "length", "speed", "angle" or "other"
    unit: str  # our spelling


@functools.lru_cache(maxsize=4096)
def known_spelling(text: str) -> StatedUnit | None:
    """Return the unit that a text spells, or None."""
    said = _plain(text)
    return _SPELLINGS.get(said) or (None if said in _OWN_CASE else _IN_ANY_CASE.get(said.lower()))


def quantity_of(text: str) -> str:
    """Return the quantity of the unit that a text spells, or ""."""
    known = known_spelling(text)
    return "" if known is None else known.quantity


def unit_of_field(field: str, text: str) -> str | None:
    """Return a unit's key in ``UNITS[field]``, or None."""
    if field == "force" and text.strip() in ("1", "-"):
        return "1"
    known = known_spelling(text)
    return known.unit if known is not None and known.quantity == QUANTITY_OF.get(field, field) else None


def without_brackets(header: str) -> tuple[str, str]:
    """Split a header into name and bracket content, as ``force [N]``."""
    found = _BRACKETS.fullmatch(header.strip())
    return (found[1].strip(), found[2].strip()) if found else (header.strip(), "")


def split_header(header: str) -> tuple[str, str]:
    """Split a header such as ``force [N]`` into name and unit.

    Other forms are ``force_N``, ``force / N``, ``force in N`` and ``force, N``. Outside of brackets only a known unit
    is one: ``F_1`` is a channel, ``a / b`` a ratio.
    """
    name, said = without_brackets(header)
    if not said and (found := _INNER.fullmatch(name)) is not None and _is_field_unit(found[2]):
        return f"{found[1]} {found[3]}", found[2]  # the run behind the unit: "Force (N) Run #1"
    if said:
        inner, also = without_brackets(name)
        return (inner, also) if known_spelling(said) is None and known_spelling(also) else (name, said)
    for pattern in (r"(.*\w)\.\.(\w+)\.", r"([^\W\d]\w*)\.([^\W\d]\w+|N|s)"):  # brackets as R writes them: "Force..N."
        if (found := re.fullmatch(pattern, name)) is not None and _is_field_unit(found[2]):
            return found[1], found[2]
    if (found := re.fullmatch(r"([^_].*)_((?:mm|cm|m|in)_s)", name)) is not None:  # a speed
        return found[1], found[2]
    for pattern in (
        r"(.*\w)-(\w+)",
        r"(.*?\S)\s*/\s*(\S+)",
        r"(.*\S)\s+in\s+(\S+)",
        r"(.*\S)\s*,\s*(\S+)",
        r"(.*[^_\s])_(\w+)",
    ):
        found = re.fullmatch(pattern, name)
        if found is None:
            continue
        known = known_spelling(found[2])
        joined = pattern in (r"(.*[^_\s])_(\w+)", r"(.*\w)-(\w+)")
        if known is not None and (known.quantity != "other" or not joined):
            return found[1].strip(), found[2]
    if (found := re.fullmatch(r"(.*\w)\s+(\S{2,}|N|s)", name)) is not None and _is_field_unit(found[2]):
        return found[1], found[2]
    return name, ""


def _is_field_unit(text: str) -> bool:
    """Return whether a text is a force, length or time unit."""
    return quantity_of(text) in ("force", "length", "time")


def _plain(text: str) -> str:
    """Return a unit without brackets, blanks and final dot, micro unified."""
    said = text.strip().strip("[](){}<>\"' \t").replace("\u00b5", "u").replace("\u03bc", "u").replace("\ufffd", "u")
    return said.removesuffix(".").strip() if len(said) > 1 else said


def _spellings() -> dict[str, StatedUnit]:
    found = {_plain(text): StatedUnit("other", text) for text in _OTHERS}
    for quantity, units in _UNITS_OF.items():
        for unit in units:
            for spelling in (unit.sign, unit.name, *unit.spellings):
                found[_plain(spelling)] = StatedUnit(quantity, unit.name if "/" not in unit.sign else unit.sign)
    return found


_SPELLINGS = _spellings()
_IN_ANY_CASE = {spelling.lower(): unit for spelling, unit in reversed(_SPELLINGS.items())}
