"""Kernels made from declarations, such as motions and tasks.

One source is compiled for each declaration; declared formulas are fused into one kernel.

A table such as that of the reward's terms declares each entry's formula as a lambda.  Numba would compile every lambda
for a tenth of a second; here their expressions are spliced, as source text, into one function that is compiled once.
The parameters of a formula are the names of the quantities that it uses, which are the local variables of that
function; a name that it does not have is refused at import.
"""

from __future__ import annotations

import ast
import inspect
import linecache
import sys
from collections.abc import Callable, Collection, Sequence
from functools import cache, lru_cache, wraps
from importlib import import_module
from operator import attrgetter
from types import CodeType, ModuleType
from typing import Any, TypeAlias


class Declaration:
    """Object of a module from which kernels are made, the same when copied."""

    place: str  # module and name of the object, "package.module:NAME"

    def __reduce__(self) -> tuple[Callable[[str], Any], tuple[str]]:
        return _object_at, (self.place,)


def _object_at(place: str) -> Any:
    module, _, name = place.partition(":")
    return attrgetter(name)(import_module(module))


def compiled_for(decorate: Callable[[Any], Any]) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Decorate a function that makes a kernel from a declaration.

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


Formula: TypeAlias = Callable[..., Any]
"""A lambda whose parameters name quantities; all of its other names are constants or functions of its module."""


def expression(formula: Formula, quantities: Collection[str], renamed: dict[str, str] | None = None) -> str:
    """Return the source of a lambda's expression, in parentheses.

    ``quantities`` are names that its parameters may have, ``renamed`` expressions to put in the place of some.
    ValueError if it asks for another quantity, or is not a lambda whose source can be read.
    """
    names, renamed = inspect.signature(formula).parameters, renamed or {}
    for name in names:
        if name not in quantities and name not in renamed:
            known = ", ".join(sorted({*quantities, *renamed}))
            raise ValueError(f"{_place(formula)}: a formula asks for {name!r}; here there are: {known}.")
    tree = ast.parse(ast.unparse(_lambda(formula).body), mode="eval")
    return f"({ast.unparse(_Renaming({name: renamed[name] for name in names if name in renamed}).visit(tree))})"


def fuse(name: str, parameters: Sequence[str], lines: Sequence[str], modules: Sequence[ModuleType | str]) -> Any:
    """Return a function of the given body, not compiled yet.

    The ``lines`` of its body are indented below the first; they use constants and functions of the ``modules``.
    """
    space: dict[str, Any] = {}
    for module in modules:
        space |= vars(sys.modules[module] if isinstance(module, str) else module)
    file = f"<fused {name}>"
    source = (
        "\n".join([f"def {name}({', '.join(parameters)}):", *(f"    {line}" for line in (*lines, "return"))]) + "\n"
    )
    linecache.cache[file] = len(source), None, source.splitlines(keepends=True), file  # for tracebacks
    exec(compile(source, file, "exec"), space)
    return space[name]


class _Renaming(ast.NodeTransformer):
    def __init__(self, renamed: dict[str, str]) -> None:
        self._renamed = {name: ast.parse(text, mode="eval").body for name, text in renamed.items()}

    def visit_Name(self, node: ast.Name) -> ast.AST:  # named by ast
        return self._renamed.get(node.id, node)


@lru_cache
def _lambdas(file: str) -> list[ast.Lambda]:
    source = "".join(linecache.getlines(file))
    return [node for node in ast.walk(ast.parse(source)) if isinstance(node, ast.Lambda)]


def _lambda(formula: Formula) -> ast.Lambda:
    """Find a lambda's syntax tree by line and compiled code."""
    code = formula.__code__
    for node in _lambdas(code.co_filename):
        if node.lineno == code.co_firstlineno and _same(node, code):
            return node
    raise ValueError(f"{_place(formula)}: the source of this formula cannot be read; give a lambda of one expression.")


def _same(node: ast.Lambda, code: CodeType) -> bool:
    again = eval(compile(ast.fix_missing_locations(ast.Expression(node)), code.co_filename, "eval")).__code__
    return bool(_content(again) == _content(code))


def _content(code: CodeType) -> tuple[object, ...]:
    constants = [(type(constant), constant) for constant in code.co_consts]  # 1 == 1.0
    return code.co_code, code.co_varnames, code.co_names, constants


def _place(formula: Formula) -> str:
    return f"{formula.__code__.co_filename}:{formula.__code__.co_firstlineno}"
