"""Arrays lent to a kernel: the same numbers, and no count of references that other cores would wait for."""

from __future__ import annotations

import sys

import numba
import numpy as np

from cutenv.compiled import borrowed


@numba.njit
def total(row):
    result = 0.0
    for number in row:
        result += number
    return result


@numba.njit
def of_all(tables, totals):
    row = tables[0][0]
    for n in range(len(totals)):
        if totals[n] == 0.0:  # which row is read is known only here
            row = tables[n % 2][n]
        totals[n] = total(row)


@numba.njit
def of_all_lent(tables, totals):
    lent = borrowed(tables)
    (filled,) = borrowed((totals,))
    row = lent[0][0]
    for n in range(len(filled)):
        if filled[n] == 0.0:
            row = lent[n % 2][n]
        filled[n] = total(row)


def tables() -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(0)
    return rng.normal(size=(7, 5)), rng.normal(size=(7, 5))


def references(kernel: numba.core.dispatcher.Dispatcher) -> int:
    """Calls in the kernel itself, not in its door to Python, that count a reference."""
    (code,) = kernel.inspect_llvm().values()
    own = code.split("\ndefine ")[1]
    return own.split("\n}")[0].count("@NRT_incref")


def test_numbers_are_those_of_counted_arrays_and_nothing_is_lost():
    given, counted, lent = tables(), np.zeros(7), np.zeros(7)
    before = [sys.getrefcount(array) for array in (*given, lent)]
    for _ in range(3):
        of_all(given, counted)
        of_all_lent(given, lent)
    np.testing.assert_array_equal(lent, counted)
    assert lent.any()
    assert [sys.getrefcount(array) for array in (*given, lent)] == before


def test_no_reference_is_counted_to_what_is_lent():
    for kernel in (of_all, of_all_lent):
        kernel(tables(), np.zeros(7))
    assert references(of_all) > 0, "a kernel that counts: without it nothing is shown"
    assert references(of_all_lent) == 0


def test_plain_python_is_given_the_arrays_themselves():
    given = tables()
    assert borrowed(given) is given
