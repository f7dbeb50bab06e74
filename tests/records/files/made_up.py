"""Traces and metadata of any content, for hypothesis; and one that is easy to read."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from hypothesis import strategies as st

from cutenv.sim.trace import COMPONENTS_OF_FORCE, PLACE, Reading, Trace, limits

FULL = Trace(
    time=np.arange(40) * 1e-3,
    force=np.linspace(0.0, 3.0, 40) ** 1.7,
    position=0.01 * np.arange(40) * 1e-3,
    speed=np.full(40, 0.01),
    angle=np.full(40, math.pi / 2),
    depth=np.full(40, 0.02),
    metadata={"rig": "bench 2", "trial": 3},
)


def some(first: int, count: int = 20) -> list[Reading]:
    """Readings of a cut in which each number tells the place."""
    return [Reading(i * 1e-3, i * 1e-2, i * 1e-6, 1e-3, math.pi / 2, 0.02) for i in range(first, first + count)]


PLAIN = st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | st.text()
JSON = st.recursive(PLAIN, lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(), inner, max_size=3))
# An operator's code is checked when it is saved: tests/records/files/test_record.py.
METADATA = st.dictionaries(st.text().filter(lambda name: name != "operator"), JSON, max_size=4)


def columns(draw: st.DrawFn, n: int, name: str, force_unit: str) -> Any:
    low, high = limits(name, force_unit)
    return draw(st.lists(st.floats(low, high), min_size=n, max_size=n))


@st.composite
def traces(draw: st.DrawFn) -> Trace:
    """Of 2 to 20 instants; any fields, any values that a trace takes, any metadata."""
    n = draw(st.integers(2, 20))
    force_unit = draw(st.sampled_from(["N", "1"]))
    steps = draw(st.lists(st.floats(1e-6, 0.5), min_size=n - 1, max_size=n - 1))
    start = draw(st.floats(-1e6, 1e6))
    # Speed and position must agree, so that not both are made up.
    moved = draw(st.sampled_from(["position", "speed"]))
    names = draw(st.sets(st.sampled_from(["angle", "depth", moved, "height", "vertical_force"])))
    names |= set(COMPONENTS_OF_FORCE) if draw(st.booleans()) else set()
    names |= {*PLACE, "lateral_force"} if draw(st.booleans()) else set()
    return Trace(
        time=np.cumsum([start, *steps]),
        force=columns(draw, n, "force", force_unit),
        **{name: columns(draw, n, name, force_unit) for name in sorted(names)},
        force_unit=force_unit,
        metadata=draw(METADATA),
    )
