"""Records of cuts as files: CSV, Parquet and HDF5 with units in the headers, and other programs' tables."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from cutenv.recording.appending import AppendingRecord, RecordingFailed
from cutenv.recording.columns import UNITS, Column, header_of, parse_header
from cutenv.recording.csv_file import read_metadata
from cutenv.recording.files import load, load_one, save
from cutenv.recording.operators import OperatorRow, load_operators, recorded_operators
from cutenv.recording.provenance import Provenance, TissueHandling
from cutenv.recording.record_errors import RecordError
from cutenv.recording.schema import SCHEMA

if TYPE_CHECKING:
    from cutenv.recording.column_map import ColumnMap
    from cutenv.recording.cut_detection import CutSearch
    from cutenv.recording.importers import Imported, load_foreign, read_record

__all__ = [
    "SCHEMA",
    "UNITS",
    "AppendingRecord",
    "Column",
    "ColumnMap",
    "CutSearch",
    "Imported",
    "OperatorRow",
    "Provenance",
    "RecordError",
    "RecordingFailed",
    "TissueHandling",
    "header_of",
    "load",
    "load_foreign",
    "load_one",
    "load_operators",
    "parse_header",
    "read_metadata",
    "read_record",
    "recorded_operators",
    "save",
]

# These judge records and need the measurement code, with the tissue's model; loading alone does not wait for that.
_WHEN_USED = {
    "ColumnMap": "column_map",
    "CutSearch": "cut_detection",
    "Imported": "importers",
    "load_foreign": "importers",
    "read_record": "importers",
}


def __getattr__(name: str) -> Any:
    if name not in _WHEN_USED:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_WHEN_USED[name]}"), name)
