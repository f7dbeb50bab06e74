"""The Lab Streaming Layer's library, kept to this machine unless another scope is asked for."""

from __future__ import annotations

from typing import Any

from cutenv._base.validation import one_of
from cutenv.recording.optional_import import optional_import

SCOPES = ("machine", "link", "site")
"""Reach of a stream: on this machine alone, on its local network, or at its site."""
_chosen: str | None = None  # a process has one scope: liblsl reads its settings once


def lsl(scope: str | None = None) -> Any:
    """Import pylsl, and on its first use in a process keep its streams within a scope.

    Raises
    ------
    ValueError
        If there is no such scope, or the process has chosen another one before.
    ModuleNotFoundError
        If pylsl is not installed; names the pip command.
    OSError
        If liblsl is missing, which comes with pylsl's wheels for usual systems.
    """
    global _chosen
    wanted = "machine" if scope is None else one_of("scope", scope, SCOPES)
    try:
        pylsl = optional_import("pylsl", "pylsl", "The Lab Streaming Layer", extra="streams")
    except RuntimeError as error:
        raise OSError(
            f"pylsl is installed, but not liblsl, which it calls ({str(error).partition('.')[0]}). Install liblsl from "
            "its releases or as conda-forge's liblsl, and set PYLSL_LIB to its file."
        ) from None
    if _chosen is None:
        listen = "ListenAddress = 127.0.0.1\n" if wanted == "machine" else ""  # to those who search for streams
        pylsl.set_config_content(f"[multicast]\nResolveScope = {wanted}\n{listen}[log]\nlevel = -3\n")
        _chosen = wanted
    elif scope is not None and wanted != _chosen:
        raise ValueError(f"scope is {wanted!r}, but this program's streams are kept to {_chosen!r}. Start it again.")
    return pylsl
