"""How a blade leans, and what turning it upright takes."""

from __future__ import annotations

import math

import pytest

from cutenv.cutting.blade import leaning, sweeping


@pytest.mark.parametrize("degrees", [1.0, 30.0, 45.0, 67.5, 90.0, 120.0, 179.0])
def test_lean_and_sine_squared_are_of_the_angle(degrees):
    angle = math.radians(degrees)
    lean, pushing = leaning(angle)
    assert lean == pytest.approx(1.0 / math.tan(angle), rel=1e-14, abs=1e-16)
    assert pushing == pytest.approx(math.sin(angle) ** 2, rel=1e-13)


def test_turning_upright_takes_energy_and_leaning_over_none():
    upright, leant = leaning(math.radians(80.0))[0], leaning(math.radians(60.0))[0]
    assert sweeping(leant, upright, 3.0, 0.02) == pytest.approx(0.5 * 3.0 * 0.02 * (leant - upright))
    assert sweeping(upright, leant, 3.0, 0.02) == 0.0
