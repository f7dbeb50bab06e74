"""Documented constants: value, unit, admissible range, provenance, and the range to sweep."""

from __future__ import annotations

import dataclasses
from typing import Any, Literal, TypeVar

from cutenv._base.validation import in_range

T = TypeVar("T")

ParameterProvenance = Literal["measured", "derived", "assumed", "choice"]


def parameter(
    default: float,
    *,
    unit: str,
    low: float,
    high: float,
    provenance: ParameterProvenance,
    source: str,
    sensitivity: tuple[float, float] | None = None,
    title: str = "",
) -> Any:
    """Declare a dataclass field for one physical constant; ``source`` names the table, the derivation or the reason.

    ``title`` is its name on report pages.
    """
    metadata = {
        "unit": unit,
        "low": low,
        "high": high,
        "provenance": provenance,
        "source": source,
        "sensitivity": sensitivity,
        "title": title,
    }
    return dataclasses.field(default=default, metadata=metadata)


def check_parameters(parameters: Any) -> None:
    """Raise if a documented constant of a dataclass is out of its range (call it in ``__post_init__``)."""
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
            f"Default {field.default:g}: {about['source']}",
        )


def parameter_table(*groups: Any) -> list[dict[str, Any]]:
    """Return all documented constants of dataclasses as rows: name, default, unit, provenance, source, sensitivity."""
    return [
        {
            "name": field.name,
            "default": field.default,
            **{key: field.metadata[key] for key in ("unit", "provenance", "source", "sensitivity")},
        }
        for group in groups
        for field in dataclasses.fields(group)
        if "unit" in field.metadata
    ]


def taken_from(keywords: dict[str, Any], kind: type[T]) -> T:
    """Return constants of a ``kind`` that a task adds, of those ``keywords`` that name its fields, which are removed.

    Raises
    ------
    ValueError, TypeError
        For a value out of range.
    """
    names = [field.name for field in dataclasses.fields(kind) if field.name in keywords]  # type: ignore[arg-type]
    return kind(**{name: keywords.pop(name) for name in names})
