"""Records of cuts as files: CSV, Parquet and HDF5, with units in the headers, losslessly."""

from __future__ import annotations

from cutenv.recording.columns import UNITS, Column, header_of, parse_header
from cutenv.recording.errors import RecordError
from cutenv.recording.files import load, load_one, save
from cutenv.recording.provenance import Provenance
from cutenv.recording.schema import SCHEMA

__all__ = [
    "SCHEMA",
    "UNITS",
    "Column",
    "Provenance",
    "RecordError",
    "header_of",
    "load",
    "load_one",
    "parse_header",
    "save",
]
