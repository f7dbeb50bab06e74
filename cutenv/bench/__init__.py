"""Measurements of speed, each against something run in the same process: ``cutenv bench``."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from importlib import import_module
from pathlib import Path

from cutenv.bench.comparison import compared
from cutenv.bench.machine import BLAS_THREADS
from cutenv.bench.measured import Number
from cutenv.bench.record import check_place, read, record_of, write

__all__ = ["BENCHMARKS", "main"]

BENCHMARKS = {
    "first": "first_use",
    "step": "environment",
    "batch": "batch",
    "tick": "tick",
    "field": "field",
    "models": "models",
    "factorisation": "factorisation",
    "calibration": "calibration",
    "ppo": "ppo",
    "reading": "reading",
}
"""Name -> module with ``measure()``."""


def main(argv: Sequence[str]) -> int:
    """Print the benchmarks named in ``argv``, all by default; write and compare their numbers if asked to."""
    parser = argparse.ArgumentParser(
        prog="cutenv bench",
        description=__doc__,
        epilog="examples:\n  cutenv bench step batch\n  cutenv bench --json before.json",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
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
        measured = import_module(f"cutenv.bench.{BENCHMARKS[name]}").measure()
        print(*measured.lines, sep="\n", flush=True)
        numbers[name] = measured.numbers
    record = record_of(numbers, datetime.now(UTC))
    if arguments.json is not None:
        write(arguments.json, record)
    if old is not None:
        print(*compared(old, record), sep="\n")
    return 0
