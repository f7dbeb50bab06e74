"""Page of all checks, made of their registry."""

from __future__ import annotations

import os
from collections.abc import Iterator

from scripts.checks import CHECKS, Check
from scripts.tables import markdown_table

PAGE = "validation/checks.md"
_HEAD = """# What backs which number

Every number of these pages that a program prints stands here, with its page, the command that prints it, run at the
root of a checkout, and what that takes on two cores, about. Where a page has a generated block, its name is in
brackets: `python -m scripts.update_docs NAME` writes it again, from what the command has left in `runs/` where it takes
long. *Long* marks checks that `python3 scripts/start.py test --long` runs before a change is closed that touches what
they check.

The list is made from `scripts/checks.py`, and a test fails if a program or a block is missing there.
"""


def pages() -> Iterator[tuple[str, str]]:
    """Yield path below ``docs`` and Markdown of the page."""
    groups: dict[str, list[Check]] = {}
    for check in CHECKS:
        groups.setdefault(check.name.partition(":")[0], []).append(check)
    yield PAGE, _HEAD + "".join(f"\n## {name.capitalize()}\n\n{table(group)}\n" for name, group in groups.items())


def table(checks: list[Check]) -> str:
    """Return checks as a table of Markdown."""
    header = ("what", "shows", "page", "command", "duration")
    rows = [
        (
            check.name.partition(": ")[2],
            check.promise,
            linked(check),
            f"`{check.command}`",
            f"{duration(check.minutes)}{', *long*' if check.long else ''}",
        )
        for check in checks
    ]
    return markdown_table(header, rows)


def linked(check: Check) -> str:
    """Return a link to the page of a check, with its block in brackets."""
    if not check.page:
        return ""
    name = check.page.removeprefix("docs/")
    link = name if name == check.page else f"[{name.removesuffix('.md')}]({os.path.relpath(name, 'validation')})"
    return f"{link} (`{check.block}`)" if check.block else link


def duration(minutes: float | None) -> str:
    """Return a duration as text."""
    if minutes is None:
        return "not measured"
    return "seconds" if minutes < 0.5 else f"{minutes:g} min" if minutes < 90 else f"{minutes / 60:g} h"
