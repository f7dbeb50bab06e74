"""Benchmark: train every agent, evaluate every policy on held-out specimens, print the table.

    python scripts/benchmark_agents.py              at most two hours on two cores; writes runs/benchmark/
    python scripts/benchmark_agents.py --plan       remaining work, and its duration
    python scripts/benchmark_agents.py --only PPO "probe and creep"
    python scripts/benchmark_agents.py --quick      a test of the whole program in some ten minutes; no result
    python scripts/benchmark_agents.py --table      the table again from the CSV files
    python scripts/benchmark_agents.py --against    where it differs from the published one beyond both intervals

Finished parts are not repeated: interrupt it at any time, and start it again.  scripts/benchmark/protocol.py defines
the comparison; the folder contains runs/ (one for each agent and training seed), cuts/ (every score of
every cut), sweeps/ (with other constants), summary.csv, leaderboard.md and leaderboard.html.
"""

from __future__ import annotations

import argparse
import os
from pathlib import Path

from benchmark.protocol import ENTRIES, QUICK, SCRIPTED, Protocol, keep_protocol, kept_protocol
from benchmark.runs import Benchmark, differs
from benchmark.table import PUBLISHED, write_tables

from cutenv.learning.evaluation import workers


def main() -> None:
    """Run the requested parts that are not yet on disk."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, help="folder; default runs/benchmark, with --quick runs/benchmark-quick")
    parser.add_argument(
        "--only", nargs="+", default=[], metavar="NAME", help=f"participants to run: {', '.join((*ENTRIES, *SCRIPTED))}"
    )
    parser.add_argument("--quick", action="store_true", help="few specimens and half a minute of training each")
    parser.add_argument("--plan", action="store_true", help="print the remaining work, and stop")
    parser.add_argument("--table", action="store_true", help="write the table from the files on disk, and stop")
    parser.add_argument(
        "--processes", type=int, default=os.cpu_count() or 1, help="number of processes; default one per core"
    )
    parser.add_argument(
        "--against", type=Path, nargs="?", const=PUBLISHED / "summary.csv", metavar="SUMMARY",
        help="compare with another summary.csv, or with the published one, and stop",
    )  # fmt: skip
    given = parser.parse_args()
    for name in given.only:
        if name not in ENTRIES and name not in SCRIPTED:
            parser.error(f"--only {name!r} takes no part; there are {', '.join((*ENTRIES, *SCRIPTED))}")
    if given.processes < 1:
        parser.error(f"--processes {given.processes} is less than 1")
    folder = given.out or Path("runs") / ("benchmark-quick" if given.quick else "benchmark")
    if given.against is not None:
        raise SystemExit(differs(given.against, folder))
    if given.table:
        write_tables(folder, kept_protocol(folder))
        return
    protocol = QUICK if given.quick else Protocol()
    benchmark = Benchmark(folder, protocol, given.only, given.processes)
    benchmark.plan()
    if given.plan:
        return
    keep_protocol(folder, protocol)
    try:
        benchmark.train()
        with workers(given.processes) as pool:
            benchmark.cut(pool)
            benchmark.sweep(pool)
    except KeyboardInterrupt:
        print("\ninterrupted; the same command continues.")
        raise SystemExit(130) from None
    write_tables(folder, protocol)


if __name__ == "__main__":
    main()
