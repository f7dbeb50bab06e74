"""Reading of any record, native or foreign, with its flaws: one function for every consumer of records."""

from __future__ import annotations

import os
from pathlib import Path

from cutenv.measurement import quality_issues
from cutenv.recording.column_map import MAP_FILE, ColumnMap
from cutenv.recording.csv_file import is_own
from cutenv.recording.csv_sniffer import sniff_table
from cutenv.recording.cut_detection import STANDARD, CutSearch, FoundCut
from cutenv.recording.files import load
from cutenv.recording.importers import Imported, how_to_map, load_foreign
from cutenv.recording.record_errors import RecordError

_NAMED_INSIDE = (".parquet", ".h5", ".hdf5")  # formats that need no mapping


def read_record(
    path: str | os.PathLike[str], mapping: ColumnMap | None = None, *, search: CutSearch | None = STANDARD
) -> Imported:
    """Read the cuts of a file that this package or another program wrote, and check them.

    A file whose headers name quantity and unit (:func:`cutenv.recording.load`) needs no mapping; its cuts are used as
    they are. Any other text file is read by :func:`cutenv.recording.importers.load_foreign`, through `mapping` or the
    one saved beside it.

    Parameters
    ----------
    path : path
        Path of the record.
    mapping : ColumnMap, optional
        Mapping of its columns.
    search : CutSearch or None
        Criteria for cuts in a foreign record. None: neither tare nor split.

    Returns
    -------
    Imported
        Its `sound` holds the cuts to calculate with.

    Raises
    ------
    RecordError
        If the file cannot be read: names place, reason and cure.
    OSError
        If the file cannot be opened.
    ModuleNotFoundError
        If the format's library is not installed; the message gives the pip command.
    """
    path = Path(path)
    is_text = path.suffix.lower() not in _NAMED_INSIDE
    if mapping is not None and not is_text:
        raise RecordError(path, "a mapping is for text files; here the names of the columns define them. Leave it out.")
    if mapping is not None:
        return load_foreign(path, mapping, search=search)
    try:
        traces = tuple(load(path))
    except RecordError as error:
        if not is_text or is_own(path):
            raise
        if (path.parent / MAP_FILE).is_file():
            return load_foreign(path, search=search)
        try:
            table = sniff_table(path)
        except RecordError:  # no table of numbers either
            raise error from None
        cure = "if another program wrote it, leave it as it is and name its columns, as at the end of this message."
        own = f"(Cutenv's own format it is not: {error.reason})"
        raise RecordError(path, f"{cure} {own} {how_to_map(table)}") from None
    return Imported(
        path=path,
        mapping=None,
        records=traces,
        tared=traces,
        cuts=tuple((FoundCut(start=0, stop=len(trace)),) for trace in traces),
        traces=traces,
        flaws=tuple(quality_issues(trace) for trace in traces),
        notes=(f"{path.name}: {len(traces)} cut{'' if len(traces) == 1 else 's'}, as recorded.",),
    )
