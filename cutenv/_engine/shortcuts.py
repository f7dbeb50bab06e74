"""Shortcuts through Numba's compiler for kernels; without them the first use takes a third longer.

All of it depends on how Numba works inside, and is used only with versions up to the one tested.  Nothing is
changed for the kernels of others: Numba compiles one function at a time, under a lock, and while that is a kernel of
this package its methods are replaced, and put back.
"""

from __future__ import annotations

import gc
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache, partial
from typing import Any

import numba
from numba.core import compiler, targetconfig, types

TESTED = (0, 68)
"""Latest version of Numba, (major, minor), with which the shortcuts were tested: that of constraints.txt."""


def are_tested() -> bool:
    """Return True if the shortcuts were tested with the Numba that is installed."""
    return bool(numba.version_info.short <= TESTED)


class KernelCompiler(compiler.CompilerBase):
    """Numba's compiler without the passes for what kernels do not contain, a tenth of the time.

    Kernels have no closures, no ``with``, no loops over tuples of different types, and nobody reads type annotations.
    """

    _UNUSED = (
        "WithLifting",
        "InlineClosureLikes",
        "FindLiterallyCalls",
        "LiteralUnroll",
        "LiteralPropagationSubPipelinePass",
        "MakeFunctionToJitFunction",
        "InlineInlinables",
        "AnnotateTypes",
    )

    def define_pipelines(self) -> list[Any]:
        builder: Any = compiler.DefaultPassBuilder  # has no types
        passes = builder.define_nopython_pipeline(self.state)
        passes.passes[:] = [step for step in passes.passes if step[0].__name__ not in self._UNUSED]
        return [passes]

    def compile_extra(self, func: Any) -> Any:
        with _without_collection(), _replaced_methods():
            compile_extra: Any = super().compile_extra  # has no types
            return compile_extra(func)


@contextmanager
def _without_collection() -> Iterator[None]:
    """Keep garbage collection away: 5 % less time."""
    collects = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if collects:
            gc.enable()


@contextmanager
def _replaced_methods() -> Iterator[None]:
    """Replace methods of Numba by faster ones of the same results, and put back those that were there."""
    before = [(owner, name, getattr(owner, name)) for owner, name, _ in _FASTER]
    try:
        for owner, name, method in _FASTER:
            setattr(owner, name, method)
        yield
    finally:
        for owner, name, method in before:
            setattr(owner, name, method)


_flags: Any = targetconfig.TargetConfig  # these have no types
_function: Any = types.functions.BaseFunction
_equal_by_options = _flags.__eq__
_resolve = _function.get_call_type
_known: dict[Any, Any] = {}


def _equal(own: Any, other: Any) -> Any:
    """Compare compiler flags by what was set before Numba reads each of 30 options: a twentieth of compiling."""
    return own._values == getattr(other, "_values", None) or _equal_by_options(own, other)


def _hash(own: Any) -> int:
    """Return Numba's own hash of compiler flags, which is that of the options' names, whatever was set."""
    return _hash_of_names(tuple(own.options))


@cache
def _hash_of_names(names: tuple[str, ...]) -> int:
    return hash(tuple(sorted(names)))


def _remembered(own: Any, context: Any, args: Any, kws: Any) -> Any:
    """Remember what an operator of given types is: at each ``a[n]`` Numba tries up to 16 templates."""
    if kws or getattr(own.typing_key, "__module__", "") != "_operator":
        return _resolve(own, context, args, kws)
    key = own._code, context, args  # the code of a type is never given to another
    if (found := _known.get(key)) is None:
        found = _known[key] = _resolve(own, context, args, kws)
    return found


_FASTER = (
    (_flags, "__eq__", _equal),
    (_flags, "__hash__", _hash),
    (_function, "get_call_type", _remembered),
)


class LateInterrupt:
    """Let a Ctrl-C wait until the kernel at hand is compiled or loaded, mostly under a second.

    In a callback from LLVM the KeyboardInterrupt would be lost, or Numba would end in an error of its own.
    """

    def __init__(self) -> None:
        self._depth = 0
        self._interrupted = False
        self._handler: Any = None

    def __enter__(self) -> None:
        if not _in_main_thread():
            return
        if self._depth == 0:
            self._handler = signal.signal(signal.SIGINT, self._remember)
        self._depth += 1

    def __exit__(self, *_: object) -> None:
        if not _in_main_thread():
            return
        self._depth -= 1
        if self._depth == 0 and self._handler is not None:  # None: not set from Python
            signal.signal(signal.SIGINT, self._handler)
        if self._interrupted:
            self._interrupted = False
            if callable(self._handler):  # not SIG_IGN
                self._handler(signal.SIGINT, None)

    def _remember(self, number: int, frame: Any) -> None:
        self._interrupted = True


def _in_main_thread() -> bool:
    """Return True in the thread that receives the signals."""
    return threading.current_thread() is threading.main_thread()


_late_interrupt = LateInterrupt()


def interrupt_late(dispatcher: Any) -> None:
    """Let a Ctrl-C wait while ``dispatcher``, as ``numba.njit`` returns it, compiles or loads its function."""
    dispatcher.compile = partial(_compile_or_load, dispatcher.compile)


def _compile_or_load(compile_or_load: Callable[[Any], Any], signature: Any) -> Any:
    with _late_interrupt:
        return compile_or_load(signature)
