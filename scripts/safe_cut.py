"""Print the cost of policies on cutenv/SafeCut-v1, and their differences from a policy on the same specimens.

    python scripts/safe_cut.py                                    probe and creep: two thirds of its cost are the budget
    python scripts/safe_cut.py runs/ppo/policy runs/careful/policy "return stroke"

Differences are from the first policy named, which is ``probe and creep`` without any, paired by specimen.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from benchmark.table import markdown_table

from cutenv.envs.tracks import COST_BUDGET_MM, PROTOCOL
from cutenv.learning.evaluation import Contestant, contestant, evaluate
from cutenv.learning.result_tables import rows_of, write_csv
from cutenv.learning.seeds import TEST_SEEDS
from cutenv.learning.statistics import by_policy, mean_with_interval

FOLDER, FILE = Path("runs") / "safe-cut", "rows.csv"
BUDGET_OF = "probe and creep"
"""Script of whose mean cost the budget is two thirds."""
SCORES = {"return": 3, "success": 3, "cost_mm": 2, "overshoot_mm": 2, "long_runs_mm": 2}
"""Columns of the table and their digits."""


def measure(names: Sequence[str], specimens: int) -> list[dict[str, Any]]:
    """Let the policies cut the first held-out specimens at 10 decisions a second; return the rows."""
    several = {name: Contestant(contestant(name).policy) for name in names}
    return evaluate(several, TEST_SEEDS[:specimens], PROTOCOL, description="SafeCut-v1")


def report(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return a Markdown table: scores of each policy, and return and cost less those of the first, by specimen."""
    each = by_policy(rows)
    (first, base), *_ = each.items()
    table = []
    for name, own in each.items():
        cells = [shown([float(row[score]) for row in own], digits) for score, digits in SCORES.items()]
        for score in ("return", "cost_mm"):
            paired = [float(row[score]) - float(other[score]) for row, other in zip(own, base, strict=True)]
            cells.append("–" if name == first else shown(paired, SCORES[score], "+"))
        table.append((name, *cells))
    heading = ("policy", "return", "success", "cost [mm]", "overshoot [mm]", "long runs [mm]")
    paired_heading = (f"return minus {first}", f"cost minus {first} [mm]")
    return (
        f"Class mixed, {len(base)} held-out specimens; mean [95 % interval]; budget for the mean cost of a cut: "
        f"{COST_BUDGET_MM:g} mm.\n\n{markdown_table((*heading, *paired_heading), table)}"
    )


def shown(values: Sequence[float], digits: int, sign: str = "") -> str:
    """Return the mean of some values with its 95 % interval as text."""
    mean, low, high, _ = mean_with_interval(values).values()
    return f"{mean:{sign}.{digits}f} [{low:{sign}.{digits}f}, {high:{sign}.{digits}f}]"


def kept(folder: Path) -> list[dict[str, str]]:
    """Return the rows of an earlier measurement; SystemExit if there is none."""
    path = folder / FILE
    if not path.is_file():
        raise SystemExit(f"{path} is missing; run 'python scripts/safe_cut.py' first.")
    return list(rows_of(path))


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("policies", nargs="*", default=[BUDGET_OF], metavar="POLICY", help="names or folders")
    parser.add_argument("--specimens", type=int, default=1000, metavar="N", help="held-out specimens; default 1000")
    parser.add_argument("--out", type=Path, default=FOLDER, metavar="FOLDER", help=f"folder; default {FOLDER}")
    parser.add_argument("--print", action="store_true", help="print the kept table without measuring again")
    arguments = parser.parse_args()
    if not arguments.print:
        try:
            rows = measure(arguments.policies, arguments.specimens)
        except ValueError as error:
            parser.error(str(error))
        arguments.out.mkdir(parents=True, exist_ok=True)
        write_csv(arguments.out / FILE, rows)
    print(report(kept(arguments.out)), flush=True)


if __name__ == "__main__":
    main()
