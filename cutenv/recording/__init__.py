"""Records of cuts as files: CSV, Parquet and HDF5 with units in the headers, and other programs' tables."""

from __future__ import annotations

from cutenv.recording.columns import UNITS, Column, header_of, parse_header
from cutenv.recording.cuts import CutSearch
from cutenv.recording.errors import RecordError
from cutenv.recording.files import load, load_one, save
from cutenv.recording.foreign import Imported, load_foreign
from cutenv.recording.mapping import ColumnMap
from cutenv.recording.operators import OperatorRow, load_operators
from cutenv.recording.provenance import Provenance
from cutenv.recording.record import read_record
from cutenv.recording.schema import SCHEMA

__all__ = [
    "SCHEMA",
    "UNITS",
    "Column",
    "ColumnMap",
    "CutSearch",
    "Imported",
    "OperatorRow",
    "Provenance",
    "RecordError",
    "header_of",
    "load",
    "load_foreign",
    "load_one",
    "load_operators",
    "parse_header",
    "read_record",
    "save",
]
