"""A loop spread over the cores covers every member once, whatever else is done meanwhile."""

from __future__ import annotations

import threading
import time

import numpy as np
import pytest

from cutenv._engine.jit import njit, njit_nogil
from cutenv._engine.parallel import _pool, cores, parallel_for, set_cores
from cutenv._engine.work_queue import atomic_add, atomic_load, make_queue, mark_done, next_chunk, wait_done


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
