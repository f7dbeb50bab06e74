"""Print the table of the benchmark, from its summary.csv and sweeps.csv.

python scripts/leaderboard.py                     the published table, of assets/benchmark
python scripts/leaderboard.py --page FILE         and as a page that opens without a network
python scripts/leaderboard.py runs/benchmark --publish    publish another one
"""

from __future__ import annotations

import argparse
from pathlib import Path

from benchmark.table import PUBLISHED, markdown, publish, write_leaderboard


def main() -> None:
    """Print the table, and write the requested files."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", nargs="?", type=Path, default=PUBLISHED, help="folder of the benchmark")
    parser.add_argument("--page", type=Path, metavar="FILE", help="write the page there")
    parser.add_argument("--publish", action="store_true", help="make it the published one")
    given = parser.parse_args()
    print(markdown(given.folder))
    if given.page is not None:
        write_leaderboard(given.page, given.folder)
    if given.publish:
        publish(given.folder)


if __name__ == "__main__":
    main()
