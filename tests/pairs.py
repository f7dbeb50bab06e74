"""Cases of several factors: far fewer than all combinations, and no two values without a case of both."""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from typing import Any


def every_pair(*factors: Iterable[Any]) -> list[tuple[Any, ...]]:
    """Choose cases, one value of each factor, so that any two values of two factors are together in one."""
    every = list(itertools.product(*map(list, factors)))
    left = {pair for case in every for pair in itertools.combinations(enumerate(case), 2)}
    chosen = []
    while left:
        best = max(every, key=lambda case: len(left.intersection(itertools.combinations(enumerate(case), 2))))
        left.difference_update(itertools.combinations(enumerate(best), 2))
        chosen.append(best)
    return chosen
