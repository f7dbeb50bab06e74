"""Measure the speed of the environment on this machine, each number compared with something run in the same process.

python -m scripts.benchmarks.speed.bench                 everything, some minutes
python -m scripts.benchmarks.speed.bench step tick       only these
python -m scripts.benchmarks.speed.bench --json FILE     keep the numbers; --compare FILE prints ratios to them later
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path

from scripts.benchmarks.speed import BENCHMARKS, measurement
from scripts.benchmarks.speed.comparison import compared
from scripts.benchmarks.speed.machine import BLAS_THREADS
from scripts.benchmarks.speed.measured import Number
from scripts.benchmarks.speed.record import check_place, read, record_of, write


def main(argv: Sequence[str] | None = None) -> int:
    """Print the benchmarks named on the command line, all by default; write and compare their numbers if asked to."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "only",
        nargs="*",
        choices=[*BENCHMARKS, []],
        metavar="BENCHMARK",
        help=f"benchmark to run: {', '.join(BENCHMARKS)}; default all",
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="write every number, with the machine's description")
    parser.add_argument("--compare", type=Path, metavar="OLD.json", help="print ratios new/old to an earlier --json")
    arguments = parser.parse_args(argv)
    old = None
    try:
        if arguments.compare is not None:
            old = read(arguments.compare)
    except ValueError as error:
        parser.error(f"argument --compare: {error}")
    try:
        if arguments.json is not None:
            check_place(arguments.json)
    except ValueError as error:
        parser.error(f"argument --json: {error}")

    # SciPy's BLAS is loaded with the first benchmark.  Threads of its own gain nothing on matrices of this size, and
    # where another program has a core they wait for each other: one factorisation then takes four times as long.
    os.environ.setdefault(BLAS_THREADS, "1")
    numbers: dict[str, Mapping[str, Number]] = {}
    for name in arguments.only or BENCHMARKS:
        print(f"measuring {name} ...", file=sys.stderr, flush=True)
        measured = measurement(name)()
        print(*measured.lines, sep="\n", flush=True)
        numbers[name] = measured.numbers
    record = record_of(numbers, datetime.now(UTC))
    if arguments.json is not None:
        write(arguments.json, record)
    if old is not None:
        print(*compared(old, record), sep="\n")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
