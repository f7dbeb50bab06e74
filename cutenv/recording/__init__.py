"""Records of cuts as files.

CSV, Parquet and HDF5 with units in the headers, and other programs' tables.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from cutenv._base.imports import import_when_used
from cutenv.recording.appending import AppendingRecord, RecordingFailed
from cutenv.recording.csv_file import read_metadata
from cutenv.recording.files import load, load_one, save
from cutenv.recording.provenance import OperatorRow, Provenance, TissueHandling, load_operators, recorded_operators
from cutenv.recording.schema import SCHEMA, UNITS, Column, RecordError, header_of, parse_header

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
__getattr__ = import_when_used(
    __name__,
    {
        "ColumnMap": "cutenv.recording.column_map",
        "CutSearch": "cutenv.recording.cut_detection",
        "Imported": "cutenv.recording.importers",
        "load_foreign": "cutenv.recording.importers",
        "read_record": "cutenv.recording.importers",
    },
)
