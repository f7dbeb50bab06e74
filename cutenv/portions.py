"""Portions of a batch that several cores take one after the other, so that none waits while there is work left.

Each core begins with a stretch of its own, the same at every pass: what it last wrote is still in its cache.  When
that is used up it takes from those of the others, which were fetched late or have other things to do as well.
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
"""Of one pass over a batch, shape (cores, 8): a line of a cache for each core, so that none waits for another's."""
_NEXT, _END, _FINISHED = range(3)  # of the core's stretch the next member and the end; how many it has finished
_LINE = 8
_WORD = ir.IntType(64)
_plain = threading.Lock()  # only where nothing is compiled


def portions(count: int, cores: int = 1) -> Portions:
    """Of a batch of ``count`` members in stretches for so many cores, none of them claimed."""
    passed = np.zeros((cores, _LINE), np.int64)
    passed[:, _END] = count * np.arange(1, cores + 1) // cores
    passed[1:, _NEXT] = passed[:-1, _END]
    return passed


@inlined
def claim(passed: Portions, core: int, size: int) -> tuple[int, int]:
    """Take the next members for ``core``, at most ``size``: the first, and the one after the last; 0 and 0 for none."""
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
    """Tell that ``core`` is done with ``size`` members: others may read what it made of them."""
    count_up(passed, core, _FINISHED, size)


@compiled_for_cores
def all_finished(passed: Portions, patience: int) -> bool:
    """Look up to ``patience`` times, a nanosecond or two each, whether all members are done with."""
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
    """Add to one of a core's numbers, in one instruction that no other core interrupts; what it was before."""
    with _plain:
        before = int(passed[core, which])
        passed[core, which] += size
    return before


def counted(passed: Any, core: Any, which: Any) -> Any:
    """One of a core's numbers, and with it what was written before it was counted up."""
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
