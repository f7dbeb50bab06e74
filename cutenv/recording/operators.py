"""Operator, group, session and order of each record of a study, from a table or from the records."""

from __future__ import annotations

import csv
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Any

from cutenv.recording.provenance import check_operator
from cutenv.recording.record_errors import RecordError

NEEDED = ("record", "operator")
OPTIONAL = ("group", "session", "order")
MARKS = "rater"
"""Beginning of the columns of marks, which are left alone unless they are asked for."""
_CURE = f"Give {' and '.join(NEEDED)}, and where the study has them {', '.join(OPTIONAL)}."


@dataclass(frozen=True, kw_only=True)
class OperatorRow:
    """Row of the table: the operator of a record.

    Attributes
    ----------
    record : str
        Name of the file, with or without its suffix; a file of several cuts is one row, or a row for each as ``name
        1``, ``name 2``.
    operator : str
        Anonymous code, such as "P07".
    group, session : str
        Group and session; "" if the table has no such column.
    order : float
        Number of the cut among all of its operator's, over all sessions; the row's place if the table has no such
        column.
    line : int
        Line in the file, from 1.
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
    """Read a table of operators: CSV with a row of headers, in UTF-8.

    Parameters
    ----------
    path : path
        File with the columns ``record`` and ``operator``, and if the study has them ``group``, ``session``, ``order``
        (a number).
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
    if not rows:
        raise RecordError(path, f"it has no rows below its headers. {_CURE}")
    _check_unique(path, rows)
    return rows


def recorded_operators(records: Sequence[Mapping[str, Any]]) -> list[OperatorRow]:
    """Return the operators that records name themselves, as a table would; the sessions are an operator's days.

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
        if records.setdefault(row.record, row.line) != row.line:
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
        if not text and name not in raters and not name.startswith(MARKS):
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
