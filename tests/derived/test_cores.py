"""A loop spread over the cores covers every member once, whatever else is done meanwhile."""

from __future__ import annotations

import threading

import numpy as np
import pytest

from cutenv.cores import cores, over_cores, set_cores


@pytest.fixture(params=[1, 2, 3])
def some_cores(request):
    before = cores()
    set_cores(request.param)
    yield request.param
    set_cores(before)


@pytest.mark.parametrize("count", [0, 1, 7, 64, 1000])
def test_every_member_is_met_once(some_cores, count):
    met = np.zeros(count, int)

    def meet(first, last, by):
        met[first:last] += by

    over_cores(meet, count, 1, fewest=7)
    assert (met == 1).all()


def test_what_is_done_meanwhile_is_done_once_and_by_the_caller(some_cores):
    done = []

    def begin(first, last):
        if first == 0:
            done.append("own stretch")

    over_cores(begin, 100, fewest=10, meanwhile=lambda: done.append(threading.current_thread()))
    assert done == [threading.current_thread(), "own stretch"]


def test_an_error_meanwhile_is_raised_when_the_others_are_through(some_cores):
    through = []

    def slowly(first, last):
        threading.Event().wait(0.05)
        through.append(first)

    def fail():
        raise OSError("nothing to be had")

    with pytest.raises(OSError, match="nothing to be had"):
        over_cores(slowly, 100, fewest=10, meanwhile=fail)
    assert len(through) == some_cores - 1, "all but the caller's own stretch"
