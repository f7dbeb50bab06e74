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
_MODULES = {
    "cutenv.records.schema": ("SCHEMA", "UNITS", "Column", "RecordError", "header_of", "parse_header"),
    "cutenv.records.appending": ("AppendingRecord", "RecordingFailed"),
    "cutenv.records.foreign.column_map": ("ColumnMap",),
    "cutenv.records.foreign.cut_detection": ("CutSearch",),
    "cutenv.records.importers": ("Imported", "load_foreign", "read_record"),
    "cutenv.records.provenance": (
        "OperatorRow",
        "Provenance",
        "TissueHandling",
        "load_operators",
        "recorded_operators",
    ),
    "cutenv.records.files": ("load", "load_one", "save"),
    "cutenv.records.csv_file": ("read_metadata",),
}
__getattr__ = import_when_used(
    __name__,
    {name: module for module, names in _MODULES.items() for name in names},
    ("foreign", "measurement", "scoring"),
)
