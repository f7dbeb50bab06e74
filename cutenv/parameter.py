"""A documented constant: its unit, its admissible range, where it comes from, and what range to sweep."""

from __future__ import annotations

import dataclasses
from typing import Any, Literal

from cutenv.validation import in_range

Provenance = Literal["measured", "derived", "assumed", "choice"]


def parameter(
    default: float,
    *,
    unit: str,
    low: float,
    high: float,
    provenance: Provenance,
    why: str,
    sweep: tuple[float, float] | None = None,
    title: str = "",
) -> Any:
    """A dataclass field for one physical constant; ``why`` names the table, the derivation or the reason.

    ``title`` is its name on a page, where readers meet it.
    """
    metadata = {
        "unit": unit,
        "low": low,
        "high": high,
        "provenance": provenance,
        "why": why,
        "sweep": sweep,
        "title": title,
    }
    return dataclasses.field(default=default, metadata=metadata)


def check_parameters(parameters: Any) -> None:
    """Refuse a dataclass whose documented constants leave their ranges (call it in ``__post_init__``)."""
    for field in dataclasses.fields(parameters):
        about = field.metadata
        if "unit" not in about:
            continue
        in_range(
            field.name,
            getattr(parameters, field.name),
            about["low"],
            about["high"],
            about["unit"],
            f"Default {field.default:g}: {about['why']}",
        )


def parameter_table(*groups: Any) -> list[dict[str, Any]]:
    """Every documented constant of the dataclasses given, as rows: name, default, unit, provenance, why, sweep."""
    return [
        {
            "name": field.name,
            "default": field.default,
            **{key: field.metadata[key] for key in ("unit", "provenance", "why", "sweep")},
        }
        for group in groups
        for field in dataclasses.fields(group)
        if "unit" in field.metadata
    ]
