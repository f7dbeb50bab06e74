"""Benchmark: train every agent, evaluate every policy on held-out specimens, print the table.

    python -m scripts.benchmarks.leaderboard.benchmark_agents
        goes on where assets/benchmark/ ends; writes runs/benchmark/
    python -m scripts.benchmarks.leaderboard.benchmark_agents --afresh
        everything again, whatever is published
    python -m scripts.benchmarks.leaderboard.benchmark_agents --against
        where it differs from the published one beyond both intervals

Finished parts are not repeated: interrupt it at any time, publish what is done with
scripts/benchmarks/leaderboard/published.py --publish, and start it again, there or on another machine.
cutenv/agents/learning/benchmark.py defines the comparison, and scripts/benchmarks/leaderboard/protocol.py who takes
part; the folder contains runs/ (one for each agent and training seed), cuts/ (one file for each of them), sweeps/ (with
other constants), summary.csv, leaderboard.md and leaderboard.html.
"""

from __future__ import annotations

import argparse
import os
from pathlib import Path

from cutenv.agents.learning.benchmark import QUICK, Protocol
from cutenv.agents.learning.evaluation import workers
from scripts.benchmarks.leaderboard.kept_cuts import merge_cuts
from scripts.benchmarks.leaderboard.protocol import ENTRIES, SCRIPTED, keep_protocol, kept_protocol
from scripts.benchmarks.leaderboard.runs import Benchmark, differs
from scripts.benchmarks.leaderboard.table import PUBLISHED, write_tables


def main() -> None:
    """Run the requested parts that are not yet on disk."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, help="folder; default runs/benchmark, with --quick runs/benchmark-quick")
    parser.add_argument(
        "--only", nargs="+", default=[], metavar="NAME", help=f"participants to run: {', '.join((*ENTRIES, *SCRIPTED))}"
    )
    parser.add_argument(
        "--runs",
        type=Path,
        metavar="FOLDER",
        help="folder named runs that holds the training runs; default that in --out",
    )
    parser.add_argument("--seeds", type=int, metavar="N", help="training runs of each agent to make now; default all")
    parser.add_argument("--afresh", action="store_true", help="do not go on from what is published")
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
    if given.seeds is not None and given.seeds < 1:
        parser.error(f"--seeds {given.seeds} is less than 1")
    if given.processes < 1:
        parser.error(f"--processes {given.processes} is less than 1")
    if given.runs is not None and given.runs.resolve().name != "runs":
        parser.error(f"--runs {given.runs} is not named runs, as cutenv train names the folder of its runs")
    folder = given.out or Path("runs") / ("benchmark-quick" if given.quick else "benchmark")
    if given.against is not None:
        raise SystemExit(differs(given.against, folder))
    if given.table:
        write_tables(folder, kept_protocol(folder))
        return
    protocol = QUICK if given.quick else Protocol()
    keep_protocol(folder, protocol)
    published = (PUBLISHED / "protocol.json").is_file() and kept_protocol(PUBLISHED) == protocol
    if published and not given.afresh:
        merge_cuts(PUBLISHED, folder, replace=False)
    benchmark = Benchmark(folder, protocol, given.only, given.processes, given.runs, given.seeds)
    benchmark.plan()
    if given.plan:
        return
    try:
        with workers(given.processes) as pool:
            untrained = benchmark.untrained()
            benchmark.cut([part for part in benchmark.uncut() if part not in untrained], pool)
            for part in benchmark.train():
                benchmark.cut([part], pool)
            benchmark.sweep(pool)
    except KeyboardInterrupt:
        print("\ninterrupted; the same command continues.")
        raise SystemExit(130) from None
    write_tables(folder, protocol)


if __name__ == "__main__":
    main()
