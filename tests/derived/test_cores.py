"""A loop spread over the cores covers every member once, whatever else is done meanwhile."""

from __future__ import annotations

import threading
import time

import numpy as np
import pytest

from cutenv.compiled import compiled, compiled_for_cores
from cutenv.cores import _pool, cores, over_cores, set_cores
from cutenv.portions import MEMBERS, all_finished, claim, finish, portions


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

    def meet(passed, by):
        first = claim(passed, size)
        while first < passed[MEMBERS]:
            last = min(first + size, passed[MEMBERS])
            met[first:last] += by
            finish(passed, last - first)
            first = claim(passed, size)

    over_cores(meet, count, 1, fewest=7)
    assert (met == 1).all()


@compiled_for_cores
def meet_compiled(passed, met):
    k = claim(passed, 3)
    while k < passed[MEMBERS]:
        for n in range(k, min(k + 3, passed[MEMBERS])):
            for _ in range(200):
                met[n] = met[n] * 1.0000001 + 1.0
        finish(passed, min(k + 3, passed[MEMBERS]) - k)
        k = claim(passed, 3)


def test_compiled_portions_are_met_once_and_are_finished_on_return(some_cores):
    expected = np.zeros(1000)
    meet_compiled(portions(1000), expected)
    for _ in range(300):
        met = np.zeros(1000)
        over_cores(meet_compiled, 1000, met, fewest=10)
        assert np.array_equal(met, expected)


def test_portions_are_counted_alike_compiled_and_not():
    ours, theirs = portions(10), portions(10)
    for size in (3, np.int64(4), 9):
        assert claim(ours, size) == compiled_claim(theirs, size)
    assert not all_finished(ours, 5)
    finish(ours, 10)
    compiled_finish(theirs, 10)
    assert ours.tolist() == theirs.tolist() == [16, 10, 10]
    assert all_finished(ours, 5)


@compiled
def compiled_claim(passed, size):
    return claim(passed, size)


@compiled
def compiled_finish(passed, size):
    finish(passed, size)


def test_a_thread_that_comes_too_late_is_not_waited_for(some_cores):
    """While all other threads are busy, the caller makes all of it."""
    leave, busy = threading.Event(), []

    def wait(passed):
        busy.append(1)
        if threading.current_thread() is not caller:
            leave.wait(20.0)

    caller, met = threading.current_thread(), np.zeros(100)
    others = [_pool().submit(wait, None) for _ in range(some_cores - 1)]
    begun = time.monotonic()
    over_cores(meet_compiled, 100, met, fewest=10)
    assert time.monotonic() - begun < 10.0
    assert met.all()
    leave.set()
    for other in others:
        other.result()


def test_what_is_done_meanwhile_is_done_once_and_by_the_caller(some_cores):
    done = []

    def begin(passed):
        if claim(passed, 100) == 0:
            done.append("all of it")
            finish(passed, 100)

    over_cores(begin, 100, fewest=10, meanwhile=lambda: done.append(threading.current_thread()))
    assert sorted(done, key=str) == sorted([threading.current_thread(), "all of it"], key=str)


def test_an_error_meanwhile_is_raised_when_the_others_are_through(some_cores):
    through = []

    def slowly(passed):
        threading.Event().wait(0.05)
        through.append(passed)

    def fail():
        raise OSError("nothing to be had")

    with pytest.raises(OSError, match="nothing to be had"):
        over_cores(slowly, 100, fewest=10, meanwhile=fail)
    assert len(through) == some_cores - 1, "all but the caller's own stretch"
