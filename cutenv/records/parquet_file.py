"""Records as Parquet.

One table with units in the names of its columns, schema and metadata beside it.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cutenv._base.imports import optional_import
from cutenv.records.schema import (
    SCHEMA,
    as_mapping,
    as_names,
    check_schema,
    from_json,
    refusing_damage,
    shortened,
    to_json,
)
from cutenv.records.table import CUT_COLUMN, CutTable, parsed_headers, row_from_0, table_of
from cutenv.sim.trace import Trace

_SCHEMA_KEY, _FACTS_KEY = b"cutenv_schema", b"cutenv_cuts"
_MAX_METADATA_BYTES = 1 << 26  # bytes of names and metadata, so that a damaged length does not request all memory


def write(traces: Sequence[Trace], path: Path) -> None:
    """Write a new file; its pages carry checksums."""
    arrow, parquet = _libraries()
    table = table_of(traces)
    columns: dict[str, Any] = {}
    if table.cut is not None:
        columns[CUT_COLUMN] = arrow.array(table.cut.astype(np.int64))
    for header, values in zip(table.headers, table.values, strict=True):
        columns[header] = arrow.array(values, from_pandas=True)  # NaN, where a cut lacks a column, becomes null
    facts = {"metadata": table.shared, "metadata_of_cut": table.own, "columns_of_cut": table.held}
    noted = {_SCHEMA_KEY: SCHEMA, _FACTS_KEY: to_json(facts)}
    parquet.write_table(arrow.table(columns).replace_schema_metadata(noted), path, write_page_checksum=True)


def read(path: Path) -> list[CutTable]:
    """Read a file as one table; a ValueError names the column at fault."""
    arrow, parquet = _libraries()
    limits = dict.fromkeys(("thrift_string_size_limit", "thrift_container_size_limit"), _MAX_METADATA_BYTES)
    with (
        refusing_damage(path, "Parquet file"),
        parquet.ParquetFile(path, page_checksum_verification=True, **limits) as file,
    ):
        schema = file.schema_arrow
        names, notes = [name.strip() for name in schema.names], dict(schema.metadata or {})
        strange = [
            (name, str(kind))
            for name, kind in zip(names, schema.types, strict=True)
            if not (arrow.types.is_floating(kind) or arrow.types.is_integer(kind))
        ]
        # Numbers only: nothing else is unpacked, and no code of an extension type runs.
        read = None if strange else file.read(use_threads=False)
        # NaN for null
        values = [] if read is None else [np.asarray(column.to_numpy(), dtype=np.float64) for column in read.columns]
    columns = parsed_headers(names)
    for name, kind in strange:
        raise ValueError(f"column {name!r} holds {kind}, no numbers. Write it as float64.")
    facts = _facts(notes)
    return [
        CutTable.of(
            names,
            values,
            columns=columns,
            place=row_from_0,
            native=_SCHEMA_KEY in notes,
            shared=as_mapping("metadata", facts.get("metadata", {})),
            own=_by_cut(facts, "metadata_of_cut", as_mapping),
            held=_by_cut(facts, "columns_of_cut", as_names),
        )
    ]


def _facts(notes: dict[bytes, bytes]) -> Any:
    """Return the facts stored beside the table of cuts."""
    if _SCHEMA_KEY in notes:
        check_schema(notes[_SCHEMA_KEY].decode("utf-8", "replace"))
    name = _FACTS_KEY.decode()
    return as_mapping(name, from_json(name, notes.get(_FACTS_KEY, b"{}")))


def _by_cut(facts: Any, name: str, checked: Any) -> dict[int, Any]:
    """Return facts of single cuts by their number."""
    found = {}
    for number, fact in as_mapping(name, facts.get(name, {})).items():
        if not (number.isascii() and number.isdigit() and len(number) < 10):
            raise ValueError(f"{name} names cut {shortened(number)}, which is no number. Save the record again.")
        found[int(number)] = checked(f"{name} {number}", fact)
    return found


def _libraries() -> tuple[Any, Any]:
    return optional_import("pyarrow", "pyarrow", "Parquet"), optional_import("pyarrow.parquet", "pyarrow", "Parquet")
