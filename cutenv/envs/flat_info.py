"""Flat infos: numbers alone, the same at every step, for wrappers that take no dictionary or text in an info."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from cutenv.tissue.specimen import CLASSES


def flat_info(info: Mapping[str, Any], ends: Sequence[str]) -> dict[str, Any]:
    """Return the info of one environment without groups, as numbers of NumPy: float64, or int64.

    An entry of a group is named after both, such as "truth_tip_m".  ``truth_specimen_class`` counts in
    :data:`~cutenv.tissue.specimen.CLASSES`, and ``end`` in ``ends``, of which the first is that of a cut that goes on;
    flags are 0 or 1.
    """
    full = {"end": ends[0], "is_success": False, **info}
    return {name: _numbers(name, value, ends) for name, value in _without_groups(full).items()}


def flat_infos(infos: Mapping[str, Any], ends: Sequence[str]) -> dict[str, Any]:
    """Return the infos of a batch as :func:`flat_info` does: arrays of shape (n,), 0 where their masks are False."""
    present = infos["_cost"]
    nothing = {"end": np.full(len(present), ends[0], dtype=object), "is_success": np.zeros(len(present), bool)}
    full = {**nothing, **infos}
    flat: dict[str, Any] = {name: full.pop(name) for name in infos if name.removeprefix("_").startswith("final_")}
    if flat:  # by Gymnasium's convention: the last ones of cuts that ended
        flat["final_info"] = flat_infos(flat["final_info"], ends)
    for name, values in _without_groups(full).items():
        numbers = _numbers(name, values, ends)
        flat[name], flat["_" + name] = np.where(present, numbers, np.zeros_like(numbers)), present
    return flat


def _without_groups(info: Mapping[str, Any]) -> dict[str, Any]:
    """Return the entries of all groups and those of none, without masks."""
    flat: dict[str, Any] = {}
    for name, value in info.items():
        if name.startswith("_"):
            continue
        inside = value.items() if isinstance(value, dict) else ()
        flat |= {f"{name}_{key}": each for key, each in inside if not key.startswith("_")} or {name: value}
    return flat


def _numbers(name: str, value: Any, ends: Sequence[str]) -> Any:
    """Return a value, or one for each environment, as float64 or int64."""
    words = {"end": ends, "truth_specimen_class": CLASSES}.get(name)
    if words is not None:
        value = np.vectorize(lambda word: 0 if word is None else words.index(word), otypes=[np.int64])(value)
    numbers = np.asarray(value)
    return numbers.astype(np.float64 if numbers.dtype.kind == "f" else np.int64)[()]
