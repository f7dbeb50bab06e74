"""A specimen: drawn from one seed, kept exactly in JSON; its thickness, and the stiffness along its slab."""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Callable

import gymnasium
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from led_cut import liver

from cutenv._engine.randomness import generator
from cutenv.sim.tissue.cut_model import CutModel
from cutenv.sim.tissue.description import TissueDescription
from cutenv.sim.tissue.grid import bulge, field_modes
from cutenv.sim.tissue.slab import THICKNESS, condensed, effective_depth, row_means, slab_of, stiffness_along
from cutenv.sim.tissue.specimen import (
    LENGTH,
    N_POINTS,
    SPACING,
    Specimen,
    draw_liver,
    nominal_stiffness,
    nominal_tissue,
)
from scripts.derivations.partial_depth import stiffness_by_depth
from scripts.validation.thesis.elements import model

Y = np.arange(N_POINTS) * SPACING
TISSUE = liver(modulus_between_liver_cv=0.15, modulus_between_cut_cv=0.22, modulus_within_cut_cv=0.2)
kinds = st.sampled_from(["uniform", "liver", "vascular"])
seeds = st.integers(0, 2**64 - 1)


def drawn(seed: int, kind: str = "liver", tissue: TissueDescription = TISSUE) -> Specimen:
    return Specimen.draw(generator(seed), specimen_class=kind, tissue=tissue)


@given(seeds, kinds)
@settings(max_examples=20)
def test_one_seed_makes_one_specimen(seed, kind):
    assert drawn(seed, kind) == drawn(seed, kind)
    assert kind == "uniform" or drawn(seed, kind) != drawn(seed ^ 1, kind)


@given(seeds, kinds)
@settings(max_examples=20)
def test_json_round_trip_is_exact(seed, kind):
    specimen = drawn(seed, kind)
    assert Specimen.from_json(specimen.to_json()) == specimen


LIVERS, CUTS = 500, 4
FAR_APART = (40, 240)  # points at 2 cm and 12 cm, five correlation lengths apart


def log_moduli(tissue: TissueDescription) -> np.ndarray:
    """Of 500 livers, 4 cuts each, at two places far apart; shape (livers, cuts, places)."""
    rng = generator(12)
    livers = [draw_liver(rng, tissue) for _ in range(LIVERS)]
    return np.log(
        [
            [Specimen.draw(rng, tissue=tissue, liver_factor=one).modulus[list(FAR_APART)] for _ in range(CUTS)]
            for one in livers
        ]
    )


def check_levels(tissue: TissueDescription, log_modulus: np.ndarray) -> None:
    """Variances of ln E between livers, between cuts and within a cut, to 20 % of the description's."""

    def expected(cv: float) -> float:
        return math.log1p(cv**2)

    within = 0.5 * np.var(log_modulus[..., 0] - log_modulus[..., 1])
    cut_means = log_modulus.mean(axis=-1)
    # Half of the difference of two cuts of one liver: between cuts, plus half of the places' variance.
    pairs = np.var(cut_means[:, 0::2] - cut_means[:, 1::2]) / 2.0
    liver_means = cut_means.mean(axis=-1)
    assert within == pytest.approx(expected(tissue.modulus_within_cut_cv), rel=0.2)
    assert pairs - 0.5 * within == pytest.approx(expected(tissue.modulus_between_cut_cv), rel=0.2)
    assert np.var(liver_means) - pairs / CUTS == pytest.approx(expected(tissue.modulus_between_liver_cv), rel=0.2)


def test_the_modulus_spreads_between_livers_between_cuts_and_within_a_cut():
    log_modulus = log_moduli(TISSUE)
    check_levels(TISSUE, log_modulus)
    for level in ("modulus_between_liver_cv", "modulus_between_cut_cv", "modulus_within_cut_cv"):
        with pytest.raises(AssertionError):
            check_levels(dataclasses.replace(TISSUE, **{level: 1.3 * getattr(TISSUE, level)}), log_modulus)


def test_draws_have_the_means_of_the_description_and_the_spread_of_the_resistance():
    rng = generator(13)
    specimens = [Specimen.draw(rng, tissue=TISSUE) for _ in range(1500)]
    modulus = np.array([s.modulus[150] for s in specimens])
    resistance = np.array([s.fracture_resistance[150] for s in specimens])
    friction = np.array([s.friction_per_depth for s in specimens]) / TISSUE.friction_share
    assert modulus.mean() == pytest.approx(TISSUE.modulus, rel=4 * modulus.std() / modulus.mean() / math.sqrt(1500))
    assert resistance.mean() == pytest.approx(TISSUE.fracture_resistance, rel=0.05)
    between, within = TISSUE.fracture_between_cut_cv, TISSUE.fracture_within_cut_cv
    assert friction.std() / friction.mean() == pytest.approx(between, rel=0.12)
    assert np.var(np.log(resistance)) == pytest.approx(math.log1p(between**2) + math.log1p(within**2), rel=0.15)


def check_correlation(length: float, log_modulus: np.ndarray) -> None:
    """Squared exponential: exp(-1/2) at one correlation length, exp(-2) at two."""
    for lengths in (0.5, 1.0, 2.0):
        step = round(lengths * length / SPACING)
        one, two = log_modulus[:, 100].T, log_modulus[:, 100 + step].T
        assert np.corrcoef(one, two)[0, 1] == pytest.approx(math.exp(-0.5 * lengths**2), abs=0.06)


def test_places_correlate_over_20_mm():
    only_within = dataclasses.replace(TISSUE, modulus_between_liver_cv=0.0, modulus_between_cut_cv=0.0)
    log_modulus = np.log([drawn(seed, tissue=only_within).modulus for seed in range(3000)])
    check_correlation(0.020, log_modulus)
    with pytest.raises(AssertionError):
        check_correlation(0.030, log_modulus)


def test_uniform_has_no_spread_and_the_mean_depth():
    one, two = drawn(1, "uniform"), drawn(2, "uniform")
    assert one == two
    for values in (one.modulus, one.fracture_resistance, one.depth):
        assert np.ptp(values) == 0.0
    assert one.depth[0] == TISSUE.mean_depth


def inclusions(specimen: Specimen) -> list[tuple[float, float]]:
    """Length [m] at half height, and height over the least R, of each tough place in even tissue."""
    factor = specimen.fracture_resistance / specimen.fracture_resistance.min()
    borders = np.flatnonzero(np.diff(np.concatenate(([0], (factor > 1.25).astype(int), [0]))))
    found = []
    for start, stop in zip(borders[::2], borders[1::2], strict=True):
        height = float(factor[start:stop].max())
        found.append((float((factor[start:stop] > 0.5 * (1.0 + height)).sum()) * SPACING, height))
    return found


def test_vascular_adds_one_or_two_inclusions_of_1_5_to_2_5_times_the_resistance_over_2_to_5_mm():
    even = dataclasses.replace(TISSUE, fracture_within_cut_cv=0.0)
    found = [inclusions(drawn(seed, "vascular", even)) for seed in range(150)]
    assert {len(one) for one in found} == {1, 2}
    assert 0.3 < np.mean([len(one) == 2 for one in found]) < 0.6  # half, less those that touch
    alone = np.array([one[0] for one in found if len(one) == 1])
    length, height = alone.T
    assert height.min() >= 1.45
    assert height.max() <= 2.5
    assert length.min() == pytest.approx(0.002, abs=SPACING)
    assert np.quantile(length, 0.9) == pytest.approx(0.005, abs=2 * SPACING)
    assert all(not inclusions(drawn(seed, "liver", even)) for seed in range(20))


def test_mixed_is_liver_or_vascular_half_each():
    drawn_kinds = [drawn(seed, "mixed").specimen_class for seed in range(200)]
    assert set(drawn_kinds) == {"liver", "vascular"}
    assert drawn_kinds.count("liver") == pytest.approx(100, abs=4 * math.sqrt(50))


def test_a_key_is_the_specimen_of_an_environments_episode():
    env = gymnasium.make("cutenv/GentleCut-v1", specimen_class="vascular")
    for episode in range(3):
        env.reset(seed=12, options={"episode": episode})
        assert env.unwrapped.specimen == Specimen.drawn(12, episode, specimen_class="vascular")  # type: ignore[attr-defined]


def no_crack_runs_on(specimen: Specimen) -> bool:
    """Tell whether somewhere up to 10 cm no force lets a crack run: it releases K^2 / (2 K') at most, and takes R B."""
    stiffness = specimen.stiffness()
    last = round(0.1 / SPACING)
    rise = np.diff(stiffness)[:last] / SPACING
    return bool(np.any(rise * specimen.fracture_force()[:last] > 0.5 * stiffness[:last] ** 2))


def test_every_key_gives_a_specimen_and_in_a_few_a_crack_finds_no_energy_to_run_on_somewhere():
    specimens = [Specimen.drawn(12, episode, specimen_class="mixed") for episode in range(1000)]
    along = np.array([[s.stiffness(), s.modulus, s.fracture_resistance, s.depth] for s in specimens])
    assert np.all(np.isfinite(along))
    assert np.all(along > 0.0)
    assert 0 < sum(map(no_crack_runs_on, specimens)) < 30


def test_the_bulge_runs_from_1_mm_to_2_cm_and_moduli_see_the_measured_mean():
    depth = Specimen.mean().depth
    assert depth[0] == pytest.approx(0.001, rel=1e-3)
    assert depth.max() == pytest.approx(0.020, rel=0.02)
    measured = (Y >= 0.0215) & (Y <= 0.12)  # from Table 4.1's first segment to the end of travel
    # Per depth over as if 1 cm deep, K in proportion to the effective depth; segments crowd where the cut is shallow.
    shown = effective_depth(Y, depth)[measured]
    assert shown.mean() / (shown / depth[measured]).mean() == pytest.approx(TISSUE.mean_depth, rel=0.25)


def test_homogeneous_is_what_it_was_given():
    specimen = Specimen.homogeneous(
        modulus=40e3, fracture_resistance=150.0, depth=0.01, friction_share=0.3, tissue=TISSUE
    )
    assert np.all(specimen.modulus == 40e3)
    assert np.all(specimen.fracture_force() == pytest.approx(0.7 * 150.0 * 0.01))
    assert specimen.friction_per_depth == pytest.approx(45.0)
    assert specimen.stiffness()[100] == pytest.approx(40e3 * 0.01 * CutModel().stiffness(0.05))
    assert len(specimen.modulus) == round(LENGTH / SPACING) + 1


def changed(**changes: object) -> Callable[[], Specimen]:
    return lambda: dataclasses.replace(drawn(1, "uniform"), **changes)


@pytest.mark.parametrize(
    ("make", "named"),
    [
        (changed(modulus=np.full(7, 4e4)), "modulus has shape"),
        (changed(thickness=0.001), "A cut is no deeper than the slab"),
        (changed(specimen_class="vasculer"), "Did you mean 'vascular'"),
        (lambda: liver(friction_share=math.nan), "friction_share"),
        (lambda: liver(thickness=0.01), "crown_depth = 0.02 m must not exceed thickness"),
    ],
)
def test_bad_input_is_refused_by_name(make, named):
    with pytest.raises(ValueError, match=named):
        make()


def test_json_with_a_missing_or_unknown_field_is_refused():
    content = json.loads(drawn(1, "uniform").to_json())
    with pytest.raises(ValueError, match=r"missing.*depth"):
        Specimen.from_json(json.dumps({name: value for name, value in content.items() if name != "depth"}))
    with pytest.raises(ValueError, match="dept"):
        Specimen.from_json(json.dumps(content | {"dept": 1.0}))


def test_profiles_cannot_be_changed_afterwards():
    specimen = drawn(1)
    with pytest.raises(ValueError, match="read-only"):
        specimen.depth[0] = 0.5


EDGE, CROWN = 0.001, 0.020
ALONG = np.linspace(0.0, LENGTH, 3001)
rises = st.floats(0.03, 0.10)


def depth_of(rise: float, y=ALONG) -> np.ndarray:
    return bulge(y, edge=EDGE, crown=CROWN, rise_length=rise, length=LENGTH)


@given(rises)
def test_the_bulge_runs_from_edge_to_crown_and_back(rise):
    """From a thin edge up to one crown and down again, never outside the measured range."""
    depth = depth_of(rise)
    assert depth[0] == pytest.approx(EDGE, rel=1e-5)
    assert depth.max() == pytest.approx(CROWN, rel=0.05)
    assert np.all((depth > 0.0) & (depth <= CROWN))
    crown = int(np.argmax(depth))
    assert np.all(np.diff(depth[: crown + 1]) >= 0.0)
    assert np.all(np.diff(depth[crown:]) <= 0.0)


@given(rises)
def test_the_rise_is_no_steeper_than_its_length(rise):
    """B' never exceeds that of the straight line from edge to crown."""
    depth = depth_of(rise)
    assert np.max(np.gradient(depth, ALONG)) <= (1.0 + 1e-6) * (CROWN - EDGE) / rise


ONES = np.ones(N_POINTS)
SLAB = slab_of("quad8", "plane_stress", 0.3)


def field(seed: int, sigma: float) -> np.ndarray:
    modes = field_modes(N_POINTS, SPACING, 0.020)
    return np.asarray(40e3 * np.exp(sigma * (np.random.default_rng(seed).standard_normal(len(modes)) @ modes)))


def check_against_the_full_model(stiffness: np.ndarray, modulus: np.ndarray, element: str, formulation: str) -> None:
    """K over T to 0.2 % of CutModel's with the moduli of its rows of elements."""
    full = CutModel(element=element, formulation=formulation, relative_modulus=np.tile(row_means(modulus) / 40e3, 8))
    assert stiffness / THICKNESS / 40e3 == pytest.approx(np.asarray(full.stiffness(Y)), rel=2e-3)


@pytest.mark.parametrize(
    ("element", "formulation"), [("quad8", "plane_stress"), ("quad8", "plane_strain"), ("quad4", "plane_stress")]
)
def test_cut_through_it_is_the_plane_model_with_the_field(element, formulation):
    slab = slab_of(element, formulation, 0.3)
    for seed in range(3):
        modulus = field(seed, 0.4)
        through = stiffness_along(slab, modulus, THICKNESS * ONES, THICKNESS)
        check_against_the_full_model(through, modulus, element, formulation)
        with pytest.raises(AssertionError):
            check_against_the_full_model(through * np.linspace(1.0, 1.01, N_POINTS), modulus, element, formulation)
        local = modulus * np.asarray(model(element, formulation).stiffness(Y)) * THICKNESS
        with pytest.raises(AssertionError):  # the modulus of the place, as if a point load averaged nothing
            check_against_the_full_model(local, modulus, element, formulation)


def test_a_uniform_slab_that_is_cut_through_has_e_kappa_b():
    even = stiffness_along(SLAB, 40e3 * ONES, 0.02 * ONES, 0.02)
    assert even == pytest.approx(40e3 * 0.02 * np.asarray(CutModel().stiffness(Y)), rel=1e-12)


def test_the_kept_model_is_the_one_that_is_computed():
    computed = condensed(CutModel())
    assert SLAB[0]["tips"] == pytest.approx(computed.kappa, rel=1e-9)
    kept_trace, trace = (np.trace(values, axis1=1, axis2=2) for values in (SLAB[0]["upper"], computed.upper))
    assert kept_trace == pytest.approx(trace, rel=1e-6)


def check_against_bricks(table: np.ndarray, bricks: np.ndarray) -> None:
    assert table == pytest.approx(bricks, rel=0.03)


def test_a_cut_of_partial_depth_is_as_stiff_as_bricks_say():
    borders = np.array([0.0, 0.0013, 0.0027, 0.0055, 0.0095, 0.0145, 0.0195, 0.025])  # few, and not the table's
    bricks = stiffness_by_depth(borders, np.ones(15))
    for n, depth in enumerate(borders[1:-1], start=1):
        along = stiffness_along(SLAB, ONES, depth * ONES, THICKNESS)[20:260:20]
        through = stiffness_along(SLAB, ONES, THICKNESS * ONES, THICKNESS)[20:260:20]
        check_against_bricks(along / through, bricks[:12, n] / bricks[:12, -1])
        with pytest.raises(AssertionError):  # as if it were proportional to the depth
            check_against_bricks(np.full(12, depth / THICKNESS), bricks[:12, n] / bricks[:12, -1])
    over_plane_stress = bricks[:12, -1] / (through[:12] / ONES[0])
    assert np.all((over_plane_stress > 1.015) & (over_plane_stress < 1.075))  # as the page says


def test_deeper_is_stiffer_and_an_edge_of_no_depth_still_pushes_a_patch():
    depths = np.linspace(1e-4, THICKNESS, 80)
    stiffness = np.array([stiffness_along(SLAB, ONES, depth * ONES, THICKNESS) for depth in depths])
    assert np.all(np.diff(stiffness, axis=0) > 0.0)
    assert 0.05 < stiffness[0, 100] / stiffness[-1, 100] < 0.15


def test_the_mean_tissue_at_any_depth_is_the_mean_specimen():
    mean = Specimen.mean()
    nominal = nominal_tissue(mean.tissue)[0]
    expected = [nominal_stiffness(nominal, i, float(mean.depth[i])) for i in range(N_POINTS)]
    assert expected == pytest.approx(mean.stiffness(), rel=1e-9)


def test_a_solid_model_is_refused_with_the_cure():
    with pytest.raises(ValueError, match="convert_modulus"):
        slab_of("hex20", "solid", 0.3)
