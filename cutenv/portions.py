"""Portions of a batch that several cores take one after the other, so that none waits while there is work left.

A core that was fetched late, or that others use as well, takes fewer.  Kernels claim and finish portions by single
atomic instructions.
"""

from __future__ import annotations

import threading
from typing import Any, TypeAlias

import numba
import numpy as np
from llvmlite import ir
from numpy.typing import NDArray

from cutenv.compiled import compiled_for_cores
from cutenv.intrinsics import array_data, lowered, typed

Portions: TypeAlias = NDArray[np.int64]
"""Of one pass over a batch: how many members were claimed, how many are finished, and how many there are."""
_CLAIMED, _FINISHED, MEMBERS = range(3)
_WORD = ir.IntType(64)
_plain = threading.Lock()  # only where nothing is compiled


def portions(count: int) -> Portions:
    """Of a batch of ``count`` members, none of them claimed."""
    return np.array((0, 0, count), np.int64)


def claim(passed: Any, size: Any) -> Any:
    """Take the next ``size`` members for oneself: the number of the first.

    The last portion reaches beyond the batch; one that begins there is none.
    """
    with _plain:
        first = int(passed[_CLAIMED])
        passed[_CLAIMED] += size
    return first


def finish(passed: Any, size: Any) -> None:
    """Tell that ``size`` members are done with: others may read what was made of them."""
    with _plain:
        passed[_FINISHED] += size


def finished(passed: Any) -> Any:
    """How many members are done with."""
    return int(passed[_FINISHED])


@typed(claim)
def _type_of_claim(_: Any) -> Any:
    return lambda passed, size: numba.types.int64


@typed(finish)
def _type_of_finish(_: Any) -> Any:
    return lambda passed, size: numba.types.none


@typed(finished)
def _type_of_finished(_: Any) -> Any:
    return lambda passed: numba.types.int64


def _counter(context: Any, builder: Any, signature: Any, arguments: Any, which: int) -> Any:
    return builder.gep(array_data(context, builder, signature, arguments, 0), [_WORD(which)])


def _size(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    return context.cast(builder, arguments[1], signature.args[1], numba.types.int64)


@lowered(claim, numba.types.Array, numba.types.Integer)
def _claim(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    counter = _counter(context, builder, signature, arguments, _CLAIMED)
    return builder.atomic_rmw("add", counter, _size(context, builder, signature, arguments), "monotonic")


@lowered(finish, numba.types.Array, numba.types.Integer)
def _finish(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    counter = _counter(context, builder, signature, arguments, _FINISHED)
    builder.atomic_rmw("add", counter, _size(context, builder, signature, arguments), "release")
    return context.get_dummy_value()


@lowered(finished, numba.types.Array)
def _finished(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    return builder.load_atomic(_counter(context, builder, signature, arguments, _FINISHED), "acquire", 8)


@compiled_for_cores
def all_finished(passed: Portions, patience: int) -> bool:
    """Look up to ``patience`` times, a nanosecond each, whether all members are done with."""
    looks = 0
    while finished(passed) < passed[MEMBERS] and looks < patience:
        looks += 1
    return bool(finished(passed) >= passed[MEMBERS])
