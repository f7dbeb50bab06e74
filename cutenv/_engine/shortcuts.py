"""Shortcuts through Numba's compiler for kernels.

Without them the first use takes a third longer.

All of it depends on how Numba works inside, and is used only with versions up to the one tested.  Nothing is
changed for the kernels of others: Numba compiles one function at a time, under a lock, and while that is a kernel of
this package its methods are replaced, and put back.
"""

from __future__ import annotations

import gc
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache, partial
from pathlib import Path
from typing import Any

import numba
from numba.core import compiler, targetconfig, types
from numba.core.compiler_lock import global_compiler_lock

fcntl: Any
try:
    import fcntl
except ModuleNotFoundError:  # Windows
    fcntl = None

TESTED = (0, 68)
"""Latest version of Numba, (major, minor), with which the shortcuts were tested: that of constraints.txt."""
_LOOKS_EVERY = 0.02  # [s] whether another process has compiled
_PATIENCE = 60.0  # [s] with another process, which may have been stopped
_held: set[Path] = set()  # folders that this process has locked; changed under Numba's lock only


def are_tested() -> bool:
    """Return True if shortcuts were tested with the installed Numba."""
    return bool(numba.version_info.short <= TESTED)


def type_of(dispatcher: Any) -> Any:
    """Return Numba's type of a ``numba.njit`` dispatcher."""
    return numba.types.Dispatcher(dispatcher)


class KernelCompiler(compiler.CompilerBase):
    """Numba's compiler without passes that kernels do not need: a tenth of the time.

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
    """Replace Numba methods by faster equivalents, and restore them."""
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
    """Compare compiler flags by their set values, for speed."""
    return own._values == getattr(other, "_values", None) or _equal_by_options(own, other)


def _hash(own: Any) -> int:
    """Return Numba's hash of compiler flags, that of the options' names."""
    return _hash_of_names(tuple(own.options))


@cache
def _hash_of_names(names: tuple[str, ...]) -> int:
    return hash(tuple(sorted(names)))


def _remembered(own: Any, context: Any, args: Any, kws: Any) -> Any:
    """Remember operators by types, as Numba tries 16 templates."""
    if kws or getattr(own.typing_key, "__module__", "") != "_operator":
        return _resolve(own, context, args, kws)
    key = own._code, context, args  # the code of a type is never given to another
    if (found := _known.get(key)) is None:
        found = _known[key] = _resolve(own, context, args, kws)
    return found


_FASTER = ((_flags, "__eq__", _equal), (_flags, "__hash__", _hash), (_function, "get_call_type", _remembered))


class LateInterrupt:
    """Postpone Ctrl-C until the current kernel is compiled or loaded.

    In a callback from LLVM the KeyboardInterrupt would be lost, or Numba would end in an error of its own.
    """

    def __init__(self) -> None:
        self._depth = 0
        self.interrupted = False
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
        if self.interrupted:
            self.interrupted = False
            if callable(self._handler):  # not SIG_IGN
                self._handler(signal.SIGINT, None)

    def _remember(self, number: int, frame: Any) -> None:
        self.interrupted = True


def _in_main_thread() -> bool:
    """Return True in the thread that receives the signals."""
    return threading.current_thread() is threading.main_thread()


_late_interrupt = LateInterrupt()


def compile_alone(dispatcher: Any, folder: Path | None) -> None:
    """Compile or load a kernel alone, with Ctrl-C postponed.

    Of several processes that want a kernel of ``folder``, one compiles it, and the others load what it has kept there.
    """
    dispatcher.compile = partial(_compile_or_load, dispatcher.compile, folder)


def _compile_or_load(compile_or_load: Callable[[Any], Any], folder: Path | None, signature: Any) -> Any:
    # Numba's own lock comes first, in every thread: two locks in either order would wait for each other.
    with _late_interrupt, global_compiler_lock, _alone_in(folder):
        return compile_or_load(signature)


@contextmanager
def _alone_in(folder: Path | None) -> Iterator[None]:
    """Wait, until Ctrl-C, while another process compiles in a lockable folder."""
    if fcntl is None or folder is None or folder in _held:
        yield
        return
    try:
        file = os.open(folder / "compiling.lock", os.O_RDWR | os.O_CREAT, 0o666)
    except OSError:  # the folder was removed, or can no longer be written to
        yield
        return
    _held.add(folder)
    try:
        ends = time.monotonic() + _PATIENCE
        while not _locked(file) and not _late_interrupt.interrupted and time.monotonic() < ends:
            time.sleep(_LOOKS_EVERY)
        yield
    finally:
        _held.discard(folder)
        os.close(file)  # ends the lock


def _locked(file: int) -> bool:
    """Lock a file unless locked; return True if no wait remains."""
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:  # a file system without locks
        return True
    return True
