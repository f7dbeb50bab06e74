"""Count the floating-point operations of one force update: a row of one lane in plain Python, on numbers that count.

NUMBA_DISABLE_JIT=1 python -m scripts.benchmarks.speed.operations
"""

from __future__ import annotations

import math
import operator
import sys
from collections import Counter
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np

from cutenv.sim.cutting import simulate
from cutenv.sim.cutting.motion import STRAIGHT
from cutenv.sim.cutting.row import ONE, begin, plain_views, take
from cutenv.sim.cutting.update import update_row
from cutenv.sim.plant import SimulatedPlant
from cutenv.sim.tissue import Specimen

_counted: Counter[str] = Counter()
_UPDATES = 2000


class Counting(float):
    """Float whose operations are counted, and those of its results."""


def _count(kind: str, plain: Callable[..., Any]) -> Callable[..., Any]:
    def counted(*numbers: Any) -> Any:
        result = plain(*(float(n) for n in numbers))
        _counted[kind] += 1
        return Counting(result) if isinstance(result, float) else result

    return counted


def _swapped(plain: Callable[..., Any]) -> Callable[..., Any]:
    return lambda a, b: plain(b, a)


for _name, _kind, _plain in (
    ("add", "additions", operator.add),
    ("sub", "additions", operator.sub),
    ("mul", "multiplications", operator.mul),
    ("truediv", "divisions", operator.truediv),
    ("pow", "multiplications", operator.pow),  # squares, all of them
):
    setattr(Counting, f"__{_name}__", _count(_kind, _plain))
    setattr(Counting, f"__r{_name}__", _count(_kind, _swapped(_plain)))
for _name in ("lt", "le", "gt", "ge"):
    setattr(Counting, f"__{_name}__", _count("comparisons", getattr(operator, _name)))
Counting.__neg__ = lambda self: Counting(-float(self))  # type: ignore[method-assign]
Counting.__abs__ = lambda self: Counting(abs(float(self)))  # type: ignore[method-assign]


def _in_counting(record: Any) -> SimpleNamespace:
    """Return a record as an object whose attributes count their operations."""
    fields: dict[str, Any] = {}
    for name in record.dtype.names:
        value = record[name].tolist()
        if isinstance(value, list) and isinstance(value[0], list):  # random words and numbers, whose making is free
            fields[name] = record[name].copy()
        elif isinstance(value, list):
            fields[name] = [Counting(v) if isinstance(v, float) else v for v in value]
        else:
            fields[name] = Counting(value) if isinstance(value, float) else value
    return SimpleNamespace(**fields)


def operations_per_update(speed: float = 0.01, angle: float = math.radians(45.0)) -> dict[str, float]:
    """Return the mean count of each kind over two seconds of a steady cut; a call of a mathematical function is one."""
    plant = SimulatedPlant(Specimen.mean(), angle=angle)
    plant.advance(speed, angle, 1000)
    c, rows = plant.cuts[0], np.zeros(1, ONE)
    plain = plain_views(rows, c.states, c.laws, c.drives)
    take(rows[0], plain, c, 0, 0)
    rows[0].given[0], rows[0].aim[0] = speed, angle
    begin(rows[0], plain, 1)
    row = _in_counting(rows[0])
    tissue: Any = [_in_counting(c.profiles[0])]
    sensor: Any = [_in_counting(c.sensors[0])]
    update, nothing = update_row(STRAIGHT), SimpleNamespace(lanes=None)
    _counted.clear()
    for i in range(_UPDATES):
        update(row, nothing, tissue, sensor, i == 0)
    return {kind: count / _UPDATES for kind, count in _counted.items()}


if __name__ == "__main__":
    if hasattr(simulate.hold(STRAIGHT), "py_func"):
        sys.exit("set NUMBA_DISABLE_JIT=1: compiled code cannot be counted")
    for _kind, _number in sorted(operations_per_update().items()):
        print(f"{_kind}: {_number:.1f}")
