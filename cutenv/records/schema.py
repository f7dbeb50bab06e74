"""Version, JSON content, columns and error of record files."""

from __future__ import annotations

import contextlib
import difflib
import json
import os
import re
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

from cutenv._base.arrays import Array
from cutenv._base.unit_table import ANGLES, FORCES, LENGTHS, SPEEDS, TIMES, TORQUES, Unit
from cutenv.sim.trace import CHANNELS, FORCE_UNITS

SCHEMA = "cutenv-record/1"
"""Name and version of the format, in every file that :func:`cutenv.records.save` writes."""

_NAME, _VERSION = SCHEMA.split("/")


def check_schema(text: str) -> None:
    """Raise a ValueError for a format that cutenv cannot read."""
    found = re.fullmatch(rf"{_NAME}/([0-9]{{1,9}})", text)
    if not found:
        raise ValueError(f"its schema is {shortened(text)}, not {SCHEMA!r}. Save the record again with cutenv.")
    if int(found[1]) > int(_VERSION):
        raise ValueError(
            f"its schema is {text!r}, newer than this cutenv, which reads up to {SCHEMA!r}: pip install -U cutenv"
        )
    if int(found[1]) < 1:
        raise ValueError(f"its schema is {text!r}, which never was. Save the record again with cutenv.")


def to_json(value: object) -> str:
    """Return one line of ASCII JSON, unambiguous in encoding."""
    return json.dumps(value, allow_nan=False)


def from_json(what: str, text: str | bytes) -> Any:
    """Parse JSON without NaN or infinity; `what` names it in the message."""
    try:
        plain = text.encode() if isinstance(text, str) else text  # text that HDF5 could not decode fails here
        return json.loads(plain.decode(), parse_constant=_no_constant)
    except (ValueError, RecursionError) as error:
        raise ValueError(
            f"{what} is not JSON ({error}): {shortened(text)}. Mend it or save the record again."
        ) from None


def mapping_from_json(what: str, text: str | bytes) -> Mapping[str, Any]:
    """Parse a JSON object; raise as :func:`from_json`, or if none."""
    return as_mapping(what, from_json(what, text))


def as_mapping(what: str, value: object) -> Mapping[str, Any]:
    """Return a JSON value if an object; ValueError otherwise."""
    if not isinstance(value, dict):
        raise ValueError(f'{what} is {shortened(value)}. Write names and values: {{"rig": "bench 2"}}.')
    return value


def as_names(what: str, value: object) -> tuple[str, ...]:
    """Return a JSON value if a list of names; ValueError otherwise."""
    if not (isinstance(value, list) and all(isinstance(name, str) for name in value)):
        raise ValueError(f"{what} is {shortened(value)}. Save the record again.")
    return tuple(value)


def shortened(value: object) -> str:
    """Return a value for a message, shortened."""
    text = ascii(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def _no_constant(name: str) -> None:
    raise ValueError(f"{name} is no number")


UTF_16 = (b"\xff\xfe", b"\xfe\xff")  # first bytes of text in UTF-16

_BEGINNINGS = {
    b"PAR1": "Parquet",
    b"\x89HDF\r\n\x1a\n": "HDF5",
    b"\x89MCAP0\r\n": "MCAP",
    b"#ROSBAG V": "a bag of ROS 1",
    b"SQLite format 3\x00": "a bag of ROS 2 in SQLite, or another SQLite file",
    b"PK\x03\x04": "a zip file or a spreadsheet",
    b"\xd0\xcf\x11\xe0": "an old Excel workbook",
    b"\x1f\x8b": "a gzip file",
    b"TDSm": "a LabVIEW TDMS file",
    **dict.fromkeys(UTF_16, "text in UTF-16"),
}


class RecordError(ValueError):
    """Error for a damaged file, or one without a record.

    Its `reason` has place, reason and cure, in the reader's words.
    """

    def __init__(self, path: str | os.PathLike[str], reason: str) -> None:
        super().__init__(f"{path}: {reason}")
        self.path = Path(path)
        self.reason = reason

    def __reduce__(self) -> tuple[type[RecordError], tuple[Path, str]]:
        return type(self), (self.path, self.reason)  # by its own arguments, so that it can be pickled between processes


@contextlib.contextmanager
def refusing_damage(path: Path, kind: str, cure: str = "Take the file again.") -> Iterator[None]:
    """Raise RecordError for whatever a library raises of a damaged file."""
    try:
        yield
    except (ModuleNotFoundError, RecordError):
        raise
    except Exception as error:
        raise RecordError(path, f"it is no {kind}, or a damaged one ({reason_of(error)}). {cure}") from None


def reason_of(error: Exception) -> str:
    """Return an error's first line, or its name."""
    return str(error).partition("\n")[0] or type(error).__name__


def check_beginning(path: Path, content: bytes, name: str, allowed: Collection[bytes] = ()) -> None:
    """Raise RecordError for an empty file, or another format's."""
    if not content:
        raise RecordError(path, "it is empty. Record or copy it again.")
    for known, what in _BEGINNINGS.items():
        if content.startswith(known) and what != name and known not in allowed:
            raise RecordError(
                path, f"it is no {name} but {what}. Give it the suffix of what it is, or save it as CSV in UTF-8."
            )


_LENGTH = re.compile(r"([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*([^\W\d]+)")

FIELD_UNITS: Mapping[str, tuple[Unit, ...]] = MappingProxyType(
    {"time": TIMES, "force": FORCES, "position": LENGTHS, "speed": SPEEDS, "angle": ANGLES, "depth": LENGTHS}
)
"""Units of each field of a :class:`cutenv.sim.trace.Trace`, the SI unit first."""
_FORCES_ASIDE = ("vertical", "lateral")
_CHANNEL_UNITS: Mapping[str, tuple[Unit, ...]] = {
    "height": LENGTHS, "vertical_force": FORCES, "lateral_force": FORCES, "torque": TORQUES, "blade": LENGTHS,
}  # fmt: skip
_BY_SPELLING = {  # people write the sign, with its slash; a header may have to do without
    field: {spelling: unit for unit in units for spelling in (unit.name, unit.sign)}
    for field, units in {**FIELD_UNITS, **_CHANNEL_UNITS}.items()
}
UNITS: Mapping[str, Mapping[str, float]] = MappingProxyType(
    {field: {spelling: unit.factor for spelling, unit in _BY_SPELLING[field].items()} for field in FIELD_UNITS}
)
"""Size in SI units of each unit's spelling, by field of a :class:`cutenv.sim.trace.Reading`."""

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
        """Unit of a force column, "N" or "1", else None."""
        if self.field.rpartition("_")[2] != "force":
            return None
        return "1" if self.unit == "1" else "N"

    def to_si(self, values: Array) -> Array:
        """Return values in SI, the same array if already so."""
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
    """Return a length such as ``80mm`` or ``3.15in`` in metres."""
    found = _LENGTH.fullmatch(text.strip())
    if found is None:
        raise ValueError(f"{name} {text!r} is no length with a unit; write 80mm or 8cm.")
    known = _BY_SPELLING["position"]
    if found[2] not in known:
        raise ValueError(f"{name} {text!r} has an unknown unit of length; write one of {', '.join(known)}.")
    return known[found[2]].to_si(float(found[1]))


def header_of(field: str, force_unit: str = "N") -> str:
    """Return a field's column name, in SI without loss.

    The field is one of a :class:`cutenv.sim.trace.Trace`, time and force among them, whose unit is "N" or "1"; another
    one is a ValueError.
    """
    if field not in UNITS and field not in CHANNELS:
        raise ValueError(f"{field!r} is no field of a trace; its fields are {', '.join((*UNITS, *CHANNELS))}.")
    if force_unit not in FORCE_UNITS:
        raise ValueError(f"force_unit must be one of {', '.join(FORCE_UNITS)}, got {force_unit!r}.")
    return f"{field}_{unit_of(field, force_unit).name}"


def unit_of(field: str, force_unit: str = "N") -> Unit:
    """Return a field's SI unit, for a force the trace's."""
    quantity = field if field in _BY_SPELLING else field.partition("_")[0]
    if quantity.rpartition("_")[2] == "force":
        return _BY_SPELLING["force"][force_unit]
    return next(iter(_BY_SPELLING[quantity].values()))


def _nearest(name: str, known: Iterable[str]) -> str:
    """Return the most similar known name, ignoring case, or ""."""
    by_lower = {key.lower(): key for key in known}
    found = difflib.get_close_matches(name.lower(), by_lower, n=1, cutoff=0.5)
    return by_lower[found[0]] if found else ""
