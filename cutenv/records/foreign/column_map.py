"""Mapping of a foreign file's columns to fields of a trace."""

from __future__ import annotations

import csv
import dataclasses
import json
import os
import re
import shlex
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from cutenv._base.output import atomic_write
from cutenv._base.validation import in_range, one_of
from cutenv.records.foreign.stated_units import unit_of_field
from cutenv.records.schema import UNITS, Column, RecordError
from cutenv.sim.tissue.description import checked_fields

MAP_SCHEMA = "cutenv-columns/1"

MAP_FILE = "cutenv-columns.json"  # name of a mapping's file, beside the files that it is for
_SET_BY_HAND = ("speed", "angle", "depth")  # fields that may be one number for the whole record
_NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"

USUAL_UNITS = {"time": "ms", "position": "mm", "speed": "mm/s", "angle": "deg", "depth": "mm"}
"""Unit of each field in most files, for examples in messages."""


@dataclass(frozen=True, kw_only=True)
class Expression:
    """Source of a field.

    A column, its opposite, the norm of several, or one number set by hand.
    """

    columns: tuple[str, ...] = ()  # names in the file, or places such as ``#2``; empty if the field is a number
    is_norm: bool = False  # true if the field is the root of the sum of the columns' squares
    sign: float = 1.0  # factor of the field; 1.0, -1.0
    value: float | None = None  # number set by hand, in `unit`
    unit: str | None = None  # unit as given, a key of ``UNITS[field]``; None to use the one in the file's header


@dataclass(frozen=True, kw_only=True)
class ColumnMap:
    """Mapping from a file's columns to a trace's fields.

    Each field is an expression in text: a column's name (``Kraft``), its opposite (``-Fx``), the norm of components
    (``norm(Fx,Fy,Fz)``), or a value set by hand (``90deg``, ``20mm``; speed, angle and depth only). A column may be
    named by its place (``#2`` is the second), and in quotation marks if its name contains a comma, a bracket or a
    leading minus. The unit follows in brackets (``t[ms]``); without it, the one in the file's header is used.

    Parameters
    ----------
    force : str
        Force along the cut, positive against forward motion. A norm has no sign: on a way back friction would count as
        resistance.
    position, speed, angle, depth : str, optional
        As in :class:`cutenv.sim.trace.Trace`.
    unit : str, optional
        Unit of the force: "N", "mN", "kN", "gf", "kgf", "lbf", or "1" for a normalised one.
    rate : float, optional
        Readings a second [Hz], 1 to 1e6, for a file without time.
    split_by : tuple of str
        Columns (``trial``, ``cut``) whose values separate the rows into records.

    Raises
    ------
    ValueError
        If an expression is invalid, a unit is unknown, or both or neither of `time` and `rate` are given.

    Examples
    --------
    >>> mapping = ColumnMap.parse(["time=t", "force=norm(Fx,Fy,Fz)", "angle=90deg"], unit="N")
    >>> mapping.expression("force").columns
    ('Fx', 'Fy', 'Fz')
    """

    force: str
    time: str | None = None
    position: str | None = None
    speed: str | None = None
    angle: str | None = None
    depth: str | None = None
    unit: str | None = None
    rate: float | None = None
    split_by: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if (self.time is None) == (self.rate is None):
            raise ValueError("give one of time (a column, time=t) and rate (readings a second, rate=1000Hz).")
        if self.rate is not None:
            in_range("rate", self.rate, 1.0, 1e6, "Hz", "Give readings a second.")
        if self.unit is not None:
            object.__setattr__(self, "unit", known_unit("force", self.unit))
        if isinstance(self.split_by, str) or not all(isinstance(name, str) and name for name in self.split_by):
            raise ValueError(f"split_by must be names of columns, got {self.split_by!r}.")
        object.__setattr__(self, "split_by", tuple(self.split_by))
        for field in self.fields:
            self.expression(field)
        if self.unit and parse_expression("force", self.force).unit not in (None, self.unit):
            raise ValueError(f"the unit of force is said twice: {self.force!r} and unit {self.unit!r}. Leave one out.")

    @property
    def fields(self) -> tuple[str, ...]:
        """Names of the mapped fields of a trace."""
        return tuple(field for field in UNITS if getattr(self, field) is not None)

    def expression(self, field: str) -> Expression:
        """Return the expression of a field; one that is not mapped is a ValueError."""
        text = getattr(self, one_of("field", field, UNITS))
        if text is None:
            raise ValueError(f"{field} is not mapped; mapped are {', '.join(self.fields)}.")
        expression = parse_expression(field, text)
        if field == "force" and self.unit:
            return dataclasses.replace(expression, unit=self.unit)
        return expression

    @classmethod
    def parse(cls, items: Iterable[str], *, unit: str | None = None) -> ColumnMap:
        """Parse a mapping from the command line.

        The items are ``field=expression`` each; also ``rate=1000Hz`` (or kHz) and ``split_by=trial,cut``. One that is
        invalid, names no field or a field twice is a ValueError, or as in :class:`ColumnMap`.
        """
        given: dict[str, str] = {}
        for item in items:
            name, equals, text = (part.strip() for part in item.partition("="))
            if not (equals and text):
                raise ValueError(f"{item!r} maps nothing. Write field=column, such as time=t.")
            one_of("field", name, (*UNITS, "rate", "split_by"))
            if name in given:
                raise ValueError(f"{name} is mapped twice: {given[name]!r} and {text!r}. Leave one out.")
            given[name] = text
        rate = _rate(given.pop("rate")) if "rate" in given else None
        split_by = tuple(_names(given.pop("split_by", "")))
        if "force" not in given:
            raise ValueError("force is not mapped. Write force=column, or force=norm(Fx,Fy,Fz).")
        return cls(**given, unit=unit, rate=rate, split_by=split_by)

    def __str__(self) -> str:
        """Command line options, such as ``--map time=t force=F --unit N``."""
        items = {field: getattr(self, field) for field in self.fields}
        if self.rate is not None:
            items["rate"] = f"{self.rate:.10g}Hz"
        if self.split_by:
            items["split_by"] = ",".join(self.split_by)
        return options_text(items | ({} if self.unit is None else {"unit": self.unit}))

    def to_json(self) -> str:
        """Return JSON text from which :meth:`from_json` restores the mapping."""
        return json.dumps({"schema": MAP_SCHEMA, **dataclasses.asdict(self)}, indent=1) + "\n"

    @classmethod
    def from_json(cls, text: str) -> ColumnMap:
        """Parse the text of :meth:`to_json`.

        Another schema, an unknown or a missing field is a ValueError, or as in :class:`ColumnMap`.
        """
        content = checked_fields(text, MAP_SCHEMA, {field.name for field in dataclasses.fields(cls)})
        for name, value in content.items():
            kinds = {"rate": (int, float), "split_by": (list,)}.get(name, (str,))
            if type(value) not in (*kinds, type(None)) or (value is None and name in ("force", "split_by")):
                raise ValueError(f"{name} = {value!r} is not what a mapping holds.")
        return cls(**content | {"split_by": tuple(content["split_by"])})

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write the mapping as JSON, named :data:`MAP_FILE` in folders; return path."""
        path = Path(path)
        path = path / MAP_FILE if path.is_dir() else path
        with atomic_write(path) as part:
            part.write_text(self.to_json(), encoding="utf-8")
        return path

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> ColumnMap:
        """Read a saved mapping from its file or folder.

        A file not written by :meth:`save` is a RecordError.
        """
        path = Path(path)
        path = path / MAP_FILE if path.is_dir() else path
        try:
            return cls.from_json(path.read_text(encoding="utf-8"))
        except (ValueError, RecursionError) as error:  # including bytes that are not UTF-8
            raise RecordError(path, f"no mapping of columns: {error}") from None


def options_text(items: Mapping[str, str]) -> str:
    """Return command line options for a mapping's items.

    The item "unit" is the unit of the force.
    """
    order = ("time", "rate", *(field for field in UNITS if field != "time"), "split_by")
    fields = [shlex.quote(f"{name}={items[name]}") for name in order if name in items]
    unit = f" --unit {items['unit']}" if "unit" in items else ""
    return f"--map {' '.join(fields)}{unit}"


def known_unit(field: str, unit: str) -> str:
    """Return the spelling in ``UNITS[field]`` of a unit as written."""
    return unit_of_field(field, unit) or one_of(f"unit of {field}", unit.strip(), UNITS[field])


def column_of(field: str, unit: str) -> Column:
    """Return a field's column that converts a unit to SI."""
    return Column(field=field, axis=None, unit=unit)


def parse_expression(field: str, text: str) -> Expression:
    """Parse one expression of a :class:`ColumnMap`."""
    if not isinstance(text, str) or not text.strip():
        raise ValueError(f"{field} = {text!r} is no expression. Write a column's name.")
    body = text.strip()
    unit = None
    if (behind := re.fullmatch(r"(.*?)\s*\[([^\[\]]*)\]", body)) is not None:
        body, unit = behind[1], known_unit(field, behind[2])
    if (by_hand := re.fullmatch(rf"({_NUMBER})\s*([^\d\s.].*)?", body)) is not None:
        return _set_by_hand(field, text, float(by_hand[1]), unit, by_hand[2])
    sign = 1.0
    if body.startswith("-"):
        sign, body = -1.0, body[1:].strip()
    if (norm := re.fullmatch(r"norm\s*\((.*)\)", body, flags=re.IGNORECASE)) is not None:
        names = _names(norm[1])
        if field != "force" or not names:
            raise ValueError(f"{field} = {text!r}: a norm is made of force's components, as in force=norm(Fx,Fy,Fz).")
        return Expression(columns=names, is_norm=True, sign=sign, unit=unit)
    names = _names(body) if body.startswith('"') else (body,)
    if len(names) != 1 or not names[0]:
        raise ValueError(f'{field} = {text!r} is no column, norm(a,b,c) or number with unit. Quote odd names: "a,b".')
    return Expression(columns=names, sign=sign, unit=unit)


def _set_by_hand(field: str, text: str, value: float, unit: str | None, behind: str | None) -> Expression:
    if field not in _SET_BY_HAND:
        raise ValueError(
            f"{field} = {text!r} is a number, but {field} is measured at every instant. Name a column; in "
            'quotation marks if its name is a number, or by its place: "#2".'
        )
    if unit is None:
        if behind is None:
            raise ValueError(
                f"{field} = {text!r} has no unit. Write one behind it, such as {text}{USUAL_UNITS[field]}."
            )
        unit = known_unit(field, behind)
    elif behind is not None:
        raise ValueError(f"{field} = {text!r} has two units. Leave one out.")
    return Expression(value=value, unit=unit)


def _names(text: str) -> tuple[str, ...]:
    """Return comma-separated names; quoted ones may contain commas."""
    if not text.strip():
        return ()
    (cells,) = csv.reader([text.replace("\n", " ").replace("\r", " ")], skipinitialspace=True)
    return tuple(cell.strip() for cell in cells)


def _rate(text: str) -> float:
    found = re.fullmatch(rf"({_NUMBER})\s*(Hz|kHz)", text.strip())
    if found is None:
        raise ValueError(f"rate = {text!r} is no number of readings a second. Write rate=1000Hz, or rate=1kHz.")
    return float(found[1]) * (1000.0 if found[2] == "kHz" else 1.0)
