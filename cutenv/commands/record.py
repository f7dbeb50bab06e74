"""Record a force stream of the Lab Streaming Layer as a cut.

The stream comes from any program on this machine or network. Channels are named by --map, as columns of a file are; the
time is the stream's own, brought to this machine's clock. Rows are on the disk as they come: Ctrl-C ends the record,
which is whole.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING

from cutenv.commands.options import command_parser, made_place, reports_errors

if TYPE_CHECKING:
    from cutenv.sim.trace import Reading


@reports_errors("record")
def main(argv: Sequence[str]) -> int:
    """Record; return 0, or 2 on bad input or stream."""
    arguments = _parser().parse_args(argv)
    from cutenv._base.validation import in_range
    from cutenv.records import ColumnMap
    from cutenv.records.foreign.lsl import LslInlet, record_stream
    from cutenv.records.foreign.mapped_columns import STAMP

    items = [*arguments.map, f"time={STAMP}"]
    if any(item.partition("=")[0].strip() in ("time", "rate", "split_by") for item in arguments.map):
        raise ValueError("--map has time, rate or split_by: a stream has a time of its own. Leave them out.")
    mapping = ColumnMap.parse(items, unit=arguments.unit)
    if arguments.seconds is not None:
        in_range("--seconds", arguments.seconds, 0.01, 86400.0, "s", "Give seconds, or leave it out and press Ctrl-C.")
    if arguments.out.suffix != ".csv":
        raise ValueError(f"--out {arguments.out} grows while it is written: give a .csv, and convert it afterwards.")
    if arguments.out.exists():
        raise ValueError(f"--out {arguments.out} exists; records are never overwritten. Give another name.")
    made_place("--out", arguments.out)
    with closing(LslInlet(arguments.stream, scope=arguments.scope)) as inlet:
        print(f"recording {arguments.stream!r}; Ctrl-C ends the record", file=sys.stderr, flush=True)
        try:
            count = record_stream(inlet, mapping, arguments.out, seconds=arguments.seconds, on_reading=_show)
            print(f"\n{count} readings: {arguments.out}")
        except KeyboardInterrupt:
            print(f"\nended: {arguments.out}")
    return 0


def _show(newest: Reading) -> None:
    print(f"\r{newest.time:8.2f} s {newest.force:9.3f}", end="", file=sys.stderr, flush=True)


def _parser() -> argparse.ArgumentParser:
    parser = command_parser(
        "record",
        __doc__,
        examples=(
            '--stream "cutenv rig readings" --map force=force position=position --out cuts/watched.csv',
            "--stream BioForce --map force=Fz[N] depth=20mm angle=90deg --seconds 30 --out cuts/trial1.csv",
        ),
    )
    add = parser.option
    add("--stream NAME", "name or source id of the stream", required=True)
    add(
        "--map FIELD=CHANNEL",
        "channel of each field: force=Fz, force=norm(Fx,Fy,Fz), position=x[mm], force=#1, angle=90deg, depth=20mm",
        nargs="+",
        required=True,
    )
    add("--unit UNIT", "unit of the force where the stream names none: N, mN, kN, gf, kgf, lbf, or 1")
    add("--seconds S", "duration of the record [s]; default until Ctrl-C", float)
    add("--out FILE", "new record, a .csv", Path, required=True)
    add(
        "--scope",
        "how far the stream is searched for: this machine (the default), its network, or its site",
        "machine",
        choices=("machine", "link", "site"),
    )
    return parser
