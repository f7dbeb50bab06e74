"""Functions that Numba lacks, for kernels.

Bit patterns of floats, prefetch, uncounted references, atomic counters.

Here each is plain Python, against which the tests compare; :mod:`cutenv._engine.lowering` registers them with Numba.
"""

from __future__ import annotations

import struct
import threading
from typing import Any, TypeVar

import numpy as np

Arrays = TypeVar("Arrays", bound=tuple[Any, ...])
CACHE_LINE = 8  # 64-bit words in a cache line, and so in a row of counters
_plain = threading.Lock()  # used only where nothing is compiled


def bits_of(number: float) -> int:
    """Return the 64 bits of a float as a signed integer."""
    return int(struct.unpack("<q", struct.pack("<d", number))[0])


def float_of(bits: int) -> float:
    """Return the float of a signed integer's 64 bits."""
    return float(struct.unpack("<d", struct.pack("<q", bits))[0])


def prefetch(array: Any, i: Any) -> None:
    """Prefetch element ``i`` into the first-level cache, without waiting; not in Python."""


def first_row(rows: Any) -> Any:
    """Return the first record of rows, which compiles fast.

    Its indices must not be negative.  It does not keep the array in memory: a kernel that made the array ends with
    :func:`keep_alive`.
    """
    return rows[0]


def keep_alive(array: Any) -> None:
    """Keep an array until here, despite Numba's early freeing under :func:`first_row`; not in Python."""


def without_refcount(arrays: Arrays) -> Arrays:
    """Return a tuple of arrays, numbers among them, without reference counting.

    The caller must keep the arrays alive.  Threads that count references to the same array contend; plain Python still
    counts them.
    """
    return arrays


def as_float64_view(records: Any) -> Any:
    """View 8-byte fields as flat float64, (size,), without copying.

    Replaces ``view`` in kernels, which takes a fifth of a second to compile.
    """
    return records.reshape(-1).view(np.float64)


def atomic_add(counters: Any, row: Any, which: Any, size: Any) -> Any:
    """Add ``size`` atomically; return the previous value (acquire-release)."""
    with _plain:
        before = int(counters[row, which])
        counters[row, which] += size
    return before


def atomic_load(counters: Any, row: Any, which: Any) -> Any:
    """Load one counter of a row atomically (acquire)."""
    return int(counters[row, which])
