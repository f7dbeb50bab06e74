"""How a blade leans, beside numbers of fifty digits."""

from __future__ import annotations

import math

import mpmath
import numpy as np
import pytest

from cutenv.compiled import compiled
from cutenv.cutting.blade import cotangent, leaning, sweeping

DEGREES = np.concatenate([
    np.linspace(-45.0, 225.0, 4001), 90.0 + np.linspace(-0.01, 0.01, 201), 10.0 ** np.linspace(-9.0, 1.0, 101),
    180.0 - 10.0 ** np.linspace(-9.0, 1.0, 101),
])  # fmt: skip


@compiled
def cotangent_in_a_kernel(angle: float) -> float:
    """As kernels have it."""
    return cotangent(angle)


def in_last_places(found: float, angle: float) -> float:
    """The error of a cotangent, in units in the last place."""
    with mpmath.workdps(50):
        exact = mpmath.cot(mpmath.mpf(angle))
        return float(abs(mpmath.mpf(found) - exact) / math.ulp(float(exact)))


def test_the_cotangent_is_right_to_the_last_places():
    angles = [a for a in np.radians(DEGREES).tolist() if a != 0.0]
    errors = [in_last_places(cotangent_in_a_kernel(angle), angle) for angle in angles]
    assert 0.0 < max(errors) < 3.0


@pytest.mark.parametrize("degrees", [1.0, 30.0, 45.0, 67.5, 90.0, 120.0, 179.0])
def test_lean_and_sine_squared_are_of_the_angle(degrees):
    angle = math.radians(degrees)
    lean, pushing = leaning(angle)
    assert lean == pytest.approx(1.0 / math.tan(angle), rel=1e-14, abs=1e-16)
    assert pushing == pytest.approx(math.sin(angle) ** 2, rel=1e-13)


def test_plain_python_and_compiled_agree_to_the_last_bit():
    for angle in np.radians(DEGREES).tolist():
        if angle != 0.0:
            assert cotangent(angle) == cotangent_in_a_kernel(angle)


def test_turning_upright_takes_energy_and_leaning_over_none():
    upright, leant = leaning(math.radians(80.0))[0], leaning(math.radians(60.0))[0]
    assert sweeping(leant, upright, 3.0, 0.02) == pytest.approx(0.5 * 3.0 * 0.02 * (leant - upright))
    assert sweeping(upright, leant, 3.0, 0.02) == 0.0
