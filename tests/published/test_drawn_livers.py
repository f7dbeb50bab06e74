"""Drawn livers beside the tables: the criterion by which rows agree, and what is measured of a cut."""

from __future__ import annotations

import numpy as np
import pytest
from reproduction import drawn_livers, scatter
from reproduction.virtual_cuts import virtual_cut

from cutenv.tissue import CutModel, measured_fracture_resistance, measured_liver

PAIRS = 1000


def share_that_agrees(row: str, *, shift: float = 0.0, factor: float = 1.0) -> float:
    """Of pairs of samples of 6 and 24 normal numbers, the second shifted and scaled."""
    rng = np.random.default_rng(1)
    compare, sample = getattr(scatter, row), scatter.Sample.of
    rows = [
        compare("", sample(50.0 + rng.normal(size=6)), sample(50.0 + shift + factor * rng.normal(size=24)))
        for _ in range(PAIRS)
    ]
    return float(np.mean([row.agrees for row in rows]))


@pytest.mark.parametrize("row", ["mean_row", "sd_row"])
def test_samples_of_one_population_agree_nineteen_times_in_twenty(row: str) -> None:
    assert share_that_agrees(row) == pytest.approx(0.95, abs=0.015)


def test_other_means_and_other_spreads_are_noticed() -> None:
    assert share_that_agrees("mean_row", shift=2.0) < 0.15
    assert share_that_agrees("sd_row", factor=5.0) < 0.15


def share_of_lines_that_agree(*, change: float) -> list[float]:
    """Of pairs of lines through seven points with scatter, by coefficient; the second is another line by ``change``."""
    rng, x = np.random.default_rng(2), np.linspace(0.1, 2.5, 7)
    line = scatter.Line.through
    found = []
    for _ in range(PAIRS):
        reference = line(x, 60.0 - 9.0 * x + rng.normal(size=7))
        ours = line(x, 60.0 + 6.0 * change - (9.0 - 4.0 * change) * x + rng.normal(size=7))
        rows = scatter.coefficient_rows("", reference, ours, slope="slope", intercept="intercept")
        found.append([row.agrees for row in rows])
    return list(np.mean(found, axis=0))


def test_lines_through_points_of_one_law_agree_nineteen_times_in_twenty() -> None:
    assert share_of_lines_that_agree(change=0.0) == pytest.approx([0.95, 0.95], abs=0.015)


def test_another_law_is_noticed() -> None:
    assert max(share_of_lines_that_agree(change=1.0)) < 0.15


def test_a_power_law_comes_back() -> None:
    x = np.array([0.1, 0.38, 0.89, 1.27, 2.54])
    line = scatter.Line.through_logarithms(x, 24.2 * x**-0.42)
    assert (line.slope, line.intercept) == pytest.approx((-0.42, 24.2))
    assert max(line.slope_error, line.intercept_error) < 1e-6


def test_what_is_measured_of_an_even_cut_is_its_modulus() -> None:
    """Two centimetres deep: twice the modulus without depth; the blade for the tip reads several per cent high."""
    trace = virtual_cut("2 cm", turns=(0.12,)).trace
    found = drawn_livers.measure(trace, 0.0508, upright=True)
    name = ("plane_stress", 0.3)
    true = measured_liver().local_effective_modulus(0.0127, np.pi / 2)
    assert 1.02 < np.median(found.per_depth[name]) / true < 1.08
    assert found.as_measured[name] == pytest.approx(2.0 * found.per_depth[name])
    assert found.of_force_per_depth == pytest.approx(found.per_depth[name], rel=1e-6)
    assert 0.9 < found.apparent / measured_fracture_resistance().mean < 1.0


def test_the_same_segments_in_another_model_differ_by_its_stiffness() -> None:
    trace = virtual_cut("bulge", turns=(0.12,)).trace
    found = drawn_livers.measure(trace, 0.0508, upright=False)
    ratio = found.as_measured["plane_strain", 0.499] / found.as_measured["plane_stress", 0.3]
    model = CutModel(formulation="plane_strain", poisson=0.499)
    whole = CutModel().stiffness(np.linspace(0.01, 0.12, 200)) / model.stiffness(np.linspace(0.01, 0.12, 200))
    assert whole.min() <= ratio.min() <= ratio.max() <= whole.max()
    assert (np.diff(ratio) > 0.0).all()  # as the models' stiffnesses come together away from the clamp
    assert found.apparent is None
