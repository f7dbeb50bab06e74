"""Kernels of a wheel's library, compiled ahead of time.

``scripts/build_kernels.py`` builds the library.

The library is used as a whole or not at all: where any source file differs from the one that it was built from, Numba
compiles, as it does in a checkout, which has no library.  A call with types that the library lacks goes to Numba, too.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Iterable
from functools import cached_property, update_wrapper
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

_PACKAGE = Path(__file__).parents[1]


def digest_of(files: Iterable[str], package: Path = _PACKAGE) -> str:
    """Return a digest of package files; empty if one is missing."""
    content = hashlib.sha256()
    for name in files:
        try:
            text = (package / name).read_bytes()
        except OSError:
            return ""
        content.update(hashlib.sha256(text.replace(b"\r\n", b"\n")).digest())
    return content.hexdigest()


def memory_of(dtype: np.dtype[Any]) -> str:
    """Describe a dtype's memory: names, offsets and kinds."""
    if dtype.subdtype is not None:
        base, shape = dtype.subdtype
        return f"{memory_of(base)}{list(shape)}"
    if dtype.names is None:
        return dtype.str
    fields = [(name, dtype.fields[name]) for name in dtype.names] if dtype.fields is not None else []
    held = ",".join(f"{name}@{offset}:{memory_of(kind)}" for name, (kind, offset, *_) in fields)
    return f"{{{held}}}{dtype.itemsize}"


def _loaded() -> Any:
    """Return the library if present and built from this source."""
    if os.environ.get("NUMBA_DISABLE_JIT") or os.environ.get("CUTENV_COMPILE"):
        return None
    try:
        library = import_module("cutenv._engine._kernels")
    except ImportError:  # a checkout, or a system that it was not built for
        return None
    if digest_of(library.sources) != library.digest:
        return None
    library.identify(lambda number, dtype: memory_of(dtype) == library.dtypes[number])
    return library


LIBRARY = _loaded()
_built: dict[str, list[int]] = {}
if LIBRARY is not None:
    for _number, _name in enumerate(LIBRARY.names):
        _built.setdefault(_name, []).append(_number)
_modules = {name.partition(":")[0] for name in _built}


def covers(function: Callable[..., Any]) -> bool:
    """Return True if the library has compiled a function of this package."""
    return LIBRARY is not None and function.__module__.partition(".")[0] == _PACKAGE.name


class Kernel:
    """Kernel from the library, or compiled by Numba when called."""

    def __init__(self, function: Callable[..., Any], compile: Callable[[], Any]) -> None:
        update_wrapper(self, function)
        self.py_func = function
        self._compile = compile
        built = _built.get(f"{function.__module__}:{function.__qualname__}", [])
        self.is_built = bool(built)
        call: Callable[..., Any] = LIBRARY.kernel(built, lambda *arguments: self.compiled(*arguments))
        self._call = call
        if named := {LIBRARY.classes[number] for number in built} - {""}:
            module, _, name = named.pop().partition(":")
            make = getattr(import_module(module), name)._make
            self._call = lambda *arguments: make(call(*arguments))

    def __call__(self, *arguments: Any) -> Any:
        """Compute; the arguments are those of the function, by place."""
        return self._call(*arguments)

    @cached_property
    def compiled(self) -> Any:
        """The function as Numba compiles it."""
        return self._compile()

    @property
    def _numba_type_(self) -> Any:
        """Numba type of a kernel when called from another."""
        return self.compiled._numba_type_
