"""Libraries for Parquet and HDF5, which the extra ``data`` installs and which are loaded when used."""

from __future__ import annotations

from importlib import import_module
from typing import Any


def optional_import(name: str, package: str, format_name: str) -> Any:
    """Import a module of the extra.

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
            f"Records in {format_name} are kept with {package}, which is not installed: pip install 'cutenv[data]'",
            name=package,
        ) from None
