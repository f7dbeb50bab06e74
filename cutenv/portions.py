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

from cutenv.compiled import compiled_for_cores, inlined
from cutenv.intrinsics import array_data, lowered, typed

Portions: TypeAlias = NDArray[np.int64]
"""Work queue of one pass over a batch, shape (threads, 8): one cache line for each thread avoids false sharing."""
_NEXT, _END, _FINISHED = range(3)  # columns: next unclaimed item and end of the thread's range; items it has done
_LINE = 8  # 64-bit words in a cache line
_WORD = ir.IntType(64)
_plain = threading.Lock()  # used only where nothing is compiled


def portions(count: int, cores: int = 1) -> Portions:
    """Make a work queue: split ``count`` items into one contiguous range per thread."""
    passed = np.zeros((cores, _LINE), np.int64)
    passed[:, _END] = count * np.arange(1, cores + 1) // cores
    passed[1:, _NEXT] = passed[:-1, _END]
    return passed


@inlined
def claim(passed: Portions, core: int, size: int) -> tuple[int, int]:
    """Claim the next chunk for thread ``core``, at most ``size`` items: (first, end), or (0, 0) when none is left."""
    for k in range(len(passed)):
        stretch = (core + k) % len(passed)
        end = passed[stretch, _END]
        if counted(passed, stretch, _NEXT) < end:
            first = count_up(passed, stretch, _NEXT, size)
            if first < end:
                return first, min(first + size, end)
    return 0, 0


@inlined
def finish(passed: Portions, core: int, size: int) -> None:
    """Mark ``size`` items as done by ``core``; a release operation, so that others may read the results."""
    count_up(passed, core, _FINISHED, size)


@compiled_for_cores
def all_finished(passed: Portions, patience: int) -> bool:
    """Poll up to ``patience`` times, a nanosecond or two each; return True as soon as all items are done."""
    core, left = 0, passed[len(passed) - 1, _END]
    for _ in range(patience + len(passed)):
        if core == len(passed):
            if left <= 0:
                return True
            core, left = 0, passed[len(passed) - 1, _END]
        left -= counted(passed, core, _FINISHED)
        core += 1
    return False


def count_up(passed: Any, core: Any, which: Any, size: Any) -> Any:
    """Add ``size`` atomically to one counter of a thread (acquire-release) and return its value before."""
    with _plain:
        before = int(passed[core, which])
        passed[core, which] += size
    return before


def counted(passed: Any, core: Any, which: Any) -> Any:
    """Load one counter of a thread atomically (acquire): what was written before it was raised is visible too."""
    return int(passed[core, which])


@typed(count_up)
def _type_of_count_up(_: Any) -> Any:
    return lambda passed, core, which, size: numba.types.int64


@typed(counted)
def _type_of_counted(_: Any) -> Any:
    return lambda passed, core, which: numba.types.int64


def _place(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    core, which = (_integer(context, builder, signature, arguments, k) for k in (1, 2))
    place = builder.add(builder.mul(core, _WORD(_LINE)), which)
    return builder.gep(array_data(context, builder, signature, arguments, 0), [place])


def _integer(context: Any, builder: Any, signature: Any, arguments: Any, k: int) -> Any:
    return context.cast(builder, arguments[k], signature.args[k], numba.types.int64)


@lowered(count_up, numba.types.Array, *[numba.types.Integer] * 3)
def _count_up(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    place = _place(context, builder, signature, arguments)
    return builder.atomic_rmw("add", place, _integer(context, builder, signature, arguments, 3), "acq_rel")


@lowered(counted, numba.types.Array, *[numba.types.Integer] * 2)
def _counted(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    return builder.load_atomic(_place(context, builder, signature, arguments), "acquire", 8)
