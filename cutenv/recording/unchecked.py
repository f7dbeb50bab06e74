"""Columns of a file of records as it states them, for a check of what may be wrong with them."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np

from cutenv.measurement.signal_faults import Readings
from cutenv.recording.column_map import ColumnMap
from cutenv.recording.files import tables_in
from cutenv.recording.importers import read_record
from cutenv.recording.schema import RecordError
from cutenv.recording.table import CutTable
from cutenv.trace import Trace


def readings_in(path: Path, mapping: ColumnMap | None = None) -> list[Readings]:
    """Return the columns of every record of a file, without tare, in the file's order.

    Of a file whose headers name quantity and unit they need not be a record: its clock may go back, and its force be of
    any size.

    Parameters
    ----------
    path : Path
        File of this package, or of another program.
    mapping : ColumnMap, optional
        Which column is what, for one of another program.

    Raises
    ------
    RecordError
        If it cannot be read.
    OSError
        If it cannot be opened.
    """
    if mapping is None:
        try:
            tables = tables_in(path)
        except RecordError:
            tables = []
        columns = [readings for table in tables for readings in _of_table(table)]
        if columns:
            return columns
    return [_of_trace(trace) for trace in read_record(path, mapping, search=None).records]


def _of_table(table: CutTable) -> list[Readings]:
    """Return the columns of each cut; none if a force must be computed first, or a cell is no number."""
    n = len(table.values[0])
    borders = [0, n] if table.cut is None else [0, *(np.flatnonzero(np.diff(table.cut)) + 1).tolist(), n]
    named = {column.of_trace: (column, values) for column, values in zip(table.columns, table.values, strict=True)}
    if "force" not in named or n < 2:
        return []
    found = []
    for number, (first, stop) in enumerate(itertools.pairwise(borders)):
        held = {
            name: column.to_si(values[first:stop])
            for name, (column, values) in named.items()
            if name in ("time", "force", "position", "speed") and not np.isnan(values[first:stop]).all()
        }
        if not {"time", "force"} <= held.keys() or not all(np.isfinite(values).all() for values in held.values()):
            return []
        facts = {**table.shared, **table.own.get(number, {})}
        found.append(Readings(**held, force_unit=named["force"][0].force_unit or "N", metadata=facts))
    return found


def _of_trace(trace: Trace) -> Readings:
    return Readings(
        time=trace.time, force=trace.force, position=trace.position, speed=trace.speed, force_unit=trace.force_unit,
        metadata=trace.metadata,
    )  # fmt: skip
