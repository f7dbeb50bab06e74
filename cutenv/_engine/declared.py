"""Kernels that are made from a declaration, such as a motion or a task: one source, compiled for each of them."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, wraps
from importlib import import_module
from operator import attrgetter
from typing import Any


class Declaration:
    """Object of a module from which kernels are made; copied or unpickled, it is the same object."""

    place: str
    """Module and name of the object, "package.module:NAME"."""

    def __reduce__(self) -> tuple[Callable[[str], Any], tuple[str]]:
        return _object_at, (self.place,)


def _object_at(place: str) -> Any:
    module, _, name = place.partition(":")
    return attrgetter(name)(import_module(module))


def compiled_for(decorate: Callable[[Any], Any]) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Return a decorator of a function that makes a kernel from a declaration.

    The decorated function makes each kernel once, when it is first asked for, and compiles it by ``decorate``, one of
    those of :mod:`cutenv._engine.jit`.  A kernel is kept on disk under module and name of its declaration.
    """

    def decorator(make: Callable[..., Any]) -> Callable[..., Any]:
        name = make.__name__

        @cache
        @wraps(make)
        def made(declaration: Any) -> Any:
            function = make(declaration)
            module, _, owner = declaration.place.partition(":")
            function.__module__, function.__name__, function.__qualname__ = module, name, f"{owner}.{name}"
            function.made_in = make.__module__
            kernel = decorate(function)
            # Numba names what a kernel encloses by where it is found: as an attribute of the declaration.
            declaration.__dict__[name] = kernel
            return kernel

        return made

    return decorator
