"""Tables of the documentation that are made of the task's declarations: observation, reward and ends."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence

from cutenv.task.observation import COMPONENTS
from cutenv.task.reward import CUT_ENDS, REWARD

_RULE = re.compile(r"^ *=+(?: =+)+$", re.MULTILINE)

Rows = list[tuple[str, ...]]


def simple_table(rows: Sequence[tuple[str, ...]]) -> str:
    """Return a simple table of reStructuredText; its first row is the head."""
    widths = [max(len(cell) for cell in column) for column in zip(*rows, strict=True)]
    rule = " ".join("=" * width for width in widths)
    head, *body = (
        " ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows
    )
    return "\n".join([rule, head, rule, *body, rule])


def observation() -> Rows:
    """Return the components of the observation."""
    head = ("Num", "Name", "Meaning", "Unit", "Scale", "Offset")
    return [
        head,
        *(
            (str(number), one.name, one.meaning, one.unit, f"{round(one.scale, 4):g}", f"{round(one.offset, 4):g}")
            for number, one in enumerate(COMPONENTS)
        ),
    ]


def reward() -> Rows:
    """Return the terms of the reward; one whose weight cannot be changed has 1."""
    terms = ((term.name, f"{1.0 if term.weight is None else term.weight:g}", term.text) for term in REWARD)
    return [("Term", "Weight", "Charged for"), *terms]


def ends() -> Rows:
    """Return the ends, in order of precedence."""
    return [("End", "When"), *((end.name, end.text) for end in CUT_ENDS)]


SECTIONS: dict[str, Callable[[], Rows]] = {"Observation": observation, "Reward": reward, "Ends": ends}
"""Sections of the environment's docstring that each begin with one of these tables."""


def with_tables(source: str) -> str:
    """Return the source of a module with the first table of each of ``SECTIONS`` in its docstring replaced."""
    for title, rows in SECTIONS.items():
        (heading,) = re.finditer(rf"^( *){title}\n *-+$", source, re.MULTILINE)
        top, _, bottom = list(_RULE.finditer(source, heading.end()))[:3]
        table = "\n".join(heading[1] + line for line in simple_table(rows()).splitlines())
        source = source[: top.start()] + table + source[bottom.end() :]
    return source
