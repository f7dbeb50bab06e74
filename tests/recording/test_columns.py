"""A header says quantity and unit; what it does not say is refused with the nearest that is known."""

from __future__ import annotations

import math

import numpy as np
import pytest

from cutenv._base.unit_table import NAMED_UNITS
from cutenv.recording.columns import FIELD_UNITS, UNITS, header_of, parse_header
from cutenv.trace import Reading


@pytest.mark.parametrize(
    ("header", "given", "si"),
    [
        ("time_s", 1.5, 1.5),
        ("time_ms", 1500.0, 1.5),
        ("time_us", 1.5e6, 1.5),
        ("time_min", 0.025, 1.5),
        ("force_N", -2.0, -2.0),
        ("force_mN", 54.0, 0.054),
        ("force_kN", 0.003, 3.0),
        ("force_gf", 1000.0, 9.80665),
        ("force_kgf", 1.0, 9.80665),
        ("force_lbf", 1.0, 0.45359237 * 9.80665),
        ("force_1", 0.3, 0.3),
        ("position_cm", 2.54, 0.0254),
        ("position_in", 1.0, 0.0254),
        ("depth_mm", 20.0, 0.02),
        ("depth_um", 20.0, 2e-5),
        ("speed_m_s", 0.1, 0.1),
        ("speed_cm_s", 2.54, 0.0254),
        ("speed_cm/s", 2.54, 0.0254),
        ("speed_mm_s", 25.4, 0.0254),
        ("speed_in_s", 1.0, 0.0254),
        ("angle_rad", 1.0, 1.0),
        ("angle_deg", 90.0, math.pi / 2),
        (" angle_deg ", 45.0, math.pi / 4),
    ],
)
def test_every_unit_comes_out_in_si(header, given, si):
    column = parse_header(header)
    (found,) = column.to_si(np.array([given]))
    assert found == pytest.approx(si, rel=1e-15)


def test_parts_of_a_unit_are_divided_to_the_last_bit():
    assert parse_header("position_cm").to_si(np.array([3.1]))[0] == 3.1 / 100
    assert 3.1 / 100 != 3.1 * 0.01


def test_no_two_units_have_one_name():
    for units in FIELD_UNITS.values():
        assert all(NAMED_UNITS[unit.name] is unit for unit in units)
        assert (units[0].si, units[0].factor) == (units[0].sign, 1.0)


def test_the_components_of_a_force_are_told_apart():
    found = [parse_header(f"force_{axis}_mN") for axis in "xyz"]
    assert [column.axis for column in found] == ["x", "y", "z"]
    assert {column.field for column in found} == {"force"}
    assert parse_header("force_N").axis is None


def test_a_normalised_force_is_no_newtons():
    assert parse_header("force_1").force_unit == parse_header("force_x_1").force_unit == "1"
    assert parse_header("force_lbf").force_unit == "N"
    assert parse_header("depth_m").force_unit is None


@pytest.mark.parametrize("field", Reading._fields)
def test_what_is_written_is_si_and_is_read_as_itself(field):
    column = parse_header(header_of(field))
    values = np.array([0.1, 1 / 3])
    assert column.field == field
    assert column.to_si(values) is values


def test_every_field_of_a_trace_has_units():
    assert tuple(UNITS) == Reading._fields
    assert header_of("force", "1") == "force_1"


@pytest.mark.parametrize(
    ("header", "message"),
    [
        ("force_Nn", "unit 'Nn'.*Did you mean force_N"),
        ("force_n", "unit 'n'.*Did you mean force_N"),
        ("force_x_mn", r"one of force_x_N, force_x_mN.*Did you mean force_x_mN"),
        ("angle_degrees", "Did you mean angle_deg"),
        ("position_km", "one of position_m, position_cm, .*Did you mean"),
        ("force", "'force' has no unit. Write one of force_N, force_mN"),
        ("force_", "has no unit"),
        ("force_x", "'force_x' has no unit. Write one of force_x_N"),
        ("pos_cm", "'pos_cm' is no quantity of a cut.*Did you mean position_cm"),
        ("Force_N", "Did you mean force_N"),
        ("Time", "Did you mean time_s"),
        ("temperature_C", "such as time_s, force_N, position_m, speed_m_s, angle_rad, depth_m"),
        ("position_x_m", "unit 'x_m'"),
        ("", "is no quantity"),
    ],
)
def test_what_is_not_known_is_refused_with_the_nearest(header, message):
    with pytest.raises(ValueError, match=message):
        parse_header(header)


@pytest.mark.parametrize("arguments", [("cut",), ("force", "mN")])
def test_no_other_field_or_unit_is_written(arguments):
    with pytest.raises(ValueError, match=r"'cut'|'mN'"):
        header_of(*arguments)
