"""Tables of what changed in the laws of depth and of the line: marks and results before and now.

Not a program: ``scripts/update_docs.py laws laws-results`` writes them.  What was before is kept in
``docs/validation/laws-before.json``: what the same checks and tables printed on the laws of that version.
"""

from __future__ import annotations

import json
from typing import Any

from cutenv.agents.learning.statistics import summarise
from scripts import ROOT
from scripts.benchmarks.policies import task_table
from scripts.tables import kept_rows, markdown_table
from scripts.validation.physics import crack_truth, descent, promises, steering

BEFORE = ROOT / "docs" / "validation" / "laws-before.json"
CHECKED = descent.check_friction, descent.check_pressing, steering.check_passing
"""Parts of the checks that were written for the change."""


def markdown() -> str:
    """Return what the checks find on the laws before and now."""
    before = json.loads(BEFORE.read_text())["checks"]
    specimens = promises.drawn(4)
    found = [row for check in CHECKED for row in check(specimens)] + list(crack_truth.check_beside(specimens))
    rows = [(row.what, before.get(row.what, "–"), row.found, row.promised) for row in found]
    return markdown_table(("what", "before", "now", "promised"), rows)


def results() -> str:
    """Return return, success and error of each policy of both tasks, before and now."""
    before: dict[str, Any] = json.loads(BEFORE.read_text())["results"]
    rows = []
    for name, table in task_table.TABLES.items():
        cuts = kept_rows(table.file, f"scripts.benchmarks.policies.task_table {name}", task_table.TEXTS)
        values = {(row["policy"], row["score"]): row["mean"] for row in summarise(cuts)}
        error, _, shown = table.errors[0]
        for policy, old in before[name].items():
            new = (values[policy, "return"], values[policy, "success"], values[policy, error])
            told = [f"{both[0]:.3f}, {100 * both[1]:.0f} %, {shown.format(both[2])}" for both in (old, new)]
            rows.append((f"{name}: {policy}", *told))
    return markdown_table(("policy: return, success, mean error", "before", "now"), rows)
