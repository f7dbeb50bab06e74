"""The natural bulge: 1 mm at the clamp, 2 cm at the crown, and the mean that was measured."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cutenv.tissue.grid import bulge

EDGE, CROWN, LENGTH = 0.001, 0.020, 0.15
Y = np.linspace(0.0, LENGTH, 3001)
rises = st.floats(0.03, 0.10)


def depth_of(rise: float, y=Y) -> np.ndarray:
    return bulge(y, edge=EDGE, crown=CROWN, rise_length=rise, length=LENGTH)


def check_shape(depth: np.ndarray) -> None:
    """From a thin edge up to one crown and down again, never outside the measured range."""
    assert depth[0] == pytest.approx(EDGE, rel=1e-5)
    assert depth.max() == pytest.approx(CROWN, rel=0.05)
    assert np.all((depth > 0.0) & (depth <= CROWN))
    crown = int(np.argmax(depth))
    assert np.all(np.diff(depth[: crown + 1]) >= 0.0)
    assert np.all(np.diff(depth[crown:]) <= 0.0)


def check_steepness(depth: np.ndarray, rise: float) -> None:
    """B' never exceeds that of the straight line from edge to crown."""
    assert np.max(np.gradient(depth, Y)) <= (1.0 + 1e-6) * (CROWN - EDGE) / rise


@given(rises)
def test_the_bulge_runs_from_edge_to_crown_and_back(rise):
    check_shape(depth_of(rise))


@given(rises)
def test_the_rise_is_no_steeper_than_its_length(rise):
    check_steepness(depth_of(rise), rise)


def test_other_shapes_fail_the_checks():
    ramp = np.minimum(EDGE + (CROWN - EDGE) * Y / 0.05, CROWN)
    with pytest.raises(AssertionError):
        check_shape(np.maximum(depth_of(0.06), 0.002))
    with pytest.raises(AssertionError):
        check_shape(ramp[::-1])
    with pytest.raises(AssertionError):
        check_steepness(ramp, 0.06)


@pytest.mark.parametrize(
    ("field", "value"),
    [("edge", 0.0), ("edge", 1.0), ("crown", 0.0005), ("crown", 2.0), ("rise_length", math.nan)],
)
def test_nonsense_is_refused_by_name(field, value):
    with pytest.raises(ValueError, match=field):
        bulge(Y, **({"edge": EDGE, "crown": CROWN, "rise_length": 0.015, "length": LENGTH} | {field: value}))
