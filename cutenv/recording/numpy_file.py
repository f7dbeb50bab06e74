"""Files of NumPy: the arrays in an ``.npz``, or the one of an ``.npy``; nothing is unpickled."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path
from typing import Any

import numpy as np

from cutenv.recording.array_names import named_arrays
from cutenv.recording.array_tables import NamedArray, table_of_arrays
from cutenv.recording.named_columns import NamedColumns
from cutenv.recording.schema import RecordError


def read(path: Path, names: Collection[str] = ()) -> NamedColumns:
    """Read an ``.npz`` or ``.npy`` file; raises RecordError if it is none, or holds no arrays of numbers."""
    notes: list[str] = []
    content: dict[str, Any] = {}
    try:
        found = np.load(path)  # without unpickling, since NumPy 1.16.3
        if isinstance(found, np.ndarray):
            content[""] = NamedArray("", found)
        else:
            with found:
                for name in found.files:
                    try:
                        values = found[name]
                        content[name] = values.reshape(-1).astype(str).tolist() if values.dtype.kind in "US" else values
                    except ValueError:
                        notes.append(f"{name} left out: it holds objects of Python, which are not unpickled")
    except Exception as error:  # a damaged file raises errors of any kind
        reason = str(error).partition("\n")[0] or type(error).__name__
        raise RecordError(path, f"it is no file of NumPy, or a damaged one ({reason}). Take the file again.") from None
    return table_of_arrays(path, named_arrays(content), "arrays of NumPy", names, notes)
