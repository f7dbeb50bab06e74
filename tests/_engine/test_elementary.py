"""Numbers that are the same everywhere: elementary functions, and random numbers by Philox-4x32-10."""

from __future__ import annotations

import ast
import hashlib
import inspect
import itertools
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
from cutenv._engine import randomness
from cutenv._engine.elementary import arctangent, cotangent, exp, log, sine_and_cosine, tanh
from cutenv._engine.jit import njit
from cutenv._engine.randomness import generator, normal_at, philox

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


@pytest.mark.parametrize(("function", "of", "x", "allowed"), CASES, ids=NAMES)
def test_functions_are_right_to_the_last_places(function, of, x, allowed):
    assert worst(in_a_kernel(function, x), x, of) < allowed


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


BITS_OF_ARRAYS = "ba793f430f98179a"


def test_sine_cosine_and_arctangent_of_arrays_are_right_and_everywhere_the_same():
    angles, tangents = np.arange(-2048, 2048) / 64.0, np.arange(-2048, 2048) / 128.0
    (sine, cosine), arc = sine_and_cosine(angles), arctangent(tangents)
    with mpmath.workdps(50):
        for of, found, x in ((mpmath.sin, sine, angles), (mpmath.cos, cosine, angles), (mpmath.atan, arc, tangents)):
            exact = [of(mpmath.mpf(each)) for each in x.tolist()]
            assert max(abs(float(y - e)) for y, e in zip(found.tolist(), exact, strict=True)) < 3e-16
    content = b"".join(each.astype("<f8").tobytes() for each in (sine, cosine, arc))
    assert hashlib.sha256(content).hexdigest()[:16] == BITS_OF_ARRAYS


def test_kernels_of_these_functions_are_plain_arithmetic():
    """A compiled kernel calls no library's function, and no product and sum may be rounded at once."""
    all_of(0, np.ones(4), np.empty(4))
    (code,), (machine_code,) = all_of.inspect_llvm().values(), all_of.inspect_asm().values()
    assert not re.findall(r"@(?:llvm\.)?(?:exp|log|pow|tanh?|sin|cos|fma|fmuladd)[a-z0-9]*[.(]", code)
    assert not re.findall(r" f(?:add|sub|mul|div) (?:fast|contract|reassoc).*", code)
    assert not re.findall(r"\tv?fn?m(?:add|sub|la|ls)\w*\t.*", machine_code)


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


def test_kernels_take_nothing_from_the_machines_libraries():
    sources = {path: path.read_text() for path in sorted(Path(inspect.getfile(cutenv)).parent.rglob("*.py"))}
    with_kernels = {path: source for path, source in sources.items() if "cutenv._engine.jit import" in source}
    assert len(with_kernels) > 20
    for path, source in with_kernels.items():
        found = of_the_machine(source)
        assert not found, (
            f"{path.name}: {'; '.join(found)}. Libraries differ in last places: use cutenv._engine.elementary; "
            "for a power multiply."
        )


# Known answers of the Random123 library, file kat_vectors: counter, key, result.
ONES = 0xFFFFFFFF
KNOWN = [
    ((0, 0, 0, 0), (0, 0), (0x6627E8D5, 0xE169C58D, 0xBC57AC4C, 0x9B00DBD8)),
    ((ONES, ONES, ONES, ONES), (ONES, ONES), (0x408F276D, 0x41C83B0E, 0xA20BC7C6, 0x6D5451FD)),
    (
        (0x243F6A88, 0x85A308D3, 0x13198A2E, 0x03707344),
        (0xA4093822, 0x299F31D0),
        (0xD16CFE09, 0x94FDCCEB, 0x5001E420, 0x24126EA1),
    ),
]
N = 100_000


@numba.njit
def normals(seed: int, episode: int, stream: int, count: int) -> np.ndarray:
    out = np.empty(count)
    for i in range(count):
        out[i] = normal_at(seed, episode, stream, i)
    return out


@numba.njit
def philox_in_a_kernel(k0, k1, c0, c1, c2, c3):
    return philox(k0, k1, c0, c1, c2, c3)


@pytest.mark.parametrize("rounds", [philox, philox_in_a_kernel])
@pytest.mark.parametrize(("counter", "key", "words"), KNOWN)
def test_philox_gives_the_published_answers(counter, key, words, rounds):
    assert tuple(int(w) for w in rounds(*(np.uint64(v) for v in (*key, *counter)))) == words


def test_layers_of_the_ziggurat_are_of_equal_area():
    """The lowest with the tail beyond R, the topmost up to the curve's peak."""
    r = mpmath.mpf(randomness._R)
    tail = mpmath.sqrt(mpmath.pi / 2) * mpmath.erfc(r / mpmath.sqrt(2))
    assert randomness._AREA == pytest.approx(float(r * mpmath.exp(-r * r / 2) + tail), rel=1e-15)
    areas = randomness.WIDTHS[1:-1] * np.diff(randomness._HEIGHTS)[1:]
    assert areas == pytest.approx(randomness._AREA, rel=1e-12)
    assert (randomness.WIDTHS[-1], randomness._HEIGHTS[-1]) == (0.0, 1.0)


def test_numbers_are_standard_normal():
    """Moments, tails and the distribution function within 4 standard errors."""
    z = normals(1, 2, 3, N)
    n = len(z)
    for power, moment, variance in ((1, 0, 1), (2, 1, 2), (3, 0, 15), (4, 3, 96)):
        assert np.mean(z**power) == pytest.approx(moment, abs=4.0 * math.sqrt(variance / n))
    for quantile in (-2.0, -1.0, 0.0, 0.5, 3.0):
        p = 0.5 * (1.0 + math.erf(quantile / math.sqrt(2.0)))
        assert np.mean(z < quantile) == pytest.approx(p, abs=4.0 * math.sqrt(p * (1.0 - p) / n))


def test_neighbours_in_counter_stream_episode_and_seed_are_independent():
    z = normals(1, 2, 3, N)
    others = [normals(2, 2, 3, N), normals(1, 3, 3, N), normals(1, 2, 4, N), normals(2, 1, 3, N), np.roll(z, 1)]
    for one, two in itertools.combinations([z, *others], 2):
        assert abs(np.mean(one * two)) < 4.0 / math.sqrt(N)
        assert abs(np.mean(one**2 * two**2) - 1.0) < 4.0 * math.sqrt(8.0 / N)


def test_a_number_is_a_pure_function_of_its_key():
    z = normals(5, 6, 7, 100)
    assert [normal_at(5, 6, 7, i) for i in (99, 3, 3, 50)] == z[[99, 3, 3, 50]].tolist()


def test_seed_and_episode_count_to_their_64th_bit():
    high = 1 << 63
    values = {normal_at(np.uint64(s), np.uint64(e), 0, 0) for s in (1, 1 + high) for e in (1, 1 + high, 1 + (1 << 32))}
    assert len(values) == 6


def test_generators_are_keyed_and_not_sequenced():
    first = generator(3, 4).standard_normal(5)
    generator(3, 5).standard_normal(100)
    assert np.array_equal(generator(3, 4).standard_normal(5), first)
    assert len({generator(s, e).random() for s in range(20) for e in range(20)}) == 400


@pytest.mark.parametrize(("seed", "episode", "named"), [(-1, 0, "seed"), (0, -1, "episode"), (2**64, 0, "seed")])
def test_seeds_out_of_range_are_refused_by_name(seed, episode, named):
    with pytest.raises(ValueError, match=rf"{named} = -?\d+ is outside"):
        generator(seed, episode)
