"""Count the floating-point operations of one force update: the law in plain Python, on numbers that count.

NUMBA_DISABLE_JIT=1 python scripts/speed/operations.py
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

from cutenv.cutting.dtypes import TICK
from cutenv.cutting.sensor import measure
from cutenv.cutting.update import update_row
from cutenv.plant import SimulatedPlant
from cutenv.tissue import Specimen

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
    counting = np.frompyfunc(Counting, 1, 1)
    names = record.dtype.names
    return SimpleNamespace(
        **{name: counting(record[name]) if record[name].dtype.kind == "f" else record[name] for name in names}
    )


def operations_per_update(speed: float = 0.01, angle: float = math.radians(45.0)) -> dict[str, float]:
    """Return the mean count of each kind over two seconds of a steady cut; a call of a mathematical function is one."""
    plant = SimulatedPlant(Specimen.mean(), angle=angle)
    plant.advance(speed, angle, 1000)
    cut = plant.cuts[0]
    row, profile, sensor = (_in_counting(cut[part][0]) for part in ("rows", "profiles", "sensors"))
    _counted.clear()
    for _ in range(_UPDATES):
        update_row(row, [profile], [sensor], TICK, False)
    return {kind: count / _UPDATES for kind, count in _counted.items()}


if __name__ == "__main__":
    if hasattr(measure, "py_func"):
        sys.exit("set NUMBA_DISABLE_JIT=1: compiled code cannot be counted")
    for _kind, _number in sorted(operations_per_update().items()):
        print(f"{_kind}: {_number:.1f}")
