"""Facts that Gymnasium reads of an environment: limit, infos, docstring.

The most steps of a cut, which its own options set, are in its ``spec``. Flat infos are numbers alone, the same at every
step, for wrappers that take no dictionary or text. What a task declares is filled into docstrings where they name it in
braces.
"""

from __future__ import annotations

import dataclasses
import inspect
import math
import re
import textwrap
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol, TypeVar

import numpy as np
from gymnasium.envs.registration import EnvSpec

from cutenv.sim.tissue.specimen import CLASSES
from cutenv.task.declare import CutNumber, Task
from cutenv.task.observation import ANGLE_CENTRE, ANGLE_SCALE, CLIP, COMPONENTS, SPEED_SCALE
from cutenv.task.reward import CUT_ENDS, REWARD


def most_steps(deadline: float, ticks: int) -> int:
    """Return the number of decisions, each ``ticks`` [ms], up to ``deadline`` [s]."""
    return math.ceil(math.ceil(1000.0 * deadline - 0.5) / ticks)


class _Limited(Protocol):
    most_steps: int


class LimitedSpec:
    """``spec`` of an environment with ``max_episode_steps`` from its own deadline.

    An entry of Gymnasium's registry has none: Gymnasium would wrap a TimeLimit with it around every environment, which
    would cut short the cuts of one that decides more often.
    """

    def __set_name__(self, owner: type, name: str) -> None:
        self._kept = f"_{name}"

    def __get__(self, env: _Limited | None, owner: type) -> EnvSpec | None:
        return None if env is None else env.__dict__.get(self._kept)

    def __set__(self, env: _Limited, spec: EnvSpec | None) -> None:
        told = spec and dataclasses.replace(spec, max_episode_steps=env.most_steps)
        env.__dict__[self._kept] = told


def flat_info(info: Mapping[str, Any], ends: Sequence[str]) -> dict[str, Any]:
    """Return an environment's info, ungrouped, as float64 or int64.

    An entry of a group is named after both, such as "truth_tip_m".  ``truth_specimen_class`` counts in
    :data:`~cutenv.sim.tissue.specimen.CLASSES`, and ``end`` in ``ends``, of which the first is that of a cut that goes
    on; flags are 0 or 1.
    """
    full = {"end": ends[0], "is_success": False, **info}
    return {name: _numbers(name, value, ends) for name, value in _without_groups(full).items()}


def flat_infos(infos: Mapping[str, Any], ends: Sequence[str]) -> dict[str, Any]:
    """Return a batch's infos as :func:`flat_info`, (n,), masked ones 0."""
    present = infos["_cost"]
    nothing = {"end": np.full(len(present), ends[0], dtype=object), "is_success": np.zeros(len(present), bool)}
    full = {**nothing, **infos}
    flat: dict[str, Any] = {name: full.pop(name) for name in infos if name.removeprefix("_").startswith("final_")}
    if flat:  # by Gymnasium's convention: the last ones of cuts that ended
        flat["final_info"] = flat_infos(flat["final_info"], ends)
    for name, values in _without_groups(full).items():
        numbers = _numbers(name, values, ends)
        flat[name], flat["_" + name] = np.where(present, numbers, np.zeros_like(numbers)), present
    return flat


def _without_groups(info: Mapping[str, Any]) -> dict[str, Any]:
    """Return the entries of all groups, without masks."""
    flat: dict[str, Any] = {}
    for name, value in info.items():
        if name.startswith("_"):
            continue
        inside = value.items() if isinstance(value, dict) else ()
        flat |= {f"{name}_{key}": each for key, each in inside if not key.startswith("_")} or {name: value}
    return flat


def _numbers(name: str, value: Any, ends: Sequence[str]) -> Any:
    """Return a value, or one per environment, as float64 or int64."""
    words = {"end": ends, "truth_specimen_class": CLASSES}.get(name)
    if words is not None:
        value = np.vectorize(lambda word: 0 if word is None else words.index(word), otypes=[np.int64])(value)
    numbers = np.asarray(value)
    return numbers.astype(np.float64 if numbers.dtype.kind == "f" else np.int64)[()]


E = TypeVar("E")
_Rows = list[tuple[str, ...]]


def simple_table(rows: Sequence[tuple[str, ...]]) -> str:
    """Return a reStructuredText simple table, header first."""
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
    """Return the observation components that a task adds; all if none."""
    first = len(COMPONENTS) if task.components else 0
    return [
        ("Num", "Name", "Meaning", "Unit", "Scale", "Offset"),
        *(
            (str(number), one.name, one.meaning, one.unit, f"{round(one.scale, 4):g}", f"{round(one.offset, 4):g}")
            for number, one in enumerate(task.all_components[first:], start=first)
        ),
    ]


def term_rows(task: Task) -> _Rows:
    """Return the reward terms that a task adds, all if none; fixed weights as 1."""
    terms = [(term.name, term.weight, term.text) for term in task.costs or REWARD]
    return [
        ("Term", "Weight", "Charged for"),
        *((name, f"{1.0 if weight is None else weight:g}", text) for name, weight, text in terms),
    ]


def end_rows(task: Task) -> _Rows:
    """Return the end that a task adds; all by precedence if none."""
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
    """Fill the task's tables into an environment's docstring.

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
