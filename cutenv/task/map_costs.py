"""Costs of a map of the whole cut, which a task adds to those of gentle cutting: records and code."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Any

from cutenv._base.arrays import StructArray
from cutenv._engine.fuse import expression
from cutenv.task.observation import CLIP, Component
from cutenv.task_quantities import MapCost


def map_fields(costs: Sequence[MapCost]) -> list[tuple[str, str]]:
    """Return the fields of a map's record that hold a success, the costs of the step, and those since reset."""
    return [
        ("success", "i8"),
        *((f"term_{cost.name}", "f8") for cost in costs),
        *((f"total_{cost.name}", "f8") for cost in costs),
    ]


def charge_lines(costs: Sequence[MapCost], record: str, quantities: Collection[str]) -> list[str]:
    """Return the lines that charge each cost in a map's ``record``."""
    lines = []
    for cost in costs:
        now = f"0.0 - {record}.weight_{cost.name} * {expression(cost.value, quantities)}"
        lines += [
            f"before = {record}.total_{cost.name}",
            f"{record}.total_{cost.name} = {now}",
            f"{record}.term_{cost.name} = {record}.total_{cost.name} - before",
        ]
    return lines


def observe_lines(components: Sequence[Component], first: int) -> list[str]:
    """Return the lines that fill components of an ``observation`` from number ``first`` on, by quantities so named."""
    return [
        f"observation[{number}] = min(max({one.name} / {one.scale!r}, {-CLIP}), {CLIP})"
        for number, one in enumerate(components, start=first)
    ]


def map_charges(maps: StructArray, costs: Sequence[MapCost], prefix: str = "term") -> dict[str, Any]:
    """Return the costs of the last step, or with "total" since reset, by name; each of shape (n,)."""
    return {cost.name: maps[f"{prefix}_{cost.name}"] for cost in costs}
