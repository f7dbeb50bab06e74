"""Thread pool for compiled loops, and its queue by atomic counters."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from cutenv._base.validation import in_range
from cutenv._engine.intrinsics import CACHE_LINE, atomic_add, atomic_load
from cutenv._engine.jit import njit_inline, njit_nogil

WorkQueue: TypeAlias = NDArray[np.int64]
"""Work queue of one pass over a batch, shape (threads, 8): one cache line for each thread avoids false sharing."""
_NEXT, _END, _FINISHED = range(3)  # columns: next unclaimed item and end of the thread's range; items it has done


def make_queue(count: int, cores: int = 1) -> WorkQueue:
    """Make a work queue of one contiguous range per thread."""
    passed = np.zeros((cores, CACHE_LINE), np.int64)
    passed[:, _END] = count * np.arange(1, cores + 1) // cores
    passed[1:, _NEXT] = passed[:-1, _END]
    return passed


@njit_inline
def next_chunk(passed: WorkQueue, core: int, size: int) -> tuple[int, int]:
    """Claim at most ``size`` items: (first, end), or (0, 0)."""
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
    """Release ``size`` items of ``core`` as done, for others to read."""
    atomic_add(passed, core, _FINISHED, size)


@njit_nogil
def wait_done(passed: WorkQueue, patience: int) -> bool:
    """Poll up to ``patience`` times, nanoseconds each; return True when done."""
    core, left = 0, passed[len(passed) - 1, _END]
    for _ in range(patience + len(passed)):
        if core == len(passed):
            if left <= 0:
                return True
            core, left = 0, passed[len(passed) - 1, _END]
        left -= atomic_load(passed, core, _FINISHED)
        core += 1
    return False


MIN_CHUNK = 32
"""Smallest number of items per thread: below it, waking a thread (some 50 microseconds) costs more than it saves."""

_PATIENCE = 100_000  # polls for the last chunks, some 100 microseconds, before the thread blocks

_cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else (os.cpu_count() or 1)
_threads: tuple[int, ThreadPoolExecutor] | None = None  # id of the process that owns the pool, and the pool


def set_cores(count: int) -> None:
    """Set the number of threads, by default ``CUTENV_CORES`` or all."""
    global _cores, _threads
    _cores = int(in_range("cores", count, 1, 4096, "1", "Give a whole number of cores."))
    _threads = None


def _number_of_cores(text: str) -> int:
    """Return the number of cores from an environment variable."""
    cure = "Give a whole number of cores, or unset it."
    if not text.strip().isdecimal():
        raise ValueError(f"CUTENV_CORES = {text!r} is no number of cores. {cure}")
    return int(in_range("CUTENV_CORES", int(text), 1, 4096, "1", cure))


def cores() -> int:
    """Return the number of threads that batches use."""
    return _cores


if _wanted := os.environ.get("CUTENV_CORES"):
    set_cores(_number_of_cores(_wanted))


def parallel_for(
    kernel: Callable[..., Any],
    count: int,
    *arguments: Any,
    fewest: int = MIN_CHUNK,
    meanwhile: Callable[[], None] | None = None,
) -> None:
    """Run ``kernel(queue, thread, *arguments)`` on up to a thread per ``fewest`` items.

    The kernel claims chunks of the ``count`` items (:mod:`cutenv._engine.parallel`) until there are none.  A thread
    that wakes late finds less to do, and nobody waits for a thread that has not begun.  ``meanwhile`` is called while
    the other threads wake: for work that does not need what the kernel fills.
    """
    workers = max(min(_cores, count // fewest), 1)
    of_batch = make_queue(count, workers)
    others = [_pool().submit(kernel, of_batch, core, *arguments) for core in range(1, workers)]
    try:
        if meanwhile is not None:
            meanwhile()
        kernel(of_batch, 0, *arguments)
    finally:
        # The last chunk of another thread is done before its future is set, so poll the queue first.
        if others and not wait_done(of_batch, _PATIENCE):
            for other in others:
                other.result()
        for other in others:
            other.cancel()


def _pool() -> ThreadPoolExecutor:
    """Return this process's thread pool, remade after a fork."""
    global _threads
    if _threads is None or _threads[0] != os.getpid():
        _threads = os.getpid(), ThreadPoolExecutor(max(_cores - 1, 1), "cutenv")
    return _threads[1]
