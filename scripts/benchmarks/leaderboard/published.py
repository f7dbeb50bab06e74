"""Print the table of the benchmark, from its kept cuts.

python -m scripts.benchmarks.leaderboard.published                        the published table, of assets/benchmark
python -m scripts.benchmarks.leaderboard.published --page FILE            and as a page that opens without a network
python -m scripts.benchmarks.leaderboard.published runs/benchmark --publish
                                                                          merge another one into it, finished or not
python -m scripts.benchmarks.leaderboard.published --add submission.json  repeat every cut of an entry, and add it to it
python -m scripts.benchmarks.leaderboard.published --add submission.json --policies my_policy/
                                                                          and let its policies act again
"""

from __future__ import annotations

import argparse
from pathlib import Path

from scripts.benchmarks.leaderboard.table import PUBLISHED, add_submission, markdown, publish, write_leaderboard


def main() -> None:
    """Change the published comparison as requested, print the table, and write its page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", nargs="?", type=Path, default=PUBLISHED, help="folder of the benchmark")
    parser.add_argument("--page", type=Path, metavar="FILE", help="write the page there")
    parser.add_argument("--publish", action="store_true", help="merge it into the published one")
    parser.add_argument("--add", type=Path, metavar="FILE", help="file of cutenv submit to add to the published one")
    parser.add_argument("--policies", nargs="+", default=[], metavar="POLICY", help="policies of --add, in their order")
    given = parser.parse_args()
    if given.publish:
        publish(given.folder)
    if given.add is not None:
        try:
            add_submission(given.add, policies=given.policies)
        except (OSError, ValueError) as error:
            raise SystemExit(str(error)) from None
    shown = PUBLISHED if given.publish or given.add is not None else given.folder
    print(markdown(shown))
    if given.page is not None:
        write_leaderboard(given.page, shown)


if __name__ == "__main__":
    main()
