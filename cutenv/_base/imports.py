"""Imports at first use: of names of a package, and of libraries for other formats, which extras install."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping
from typing import Any


def import_when_used(package: str, modules: Mapping[str, str]) -> Callable[[str], Any]:
    """Return the ``__getattr__`` of a package (PEP 562) for names, each with the full name of its module."""

    def attribute(name: str) -> Any:
        if name not in modules:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        return getattr(importlib.import_module(modules[name]), name)

    return attribute


def optional_import(name: str, package: str, format_name: str, extra: str = "data") -> Any:
    """Import a module of an extra.

    Raises
    ------
    ModuleNotFoundError
        If `package` is not installed; the message gives the pip command.
    """
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] != name.partition(".")[0]:
            raise
        raise ModuleNotFoundError(
            f"{format_name} is read and written with {package}, which is not installed: pip install 'cutenv[{extra}]'",
            name=package,
        ) from None
