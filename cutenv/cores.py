"""Spread a compiled loop over the cores.

Threads of Python's own run compiled code that has let go of the interpreter's lock.  Numba's parallel loops would do
the same, but take some four seconds each to compile, must not be forked, and wait for work by turning in a loop, which
robs whatever else runs beside them.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from cutenv.portions import all_finished, portions
from cutenv.validation import in_range

FEWEST = 32
"""Members of a batch, below which waking another thread (some 50 microseconds) costs more than it saves."""

_PATIENCE = 100_000  # looks at what is finished, some 100 microseconds, before a core is left to others

_cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else (os.cpu_count() or 1)
_threads: tuple[int, ThreadPoolExecutor] | None = None  # and the process that they belong to


def set_cores(count: int) -> None:
    """Use so many cores from now on; by default all that the process may use, or ``CUTENV_CORES``."""
    global _cores, _threads
    _cores = int(in_range("cores", count, 1, 4096, "1", "Give a whole number of cores."))
    _threads = None


def cores() -> int:
    """How many cores are used."""
    return _cores


if "CUTENV_CORES" in os.environ:
    set_cores(int(os.environ["CUTENV_CORES"]))


def over_cores(
    kernel: Callable[..., Any],
    count: int,
    *arguments: Any,
    fewest: int = FEWEST,
    meanwhile: Callable[[], None] | None = None,
) -> None:
    """Call ``kernel(portions, core, *arguments)`` on as many cores as there are ``fewest`` members for.

    The kernel takes portions of the ``count`` members (:mod:`cutenv.portions`) until there are none.  Who comes late
    finds the less to do; nobody waits for a thread that has not even begun.  ``meanwhile`` is called while other
    threads wake: for what needs nothing that the kernel fills.
    """
    workers = max(min(_cores, count // fewest), 1)
    of_batch = portions(count, workers)
    others = [_pool().submit(kernel, of_batch, core, *arguments) for core in range(1, workers)]
    try:
        if meanwhile is not None:
            meanwhile()
        kernel(of_batch, 0, *arguments)
    finally:
        # The last portion of another is finished sooner than its thread could say so.
        if others and not all_finished(of_batch, _PATIENCE):
            for other in others:
                other.result()
        for other in others:
            other.cancel()


def _pool() -> ThreadPoolExecutor:
    """Threads of this process: a fork inherits none."""
    global _threads
    if _threads is None or _threads[0] != os.getpid():
        _threads = os.getpid(), ThreadPoolExecutor(max(_cores - 1, 1), "cutenv")
    return _threads[1]
