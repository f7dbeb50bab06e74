"""The modulus against speed and angle: exact where there is no noise, tied to pig liver where there is no cut."""

from __future__ import annotations

import math

import numpy as np
import pytest

from cutenv.measurement import SpeedDependence, fit_speed_dependence
from cutenv.measurement.speed_dependence import is_between_the_measured
from cutenv.tissue import measured_liver
from cutenv.tissue.fall import speed_on_line

UPRIGHT, INCLINED = math.pi / 2, math.pi / 4
TRUTH = SpeedDependence(intercept_90=60e3, slope_90=-1.5e6, intercept_45=35e3, slope_45=-0.4e6, measured=frozenset())
NAMES = ("intercept_90", "slope_90", "intercept_45", "slope_45")


def moduli(speeds: np.ndarray, angles: np.ndarray) -> list[float]:
    return [TRUTH.modulus(v, angle) for v, angle in zip(speeds, angles, strict=True)]


def fitted(speeds: list[float], angles_deg: list[float]) -> SpeedDependence:
    """A fit to the truth at these conditions."""
    v, theta = np.array(speeds), np.radians(angles_deg)
    return fit_speed_dependence(v, theta, moduli(v, theta))


def check_is_the_truth(found: SpeedDependence, names: tuple[str, ...] = NAMES) -> None:
    for name in names:
        assert getattr(found, name) == pytest.approx(getattr(TRUTH, name), rel=1e-9), name


def test_lines_without_noise_are_found_exactly() -> None:
    found = fitted([0.001, 0.01, 0.02, 0.001, 0.01, 0.02], [90, 90, 90, 45, 45, 45])
    check_is_the_truth(found)
    assert found.measured == set(NAMES)


def test_angles_in_between_tell_both_lines() -> None:
    check_is_the_truth(fitted([0.001, 0.02, 0.01, 0.002, 0.02, 0.015], [90, 80, 70, 45, 50, 60]))


def test_neither_order_nor_repetition_of_cuts_matters() -> None:
    rng = np.random.default_rng(1)
    v, theta = rng.uniform(0.001, 0.025, 20), rng.choice([UPRIGHT, INCLINED], 20)
    E = np.array(moduli(v, theta)) * rng.lognormal(0.0, 0.2, 20)
    plain = fit_speed_dependence(v, theta, E)
    order = rng.permutation(20)
    mixed = fit_speed_dependence(v[order], theta[order], E[order])
    twice = fit_speed_dependence(np.tile(v, 2), np.tile(theta, 2), np.tile(E, 2))
    for other in (mixed, twice):
        assert [getattr(other, name) for name in NAMES] == pytest.approx([getattr(plain, name) for name in NAMES])


def test_many_noisy_cuts_come_near_the_truth() -> None:
    rng = np.random.default_rng(2)
    v, theta = rng.uniform(0.001, 0.025, 4000), rng.choice([UPRIGHT, INCLINED], 4000)
    E = np.array(moduli(v, theta)) * rng.normal(1.0, 0.2, 4000)
    found = fit_speed_dependence(v, theta, E)
    assert [getattr(found, name) for name in NAMES] == pytest.approx([getattr(TRUTH, name) for name in NAMES], rel=0.05)


@pytest.mark.parametrize(("angle", "other"), [(90, 45), (45, 90)])
def test_an_angle_that_was_not_cut_follows_the_other_as_in_pig_liver(angle: int, other: int) -> None:
    found = fitted([0.001, 0.01, 0.02], [angle] * 3)
    check_is_the_truth(found, (f"intercept_{angle}", f"slope_{angle}"))
    assert found.measured == {f"intercept_{angle}", f"slope_{angle}"}
    for name in ("intercept", "slope"):
        own, its = (getattr(measured_liver(), f"{name}_{each}") for each in (angle, other))
        assert getattr(found, f"{name}_{other}") / getattr(found, f"{name}_{angle}") == pytest.approx(its / own)


@pytest.mark.parametrize("ratio", [1.0, 1.4])
def test_speeds_that_hardly_differ_give_pig_livers_fall(ratio: float) -> None:
    found = fitted([0.01, 0.01 * ratio, 0.001, 0.02], [90, 90, 45, 45])
    assert found.measured == set(NAMES) - {"slope_90"}
    liver = measured_liver()
    assert found.slope_90 / found.intercept_90 == pytest.approx(liver.slope_90 / liver.intercept_90)
    check_is_the_truth(found, ("intercept_45", "slope_45"))


def test_the_border_between_upright_and_inclined_is_in_the_middle() -> None:
    assert fitted([0.001, 0.02], [68, 68]).measured == {"intercept_90", "slope_90"}
    assert fitted([0.001, 0.02], [67, 67]).measured == {"intercept_45", "slope_45"}


def test_the_modulus_is_linear_in_the_angle() -> None:
    middle = TRUTH.modulus(0.01, math.radians(67.5))
    assert middle == pytest.approx(0.5 * (TRUTH.modulus(0.01, UPRIGHT) + TRUTH.modulus(0.01, INCLINED)))
    assert TRUTH.modulus(0.01, None) == TRUTH.modulus(0.01, UPRIGHT)


def test_a_loading_ratio_lies_between_a_hundredth_and_one() -> None:
    assert TRUTH.loading_ratio(0.01, INCLINED) == pytest.approx(31.0 / 60.0)
    fallen = 1.5e6 * speed_on_line(0.01, measured_liver().falls_90)
    assert TRUTH.loading_ratio(0.01, UPRIGHT) == pytest.approx(1.0 - fallen / 60e3)
    assert TRUTH.loading_ratio(-0.01, UPRIGHT) == TRUTH.loading_ratio(0.01, UPRIGHT)
    assert TRUTH.loading_ratio(1.0, INCLINED) == 0.01
    rising = SpeedDependence(intercept_90=1e4, slope_90=1e6, intercept_45=1e4, slope_45=1e6, measured=frozenset())
    assert rising.loading_ratio(0.02, UPRIGHT) == 1.0


def test_no_cut_is_refused() -> None:
    with pytest.raises(ValueError, match="no cut to fit the modulus to"):
        fit_speed_dependence([], [], [])


@pytest.mark.parametrize(
    ("angle_deg", "between"), [(44.6, True), (44.4, False), (90.4, True), (90.6, False), (60, True)]
)
def test_angles_count_as_measured_to_half_a_degree(angle_deg: float, between: bool) -> None:
    assert is_between_the_measured(math.radians(angle_deg)) is between
