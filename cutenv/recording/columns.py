"""Columns of a record: headers name quantity and unit (``force_N``, ``position_cm``), values are converted to SI."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

from cutenv._base.arrays import Array
from cutenv._base.unit_table import ANGLES, FORCES, LENGTHS, SPEEDS, TIMES, TORQUES, Unit
from cutenv.trace import BESIDE, FORCE_UNITS

_LENGTH = re.compile(r"([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*([^\W\d]+)")

FIELD_UNITS: Mapping[str, tuple[Unit, ...]] = MappingProxyType(
    {"time": TIMES, "force": FORCES, "position": LENGTHS, "speed": SPEEDS, "angle": ANGLES, "depth": LENGTHS}
)
"""Units of each field of a :class:`cutenv.trace.Trace`, the SI unit first."""
_FORCES_ASIDE = ("vertical", "lateral")
_BESIDE_UNITS: Mapping[str, tuple[Unit, ...]] = {
    "height": LENGTHS, "vertical_force": FORCES, "lateral_force": FORCES, "torque": TORQUES, "blade": LENGTHS,
}  # fmt: skip
_BY_SPELLING = {  # people write the sign, with its slash; a header may have to do without
    field: {spelling: unit for unit in units for spelling in (unit.name, unit.sign)}
    for field, units in {**FIELD_UNITS, **_BESIDE_UNITS}.items()
}
UNITS: Mapping[str, Mapping[str, float]] = MappingProxyType(
    {field: {spelling: unit.factor for spelling, unit in _BY_SPELLING[field].items()} for field in FIELD_UNITS}
)
"""Size in SI units of each unit's spelling, by field of a :class:`cutenv.trace.Reading`."""

AXES = ("x", "y", "z")
"""Directions of a force or torque measured in components: ``force_x_N``, ``force_z_N``, ``torque_y_N_m``."""


@dataclass(frozen=True, kw_only=True)
class Column:
    """Content of a column according to its header.

    Attributes
    ----------
    field : str
        Quantity: a key of :data:`UNITS`, "height", "vertical_force", "lateral_force", "torque" or "blade".
    axis : {"x", "y", "z"} or None
        Direction of a component of force or torque, or of a place of the blade; None for anything else.
    unit : str
        Spelling of the unit, such as a key of ``UNITS[field]``.
    """

    field: str
    axis: str | None
    unit: str

    @property
    def factor(self) -> float:
        """Number of SI units in one of the unit."""
        return _BY_SPELLING[self.field][self.unit].factor

    @property
    def of_trace(self) -> str:
        """Name of the field of a trace: ``force``, ``force_x``."""
        return f"{self.field}_{self.axis}" if self.axis else self.field

    @property
    def force_unit(self) -> str | None:
        """Value of a trace's ``force_unit`` for this force, "N" or "1"; None if the column is not a force."""
        if self.field.rpartition("_")[2] != "force":
            return None
        return "1" if self.unit == "1" else "N"

    def to_si(self, values: Array) -> Array:
        """Return values in SI, of the same shape; the same array if they are in SI already."""
        return _BY_SPELLING[self.field][self.unit].to_si(values)


def parse_header(name: str) -> Column:
    """Read quantity and unit from a column's name.

    Parameters
    ----------
    name : str
        Such as ``time_ms``, ``force_N``, ``force_x_mN``, ``speed_cm_s``, ``torque_z_N_m``; blanks around it are
        ignored.

    Raises
    ------
    ValueError
        If the quantity or the unit is unknown or missing; the message names the nearest known one.
    """
    field, _, unit = name.strip().partition("_")
    if field in _FORCES_ASIDE and (unit == "force" or unit.startswith("force_")):
        field, unit = f"{field}_force", unit.removeprefix("force").removeprefix("_")
    if field not in _BY_SPELLING:
        nearest = _nearest(field, UNITS)
        hint = f" Did you mean {nearest}_{unit or header_of(nearest).partition('_')[2]}?" if nearest else ""
        known = ", ".join(header_of(known) for known in UNITS)
        raise ValueError(f"column {name!r} is no quantity of a cut with its unit, such as {known}.{hint}")
    axis, _, rest = unit.partition("_")
    if field in ("force", "torque", "blade") and axis in (AXES[:2] if field == "blade" else AXES):
        unit = rest
    elif field == "torque":
        raise ValueError(f"column {name!r} names no axis. Write torque_x_N_m, torque_y_N_m or torque_z_N_m.")
    elif field == "blade":
        raise ValueError(f"column {name!r} names no axis. Write blade_x_m or blade_y_m.")
    else:
        axis = ""
    known_units = _BY_SPELLING[field]
    if unit not in known_units:
        stem = f"{field}_{axis}" if axis else field
        listed = ", ".join(f"{stem}_{known}" for known in known_units if "/" not in known)
        if not unit:
            raise ValueError(f"column {name!r} has no unit. Write one of {listed}.")
        nearest = _nearest(unit, known_units)
        hint = f" Did you mean {stem}_{nearest}?" if nearest else ""
        raise ValueError(f"column {name!r} has the unit {unit!r}, which is not known. Write one of {listed}.{hint}")
    return Column(field=field, axis=axis or None, unit=unit)


def parse_length(name: str, text: str) -> float:
    """Return a length such as ``80mm``, ``8 cm`` or ``3.15in`` in metres.

    Parameters
    ----------
    name : str
        Option or argument that it was given to, for the message.
    text : str
        Number and unit, one of ``UNITS["position"]``.

    Raises
    ------
    ValueError
        If there is no number or no known unit.
    """
    found = _LENGTH.fullmatch(text.strip())
    if found is None:
        raise ValueError(f"{name} {text!r} is no length with a unit; write 80mm or 8cm.")
    known = _BY_SPELLING["position"]
    if found[2] not in known:
        raise ValueError(f"{name} {text!r} has an unknown unit of length; write one of {', '.join(known)}.")
    return known[found[2]].to_si(float(found[1]))


def header_of(field: str, force_unit: str = "N") -> str:
    """Return the name of the column for a field of a trace: in SI, so that nothing is lost.

    Parameters
    ----------
    field : str
        Field of a :class:`cutenv.trace.Trace`, time and force among them.
    force_unit : {"N", "1"}
        Unit of the trace's force.

    Raises
    ------
    ValueError
        If there is no such field or unit.
    """
    if field not in UNITS and field not in BESIDE:
        raise ValueError(f"{field!r} is no field of a trace; its fields are {', '.join((*UNITS, *BESIDE))}.")
    if force_unit not in FORCE_UNITS:
        raise ValueError(f"force_unit must be one of {', '.join(FORCE_UNITS)}, got {force_unit!r}.")
    return f"{field}_{unit_of(field, force_unit).name}"


def unit_of(field: str, force_unit: str = "N") -> Unit:
    """Return the SI unit of a field of a trace, for a force the trace's own."""
    quantity = field if field in _BY_SPELLING else field.partition("_")[0]
    if quantity.rpartition("_")[2] == "force":
        return _BY_SPELLING["force"][force_unit]
    return next(iter(_BY_SPELLING[quantity].values()))


def _nearest(name: str, known: Iterable[str]) -> str:
    """Return the most similar of the known names, or ""; upper and lower case count as equal."""
    by_lower = {key.lower(): key for key in known}
    found = difflib.get_close_matches(name.lower(), by_lower, n=1, cutoff=0.5)
    return by_lower[found[0]] if found else ""
