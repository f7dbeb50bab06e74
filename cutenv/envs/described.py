"""Docstrings of environments: what the task declares is filled in where they name it in braces."""

from __future__ import annotations

import inspect
import math
import re
import textwrap
from collections.abc import Callable, Sequence
from typing import TypeVar

from cutenv.task.declare import CutNumber, Task
from cutenv.task.observation import ANGLE_CENTRE, ANGLE_SCALE, CLIP, COMPONENTS, SPEED_SCALE
from cutenv.task.reward import CUT_ENDS, REWARD

E = TypeVar("E")
_Rows = list[tuple[str, ...]]


def simple_table(rows: Sequence[tuple[str, ...]]) -> str:
    """Return a simple table of reStructuredText; its first row is the head."""
    widths = [max(len(cell) for cell in column) for column in zip(*rows, strict=True)]
    rule = " ".join("=" * width for width in widths)
    head, *body = (
        " ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows
    )
    return "\n".join([rule, head, rule, *body, rule])


def action_rows(task: Task) -> _Rows:
    """Return the numbers of an action."""
    low, high = (math.degrees(ANGLE_CENTRE + sign * ANGLE_SCALE) for sign in (-1.0, 1.0))
    speed = 100.0 * SPEED_SCALE
    rows = [
        ("target speed", f"{-speed:g} to {speed:g}", "cm/s"),
        ("target angle", f"{low:g} to {high:g} (upright)", "deg"),
        *([] if task.axis is None else [(task.axis.meaning, task.axis.shown, task.axis.unit)]),
    ]
    return [("Num", "Action", "-1 to 1 is", "Unit"), *((str(number), *row) for number, row in enumerate(rows))]


def component_rows(task: Task) -> _Rows:
    """Return the components of the observation that a task adds; all of one that adds none."""
    first = len(COMPONENTS) if task.components else 0
    return [
        ("Num", "Name", "Meaning", "Unit", "Scale", "Offset"),
        *(
            (str(number), one.name, one.meaning, one.unit, f"{round(one.scale, 4):g}", f"{round(one.offset, 4):g}")
            for number, one in enumerate(task.all_components[first:], start=first)
        ),
    ]


def term_rows(task: Task) -> _Rows:
    """Return the terms of the reward that a task adds; all of one that adds none, 1 for a weight that is fixed."""
    terms = [(term.name, term.weight, term.text) for term in task.costs or REWARD]
    return [
        ("Term", "Weight", "Charged for"),
        *((name, f"{1.0 if weight is None else weight:g}", text) for name, weight, text in terms),
    ]


def end_rows(task: Task) -> _Rows:
    """Return the end that a task adds; all of one that adds none, in order of precedence."""
    ends = [(task.end, task.end_text)] if task.end else [(end.name, end.text) for end in CUT_ENDS]
    return [("End", "When"), *ends]


def number_rows(numbers: Sequence[CutNumber]) -> _Rows:
    """Return numbers of a cut."""
    return [("Name", "Meaning"), *((f"``{one.name}``", one.meaning) for one in numbers)]


TABLES: dict[str, Callable[[Task], _Rows]] = {
    "{actions}": action_rows, "{components}": component_rows, "{terms}": term_rows, "{ends}": end_rows,
    "{truth}": lambda task: number_rows(task.truth), "{errors}": lambda task: number_rows(task.errors),
    "{errors on a rig}": lambda task: number_rows([one for one in task.errors if one.on_rig]),
}  # fmt: skip
"""Tables of a task by how a docstring names them."""


def described(environment: type[E]) -> type[E]:
    """Fill the tables of the task into the docstring of an environment.

    The names in :data:`TABLES` stand for tables, ``{space}`` for the space of the observations, and ``{keywords}`` for
    the names of the task's keywords of which the docstring has no row.
    """
    if environment.__doc__ is None:  # python -OO
        return environment
    options, doc = environment.options_class, inspect.cleandoc(environment.__doc__)  # type: ignore[attr-defined]
    names = getattr(environment, "option_names", options.names)
    others = (f"``{name}``" for name in names if not re.search(rf"^{name} ", doc, re.MULTILINE))
    filled = {name: simple_table(rows(options.task)) for name, rows in TABLES.items() if name in doc}
    filled["{space}"] = f"Box({-CLIP:g}, {CLIP:g}, ({len(options.task.all_components)},), float32)"
    filled["{keywords}"] = textwrap.fill(", ".join(others), 116)
    for name, text in filled.items():
        doc = doc.replace(name, text)
    environment.__doc__ = doc
    return environment
