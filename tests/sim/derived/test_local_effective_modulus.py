"""The local effective modulus between, at and beyond the measured speeds and angles, and its fall with speed."""

from __future__ import annotations

import dataclasses
import itertools
import math

import numpy as np
import pytest

from cutenv.sim.cutting.dtypes import law_records
from cutenv.sim.cutting.law import loading_ratio
from cutenv.sim.tissue import Specimen, measured_liver
from cutenv.sim.tissue.description import TissueDescription, inclined_spread, tables_only
from cutenv.sim.tissue.effective_modulus import (
    checked_falls,
    end_of_fall,
    falls,
    linear_fit,
    local_effective_modulus,
    power_fit,
    quasi_static_modulus,
    speed_on_line,
)
from cutenv.sim.tissue.tables import table

UPRIGHT, INCLINED = math.radians(90), math.radians(45)
SPEEDS = np.linspace(0.001, 0.0254, 25)
HYPOTHESES = [(0.3, True), (0.3, False), (0.499, True)]
FORMULATIONS = ("plane_stress", "plane_strain")
EVERY_HYPOTHESIS = pytest.mark.parametrize(
    ("formulation", "poisson", "depth_normalised"),
    [(formulation, *case) for formulation, case in itertools.product(FORMULATIONS, HYPOTHESES)],
)


def check_least_squares(speed: np.ndarray, measured: np.ndarray, intercept: float, slope: float) -> None:
    """The normal equations: the residuals have no mean and no slope left in them."""
    residual = measured - (intercept + slope * speed)
    scale = np.abs(measured).max() * len(measured)
    assert abs(residual.sum()) < 1e-9 * scale
    assert abs((residual * speed).sum()) < 1e-9 * scale * speed.max()


@pytest.mark.parametrize("number", ["5.6", "5.7"])
@pytest.mark.parametrize("angle_deg", [90, 45])
@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_linear_fits_solve_the_normal_equations(number, angle_deg, formulation):
    data = table(number)
    fit = linear_fit(number, angle_deg=angle_deg, formulation=formulation)
    speed, measured = data["speed_cm_s"] / 100, data[f"lem_{formulation}_{angle_deg}_deg_Pa"]
    check_least_squares(speed, measured, fit.intercept, fit.slope)
    slope = (measured[-1] - measured[0]) / (speed[-1] - speed[0])
    with pytest.raises(AssertionError):  # the line through the two ends is not the least-squares line
        check_least_squares(speed, measured, measured[0] - slope * speed[0], slope)


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_power_law_is_fitted_to_the_logarithms_without_the_missing_speed(formulation):
    data, fit = table("5.5"), power_fit(formulation=formulation)
    measured = data[f"lem_{formulation}_45_deg_Pa"]
    present = np.isfinite(measured)
    assert present.sum() == 6
    log_speed = np.log(data["speed_cm_s"][present])
    check_least_squares(log_speed, np.log(measured[present]), math.log(fit.modulus_at_reference), fit.exponent)


def test_the_logarithmic_fit_comes_closer_to_equations_5_3_and_5_4_than_that_of_the_moduli():
    for formulation, printed in (("plane_stress", 24.21), ("plane_strain", 22.17)):
        data = table("5.5")
        present = np.isfinite(data["lem_plane_stress_45_deg_Pa"])
        speed, kPa = data["speed_cm_s"][present], data[f"lem_{formulation}_45_deg_Pa"][present] / 1000
        # Least squares of the moduli: for each exponent the best coefficient is linear; search the exponent.
        exponents = np.linspace(-0.6, -0.3, 3001)
        shapes = speed ** exponents[:, None]
        coefficients = (shapes * kPa).sum(axis=1) / (shapes**2).sum(axis=1)
        misfit = ((coefficients[:, None] * shapes - kPa) ** 2).sum(axis=1)
        of_the_moduli = coefficients[misfit.argmin()]
        of_the_logarithms = power_fit(formulation=formulation).modulus_at_reference / 1000
        assert abs(of_the_logarithms - printed) < abs(of_the_moduli - printed)


def test_fits_are_in_si_and_say_where_they_come_from():
    fit = linear_fit("5.6", angle_deg=90, formulation="plane_stress")
    assert (fit.speed_min, fit.speed_max) == (0.001, 0.0254)
    assert fit.intercept == pytest.approx(48_400, abs=50)  # equation 5.5
    assert fit.slope == pytest.approx(-11_600 * 100, abs=50 * 100)
    assert fit.source == "Table 5.6, 90 deg, plane_stress, Poisson's ratio 0.3"
    assert power_fit().reference_speed == 0.01


def test_quasi_static_modulus_is_the_intercept_of_the_depth_normalised_plane_stress_fit():
    assert quasi_static_modulus() == linear_fit("5.6", angle_deg=90, formulation="plane_stress").intercept
    assert quasi_static_modulus() == pytest.approx(48_356, abs=0.5)


@EVERY_HYPOTHESIS
def test_modulus_is_positive_and_falls_with_speed_at_every_angle(formulation, poisson, depth_normalised):
    for angle in np.radians([45, 60, 75, 90]):
        moduli = local_effective_modulus(SPEEDS, angle, formulation, poisson, depth_normalised)
        assert (moduli > 0).all()
        assert (np.diff(moduli) < 0).all()


@EVERY_HYPOTHESIS
def test_angles_in_between_are_interpolated_linearly(formulation, poisson, depth_normalised):
    def at(angle):
        return local_effective_modulus(0.01, angle, formulation, poisson, depth_normalised)

    for share in (0.25, 0.5, 0.75):
        expected = (1 - share) * at(INCLINED) + share * at(UPRIGHT)
        assert at(INCLINED + share * (UPRIGHT - INCLINED)) == pytest.approx(expected, rel=1e-12)


@EVERY_HYPOTHESIS
def test_speeds_beyond_the_measured_ones_count_as_the_nearest_measured(formulation, poisson, depth_normalised):
    for angle in (INCLINED, 1.2, UPRIGHT):
        beyond = local_effective_modulus([0.0, 0.0005, 0.03, 0.1], angle, formulation, poisson, depth_normalised)
        ends = local_effective_modulus([0.001, 0.001, 0.0254, 0.0254], angle, formulation, poisson, depth_normalised)
        np.testing.assert_array_equal(beyond, ends)


def test_defaults_are_plane_stress_0_3_and_depth_normalised():
    assert local_effective_modulus(0.005, UPRIGHT) == linear_fit("5.6", angle_deg=90).modulus(0.005)
    assert local_effective_modulus(0.005, INCLINED) == linear_fit("5.6", angle_deg=45).modulus(0.005)


@pytest.mark.parametrize(
    ("poisson", "depth_normalised", "number"), [(0.3, True, "5.6"), (0.3, False, "5.5"), (0.499, True, "5.7")]
)
@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_each_hypothesis_takes_its_own_table(poisson, depth_normalised, number, formulation):
    expected = linear_fit(number, angle_deg=90, formulation=formulation).modulus(0.01)
    assert local_effective_modulus(0.01, UPRIGHT, formulation, poisson, depth_normalised) == expected


def test_scalars_give_a_float_and_arrays_their_broadcast_shape():
    assert type(local_effective_modulus(0.01, UPRIGHT)) is float
    assert type(local_effective_modulus(np.float64(0.01), np.float64(UPRIGHT))) is float
    moduli = local_effective_modulus(SPEEDS[:, None], np.array([INCLINED, UPRIGHT]))
    assert moduli.shape == (25, 2)
    assert moduli[7, 1] == local_effective_modulus(float(SPEEDS[7]), UPRIGHT)
    assert local_effective_modulus([], UPRIGHT).shape == (0,)


def test_angles_that_went_through_degrees_keep_their_end_points():
    tilt = 1e-10
    assert local_effective_modulus(0.01, UPRIGHT + tilt) == local_effective_modulus(0.01, UPRIGHT)
    assert local_effective_modulus(0.01, INCLINED - tilt) == local_effective_modulus(0.01, INCLINED)


@pytest.mark.parametrize(
    ("speed", "angle", "hint"),
    [
        (2.54, UPRIGHT, r"speed = 2\.54 m/s is outside 0 to 0\.1 m/s.*cm/s"),
        (-0.01, UPRIGHT, "magnitude"),
        (math.nan, UPRIGHT, "speed = nan"),
        ([0.01, math.inf], UPRIGHT, "speed = inf"),
        (0.01, 90, r"angle = 90 rad.*degrees.*radians"),
        (0.01, 1.6, "45 to 90 degrees"),
        (0.01, 0.7, "45 to 90 degrees"),
        (0.01, math.nan, "angle = nan"),
        ([0.01, 0.02], [1.0, 1.1, 1.2], "shape"),
    ],
)
def test_impossible_speeds_and_angles_are_refused_with_the_cure(speed, angle, hint):
    with pytest.raises(ValueError, match=hint):
        local_effective_modulus(speed, angle)


@pytest.mark.parametrize("poisson", [0.0, 0.4, 0.45, 0.5, math.nan])
def test_unmeasured_poissons_ratios_are_sent_to_the_conversion(poisson):
    with pytest.raises(ValueError, match=r"poisson = .*CutModel\.convert_modulus"):
        local_effective_modulus(0.01, UPRIGHT, poisson=poisson)


@pytest.mark.parametrize(
    ("keywords", "hint"),
    [
        ({"poisson": 0.499, "depth_normalised": False}, r"not depth-normalised.*0\.3.*CutModel\.convert_modulus"),
        ({"formulation": "plain_strain"}, "Did you mean 'plane_strain'"),
    ],
)
def test_what_was_not_measured_or_is_misspelt_is_refused_with_the_cure(keywords, hint):
    with pytest.raises(ValueError, match=hint):
        local_effective_modulus(0.01, UPRIGHT, **keywords)


@pytest.mark.parametrize(
    ("arguments", "hint"),
    [
        ({"number": "5.4"}, "table number must be one of '5.5'"),
        ({"number": "5.5", "angle_deg": 45}, "power_fit"),
        ({"number": "5.6", "angle_deg": 60}, "angle_deg must be one of 90, 45"),
        ({"number": "5.6", "formulation": "solid"}, "formulation must be one of"),
    ],
)
def test_fits_that_do_not_exist_are_refused(arguments, hint):
    with pytest.raises(ValueError, match=hint):
        linear_fit(**arguments)


LIVER = measured_liver()
STEPS = np.array([0.0, 0.0005, 0.001, 0.002, 0.0038, 0.006, 0.0127, 0.015, 0.0165, 0.02, 0.0254, 0.05])
# Pooled by hand from Table 5.6 at 90 degrees, [kPa]: neighbours that rise are averaged.
POOLED = (51.0, 40.0, 38.5, 38.5, 22.0, 22.0, 22.0)


def test_the_law_follows_the_pooled_means_at_every_measured_speed() -> None:
    for speed, level in zip(table("5.6")["speed_cm_s"] / 100, POOLED, strict=True):
        assert LIVER.local_effective_modulus(float(speed), UPRIGHT) == pytest.approx(1e3 * level, rel=1e-9)


def test_no_curve_that_never_rises_is_nearer_to_the_means() -> None:
    """Moved anywhere by 0.1 kPa, it is farther away or rises."""
    means = table("5.6")["lem_plane_stress_90_deg_Pa"] / 1e3
    best = float(((means - np.array(POOLED)) ** 2).sum())
    for n in range(len(means)):
        for change in (-0.1, 0.1):
            moved = np.array(POOLED)
            moved[n] += change
            assert (np.diff(moved) > 1e-9).any() or ((means - moved) ** 2).sum() > best


@pytest.mark.parametrize("angle", [INCLINED, 1.0, UPRIGHT])
@pytest.mark.parametrize("inclined_ratio", [0.5, 1.0, 2.5])
@pytest.mark.parametrize("tissue", [LIVER, tables_only()], ids=["steps", "line"])
def test_law_and_specimen_have_the_same_ratio(tissue: TissueDescription, inclined_ratio: float, angle: float) -> None:
    specimen = dataclasses.replace(Specimen.mean(tissue), inclined_ratio=inclined_ratio)
    law = law_records([specimen])[0]
    for speed in STEPS:
        ratio = specimen.loading_ratio(float(speed), angle)
        assert loading_ratio(law, speed, angle) == pytest.approx(ratio, rel=1e-12)
        assert 0.0 < ratio <= 1.0


def test_a_tissue_without_steps_falls_along_the_line_of_the_thesis() -> None:
    fit = linear_fit("5.6", angle_deg=90)
    for speed in (0.001, 0.01, 0.0254):
        assert tables_only().local_effective_modulus(speed, UPRIGHT) == pytest.approx(float(fit.modulus(speed)))


def test_steps_and_a_line_of_the_same_mean_slope_meet_at_the_end() -> None:
    intercept, slope, steps = falls("5.6")
    end = end_of_fall(steps)
    assert end == 0.0165
    assert float(speed_on_line(end, steps)) == pytest.approx(end)
    assert float(speed_on_line(1.0, steps)) == pytest.approx(end)
    assert intercept + slope * end == pytest.approx(22e3)
    assert speed_on_line([0.01, 0.02], ()).tolist() == [0.01, 0.02]


@pytest.mark.parametrize(
    "given",
    [
        3.0,
        [(0.5, 0.001, 0.01)],
        [(1.0, 0.01)],
        [(0.25, 0.0, 0.01)] * 4,
        [(1.5, 0.0, 0.01), (-0.5, 0.01, 0.02)],
        [(1.0, 0.02, 0.01)],
        [("half", 0.0, 0.01)],
    ],
)
def test_steps_that_are_none_are_refused_by_name(given: object) -> None:
    with pytest.raises(ValueError, match="falls_90"):
        checked_falls("falls_90", given)  # type: ignore[arg-type]


def test_an_inclined_blade_scatters_as_table_5_6_does_beyond_an_upright_one() -> None:
    cv = {
        angle: table("5.6")[f"sd_plane_stress_{angle}_deg_Pa"] / table("5.6")[f"lem_plane_stress_{angle}_deg_Pa"]
        for angle in (45, 90)
    }
    assert inclined_spread() ** 2 + (cv[90] ** 2).mean() == pytest.approx((cv[45] ** 2).mean())
    drawn = np.log([Specimen.drawn(5, n).inclined_ratio for n in range(2000)])
    sigma = math.sqrt(math.log(1.0 + inclined_spread() ** 2))
    assert drawn.std() == pytest.approx(sigma, rel=0.05)
    assert np.exp(drawn).mean() == pytest.approx(1.0, abs=0.04)
