"""Convert records of cuts to CSV, Parquet, HDF5, or MCAP for ROS.

Cutenv's own files keep every number, cut and metadata. Files and bags of other programs are read by --map; without
--cuts each record stays whole and its force as it was.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from cutenv.commands.options import command_parser, made_place, reports_errors


@reports_errors("convert")
def main(argv: Sequence[str]) -> int:
    """Convert records; return 0, or 2 on bad input."""
    arguments = _parser().parse_args(argv)
    from cutenv.commands.inputs import given_mapping
    from cutenv.records import read_record, save
    from cutenv.records.files import format_of
    from cutenv.records.foreign.cut_detection import STANDARD

    format_of(arguments.out)
    if arguments.out.exists() and not arguments.force:
        raise ValueError(f"--out {arguments.out} exists; give another name, or --force to replace it.")
    mapping = given_mapping(arguments)
    made_place("--out", arguments.out)
    traces = []
    for path in arguments.records:
        imported = read_record(path, mapping, search=STANDARD if arguments.cuts else None)
        kept = imported.traces if arguments.cuts else imported.records
        traces += [trace.with_metadata({"name": path.stem, **trace.metadata}) for trace in kept]
        for note in imported.notes:
            print(f"note: {note}", file=sys.stderr)
    save(traces, arguments.out)
    readings = sum(map(len, traces))
    print(f"{len(traces)} record{'s' * (len(traces) != 1)}, {readings} readings: {arguments.out}")
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = command_parser(
        "convert",
        __doc__,
        examples=(
            "cuts/*.csv --out session.mcap",
            "session.mcap --out session.parquet",
            "rig.bag --out rig.csv --map time=stamp force=/ft/wrench.wrench.force.x position=/stage.position.feed",
        ),
        note="Without --map, a bag of another program is answered with the topics in it and a --map for it.",
    )
    add = parser.option
    add(
        "records FILE",
        "records: CSV, Parquet, HDF5, MCAP; text of other programs; bags of ROS (.mcap or .db3 out of the bag's "
        "folder, .bag)",
        Path,
        nargs="+",
    )
    add("--out FILE", "new file; its suffix .csv, .parquet, .h5 or .mcap is the format", Path, required=True)
    add("--force", "replace the file if it exists")
    add("--cuts", "keep the cuts found in the records of other programs, offset taken off")
    add(
        "--map FIELD=COLUMN",
        "which column or topic is what: time=stamp force=/ft/wrench.wrench.force.x position=x[mm] depth=20mm",
        nargs="+",
    )
    add("--unit UNIT", "unit of the force: N, mN, kN, gf, kgf, lbf, or 1 if it is normalised")
    return parser
