"""Work queue for a batch that several threads share: chunks are claimed with atomic counters, so that none idles.

Each thread starts with its own contiguous range, the same one at every pass, because what it last wrote is still in
its cache.  When that range is used up it steals chunks from the ranges of threads that woke late or are busy.
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from cutenv._engine.intrinsics import CACHE_LINE, atomic_add, atomic_load
from cutenv._engine.jit import njit_inline, njit_nogil

WorkQueue: TypeAlias = NDArray[np.int64]
"""Work queue of one pass over a batch, shape (threads, 8): one cache line for each thread avoids false sharing."""
_NEXT, _END, _FINISHED = range(3)  # columns: next unclaimed item and end of the thread's range; items it has done


def make_queue(count: int, cores: int = 1) -> WorkQueue:
    """Make a work queue: split ``count`` items into one contiguous range per thread."""
    passed = np.zeros((cores, CACHE_LINE), np.int64)
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
