"""Print the cost of policies on cutenv/SafeCut-v1, and their differences from a policy on the same specimens.

    python -m scripts.benchmarks.policies.safe_cut  probe and creep: two thirds of its cost are the budget
    python -m scripts.benchmarks.policies.safe_cut runs/ppo/policy runs/careful/policy "return stroke"

Differences are from the first policy named, which is ``probe and creep`` without any, paired by specimen.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from cutenv.agents.learning.evaluation import Contestant, contestant, evaluate
from cutenv.agents.learning.seeds import TEST_SEEDS
from cutenv.agents.learning.statistics import by_policy
from cutenv.envs.tracks import COST_BUDGET_MM, PROTOCOL
from scripts.tables import keep, kept_rows, markdown_table, mean_text

FOLDER, FILE = Path("runs") / "safe-cut", "rows.csv"
BUDGET_OF = "probe and creep"  # script of whose mean cost the budget is two thirds
SCORES = {"return": 3, "success": 3, "cost_mm": 2, "overshoot_mm": 2, "long_runs_mm": 2}
"""Columns of the table and their digits."""


def measure(names: Sequence[str], specimens: int) -> list[dict[str, Any]]:
    """Let the policies cut the first held-out specimens at 10 decisions a second; return the rows."""
    several = {name: Contestant(contestant(name).policy) for name in names}
    rows = evaluate(several, TEST_SEEDS[:specimens], PROTOCOL, description="SafeCut-v1")
    return [{name: row[name] for name in ("policy", "seed", *SCORES)} for row in rows]


def report(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return a Markdown table: scores of each policy, cost less the budget, and paired differences from the first."""
    each = by_policy(rows)
    (first, base), *_ = each.items()
    table = []
    for name, own in each.items():
        cells = [mean_text((row[score] for row in own), digits) for score, digits in SCORES.items()]
        cells.append(mean_text((row["cost_mm"] - COST_BUDGET_MM for row in own), SCORES["cost_mm"], "+"))
        for score in ("return", "cost_mm"):
            paired = (row[score] - other[score] for row, other in zip(own, base, strict=True))
            cells.append("–" if name == first else mean_text(paired, SCORES[score], "+"))
        table.append((name, *cells))
    heading = ("policy", "return", "success", "cost [mm]", "overshoot [mm]", "long runs [mm]", "cost minus budget [mm]")
    paired_heading = (f"return minus {first}", f"cost minus {first} [mm]")
    return (
        f"Class mixed, {len(base)} held-out specimens; mean [95 % interval]; budget for the mean cost of a cut: "
        f"{COST_BUDGET_MM:g} mm.\n\n{markdown_table((*heading, *paired_heading), table)}"
    )


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
        keep(arguments.out / FILE, rows)
    print(report(kept_rows(arguments.out / FILE, "scripts.benchmarks.policies.safe_cut")), flush=True)


if __name__ == "__main__":
    main()
