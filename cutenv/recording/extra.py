"""The libraries behind Parquet and HDF5, which come with the extra ``data`` and are loaded when they are used."""

from __future__ import annotations

from importlib import import_module
from typing import Any


def library(name: str, package: str, format_name: str) -> Any:
    """Import a module of the extra.

    Raises
    ------
    ModuleNotFoundError
        If `package` is not installed; names the pip command that brings it.
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
