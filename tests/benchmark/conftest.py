"""Ratios of the processor time of two things that are measured in turns, in one process: a busy machine slows both.

pytest-benchmark times the turns and keeps the ratio beside them (``--benchmark-json``, under ``extra_info``).  Without
xdist, as in ``pytest tests/benchmark``, it repeats them and prints a table; under ``pytest -n 2`` the turns are taken
once, and the bounds are guarded all the same.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

TURNS = 7
REPEATS = 3  # by pytest-benchmark, for its statistics

Way = Callable[[], Any]
Ratio = Callable[[Way, Way], float]


@pytest.fixture
def ratio(benchmark: Any) -> Ratio:
    """Return a function that divides the processor time of one way by that of another; the fastest turns count."""

    def measured(way: Way, other: Way) -> float:
        best = [np.inf, np.inf]

        def take_turns() -> None:
            for _ in range(TURNS):
                for i, one in enumerate((way, other)):
                    start = time.process_time()
                    one()
                    best[i] = min(best[i], time.process_time() - start)

        way(), other()  # what is compiled, opened or made at the first time
        benchmark.pedantic(take_turns, rounds=REPEATS, iterations=1)
        benchmark.extra_info["ratio"] = best[0] / best[1]
        return float(best[0] / best[1])

    return measured
