"""Records of cuts as files: CSV, Parquet and HDF5, with units in the headers, losslessly."""

from __future__ import annotations

from cutenv.recording.columns import UNITS, Column, parse_header
from cutenv.recording.errors import RecordError

__all__ = ["UNITS", "Column", "RecordError", "parse_header"]
