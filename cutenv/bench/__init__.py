"""Measurements of speed, each against something run in the same process: ``cutenv bench``."""

from __future__ import annotations

import argparse
from collections.abc import Sequence

__all__ = ["main"]


def main(argv: Sequence[str]) -> int:
    """Print the benchmarks named in ``argv``, all by default."""
    parser = argparse.ArgumentParser(prog="cutenv bench", description=__doc__)
    parser.add_argument(
        "only",
        nargs="*",
        choices=["step", "factorisation", []],
        metavar="BENCHMARK",
        help="step, factorisation; default both",
    )
    chosen = parser.parse_args(argv).only or ["step", "factorisation"]
    if "step" in chosen:
        from cutenv.bench import environment

        environment.print_report()
    if "factorisation" in chosen:
        from cutenv.bench import factorisation

        factorisation.print_report()
    return 0
