"""LEM in, LEM out: from the record of a cut; its variance components and the mean depth of cut."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from pairs import every_pair
from recorded_cut import RecordedCut, rested_cut

from cutenv.records.measurement import (
    estimate_fracture_resistance,
    estimate_local_effective_moduli,
    iterate_modulus,
    loading_segments,
)
from cutenv.sim.tissue.cut_model import CutModel
from cutenv.sim.tissue.description import ModulusSpread, mean_depth_of_cut, modulus_spread, variance_components
from cutenv.sim.tissue.effective_modulus import local_effective_modulus
from cutenv.sim.tissue.tables import table
from cutenv.sim.trace import Trace

SPEEDS = (0.001, 0.0127, 0.0254)
MODEL = CutModel()


def check_modulus_comes_back(cut: RecordedCut, **changes: Any) -> None:
    """Section 6 of the design: 5 % median; the tips besides."""
    estimate = estimate_local_effective_moduli(cut.trace, MODEL, **changes)
    assert len(estimate) >= 5
    ratio = estimate.modulus / cut.true_moduli(estimate.segments)
    assert abs(np.median(ratio) - 1.0) < 0.025
    assert np.median(np.abs(ratio - 1.0)) < 0.025
    tips = np.array([cut.tip[s.samples].mean() for s in estimate.segments])
    assert np.median(np.abs(estimate.position - tips)) < 0.3e-3


@pytest.mark.parametrize(
    ("kind", "speed", "angle_deg"), every_pair(("2 cm", "1 cm", "bulge", "liver"), SPEEDS, (90.0, 45.0))
)
def test_modulus_comes_back_from_any_speed_angle_and_depth(kind: str, speed: float, angle_deg: float) -> None:
    cut = rested_cut(kind, speed=speed, angle_deg=angle_deg)
    check_modulus_comes_back(cut, loading_ratio=cut.specimen.loading_ratio)
    assert estimate_local_effective_moduli(cut.trace, MODEL).flags == ()


@pytest.mark.parametrize("speed", SPEEDS)
def test_an_inclined_cut_unlike_the_mean_shifts_the_tip_and_hardly_the_modulus(speed: float) -> None:
    """Of this one the LEM at 45 degrees is not the mean tissue's, from which the lag of the tip is reckoned."""
    cut = rested_cut("liver", speed=speed, angle_deg=45.0)
    assert not 0.8 < cut.specimen.inclined_ratio < 1.2
    estimate = estimate_local_effective_moduli(cut.trace, MODEL)
    assert np.median(estimate.modulus / cut.true_moduli(estimate.segments)) == pytest.approx(1.0, abs=0.025)
    tips = np.array([cut.tip[s.samples].mean() for s in estimate.segments])
    assert 0.3e-3 < np.median(np.abs(estimate.position - tips)) < 2e-3


@pytest.mark.parametrize("angle_deg", [90.0, 45.0])
@pytest.mark.parametrize("speed", SPEEDS)
def test_kappa_at_the_blade_costs_more_than_3_percent(speed: float, angle_deg: float) -> None:
    cut = rested_cut(speed=speed, angle_deg=angle_deg)
    at_tip = estimate_local_effective_moduli(cut.trace, MODEL)
    at_blade = estimate_local_effective_moduli(cut.trace, MODEL, loading_ratio=0.0)
    assert 1.03 < np.median(at_blade.modulus / at_tip.modulus) < 1.08


def test_friction_comes_from_the_way_back() -> None:
    cut = rested_cut("bulge")
    estimate = estimate_local_effective_moduli(cut.trace, MODEL)
    assert estimate.friction_per_depth == pytest.approx(cut.specimen.friction_per_depth, rel=0.03)


@pytest.mark.parametrize("kind", ["2 cm", "bulge", "liver"])
@pytest.mark.parametrize("speed", SPEEDS)
def test_a_cut_without_way_back_is_flagged_and_friction_takes_its_assumed_share(kind: str, speed: float) -> None:
    cut = rested_cut(kind, speed=speed).forward()
    check_modulus_comes_back(cut)
    estimate = estimate_local_effective_moduli(cut.trace, MODEL)
    assert any("friction assumed to be 20 %" in flag for flag in estimate.flags)
    assert estimate.friction_per_depth == estimate_fracture_resistance(cut.trace).friction_per_depth
    given = estimate_local_effective_moduli(cut.trace, MODEL, friction_per_depth=estimate.friction_per_depth)
    assert given.flags == ()
    assert np.array_equal(given.modulus, estimate.modulus)


def test_a_cut_of_no_resistance_has_no_share_of_friction_and_is_flagged() -> None:
    cut = rested_cut().forward()
    nothing = dataclasses.replace(cut.trace, force=np.zeros(len(cut.trace)))
    estimate = estimate_local_effective_moduli(nothing, MODEL)
    assert (len(estimate), estimate.friction_per_depth) == (0, 0.0)
    assert any("friction unknown and taken as zero" in flag for flag in estimate.flags)


def test_the_first_segment_after_contact_is_left_out() -> None:
    cut = rested_cut(turns=(0.04, 0.0, 0.08, 0.0))
    left_out = [s.start for s in loading_segments(cut.trace) if s.after_standstill]
    assert len(left_out) == 2
    used = [s.start for s in estimate_local_effective_moduli(cut.trace, MODEL).segments]
    assert not set(left_out) & set(used)


def test_without_depth_the_modulus_is_that_of_unit_thickness_and_flagged() -> None:
    """As in Tables 5.1 to 5.5: force as if the cut were 1 cm deep, so twice the modulus at 2 cm."""
    cut = rested_cut()
    by_depth = estimate_local_effective_moduli(cut.trace, MODEL)
    blind = dataclasses.replace(cut.trace, depth=None)
    for estimate in (
        estimate_local_effective_moduli(blind, MODEL),
        estimate_local_effective_moduli(cut.trace, MODEL, depth_normalised=False),
    ):
        assert estimate.modulus == pytest.approx(2.0 * by_depth.modulus, rel=1e-9)
        assert any("not normalised by depth: as if 1 cm deep" in flag for flag in estimate.flags)


def test_plane_strain_moduli_differ_by_the_ratio_of_stiffness() -> None:
    cut = rested_cut()
    strain = CutModel(formulation="plane_strain")
    stress_estimate = estimate_local_effective_moduli(cut.trace, MODEL)
    strain_estimate = estimate_local_effective_moduli(cut.trace, strain)
    expected = MODEL.convert_modulus(stress_estimate.modulus, strain, stress_estimate.position)
    assert strain_estimate.modulus == pytest.approx(expected, rel=1e-12)


def check_iteration_agrees(tip: float, initial: float, *, thickness: float = 0.02) -> None:
    """The thesis's loop around the finite-element model ends at the modulus that one division gives."""
    node = MODEL.pairs[np.argmin(np.abs(MODEL.nodes[MODEL.pairs[:, 0], 1] - tip)), 0]
    dF, dU = 1.7, 4e-3

    def force_rise(E: float) -> float:
        per_newton = MODEL.displacement(tip, 1.0, E, thickness)[node, 1]
        return dU / float(per_newton)

    found = iterate_modulus(force_rise, dF, initial=initial)
    assert found == pytest.approx(dF / dU / (MODEL.stiffness(tip) * 0.02), rel=1e-9)


@pytest.mark.parametrize("initial", [10.0, 5e4, 1e9])
@pytest.mark.parametrize("tip", [0.02, 0.05, 0.10])
def test_the_iteration_agrees_with_the_one_step_of_a_linear_model(tip: float, initial: float) -> None:
    check_iteration_agrees(tip, initial)


@pytest.mark.parametrize("power", [0.5, 0.8, 1.5])
def test_the_iteration_finds_the_modulus_of_a_model_that_is_not_linear_in_it(power: float) -> None:
    E = iterate_modulus(lambda E: 1e-3 * E**power, 1e-3 * 40e3**power, tolerance=1e-6)
    assert pytest.approx(40e3, rel=1e-5) == E


def test_the_iteration_says_where_it_diverges() -> None:
    with pytest.raises(RuntimeError, match="did not converge: step 100, modulus 10000 Pa, residual 1"):
        iterate_modulus(lambda E: 1e-8 * E**2, 2.0)
    with pytest.raises(RuntimeError, match=r"did not converge: step 7, modulus .* Pa, residual"):
        iterate_modulus(lambda E: 1e-12 * E**3, 2.0)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"loading_ratio": 1.5}, "loading_ratio = 1.5 is outside"),
        ({"friction_per_depth": -1.0}, "friction_per_depth = -1 N/m is outside"),
        ({"smallest_drop": -1.0}, "smallest_drop"),
    ],
)
def test_nonsense_is_refused(changes: dict[str, float], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        estimate_local_effective_moduli(rested_cut().trace, MODEL, **changes)  # type: ignore[arg-type]


def test_what_a_trace_lacks_is_named() -> None:
    trace = rested_cut().trace
    with pytest.raises(ValueError, match="estimate_local_effective_moduli needs position"):
        estimate_local_effective_moduli(Trace(time=trace.time, force=trace.force), MODEL)
    with pytest.raises(ValueError, match="estimate_local_effective_moduli without loading_ratio needs angle"):
        estimate_local_effective_moduli(dataclasses.replace(trace, angle=None), MODEL)
    with pytest.raises(ValueError, match="needs force in newtons"):
        estimate_local_effective_moduli(dataclasses.replace(trace, force_unit="1"), MODEL)


def test_without_angle_the_loading_ratio_can_be_given() -> None:
    trace = dataclasses.replace(rested_cut().trace, angle=None)
    ratio = local_effective_modulus(0.0127, math.radians(90)) / local_effective_modulus(0.0, math.radians(90))
    assert len(estimate_local_effective_moduli(trace, MODEL, loading_ratio=float(ratio))) > 5


def test_a_speed_outside_the_measured_range_is_flagged() -> None:
    estimate = estimate_local_effective_moduli(rested_cut(speed=0.035).trace, MODEL)
    assert any("speed outside the measured range" in flag for flag in estimate.flags)


FORMULATIONS = ("plane_stress", "plane_strain")


def check_recovers(components: tuple[float, float], between: float, within: float) -> None:
    assert components[0] == pytest.approx(between, rel=0.05)
    assert components[1] == pytest.approx(within, rel=0.05)


def made_up(n_tables: int = 20_000) -> np.ndarray:
    """Three livers of four cuts, many times over: SD 0.3 between livers, 0.2 between cuts."""
    rng = np.random.default_rng(52)
    return 1 + rng.normal(0, 0.3, (n_tables, 3, 1)) + rng.normal(0, 0.2, (n_tables, 3, 4))


def test_components_are_recovered_without_bias():
    check_recovers(variance_components(made_up()), 0.3**2, 0.2**2)
    groups = made_up()
    with pytest.raises(AssertionError):  # the plain variance of the means still contains a quarter of that between cuts
        check_recovers((groups.mean(axis=2).var(axis=1, ddof=1).mean(), 0.2**2), 0.3**2, 0.2**2)


def test_components_can_be_worked_out_by_hand():
    # Means 2 and 6, squares about them 2 + 8 over 2 degrees of freedom: within 5; between (16 - 5)/2.
    between, within = variance_components(np.array([[[1.0, 3.0], [4.0, 8.0]]]))
    assert (between, within) == (pytest.approx((16 - 5) / 2), pytest.approx(5))


def test_equal_groups_give_a_negative_component_between_them():
    between, _ = variance_components(np.array([[[1.0, 3.0], [1.0, 3.0]]]))
    assert between == pytest.approx(-1)


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_measured_spread_is_the_analysis_of_variance_written_out(formulation):
    between, within, ratios = [], [], []
    for number in ("5.2", "5.3", "5.4"):
        mean, sd = table(number)[f"lem_{formulation}_Pa"], table(number)[f"sd_{formulation}_Pa"]
        livers = [mean[i : i + 4] / mean.mean() for i in (0, 4, 8)]
        within.append(sum(((cuts - cuts.mean()) ** 2).sum() for cuts in livers) / 9)
        between.append(4 * sum((cuts.mean() - 1) ** 2 for cuts in livers) / 2)
        ratios.extend(sd / mean)
    spread = modulus_spread(formulation)
    assert spread.between_cut_cv == pytest.approx(math.sqrt(np.mean(within)))
    assert spread.between_liver_cv == pytest.approx(math.sqrt((np.mean(between) - np.mean(within)) / 4))
    assert spread.within_cut_cv == pytest.approx(np.mean(ratios))
    assert not spread.between_liver_clipped


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_between_cut_spread_is_smaller_than_within(formulation):
    spread = modulus_spread(formulation)
    assert 0 < spread.between_liver_cv < spread.between_cut_cv < spread.within_cut_cv


def test_a_negative_component_is_clipped_to_zero_and_reported(monkeypatch):
    monkeypatch.setattr("cutenv.sim.tissue.description.variance_components", lambda groups: (-0.01, 0.04))
    spread = modulus_spread()
    assert (spread.between_liver_cv, spread.between_cut_cv) == (0.0, pytest.approx(0.2))
    assert spread.between_liver_clipped


def test_rows_of_tables_5_2_and_5_3_correlate_as_the_caution_says():
    slow, medium, fast = (table(number)["lem_plane_stress_Pa"] for number in ("5.2", "5.3", "5.4"))
    assert np.corrcoef(slow, medium)[0, 1] == pytest.approx(0.79, abs=0.005)
    assert abs(np.corrcoef(slow, fast)[0, 1]) < 0.3


@pytest.mark.parametrize("change", [{"between_liver_cv": -0.1}, {"within_cut_cv": math.nan}, {"between_cut_cv": 20}])
def test_a_spread_that_is_none_is_refused(change):
    with pytest.raises(ValueError, match=next(iter(change))):
        dataclasses.replace(ModulusSpread(between_liver_cv=0.1, between_cut_cv=0.2, within_cut_cv=0.4), **change)


def test_mean_depth_is_the_geometric_mean_ratio_of_tables_5_5_and_5_6():
    columns = [f"lem_plane_stress_{angle}_deg_Pa" for angle in (90, 45)]
    ratios = np.concatenate([table("5.5")[column] / table("5.6")[column] for column in columns])
    ratios = ratios[np.isfinite(ratios)]
    assert len(ratios) == 13
    assert mean_depth_of_cut() == pytest.approx(0.01 * np.prod(ratios) ** (1 / 13))
    assert mean_depth_of_cut() == pytest.approx(0.0143, abs=5e-5)


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_mean_depth_lies_within_the_measured_depths(formulation):
    assert 0.001 <= mean_depth_of_cut(formulation=formulation) <= 0.02


@pytest.mark.parametrize(("function", "argument"), [(modulus_spread, "solid"), (mean_depth_of_cut, "solid")])
def test_what_was_not_measured_is_refused(function, argument):
    with pytest.raises(ValueError, match="must be one of"):
        function(argument)


def test_kappa_at_the_blade_instead_of_the_tip_is_noticed() -> None:
    with pytest.raises(AssertionError):
        check_modulus_comes_back(rested_cut(), loading_ratio=0.0)


def test_friction_left_in_where_the_depth_grows_is_noticed() -> None:
    with pytest.raises(AssertionError):
        check_modulus_comes_back(rested_cut("bulge"), friction_per_depth=0.0)


def test_depth_at_the_blade_instead_of_the_tip_is_noticed() -> None:
    with pytest.raises(AssertionError):
        check_modulus_comes_back(rested_cut("bulge"), loading_ratio=0.0)


def test_friction_left_in_the_force_of_a_cut_without_way_back_is_noticed() -> None:
    with pytest.raises(AssertionError):
        check_modulus_comes_back(rested_cut("bulge").forward(), friction_per_depth=0.0)


def test_another_thickness_in_the_iteration_is_noticed() -> None:
    with pytest.raises(AssertionError):
        check_iteration_agrees(0.05, 1e4, thickness=0.01)
