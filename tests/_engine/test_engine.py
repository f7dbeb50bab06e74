"""Pieces of compiled loops: arrays that are lent to a kernel, formulas that become one function, and cores."""

from __future__ import annotations

import gc
import math
import os
import re
import subprocess
import sys
import threading
import time

import numba
import numpy as np
import pytest

from cutenv._engine.declared import expression, fuse
from cutenv._engine.intrinsics import as_float64_view, without_refcount
from cutenv._engine.jit import njit, njit_nogil
from cutenv._engine.parallel import (
    _number_of_cores,
    _pool,
    atomic_add,
    atomic_load,
    cores,
    make_queue,
    mark_done,
    next_chunk,
    parallel_for,
    set_cores,
    wait_done,
)


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


SCALE = 4.0
FIRST, SECOND = (lambda a: a + 1.0), (lambda a, b: a * b)
SAME, AGAIN = (lambda a: a - SCALE), (lambda a: a - SCALE)
ONE, TWO, WHOLE = (lambda a: a + 1.0), (lambda a: a + 2.0), (lambda a: a + 2)
(LONG,) = (
    lambda a, b: (
        a
        if a > b  # the larger
        else b
    ),
)
MADE = eval("lambda a: a")


def fused(*formulas, **renamed):
    """A function of a and b that returns the values of formulas."""
    lines = [f"found[{n}] = {expression(each, ('a', 'b'), renamed)}" for n, each in enumerate(formulas)]
    function = fuse("found_by", ["a", "b", "found"], lines, [__name__])

    def values(a, b):
        found = [math.nan] * len(formulas)
        function(a, b, found)
        return found

    return values


@pytest.mark.parametrize(("a", "b"), [(2.0, 5.0), (7.0, -1.0)])
def test_formulas_on_one_line_and_on_several_are_told_apart(a, b):
    assert fused(FIRST, SECOND, SAME, AGAIN, LONG)(a, b) == [a + 1.0, a * b, a - 4.0, a - 4.0, max(a, b)]
    assert [expression(each, ("a",)) for each in (ONE, TWO, WHOLE)] == ["(a + 1.0)", "(a + 2.0)", "(a + 2)"]


def test_parameters_are_renamed_and_nothing_else():
    total = lambda total, a: total + a * len("total")  # noqa: E731
    assert expression(total, ("a",), {"total": "count.total[k]"}) == "(count.total[k] + a * len('total'))"
    assert expression(lambda b: b * (1.0 + b), (), {"b": "x - y"}) == "((x - y) * (1.0 + (x - y)))"


def test_an_unknown_quantity_is_named_with_file_and_line():
    unknown = lambda a, humidity: a * humidity  # noqa: E731
    place = f"{__file__}:{unknown.__code__.co_firstlineno}"
    with pytest.raises(ValueError, match=r"asks for 'humidity'; here there are: a, b\.") as error:
        expression(unknown, ("b", "a"))
    assert str(error.value).startswith(place)


def test_what_is_not_a_lambda_in_a_file_is_refused():
    def defined(a: float) -> float:
        return a

    for formula in (defined, MADE):
        with pytest.raises(ValueError, match="cannot be read; give a lambda of one expression"):
            expression(formula, ("a",))


def test_a_traceback_shows_the_fused_line():
    with pytest.raises(ZeroDivisionError) as error:
        fused(lambda a, b: a / b)(1.0, 0.0)
    assert str(error.traceback[-1].statement).strip() == "found[0] = (a / b)"


@pytest.fixture(params=[1, 2, 3])
def some_cores(request):
    before = cores()
    set_cores(request.param)
    yield request.param
    set_cores(before)


@pytest.mark.parametrize("count", [0, 1, 7, 64, 1000])
@pytest.mark.parametrize("size", [1, 3, 32])
def test_every_member_is_met_once(some_cores, count, size):
    met = np.zeros(count, int)

    def meet(passed, core, by):
        first, last = next_chunk(passed, core, size)
        while first < last:
            met[first:last] += by
            mark_done(passed, core, last - first)
            first, last = next_chunk(passed, core, size)

    parallel_for(meet, count, 1, fewest=7)
    assert (met == 1).all()


@njit_nogil
def meet_compiled(passed, core, met):
    first, last = next_chunk(passed, core, 3)
    while first < last:
        for n in range(first, last):
            for _ in range(200):
                met[n] = met[n] * 1.0000001 + 1.0
        mark_done(passed, core, last - first)
        first, last = next_chunk(passed, core, 3)


def test_compiled_portions_are_met_once_and_are_finished_on_return(some_cores):
    expected = np.zeros(1000)
    meet_compiled(make_queue(1000), 0, expected)
    for _ in range(300):
        met = np.zeros(1000)
        parallel_for(meet_compiled, 1000, met, fewest=10)
        assert np.array_equal(met, expected)


def test_each_core_begins_with_its_own_stretch_and_then_takes_from_the_others():
    passed = make_queue(10, 3)  # 0 to 2, 3 to 5, 6 to 9
    assert [next_chunk(passed, 1, 2) for _ in range(2)] == [(3, 5), (5, 6)]
    assert next_chunk(passed, 1, 2) == (6, 8)
    assert next_chunk(passed, 2, 32) == (8, 10)
    assert next_chunk(passed, 2, 32) == (0, 3)
    assert next_chunk(passed, 0, 1) == (0, 0)
    mark_done(passed, 0, 4)
    mark_done(passed, 2, 5)
    assert not wait_done(passed, 9)
    mark_done(passed, 1, 1)
    assert wait_done(passed, 9)


def test_a_number_is_counted_up_alike_compiled_and_not():
    ours, theirs = make_queue(10, 2), make_queue(10, 2)
    for core, size in ((0, 3), (1, np.int64(4)), (1, 9)):
        assert atomic_add(ours, core, 0, size) == compiled_count_up(theirs, core, 0, size)
    assert np.array_equal(ours, theirs)
    assert atomic_load(ours, 1, 0) == 18


@njit
def compiled_count_up(passed, core, which, size):
    return atomic_add(passed, core, which, size)


def test_a_thread_that_comes_too_late_is_not_waited_for(some_cores):
    """While all other threads are busy, the caller makes all of it."""
    leave, busy = threading.Event(), []

    def wait():
        busy.append(1)
        if threading.current_thread() is not caller:
            leave.wait(20.0)

    caller, met = threading.current_thread(), np.zeros(100)
    others = [_pool().submit(wait) for _ in range(some_cores - 1)]
    begun = time.monotonic()
    parallel_for(meet_compiled, 100, met, fewest=10)
    assert time.monotonic() - begun < 10.0
    assert met.all()
    leave.set()
    for other in others:
        other.result()


def test_what_is_done_meanwhile_is_done_once_and_by_the_caller(some_cores):
    done = []

    def begin(passed, core):
        if core == 0:
            done.append("own stretch")

    parallel_for(begin, 100, fewest=10, meanwhile=lambda: done.append(threading.current_thread()))
    assert done == [threading.current_thread(), "own stretch"]


def test_an_error_meanwhile_is_raised_when_the_others_are_through(some_cores):
    through = []

    def slowly(passed, core):
        threading.Event().wait(0.05)
        through.append(core)

    def fail():
        raise OSError("nothing to be had")

    with pytest.raises(OSError, match="nothing to be had"):
        parallel_for(slowly, 100, fewest=10, meanwhile=fail)
    assert len(through) == some_cores - 1, "all but the caller's own stretch"


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ("abc", "CUTENV_CORES = 'abc' is no number of cores"),
        ("1.5", "CUTENV_CORES = '1.5' is no number of cores"),
        ("-1", "CUTENV_CORES = '-1' is no number of cores"),
        ("0", "CUTENV_CORES = 0 is outside 1 to 4096"),
    ],
)
def test_a_bad_number_of_cores_names_the_variable_and_the_cure(given, said):
    with pytest.raises(ValueError, match=f"{re.escape(said)}.*Give a whole number of cores, or unset it"):
        _number_of_cores(given)


@pytest.mark.parametrize(("given", "used"), [("3", "3"), ("", str(cores()))])
def test_the_environment_sets_the_number_of_cores(given, used):
    program = "from cutenv._engine.parallel import cores; print(cores())"
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, env=os.environ | {"CUTENV_CORES": given}
    )
    assert done.stdout.strip() == used, done.stderr


ROW = """
import numpy as np
from numba.np import numpy_support
from cutenv._engine.lowering import RowType
print(RowType(numpy_support.from_dtype(np.dtype([("blade", "f8", (8,))]))).name)
"""


def test_a_row_has_one_type_in_every_process_so_that_its_kernels_are_found_on_disk() -> None:
    names = {
        subprocess.run(
            [sys.executable, "-c", ROW], capture_output=True, text=True, check=True,
            env=os.environ | {"PYTHONHASHSEED": seed},
        ).stdout
        for seed in ("1", "2")
    }  # fmt: skip
    assert len(names) == 1
