"""Count the return strokes of policies, by which the force tells where the tip is.

    python -m scripts.benchmarks.policies.return_strokes "return stroke" ppo-free runs/NAME/policy
        writes runs/strokes/strokes.csv

A return stroke draws the blade back by a millimetre or more, and goes forward again by as much.  The last drawing back,
which unloads the tissue at the end, is none.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cutenv._base.arrays import Array
from cutenv.agents.learning.evaluation import batched_rollout, contestant
from cutenv.agents.learning.seeds import TEST_SEEDS
from cutenv.agents.learning.statistics import by_policy
from scripts.tables import keep, kept_rows, markdown_table, mean_text

FILE = Path("runs") / "strokes" / "strokes.csv"
LEAST = 0.001  # distance of a stroke, back and forward again [m]
SEEN_EVERY = 20  # readings between two looks at the place of the blade, 20 ms


def return_strokes(position: Array) -> int:
    """Return how often a blade at these places [m], 1 ms apart, draws back and goes forward again."""
    strokes, turn, lowest = 0, float(position[0]), None
    for place in position[::SEEN_EVERY].tolist():
        if lowest is None:
            turn = max(turn, place)
            lowest = place if turn - place >= LEAST else None
        else:
            lowest = min(lowest, place)
            if place - lowest >= LEAST:
                strokes, turn, lowest = strokes + 1, place, None
    return strokes


def measure(names: Sequence[str], specimens: int) -> list[dict[str, Any]]:
    """Return one row for each cut of each policy of gentle cutting: its strokes, return and success."""
    rows = []
    for name in names:
        one, shown = contestant(name), name if not Path(name).is_dir() else Path(name).parent.name
        arguments = {"specimen_class": "mixed", **one.arguments}
        for cut in batched_rollout(one.policy, list(TEST_SEEDS[:specimens]), arguments, readings=True):
            strokes = return_strokes(cut.readings["position"])
            scores = cut.scores()
            rows.append({"policy": shown, "strokes": strokes, **{name: scores[name] for name in ("return", "success")}})
    return rows


def report(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return the table as Markdown."""
    lines = []
    for name, own in by_policy(rows).items():
        strokes, success = (100.0 * np.mean([row[what] > 0 for row in own]) for what in ("strokes", "success"))
        lines.append((name, f"{strokes:.0f} %", mean_text(row["return"] for row in own), f"{success:.0f} %"))
    table = markdown_table(("policy", "cuts with a return stroke", "return", "success"), lines)
    return f"{table}\n\n{len(rows) // len(lines)} held-out specimens of class mixed; mean [95 % interval]."


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("policies", nargs="*", metavar="POLICY", help="names of policies, or folders of them")
    parser.add_argument("--specimens", type=int, default=500, metavar="N", help="held-out specimens; default 500")
    parser.add_argument("--print", action="store_true", help="print the kept table without measuring again")
    arguments = parser.parse_args()
    if not arguments.print:
        if not arguments.policies:
            parser.error("name a policy, such as 'return stroke', or give --print")
        keep(FILE, measure(arguments.policies, arguments.specimens))
    print(report(kept_rows(FILE, "scripts.benchmarks.policies.return_strokes POLICY ...")), flush=True)
