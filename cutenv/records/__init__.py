"""Records of cuts: read from files, measured and scored.

A record is a :class:`~cutenv.sim.trace.Trace` in a file, of the simulator, a rig, a person or another program. Nothing
here sees the simulator: what is said of a record is the same wherever it was made.

- the modules of this package read and write the project's own files, CSV, Parquet, HDF5 and MCAP, with units in the
  headers (:func:`load`, :func:`save`); :func:`read_record` reads any record;
- :mod:`~cutenv.records.foreign`: files and streams of other programs;
- :mod:`~cutenv.records.measurement`: modulus, fracture resistance and depth from recorded cuts, calibration of a
  tissue;
- :mod:`~cutenv.records.scoring`: the score of a cut, studies and pass marks.

May import: sim. Of that the law and the plants stay unseen.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from cutenv._base.imports import import_when_used

if TYPE_CHECKING:
    from cutenv.records.appending import AppendingRecord, RecordingFailed
    from cutenv.records.csv_file import read_metadata
    from cutenv.records.files import load, load_one, save
    from cutenv.records.foreign.column_map import ColumnMap
    from cutenv.records.foreign.cut_detection import CutSearch
    from cutenv.records.importers import Imported, load_foreign, read_record
    from cutenv.records.provenance import OperatorRow, Provenance, TissueHandling, load_operators, recorded_operators
    from cutenv.records.schema import SCHEMA, UNITS, Column, RecordError, header_of, parse_header

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
    "foreign",
    "header_of",
    "load",
    "load_foreign",
    "load_one",
    "load_operators",
    "measurement",
    "parse_header",
    "read_metadata",
    "read_record",
    "recorded_operators",
    "save",
    "scoring",
]

# An environment scores its cuts: it needs the score, but no file.
__getattr__ = import_when_used(
    __name__,
    {
        "SCHEMA": "cutenv.records.schema",
        "UNITS": "cutenv.records.schema",
        "AppendingRecord": "cutenv.records.appending",
        "Column": "cutenv.records.schema",
        "ColumnMap": "cutenv.records.foreign.column_map",
        "CutSearch": "cutenv.records.foreign.cut_detection",
        "Imported": "cutenv.records.importers",
        "OperatorRow": "cutenv.records.provenance",
        "Provenance": "cutenv.records.provenance",
        "RecordError": "cutenv.records.schema",
        "RecordingFailed": "cutenv.records.appending",
        "TissueHandling": "cutenv.records.provenance",
        "header_of": "cutenv.records.schema",
        "load": "cutenv.records.files",
        "load_foreign": "cutenv.records.importers",
        "load_one": "cutenv.records.files",
        "load_operators": "cutenv.records.provenance",
        "parse_header": "cutenv.records.schema",
        "read_metadata": "cutenv.records.csv_file",
        "read_record": "cutenv.records.importers",
        "recorded_operators": "cutenv.records.provenance",
        "save": "cutenv.records.files",
    },
    ("foreign", "measurement", "scoring"),
)
