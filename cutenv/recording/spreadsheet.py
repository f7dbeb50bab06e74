"""Workbooks of Excel and OpenDocument: each sheet is read as a text table is, a sheet of its own a record."""

from __future__ import annotations

import datetime
from collections.abc import Collection, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from cutenv._base.imports import optional_import
from cutenv.recording.array_tables import below_one_another
from cutenv.recording.csv_sniffer import sniff_table
from cutenv.recording.named_columns import NamedColumns
from cutenv.recording.schema import RecordError

WORKBOOKS = (".xlsx", ".xlsm", ".xlsb", ".xls", ".ods")
_OLD = b"\xd0\xcf\x11\xe0"  # first bytes of an Excel workbook before 2007
_FEWEST = 10  # rows of a table that is a record beside longer ones, and no list of results


def is_workbook(path: Path) -> bool:
    """Return whether a file is a workbook by its suffix; ``.xls`` by its first bytes: loggers call text so, too."""
    if path.suffix.lower() != ".xls":
        return path.suffix.lower() in WORKBOOKS
    with path.open("rb") as file:
        return file.read(4) in (_OLD, b"PK\x03\x04")


def read(path: Path, names: Collection[str] = ()) -> NamedColumns:
    """Read the tables of a workbook; `names` has no effect.

    The longest is read, and below it every other with the same columns: testing machines write a sheet for each
    specimen.

    Raises
    ------
    RecordError
        If it is no such file, or none of its sheets holds a table of numbers.
    ModuleNotFoundError
        If python-calamine is not installed; names the pip command.
    """
    calamine = optional_import("python_calamine", "python_calamine", "A workbook", extra="formats")
    try:
        workbook = calamine.CalamineWorkbook.from_path(str(path))
        found = {name: workbook.get_sheet_by_name(name) for name in workbook.sheet_names}
        sheets = {name: sheet.to_python(skip_empty_area=False) for name, sheet in found.items()}
    except Exception as error:  # the library raises errors of any kind for a damaged file
        reason = str(error).partition("\n")[0] or type(error).__name__
        raise RecordError(path, f"it is no workbook, or a damaged one ({reason}). Save it again.") from None
    tables, empty = {}, {}
    for name, rows in sheets.items():
        try:
            tables[name] = replace(sniff_table(path, _lines(rows)), row_name="row", about=f"sheet {name!r}")
        except RecordError as error:
            empty[name] = error.reason
    if not tables:
        told = "; ".join(f"{name!r}: {reason}" for name, reason in empty.items())
        raise RecordError(path, f"none of its sheets holds a table of numbers. {told}")
    main = max(tables, key=lambda name: len(tables[name]))
    alike = {
        name: table
        for name, table in tables.items()
        if name == main or (table.headers == tables[main].headers and len(table) >= _FEWEST)
    }
    others = [repr(name) for name in sheets if name not in alike and sheets[name]]
    notes = [f"sheets that are left out: {', '.join(others)}"] if others else []
    if len(alike) == 1:
        return replace(tables[main], notes=(*tables[main].notes, *notes))
    return below_one_another(path, f"{len(alike)} sheets", list(alike.items()), notes)


def _lines(rows: Sequence[Sequence[Any]]) -> list[str]:
    """Return rows of cells as lines with tabs."""
    return ["\t".join(map(_text, row)).rstrip() for row in rows]


def _text(cell: Any) -> str:
    if isinstance(cell, float):
        return f"{cell:.0f}" if cell.is_integer() and abs(cell) < 1e15 else repr(cell)
    if isinstance(cell, datetime.datetime | datetime.time):
        return cell.isoformat(sep=" ") if isinstance(cell, datetime.datetime) else cell.isoformat()
    return " ".join(str(cell).replace('"', "\u2033").split())
