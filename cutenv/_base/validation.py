"""Input checks that name field, value, range and cure.

Documented constants: value, unit, range, provenance, sweep.
"""

from __future__ import annotations

import dataclasses
import difflib
from collections.abc import Iterable
from typing import Any, Literal, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

T = TypeVar("T")

_MAX_LISTED = 16  # number of choices beyond which the nearest is named, and not all are listed


def in_range(name: str, value: float, low: float, high: float, unit: str, cure: str = "") -> float:
    """Return ``value`` as float if finite and ``low <= value <= high``.

    ``name`` of the field as the reader knows it, ``unit`` ("1" for a pure number) and the advice ``cure`` are for the
    message.  TypeError if ``value`` is not one real number, ValueError if it is NaN, infinite or outside.
    """
    if isinstance(value, (bool, np.bool_, str, bytes)) or value is None:
        raise TypeError(f"{name} must be one real number in {unit}, got {value!r}. {cure}".rstrip())
    try:
        number = float(value)
    except (TypeError, ValueError):
        raise TypeError(f"{name} must be one real number in {unit}, got {value!r}. {cure}".rstrip()) from None
    if not (low <= number <= high and np.isfinite(number)):  # NaN fails both comparisons
        shown = "" if unit == "1" else f" {unit}"
        raise ValueError(f"{name} = {number:g}{shown} is outside {low:g} to {high:g}{shown}. {cure}".rstrip())
    return number


def array_in_range(
    name: str, values: ArrayLike, low: float, high: float, unit: str, cure: str = ""
) -> NDArray[np.float64]:
    """Return ``values`` as float64 if all are :func:`in_range`; name the first bad."""
    try:
        raw = np.asarray(values)
        if raw.dtype.kind not in "iuf":
            raise TypeError
        array = raw.astype(np.float64, copy=False)
    except (TypeError, ValueError):
        raise TypeError(f"{name} must be real numbers in {unit}, got {values!r}. {cure}".rstrip()) from None
    bad = ~((array >= low) & (array <= high) & np.isfinite(array))
    if bad.any():
        in_range(name, array[bad].flat[0], low, high, unit, cure)
    return array


def one_of(name: str, value: T, choices: Iterable[T]) -> T:
    """Return ``value`` if among ``choices``; else raise ValueError with the nearest."""
    known = list(choices)
    if value not in known:
        hint, listed = nearest_choices(value, known), ", ".join(repr(choice) for choice in known)
        if hint and len(known) > _MAX_LISTED:
            raise ValueError(f"{name} {value!r} is not known.{hint}")
        raise ValueError(f"{name} must be one of {listed}, got {value!r}.{hint}")
    return value


class UnexpectedKeyword(TypeError):
    """Python's error for a keyword not taken, which a command can tell apart."""


def unexpected_keyword(of: str, keyword: str, known: Iterable[str] = (), cure: str = "") -> UnexpectedKeyword:
    """Return a TypeError for an unknown keyword, with the nearest known.

    Libraries that try what an environment takes, as TorchRL does, look for Python's words in a TypeError.
    """
    names = list(known)
    listed = f" It takes {', '.join(names)}." if names else ""
    if len(names) > _MAX_LISTED:
        listed = f" help({of}) lists what it takes."
    hint = nearest_choices(keyword, names)
    said = f"{of}.__init__() got an unexpected keyword argument {keyword!r}.{hint}{listed} {cure}"
    return UnexpectedKeyword(said.rstrip())


def nearest_choices(value: Any, known: Iterable[Any], *, most: int = 1) -> str:
    """Return a sentence naming at most ``most`` nearest choices, or ""."""
    nearest = difflib.get_close_matches(str(value), [str(choice) for choice in known], n=most, cutoff=0.5)
    return f" Did you mean {' or '.join(map(repr, nearest))}?" if nearest else ""


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
    """Declare a dataclass field for one physical constant, ``title`` on report pages.

    ``source`` names the table, the derivation or the reason.
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
    """Raise if a dataclass constant is out of range, in ``__post_init__``."""
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
    """Return documented constants as rows: name, default, unit, provenance, source, sensitivity."""
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
    """Pop a ``kind``'s constants from ``keywords``, and return them, in range."""
    names = [field.name for field in dataclasses.fields(kind) if field.name in keywords]  # type: ignore[arg-type]
    return kind(**{name: keywords.pop(name) for name in names})
