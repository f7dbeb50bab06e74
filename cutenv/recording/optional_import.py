"""Libraries for files and streams of other kinds, which extras install and which are loaded when used."""

from __future__ import annotations

from importlib import import_module
from typing import Any


def optional_import(name: str, package: str, format_name: str, extra: str = "data") -> Any:
    """Import a module of an extra.

    Raises
    ------
    ModuleNotFoundError
        If `package` is not installed; the message gives the pip command.
    """
    try:
        return import_module(name)
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] != package:
            raise
        raise ModuleNotFoundError(
            f"{format_name} is read and written with {package}, which is not installed: pip install 'cutenv[{extra}]'",
            name=package,
        ) from None
