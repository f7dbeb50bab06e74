"""Policies of one's own, by the name of their class."""

from __future__ import annotations

import sys
from importlib import import_module
from typing import Any

from cutenv.policy.interface import Policy


def own_policy(name: str) -> tuple[Policy, dict[str, Any]] | None:
    """Return a policy of one's own, and the arguments of its environment; None if the name is not ``MODULE:CLASS``.

    Parameters
    ----------
    name : str
        ``MODULE:CLASS``, of a module in the present folder or an installed one.  The class is made without arguments.
        Its attribute ``environment_arguments``, if it has one, are those with which it was trained:
        ``{"control_hz": 10}``.

    Raises
    ------
    ValueError
        If there is no such module or class.
    """
    module, colon, made = name.partition(":")
    if not colon or not module.replace(".", "").isidentifier():
        return None
    if "" not in sys.path:
        sys.path.insert(0, "")
    try:
        policy: Policy = getattr(import_module(module), made)()
    except (ImportError, AttributeError) as error:
        raise ValueError(f"policy {name!r}: {error}. Give MODULE:CLASS, of a module in this folder.") from error
    return policy, dict(getattr(policy, "environment_arguments", {}))
