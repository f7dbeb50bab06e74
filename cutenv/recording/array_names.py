"""Names and units of arrays, as they stand beside them in a structure of MATLAB, an ``.npz`` or a group of HDF5."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from cutenv.recording.array_tables import NamedArray
from cutenv.recording.stated_units import known_spelling

_FEW_TEXTS = 16  # a longer list of text may be a column of times, and not names or units
_LABELS, _VALUES, _UNITS = ("label", "title", "name"), ("values", "data"), ("units", "unit")


class Elements(dict[str, Any]):
    """Elements of an array of structures or cells, named by their numbers."""


def named_arrays(content: Mapping[str, Any], before: str = "") -> Iterator[NamedArray]:
    """Yield the numbers of a structure with their places, and with the names and units that stand beside them.

    Parameters
    ----------
    content : mapping
        By name: a NamedArray, an ndarray, a list of text, or a mapping of these. A list with an entry for each column
        of a matrix names them, or gives their units. A mapping of a label and its values, as Simulink and Spike2 have
        for each channel, is a column.
    before : str
        Place of the structure, with a dot behind it.
    """
    arrays = {
        name: _as_array(name, value) for name, value in content.items() if isinstance(value, np.ndarray | NamedArray)
    }
    lists = {name: tuple(value) for name, value in content.items() if isinstance(value, list) and value}
    vectors = [name for name, array in arrays.items() if array.values.size > 1]
    in_order = next((texts for texts in lists.values() if len(texts) == len(vectors) > 1 and _are_units(texts)), ())
    units = dict(zip(vectors, in_order, strict=False))
    for name, value in content.items():
        if isinstance(value, dict):
            channel = _channel(value)
            if channel is not None:
                yield replace(channel, name=f"{before}{channel.name}")
                yield from (
                    replace(each, name=f"{before}{name}.{each.name}")
                    for each in named_arrays(value)
                    if each.values.size == 1
                )
            else:
                yield from named_arrays(value, before if isinstance(value, Elements) else f"{before}{name}.")
        elif name in arrays:
            array = _labelled(arrays[name], lists)
            unit = array.unit or units.get(name) or _unit_beside(name, content)
            yield replace(array, name=f"{before}{name}", unit=unit)
        elif isinstance(value, list) and len(value) > _FEW_TEXTS:
            yield NamedArray(f"{before}{name}", np.array(value))


def _as_array(name: str, value: Any) -> NamedArray:
    return value if isinstance(value, NamedArray) else NamedArray(name, value)


def _channel(content: Mapping[str, Any]) -> NamedArray | None:
    """Return the channel that a structure of a label and its values is; None for any other structure."""
    by_key = {key.lower(): value for key, value in content.items()}
    label = next((value[0] for key in _LABELS if isinstance(value := by_key.get(key), list) and len(value) == 1), "")
    values = next((value for key in _VALUES if isinstance(value := by_key.get(key), np.ndarray | NamedArray)), None)
    array = None if values is None else _as_array(label, values)
    if not label or array is None or array.values.size < 2 or array.values.size != max(array.values.shape):
        return None
    unit = next((value[0] for key in _UNITS if isinstance(value := by_key.get(key), list) and len(value) == 1), "")
    return replace(array, name=label, unit=array.unit or unit)


def _labelled(array: NamedArray, lists: Mapping[str, tuple[str, ...]]) -> NamedArray:
    """Return a matrix with the lists of text beside it that have an entry for each of its columns."""
    counts = {count for count in array.values.shape if count > 1} if array.values.ndim == 2 else set()
    fitting = [texts for texts in lists.values() if len(texts) in counts and any(texts)]
    units = next((texts for texts in fitting if _are_units(texts)), ())
    labels = next((texts for texts in fitting if texts != units and len({*texts}) == len(texts)), ())
    return replace(array, names=array.names or labels, units=array.units or units)


def _are_units(texts: Collection[str]) -> bool:
    return all(not text or known_spelling(text) is not None for text in texts)


def _unit_beside(name: str, content: Mapping[str, Any]) -> str:
    """Return the unit that a variable called after another holds, ``force_unit``, or a structure ``units.force``."""
    stem = name.lower()
    called = {f"{stem}_unit", f"{stem}_units", f"{stem}unit", f"{stem}units", f"unit_{stem}", f"units_{stem}"}
    for other, value in content.items():
        if isinstance(value, dict) and other.lower() in _UNITS:
            value = value.get(name)
        elif other.lower() not in called:
            continue
        if isinstance(value, list) and len(value) == 1:
            return str(value[0])
    return ""
