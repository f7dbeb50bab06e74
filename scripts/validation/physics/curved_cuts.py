"""Benchmark of cuts along a curve for other solvers: make its files, check an entry, print the table.

    python -m scripts.validation.physics.curved_cuts make            write assets/benchmark/curves: a minute
    python -m scripts.validation.physics.curved_cuts check FOLDER    measure an entry against the reference
    python -m scripts.validation.physics.curved_cuts table           print the table of all entries

docs/validation/curved-benchmark.md says what an entry holds.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from scripts import ROOT
from scripts.tables import markdown_table
from scripts.validation.physics.curves.entry import HEADER, measured
from scripts.validation.physics.curves.made import make

FOLDER = ROOT / "assets" / "benchmark" / "curves"  # files of the benchmark


def table(folder: Path = FOLDER) -> str:
    """Return the table of all entries as Markdown, least error first."""
    standings = [measured(entry, folder) for entry in sorted((folder / "entries").iterdir())]
    standings.sort(key=lambda standing: max(standing.errors))
    return markdown_table(HEADER, [standing.cells() for standing in standings])


def main(argv: Sequence[str] | None = None) -> int:
    """Make, check or print; return 1 if an entry cannot be measured."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("make", "check", "table"), help="see above")
    parser.add_argument("folder", type=Path, nargs="?", help="entry to check; for make: where to write")
    arguments = parser.parse_args(argv)
    if arguments.what == "make":
        make(arguments.folder or FOLDER)
    elif arguments.what == "table":
        print(table())
    elif arguments.folder is None:
        parser.error("check needs the folder of an entry")
    else:
        try:
            print(markdown_table(HEADER, [measured(arguments.folder, FOLDER).cells()]))
        except ValueError as error:
            print(error, file=sys.stderr)
            return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
