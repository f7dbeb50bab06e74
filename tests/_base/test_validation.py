"""The checks at the door: what passes, what is refused, and what the refusal says."""

from __future__ import annotations

import math

import numpy as np
import pytest

from cutenv._base.validation import array_in_range, in_range, one_of


@pytest.mark.parametrize("value", [0.0, 0.5, 1, 1.0, np.float64(0.25), np.float32(0.25), np.int64(1), np.array(0.5)])
def test_in_range_returns_a_float_of_the_same_value(value):
    checked = in_range("share", value, 0.0, 1.0, "1")
    assert type(checked) is float
    assert checked == value


@pytest.mark.parametrize("values", [0.5, [0.0, 1.0], np.full((2, 3), 0.5), [], range(2), np.array([0, 1], np.int8)])
def test_array_in_range_keeps_shape_and_values_as_float64(values):
    checked = array_in_range("share", values, 0.0, 1.0, "1")
    assert (checked.dtype, checked.shape) == (np.float64, np.shape(values))
    np.testing.assert_array_equal(checked, values)


@pytest.mark.parametrize("check", [in_range, array_in_range])
@pytest.mark.parametrize("value", [-1e-12, 1.0000001, math.nan, math.inf, -math.inf, np.float64("nan")])
def test_what_is_outside_or_not_finite_is_refused(check, value):
    with pytest.raises(ValueError, match="share = "):
        check("share", value, 0.0, 1.0, "1")
    with pytest.raises(ValueError, match="modulus = inf"):
        check("modulus", math.inf, 0.0, math.inf, "Pa")


@pytest.mark.parametrize(
    ("values", "named"), [([0.5, 2.0, 3.0], "2"), ([[0.5], [-1.0]], "-1"), ([math.nan, 0.5], "nan")]
)
def test_array_in_range_names_the_first_offender(values, named):
    with pytest.raises(ValueError, match=f"share = {named}"):
        array_in_range("share", values, 0.0, 1.0, "1")


@pytest.mark.parametrize("value", [True, False, "0.5", b"0.5", None, 1j, [0.5, 0.6], [], {}, np.zeros(2), object()])
def test_in_range_refuses_what_is_not_one_real_number(value):
    with pytest.raises(TypeError, match="share must be one real number in N"):
        in_range("share", value, 0.0, 1.0, "N")


@pytest.mark.parametrize("values", ["fast", ["0.5"], [1j], [[1.0], [1.0, 2.0]], [{}], True, [True, False]])
def test_array_in_range_refuses_what_is_no_array_of_real_numbers(values):
    with pytest.raises(TypeError, match="share must be real numbers in N"):
        array_in_range("share", values, 0.0, 1.0, "N", "Give numbers.")


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (
            lambda: in_range("speed", 2.54, 0.0, 0.1, "m/s", "2.54 looks like cm/s."),
            "speed = 2.54 m/s is outside 0 to 0.1 m/s. 2.54 looks like cm/s.",
        ),
        (lambda: in_range("poisson", 0.6, 0.0, 0.499, "1"), "poisson = 0.6 is outside 0 to 0.499."),
        (
            lambda: one_of("formulation", "plain_stress", ["plane_stress", "plane_strain"]),
            "formulation must be one of 'plane_stress', 'plane_strain', got 'plain_stress'. Did you mean "
            "'plane_stress'?",
        ),
        (
            lambda: one_of("element", "hexagon", ["quad4", "quad8"]),
            "element must be one of 'quad4', 'quad8', got 'hexagon'.",
        ),
    ],
)
def test_a_refusal_names_field_value_range_unit_and_cure(call, said):
    with pytest.raises(ValueError) as refusal:  # noqa: PT011  the whole text follows
        call()
    assert str(refusal.value) == said


def test_one_of_returns_the_choice():
    assert one_of("angle_deg", 45, (90, 45)) == 45
    assert one_of("element", "quad8", iter(["quad4", "quad8"])) == "quad8"
