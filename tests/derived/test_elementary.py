"""Elementary functions: beside numbers of fifty digits, the same bits everywhere, and no others in any kernel."""

from __future__ import annotations

import ast
import hashlib
import inspect
import math
import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import mpmath
import numba
import numpy as np
import pytest

import cutenv
from cutenv._engine import elementary
from cutenv._engine.elementary import cotangent, exp, log, tanh
from cutenv._engine.jit import njit

Function = Callable[[float], float]
RNG = np.random.default_rng(1)
LN2 = math.log(2.0)
ANGLES = np.radians(np.concatenate([
    np.linspace(-45.0, 225.0, 4001), 90.0 + np.linspace(-0.01, 0.01, 201), 10.0 ** np.linspace(-9.0, 1.0, 101),
    180.0 - 10.0 ** np.linspace(-9.0, 1.0, 101),
]))  # fmt: skip
EXPONENTS = np.concatenate([
    RNG.uniform(-745.1, 709.78, 4000), RNG.uniform(-1.0, 1.0, 2000), (np.arange(-1074, 1023) + 0.5) * LN2,
    RNG.choice([-1.0, 1.0], 500) * 10.0 ** RNG.uniform(-320.0, 0.0, 500),
])  # fmt: skip
POSITIVE = np.concatenate([
    10.0 ** RNG.uniform(-323.0, 308.0, 3000), RNG.uniform(0.4, 3.0, 2000), 1.0 + RNG.uniform(-0.02, 0.02, 2000),
    1.0 + 10.0 ** RNG.uniform(-15.0, -2.0, 500), 2.0 ** np.arange(-1000.0, 1000.0) * math.sqrt(0.5),
])  # fmt: skip
ALL = np.concatenate([RNG.uniform(-3.0, 3.0, 4000), RNG.uniform(-25.0, 25.0, 1000), EXPONENTS[-500:]])
CASES = [
    (exp, mpmath.exp, EXPONENTS, 1.0),
    (log, mpmath.log, POSITIVE, 1.0),
    (tanh, mpmath.tanh, ALL, 3.0),
    (cotangent, mpmath.cot, ANGLES[ANGLES != 0.0], 3.0),
]
NAMES = ["exp", "log", "tanh", "cotangent"]


@njit
def all_of(which: int, x: np.ndarray, y: np.ndarray) -> None:
    """Fill ``y`` with one of the functions of ``x``: a loop, as kernels have them."""
    for i in range(len(x)):
        if which == 0:
            y[i] = exp(x[i])
        elif which == 1:
            y[i] = log(x[i])
        elif which == 2:
            y[i] = tanh(x[i])
        else:
            y[i] = cotangent(x[i])


def in_a_kernel(function: Function, x: np.ndarray) -> np.ndarray:
    """What kernels make of a function of many numbers."""
    y = np.empty_like(x)
    all_of(NAMES.index(function.__name__), x, y)
    return y


def worst(found: np.ndarray, x: np.ndarray, of: Any) -> float:
    """The largest error, in units in the last place."""
    with mpmath.workdps(50):
        exact = [of(mpmath.mpf(each)) for each in x.tolist()]
        return max(
            float(abs(mpmath.mpf(y) - e) / math.ulp(float(e))) for y, e in zip(found.tolist(), exact, strict=True)
        )


def check_last_places(found: np.ndarray, x: np.ndarray, of: Any, allowed: float) -> None:
    assert worst(found, x, of) < allowed


@pytest.mark.parametrize(("function", "of", "x", "allowed"), CASES, ids=NAMES)
def test_functions_are_right_to_the_last_places(function, of, x, allowed):
    check_last_places(in_a_kernel(function, x), x, of, allowed)


@pytest.mark.parametrize(("function", "of", "x", "allowed"), CASES, ids=NAMES)
def test_a_series_that_ends_a_term_too_early_fails_the_check(monkeypatch, function, of, x, allowed):
    terms = {exp: "_E13", tanh: "_E13", log: "_L19", cotangent: "_S15"}  # _L21 is a fifth of a last place
    monkeypatch.setattr(elementary, terms[function], 0.0)
    broken = np.array([function(each) for each in x.tolist()])
    with pytest.raises(AssertionError):
        check_last_places(broken, x, of, allowed)


@pytest.mark.parametrize(("function", "of", "x", "allowed"), CASES, ids=NAMES)
def test_plain_python_and_compiled_agree_to_the_last_bit(function, of, x, allowed):
    assert np.array([function(each) for each in x.tolist()]).tobytes() == in_a_kernel(function, x).tobytes()


EDGES = {
    exp: [(709.782712893384, 1.7976931348622732e308), (709.7827128933841, math.inf), (math.inf, math.inf),
          (-745.1332191019411, 5e-324), (-745.1332191019412, 0.0), (-math.inf, 0.0), (0.0, 1.0)],
    log: [(0.0, -math.inf), (-0.0, -math.inf), (-1.0, math.nan), (-math.inf, math.nan), (math.inf, math.inf),
          (1.0, 0.0), (5e-324, -744.4400719213812), (sys.float_info.max, 709.782712893384)],
    tanh: [(math.inf, 1.0), (-math.inf, -1.0), (0.0, 0.0), (-0.0, -0.0), (1e308, 1.0), (-5e-324, -5e-324)],
}  # fmt: skip


@pytest.mark.parametrize("function", EDGES)
def test_beyond_the_numbers_functions_do_as_a_library_does(function):
    given, expected = (np.array(values) for values in zip(*[*EDGES[function], (math.nan, math.nan)], strict=True))
    for found in (in_a_kernel(function, given), np.array([function(x) for x in given.tolist()])):
        np.testing.assert_array_equal(found, expected)
        np.testing.assert_array_equal(np.signbit(found[:-1]), np.signbit(expected[:-1]))


BITS = "8620a08122985f0f"


def test_every_machine_computes_these_bits():
    steps = np.arange(-2048, 2048)
    inputs = {
        exp: steps * 0.34375,
        log: (steps + 2049) / 128.0,
        tanh: steps / 256.0,
        cotangent: (steps + 2049) / 2048.0,
    }
    content = b"".join(in_a_kernel(function, x).astype("<f8").tobytes() for function, x in inputs.items())
    assert hashlib.sha256(content).hexdigest()[:16] == BITS


def check_plain_arithmetic(kernel: Any) -> None:
    """A compiled kernel calls no library's function, and no product and sum may be rounded at once."""
    (code,), (machine_code,) = kernel.inspect_llvm().values(), kernel.inspect_asm().values()
    assert not re.findall(r"@(?:llvm\.)?(?:exp|log|pow|tanh?|sin|cos|fma|fmuladd)[a-z0-9]*[.(]", code)
    assert not re.findall(r" f(?:add|sub|mul|div) (?:fast|contract|reassoc).*", code)
    assert not re.findall(r"\tv?fn?m(?:add|sub|la|ls)\w*\t.*", machine_code)


def test_kernels_of_these_functions_are_plain_arithmetic():
    all_of(0, np.ones(4), np.empty(4))
    check_plain_arithmetic(all_of)


@pytest.mark.parametrize(
    "broken",
    [
        numba.njit(lambda x: math.exp(x)),
        numba.njit(lambda x: x**x),
        numba.njit(fastmath={"contract"})(lambda x: x * x + 0.1),
    ],
    ids=["library", "power", "fused"],
)
def test_other_kernels_fail_the_check(broken):
    broken(1.5)
    with pytest.raises(AssertionError):
        check_plain_arithmetic(broken)


KERNELS = {"njit", "njit_nogil", "njit_internal", "njit_inline"}
EXACT = {"copysign", "floor", "ceil", "trunc", "fabs", "sqrt", "isnan", "isinf", "isfinite"}
"""Of ``math``: alike in every library."""
INEXACT = re.compile(r"a?(?:sin|cos|tan)h?|arc\w+|atan2|hypot|exp2?|expm1|log(?:2|10|1p)?|(?:float_)?power|pow|cbrt|"
                     r"logaddexp2?|sinc|dot|vdot|inner|matmul|tensordot|einsum|linalg\.\w+")  # fmt: skip
"""Of ``numpy``."""


def of_the_machine(source: str) -> list[str]:
    """What kernels in a module's source would take from the machine's libraries, and so not alike on every machine.

    Powers: Numba multiplies where the exponent is written as 2, and Python itself works out one of constants, which is
    exact where the base is 2.  A product of matrices is summed in the library's order.
    """
    tree = ast.parse(source)
    imported = {}
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module in {"math", "numpy"}:
            module = {"math": "math", "numpy": "np"}[node.module]
            imported |= {alias.asname or alias.name: f"{module}.{alias.name}" for alias in node.names}
    found = []
    for kernel in ast.walk(tree):
        if not isinstance(kernel, ast.FunctionDef) or not KERNELS & {ast.unparse(d) for d in kernel.decorator_list}:
            continue
        for node in ast.walk(kernel):
            if isinstance(node, ast.Call):
                called = ast.unparse(node.func)
                module, _, function = imported.get(called, called).partition(".")
                inexact = function not in EXACT if module == "math" else module == "np" and INEXACT.fullmatch(function)
            elif isinstance(node, ast.BinOp | ast.AugAssign):
                base, exponent = (node.left, node.right) if isinstance(node, ast.BinOp) else (node.target, node.value)
                square = isinstance(exponent, ast.Constant) and exponent.value == 2 and isinstance(exponent.value, int)
                known = ast.unparse(base) in {"2", "2.0"}
                inexact = isinstance(node.op, ast.MatMult) or (isinstance(node.op, ast.Pow) and not (square or known))
            else:
                continue
            if inexact:
                found.append(f"{kernel.name}, line {node.lineno}: {ast.unparse(node)}")
    return found


def check_nothing_of_the_machine(source: str, name: str) -> None:
    found = of_the_machine(source)
    assert not found, (
        f"{name}: {'; '.join(found)}. Libraries differ in last places: use cutenv._engine.elementary; for a power "
        "multiply."
    )


def test_kernels_take_nothing_from_the_machines_libraries():
    sources = {path: path.read_text() for path in sorted(Path(inspect.getfile(cutenv)).parent.rglob("*.py"))}
    with_kernels = {path: source for path, source in sources.items() if "cutenv._engine.jit import" in source}
    assert len(with_kernels) > 20
    for path, source in with_kernels.items():
        check_nothing_of_the_machine(source, path.name)


@pytest.mark.parametrize(
    "expression",
    [
        "math.exp(x)",
        "np.log(x)",
        "x**0.5",
        "x**n",
        "0.1**2.0",
        "np.linalg.norm(x)",
        "x @ x",
        "sine(x)",
        "math.pow(x, 2)",
    ],
)
@pytest.mark.parametrize("decorator", sorted(KERNELS))
def test_what_the_machine_computes_is_found_in_a_kernel(decorator, expression):
    source = f"from math import sin as sine\n@{decorator}\ndef kernel(x, n):\n    return 1.0 + {expression}\n"
    with pytest.raises(AssertionError, match=r"use cutenv\._engine\.elementary"):
        check_nothing_of_the_machine(source, "made up")
    check_nothing_of_the_machine(source.replace(f"@{decorator}\n", ""), "made up")
