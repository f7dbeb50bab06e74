"""Arrays lent to a kernel: the same numbers, and no count of references that other cores would wait for."""

from __future__ import annotations

import gc
import sys

import numba
import numpy as np
import pytest

from cutenv._engine.intrinsics import as_float64_view, without_refcount
from cutenv._engine.jit import njit


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
    lent = without_refcount(tables)
    (filled,) = without_refcount((totals,))
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
    assert without_refcount(given) is given


KIND = np.dtype([("a", "f8"), ("b", "f8", (3,))])


@numba.njit
def doubled(records):
    numbers = as_float64_view(records)
    for k in range(len(numbers)):
        numbers[k] *= 2.0


@numba.njit
def own_numbers(count):
    records = np.zeros(count, KIND)
    records[count - 1].b[2] = 7.0
    return as_float64_view(records)


def test_numbers_of_records_are_the_records_own_memory():
    records = np.zeros(2, KIND)
    records["a"], records["b"] = (1.0, 2.0), ((3.0, 4.0, 5.0), (6.0, 7.0, 8.0))
    assert as_float64_view(records).tolist() == [1.0, 3.0, 4.0, 5.0, 2.0, 6.0, 7.0, 8.0]
    before = sys.getrefcount(records)
    doubled(records)
    assert records["b"].tolist() == [[6.0, 8.0, 10.0], [12.0, 14.0, 16.0]]
    assert sys.getrefcount(records) == before


def test_numbers_outlive_the_name_of_their_records():
    found = [own_numbers(1000) for _ in range(20)]
    assert all(numbers[-1] == 7.0 and numbers.sum() == 7.0 for numbers in found)


def test_numbers_with_gaps_between_them_are_refused():
    with pytest.raises(numba.errors.TypingError):
        doubled(np.zeros(6)[::2])


def test_garbage_is_collected_again_once_a_kernel_is_compiled_even_in_vain(monkeypatch):
    collected = []

    def watched(number):
        pass

    @numba.extending.overload(watched, strict=False)
    def _watch(number):  # called while a kernel is typed
        collected.append(gc.isenabled())
        return lambda number: None

    def kernel(number):
        watched(number)

    def in_vain(number):
        watched(number)
        return number.nothing_of_the_kind

    for function in (kernel, in_vain):
        monkeypatch.setattr(function, "__module__", "cutenv.made_up")
    njit(kernel)(1.0)
    with pytest.raises(numba.errors.TypingError):
        njit(in_vain)(2)
    assert collected
    assert not any(collected)
    assert gc.isenabled()
