"""The registry of checks: the thesis's numbers beside ours and beside each other, by groups of tables."""

from __future__ import annotations

from scripts.validation.thesis import (
    chapter_4,
    chapters_5_to_7,
    cutting,
    derived,
    drawn_tables,
    elements,
    measuring,
    models,
    moduli,
    worked_check,
)
from scripts.validation.thesis.rows import Check, Comparison, Row

_MODULES = (
    *(elements, models, moduli, drawn_tables, derived, measuring, cutting, worked_check, chapters_5_to_7),
    chapter_4,
)
CHECKS = {each.name: each for module in _MODULES for each in vars(module).values() if isinstance(each, Check)}
"""All checks by short name, in the order of the documentation's table."""

COMPARISONS = {name: each for name, each in CHECKS.items() if each.listed}
"""Those that stand in that table; each takes whether to be quick."""

__all__ = ["CHECKS", "COMPARISONS", "Check", "Comparison", "Row"]
