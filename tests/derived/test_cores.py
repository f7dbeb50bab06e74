"""A loop spread over the cores covers every member once, whatever else is done meanwhile."""

from __future__ import annotations

import threading
import time

import numpy as np
import pytest

from cutenv.compiled import compiled, compiled_for_cores
from cutenv.cores import _pool, cores, over_cores, set_cores
from cutenv.portions import all_finished, claim, count_up, counted, finish, portions


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
        first, last = claim(passed, core, size)
        while first < last:
            met[first:last] += by
            finish(passed, core, last - first)
            first, last = claim(passed, core, size)

    over_cores(meet, count, 1, fewest=7)
    assert (met == 1).all()


@compiled_for_cores
def meet_compiled(passed, core, met):
    first, last = claim(passed, core, 3)
    while first < last:
        for n in range(first, last):
            for _ in range(200):
                met[n] = met[n] * 1.0000001 + 1.0
        finish(passed, core, last - first)
        first, last = claim(passed, core, 3)


def test_compiled_portions_are_met_once_and_are_finished_on_return(some_cores):
    expected = np.zeros(1000)
    meet_compiled(portions(1000), 0, expected)
    for _ in range(300):
        met = np.zeros(1000)
        over_cores(meet_compiled, 1000, met, fewest=10)
        assert np.array_equal(met, expected)


def test_each_core_begins_with_its_own_stretch_and_then_takes_from_the_others():
    passed = portions(10, 3)  # 0 to 2, 3 to 5, 6 to 9
    assert [claim(passed, 1, 2) for _ in range(2)] == [(3, 5), (5, 6)]
    assert claim(passed, 1, 2) == (6, 8)
    assert claim(passed, 2, 32) == (8, 10)
    assert claim(passed, 2, 32) == (0, 3)
    assert claim(passed, 0, 1) == (0, 0)
    finish(passed, 0, 4)
    finish(passed, 2, 5)
    assert not all_finished(passed, 9)
    finish(passed, 1, 1)
    assert all_finished(passed, 9)


def test_a_number_is_counted_up_alike_compiled_and_not():
    ours, theirs = portions(10, 2), portions(10, 2)
    for core, size in ((0, 3), (1, np.int64(4)), (1, 9)):
        assert count_up(ours, core, 0, size) == compiled_count_up(theirs, core, 0, size)
    assert np.array_equal(ours, theirs)
    assert counted(ours, 1, 0) == 18


@compiled
def compiled_count_up(passed, core, which, size):
    return count_up(passed, core, which, size)


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
    over_cores(meet_compiled, 100, met, fewest=10)
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

    over_cores(begin, 100, fewest=10, meanwhile=lambda: done.append(threading.current_thread()))
    assert done == [threading.current_thread(), "own stretch"]


def test_an_error_meanwhile_is_raised_when_the_others_are_through(some_cores):
    through = []

    def slowly(passed, core):
        threading.Event().wait(0.05)
        through.append(core)

    def fail():
        raise OSError("nothing to be had")

    with pytest.raises(OSError, match="nothing to be had"):
        over_cores(slowly, 100, fewest=10, meanwhile=fail)
    assert len(through) == some_cores - 1, "all but the caller's own stretch"
