"""Work queue for a batch that several threads share: chunks are claimed with atomic counters, so that none idles.

Each thread starts with its own contiguous range, the same one at every pass, because what it last wrote is still in
its cache.  When that range is used up it steals chunks from the ranges of threads that woke late or are busy.
"""

from __future__ import annotations

import threading
from typing import Any, TypeAlias

import numba
import numpy as np
from llvmlite import ir
from numpy.typing import NDArray

from cutenv._engine.intrinsics import array_data, lower_builtin, type_callable
from cutenv._engine.jit import njit_inline, njit_nogil

WorkQueue: TypeAlias = NDArray[np.int64]
"""Work queue of one pass over a batch, shape (threads, 8): one cache line for each thread avoids false sharing."""
_NEXT, _END, _FINISHED = range(3)  # columns: next unclaimed item and end of the thread's range; items it has done
_LINE = 8  # 64-bit words in a cache line
_WORD = ir.IntType(64)
_plain = threading.Lock()  # used only where nothing is compiled


def make_queue(count: int, cores: int = 1) -> WorkQueue:
    """Make a work queue: split ``count`` items into one contiguous range per thread."""
    passed = np.zeros((cores, _LINE), np.int64)
    passed[:, _END] = count * np.arange(1, cores + 1) // cores
    passed[1:, _NEXT] = passed[:-1, _END]
    return passed


@njit_inline
def next_chunk(passed: WorkQueue, core: int, size: int) -> tuple[int, int]:
    """Claim the next chunk for thread ``core``, at most ``size`` items: (first, end), or (0, 0) when none is left."""
    for k in range(len(passed)):
        stretch = (core + k) % len(passed)
        end = passed[stretch, _END]
        if atomic_load(passed, stretch, _NEXT) < end:
            first = atomic_add(passed, stretch, _NEXT, size)
            if first < end:
                return first, min(first + size, end)
    return 0, 0


@njit_inline
def mark_done(passed: WorkQueue, core: int, size: int) -> None:
    """Mark ``size`` items as done by ``core``; a release operation, so that others may read the results."""
    atomic_add(passed, core, _FINISHED, size)


@njit_nogil
def wait_done(passed: WorkQueue, patience: int) -> bool:
    """Poll up to ``patience`` times, a nanosecond or two each; return True as soon as all items are done."""
    core, left = 0, passed[len(passed) - 1, _END]
    for _ in range(patience + len(passed)):
        if core == len(passed):
            if left <= 0:
                return True
            core, left = 0, passed[len(passed) - 1, _END]
        left -= atomic_load(passed, core, _FINISHED)
        core += 1
    return False


def atomic_add(passed: Any, core: Any, which: Any, size: Any) -> Any:
    """Add ``size`` atomically to one counter of a thread (acquire-release) and return its value before."""
    with _plain:
        before = int(passed[core, which])
        passed[core, which] += size
    return before


def atomic_load(passed: Any, core: Any, which: Any) -> Any:
    """Load one counter of a thread atomically (acquire): what was written before it was raised is visible too."""
    return int(passed[core, which])


@type_callable(atomic_add)
def _type_of_count_up(_: Any) -> Any:
    return lambda passed, core, which, size: numba.types.int64


@type_callable(atomic_load)
def _type_of_counted(_: Any) -> Any:
    return lambda passed, core, which: numba.types.int64


def _place(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    core, which = (_integer(context, builder, signature, arguments, k) for k in (1, 2))
    place = builder.add(builder.mul(core, _WORD(_LINE)), which)
    return builder.gep(array_data(context, builder, signature, arguments, 0), [place])


def _integer(context: Any, builder: Any, signature: Any, arguments: Any, k: int) -> Any:
    return context.cast(builder, arguments[k], signature.args[k], numba.types.int64)


@lower_builtin(atomic_add, numba.types.Array, *[numba.types.Integer] * 3)
def _count_up(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    place = _place(context, builder, signature, arguments)
    return builder.atomic_rmw("add", place, _integer(context, builder, signature, arguments, 3), "acq_rel")


@lower_builtin(atomic_load, numba.types.Array, *[numba.types.Integer] * 2)
def _counted(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    return builder.load_atomic(_place(context, builder, signature, arguments), "acquire", 8)
