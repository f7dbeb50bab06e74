"""Try a rig's drivers against what their protocol promises, and print what was promised, measured and missed.

An axis moves to and fro by some millimetres: take the blade off, and lay nothing in its way. A sensor must not be
touched. Without --section the blade's axis and the sensor are tried. How a whole rig stops at every fault is
measured on an emulator: scripts/rig_faults.py.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence

from cutenv.commands.options import RIG, command_parser, reports_errors
from cutenv.rig.driver_trial import SECTIONS_TRIED, tried_drivers
from cutenv.rig.errors import RigError
from cutenv.rig.operation.conformance import HEADER, conformance_rows


@reports_errors("rig conform")
def main(argv: Sequence[str]) -> int:
    """Try the drivers; return 0, 1 if a promise is not kept or a device fails, or 2 if the file or name is bad."""
    arguments = _parser().parse_args(argv)
    try:
        found = tried_drivers(arguments.rig, arguments.section or None)
    except RigError as error:
        print(f"cutenv rig conform: {error}", file=sys.stderr)
        return 1
    if arguments.json:
        told = {role: [each._asdict() for each in findings] for role, (_, findings) in found.items()}
        print(json.dumps(told, indent=2))
    else:
        for role, (driver, findings) in found.items():
            print(f"{role}: driver {driver}")
            rows = [HEADER, *conformance_rows(findings)]
            widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
            for row in rows:
                cells = (cell.ljust(width) for cell, width in zip(row, widths, strict=True))
                print(f"  {'  '.join(cells)}".rstrip())
    missed = [each for _, findings in found.values() for each in findings if not each.kept]
    total = sum(len(findings) for _, findings in found.values())
    if not arguments.json:
        print(f"{len(missed)} of {total} promises are missed" if missed else f"all {total} promises are kept")
    return 1 if missed else 0


def _parser() -> argparse.ArgumentParser:
    parser = command_parser(
        "rig conform", __doc__, examples=("serial", "my_rig.toml --section sensor", "my_package.stage:Stage")
    )
    parser.add_argument("rig", metavar="RIG", help=f"{RIG}; or a driver that needs no options, such as module:Class")
    parser.add_argument(
        "--section", action="append", choices=SECTIONS_TRIED, help="section whose driver is tried; may be given again"
    )
    parser.add_argument("--json", action="store_true", help="print the result as JSON")
    return parser
