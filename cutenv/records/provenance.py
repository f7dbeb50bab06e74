"""Provenance of a record.

Rig, sensor, blade, specimen, day, consent, calibration; operator, group, session, order.
"""

from __future__ import annotations

import csv
import json
import math
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from datetime import datetime
from pathlib import Path
from typing import Any

from cutenv._base.validation import in_range, one_of
from cutenv.records.schema import RecordError, to_json

_TEXTS = ("rig", "sensor", "blade", "specimen")
_MAX_CHARACTERS = 500  # characters
_ROLES = "operator|participant|subject|surgeon|student|trainee|resident|novice|expert|person|user"
# A few letters and a number, a role and a number, or the beginning of a hash: too short for a name.
_CODE = re.compile(
    rf"[a-z]{{0,3}}[-_]?[0-9]{{1,6}}[a-z]?|(?:{_ROLES})[-_]?[0-9]{{1,6}}|(?=.*[0-9])(?=.*[a-f])[0-9a-f]{{8,64}}",
    re.IGNORECASE,
)


@dataclass(frozen=True, kw_only=True)
class TissueHandling:
    """Handling of tissue before and during its cuts.

    Unknown parts are None.

    Parameters
    ----------
    hours_post_mortem : float, optional
        Time from death to the cut [h], 0 to 1000.
    temperature_C : float, optional
        Temperature at the cut, -5 to 60.
    preconditioning_cycles : int, optional
        Loading cycles before the cut, 0 for none.
    capsule : {"kept", "removed"}, optional
        The organ's capsule.

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
        """Known parts, as metadata of a :class:`cutenv.sim.trace.Trace`."""
        known = {part.name: getattr(self, part.name) for part in fields(self)}
        if self.handling is not None:
            known["handling"] = {name: value for name, value in asdict(self.handling).items() if value is not None}
        return {name: value for name, value in known.items() if value is not None}

    @classmethod
    def from_metadata(cls, metadata: Mapping[str, Any]) -> Provenance:
        """Make the provenance from its parts of a trace's metadata."""
        known = {part.name: metadata[part.name] for part in fields(cls) if part.name in metadata}
        if isinstance(known.get("handling"), Mapping):
            for name in known["handling"]:
                one_of("handling", name, [part.name for part in fields(TissueHandling)])
            known["handling"] = TissueHandling(**known["handling"])
        return cls(**known)

    def __repr__(self) -> str:
        return f"Provenance({', '.join(f'{name}={value!r}' for name, value in self.metadata.items())})"


def check_operator(code: object) -> None:
    """Raise an error for a code that may identify the operator.

    It looks like a name, a mail address, a telephone number or a date of birth.
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
    if not value.strip() or len(value) > _MAX_CHARACTERS:
        raise ValueError(f"{name} must be a text of 1 to {_MAX_CHARACTERS} characters; leave out what is not known.")


def _check_date(value: object) -> None:
    if not isinstance(value, str):
        raise TypeError(f"date must be text such as '2026-03-01', got {value!r}; a date has .isoformat().")
    try:
        datetime.fromisoformat(value)
    except ValueError:
        raise ValueError(f"date {value!r} is none in ISO 8601. Write it as '2026-03-01'.") from None


def _json_copy(calibration: object) -> Mapping[str, Any]:
    """Return the mapping as restored from a file."""
    if not isinstance(calibration, Mapping):
        raise TypeError(f'calibration must map names to values ({{"gain_N_per_V": 5.0}}), got {calibration!r}.')
    try:
        copy: Mapping[str, Any] = json.loads(to_json(dict(calibration)))
    except (TypeError, ValueError) as error:
        raise TypeError(f"calibration {calibration!r} is not what JSON can hold: {error}.") from None
    return copy


NEEDED = ("record", "operator")
OPTIONAL = ("group", "session", "order")
MARKS = "rater"  # beginning of the columns of marks, which are left alone unless they are asked for
_CURE = f"Give {' and '.join(NEEDED)}, and where the study has them {', '.join(OPTIONAL)}."


@dataclass(frozen=True, kw_only=True)
class OperatorRow:
    """Row of the table: the operator of a record.

    Attributes
    ----------
    record : str
        Name of the file, with or without its suffix; a file of several cuts is one row, or a row for each as ``name
        1``, ``name 2``. "" is a cut that was begun and left, which has no record.
    operator : str
        Anonymous code, such as "P07".
    group, session : str
        Group and session; "" if the table has no such column.
    order : float
        Number of the cut among all of its operator's, over all sessions; the row's place if the table has no such
        column.
    marks : mapping of str to float
        Mark of the record by each rater who gave one.
    """

    record: str
    operator: str
    group: str
    session: str
    order: float
    line: int
    marks: Mapping[str, float] = field(default_factory=dict)


def load_operators(path: str | os.PathLike[str], *, raters: Sequence[str] = ()) -> list[OperatorRow]:
    """Read a table of operators from CSV in UTF-8.

    Parameters
    ----------
    path : path
        File with the columns ``record`` and ``operator``, and if the study has them ``group``, ``session``, ``order``
        (a number). A row without a record is a cut that was begun and left.
    raters : sequence of str
        Columns with the marks of one rater each: a number, or nothing where the rater gave none. Other columns that
        begin with "rater" are left alone.

    Returns
    -------
    list of OperatorRow
        Rows in the order of the file.

    Raises
    ------
    RecordError
        If columns are missing, unknown or repeated, a cell is empty or not a code, or a record or an operator's order
        is repeated; names line and cure.
    FileNotFoundError
        If there is no such file.
    """
    path = Path(path)
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            first = file.readline()
            # A spreadsheet whose decimal sign is the comma separates cells by semicolons.
            separator = ";" if ";" in first and "," not in first else ","
            file.seek(0)
            reader = csv.reader(file, delimiter=separator)
            headers = [cell.strip().lower() for cell in next(reader, [])]
            marked = tuple(rater.strip().lower() for rater in raters)
            _check_headers(path, headers, marked)
            rows = [
                _row(path, reader.line_num, headers, [cell.strip() for cell in cells], marked)
                for cells in reader
                if any(cell.strip() for cell in cells)
            ]
    except FileNotFoundError:
        raise FileNotFoundError(f"no such table of operators: {path}. Give a CSV file, or leave it out.") from None
    except UnicodeDecodeError:
        raise RecordError(path, "it is not text in UTF-8. Save it as CSV in UTF-8.") from None
    except csv.Error as error:
        raise RecordError(path, f"it is no table ({error}). Save it as CSV in UTF-8.") from None
    if not any(row.record for row in rows):
        raise RecordError(path, f"it has no rows below its headers. {_CURE}")
    _check_unique(path, rows)
    return rows


def recorded_operators(records: Sequence[Mapping[str, Any]]) -> list[OperatorRow]:
    """Return operators named in records, as from a table.

    The sessions are an operator's days.

    Parameters
    ----------
    records : sequence of mapping
        Metadata of each record; "operator" is needed. With a "date" in every record they are in order of time, and
        without they stay in the order given, as one session.

    Raises
    ------
    ValueError
        If a record names no operator; lists these records.
    """
    names = [str(each.get("name", number)) for number, each in enumerate(records, 1)]
    without = [name for name, each in zip(names, records, strict=True) if not each.get("operator")]
    if without:
        raise ValueError(f"no operator is named in {', '.join(without)}; give a table of operators.")
    dates = [str(each.get("date") or "") for each in records]
    times = [datetime.fromisoformat(date).timestamp() for date in dates] if all(dates) else range(len(records))
    days: dict[str, set[str]] = {}
    for each, date in zip(records, dates, strict=True):
        days.setdefault(each["operator"], set()).add(date[:10])
    return [
        OperatorRow(
            record=name,
            operator=each["operator"],
            group="",
            session=str(1 + sorted(days[each["operator"]]).index(date[:10])) if all(dates) else "",
            order=time,
            line=line,
        )
        for line, (name, each, date, time) in enumerate(zip(names, records, dates, times, strict=True), 1)
    ]


def _check_unique(path: Path, rows: list[OperatorRow]) -> None:
    records: dict[str, int] = {}
    places: dict[tuple[str, float], int] = {}
    for row in rows:
        if row.record and records.setdefault(row.record, row.line) != row.line:
            raise RecordError(
                path, f"record {row.record!r} stands in line {records[row.record]} and in line {row.line}; keep one."
            )
        other = places.setdefault((row.operator, row.order), row.line)
        if other != row.line:
            raise RecordError(
                path,
                f"operator {row.operator} has order {row.order:g} in line {other} and in line {row.line}. Number all "
                "of an operator's cuts on, from session to session.",
            )


def _check_headers(path: Path, headers: list[str], raters: tuple[str, ...]) -> None:
    missing = [name for name in (*NEEDED, *raters) if name not in headers]
    known = (*NEEDED, *OPTIONAL, *raters)
    unknown = [name for name in headers if name not in known and not name.startswith(MARKS)]
    if missing or unknown or len(set(headers)) < len(headers):
        wrong = [f"lacks {', '.join(missing)}"] * bool(missing)
        wrong += [f"has unknown columns {', '.join(map(repr, unknown))}"] * bool(unknown)
        wrong += ["has a column twice"] * (not wrong)
        raise RecordError(path, f"its header {','.join(headers)!r} {' and '.join(wrong)}. {_CURE}")


def _row(path: Path, line: int, headers: list[str], cells: list[str], raters: tuple[str, ...]) -> OperatorRow:
    if len(cells) != len(headers):
        raise RecordError(path, f"line {line} has {len(cells)} cells for {len(headers)} columns.")
    cell = dict(zip(headers, cells, strict=True))
    for name, text in cell.items():
        if not text and name != "record" and name not in raters and not name.startswith(MARKS):
            raise RecordError(path, f"line {line} has no {name}. Fill it in, or leave the column out for all.")
    try:
        check_operator(cell["operator"])
    except ValueError as error:
        raise RecordError(path, f"line {line}: {error}") from None
    return OperatorRow(
        record=cell["record"],
        operator=cell["operator"],
        group=cell.get("group", ""),
        session=cell.get("session", ""),
        order=_number(path, line, "order", cell.get("order", str(line)), "Give the cut's place: 1, 2, 3, ..."),
        line=line,
        marks={
            rater: _number(path, line, rater, cell[rater].replace(",", "."), "Give a mark, or nothing.")
            for rater in raters
            if cell[rater]
        },
    )


def _number(path: Path, line: int, name: str, text: str, cure: str) -> float:
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        raise RecordError(path, f"line {line}: {name} {text!r} is no number. {cure}")
    return number
