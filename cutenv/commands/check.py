"""Check records of force: each fault with place, certainty and cure."""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from cutenv.commands.options import command_parser, reports_errors

if TYPE_CHECKING:
    from cutenv.records.measurement.signal_faults import Fault, Readings


@reports_errors("check")
def main(argv: Sequence[str]) -> int:
    """Check records; return 0 (sound), 1 (not), 2 (bad input)."""
    arguments = _parser().parse_args(argv)
    from cutenv.commands.inputs import given_mapping, record_files
    from cutenv.records import RecordError
    from cutenv.records.importers import readings_in
    from cutenv.records.scoring.record_check import record_faults

    mapping = given_mapping(arguments)
    told: list[dict[str, object]] = []
    for path in record_files(arguments):
        try:
            records = readings_in(path, mapping)
        except RecordError as error:
            told.append({"file": str(path), "unreadable": error.reason})
            if not arguments.json:
                print(f"{path}: unreadable: {error.reason}")
            continue
        for number, readings in enumerate(records, 1):
            faults = record_faults(readings)
            name = f"{path}" if len(records) == 1 else f"{path}, cut {number}"
            told.append({"file": str(path), "cut": number, "faults": [_as_json(each, readings) for each in faults]})
            if not arguments.json:
                lines = [f"{name}: {_line(each, readings)}" for each in faults]
                print("\n".join(lines or [f"{name}: sound, {len(readings)} readings"]))
    if arguments.json:
        print(json.dumps({"records": told}, indent=1, ensure_ascii=False))
    return int(any(each.get("faults") or "unreadable" in each for each in told))


def _line(fault: Fault, readings: Readings) -> str:
    first, last = fault.rows
    rows = f"row {first + 1}" if first == last else f"rows {first + 1} to {last + 1}"
    where = "throughout" if fault.rows == readings.all_rows else f"{rows}, from {readings.time[first]:.4g} s"
    return f"{fault.kind} ({fault.sure}), {where}: {fault.seen.rstrip('.')}. {fault.cure}"


def _as_json(fault: Fault, readings: Readings) -> dict[str, object]:
    first, last = fault.rows
    return {
        "kind": fault.kind,
        "sure": fault.sure,
        "rows": [first + 1, last + 1],
        "time_s": [float(readings.time[first]), float(readings.time[last])],
        "seen": fault.seen,
        "cure": fault.cure,
    }


def _parser() -> argparse.ArgumentParser:
    parser = command_parser(
        "check",
        __doc__,
        examples=("cut.csv", "cuts --json", "trial.txt --map time=t force=Fx position=x[mm] --unit N"),
        note="Rows are counted from 1, without the header. The exit status is 1 if a record is not sound.\n"
        "Which faults are known, and how well they are found: page 'Faults of records'.",
    )
    add = parser.option
    add("records FILE", "records of force, or folders of them", Path, nargs="+")
    add(
        "--map FIELD=COLUMN",
        "which column of another program's file is what: time=t force=Fx position=x[mm]",
        nargs="+",
    )
    add("--unit UNIT", "unit of the force in such a file: N, mN, kN, gf, kgf, lbf, or 1")
    add("--json", "print everything as JSON, for programs")
    return parser
