"""Measurements of speed, each against something run in the same process: ``cutenv bench``."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from importlib import import_module

__all__ = ["BENCHMARKS", "main"]

BENCHMARKS = {
    "step": "environment",
    "batch": "batch",
    "tick": "tick",
    "factorisation": "factorisation",
    "records": "records",
}
"""Name -> module with ``print_report()``."""


def main(argv: Sequence[str]) -> int:
    """Print the benchmarks named in ``argv``, all by default."""
    parser = argparse.ArgumentParser(prog="cutenv bench", description=__doc__)
    parser.add_argument(
        "only",
        nargs="*",
        choices=[*BENCHMARKS, []],
        metavar="BENCHMARK",
        help=f"{', '.join(BENCHMARKS)}; default all",
    )
    for name in parser.parse_args(argv).only or BENCHMARKS:
        import_module(f"cutenv.bench.{BENCHMARKS[name]}").print_report()
    return 0
