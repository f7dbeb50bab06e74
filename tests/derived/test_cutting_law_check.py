"""The worked-out check of the cutting law: homogeneous tissue, 10 cm, four speeds, two angles."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import pytest
from led_cut import LedCut, changed_law, constant_feed, homogeneous, lead, lead_by, liver, residual_of

from cutenv.tissue.cut_model import CutModel
from cutenv.tissue.effective_modulus import local_effective_modulus

DEPTH, TOUGHNESS = 0.02, 211.0 * 0.02  # B [m], R B [N]
MODEL = CutModel()


class Row(NamedTuple):
    angle_deg: float
    speed: float  # [m/s]
    units: int
    unstable_share: float
    peak_force: float  # [N]

    @property
    def angle(self) -> float:
        return math.radians(self.angle_deg)


ROWS = [
    Row(90, 0.0010, 27, 0.98, 5.40),
    Row(90, 0.0038, 25, 0.91, 5.40),
    Row(90, 0.0127, 19, 0.69, 5.40),
    Row(90, 0.0254, 11, 0.38, 5.40),
    Row(45, 0.0010, 32, 0.63, 4.81),
    Row(45, 0.0038, 30, 0.59, 4.81),
    Row(45, 0.0127, 25, 0.45, 4.81),
    Row(45, 0.0254, 15, 0.25, 4.81),
]
FAST = ROWS[3]
every_row = pytest.mark.parametrize("row", ROWS, ids=lambda row: f"{row.angle_deg}deg-{row.speed * 100:g}cm/s")


@lru_cache
def cut_of(row: Row) -> LedCut:
    return lead(homogeneous(), constant_feed(row.speed), row.angle)


def check_units(cut: LedCut, row: Row) -> None:
    assert abs(cut.end.units - row.units) <= 1


def check_unstable_share(cut: LedCut, row: Row) -> None:
    assert cut.end.uncontrolled / cut.end.tip == pytest.approx(row.unstable_share, abs=0.02)


def check_peak_force(cut: LedCut, row: Row) -> None:
    assert cut.readings["elastic_force"].max() == pytest.approx(row.peak_force, abs=0.005)


def check_mean_lag(cut: LedCut) -> None:
    assert cut.lag.mean() == pytest.approx(5.8e-3, abs=0.1e-3)


def check_work_per_area(cut: LedCut) -> None:
    ratio = (cut.end.work - cut.stored[-1]) / (TOUGHNESS * cut.end.tip)
    assert 0.985 <= ratio <= 1.0005


def check_residual(cut: LedCut) -> None:
    assert np.abs(residual_of(cut)).max() < 1e-12


def loading_slopes(cut: LedCut, row: Row) -> list[float]:
    """Slope of the force between two arrests while the crack grows stably, over LEM kappa B at that place."""
    growing = (np.diff(cut.states["tip"]) > 0.0) & (cut.readings["jump"] == 0.0)
    borders = np.flatnonzero(np.diff(np.concatenate(([False], growing, [False])).astype(int)))
    LEM = local_effective_modulus(row.speed, row.angle)
    slopes = []
    for start, stop in zip(borders[::2], borders[1::2], strict=True):
        if stop - start >= 5:
            segment = cut.readings[start:stop]
            slope = np.polyfit(segment["position"], segment["elastic_force"], 1)[0]
            slopes.append(slope / (LEM * MODEL.stiffness(float(segment["tip"].mean())) * DEPTH))
    return slopes


def check_loading_slope(cut: LedCut, row: Row) -> None:
    slopes = loading_slopes(cut, row)
    assert len(slopes) >= row.units - 2
    assert np.mean(slopes) == pytest.approx(1.00, abs=0.005)


@every_row
def test_number_of_units(row):
    check_units(cut_of(row), row)


@every_row
def test_share_of_the_cut_made_by_unstable_growth(row):
    check_unstable_share(cut_of(row), row)


@every_row
def test_peak_force(row):
    check_peak_force(cut_of(row), row)


@every_row
def test_loading_slope_is_lem_kappa_b(row):
    check_loading_slope(cut_of(row), row)


@every_row
def test_mean_lag_of_the_tip(row):
    check_mean_lag(cut_of(row))


@every_row
def test_work_per_area_returns_the_resistance_put_in(row):
    check_work_per_area(cut_of(row))


@every_row
def test_energy_account_closes(row):
    check_residual(cut_of(row))


def test_doubled_eta90_fails_units_share_and_peak():
    cut = lead(homogeneous(tissue=liver(eta90=0.56)), constant_feed(FAST.speed), FAST.angle)
    for check in (check_units, check_unstable_share, check_peak_force):
        with pytest.raises(AssertionError):
            check(cut, FAST)


def test_an_eta_blind_to_the_angle_fails_the_peak_at_45_degrees():
    row = ROWS[-1]
    law = changed_law(("law.eta90 * pushing", "law.eta90"))
    with pytest.raises(AssertionError):
        check_peak_force(lead_by(law, homogeneous(), constant_feed(row.speed), row.angle), row)


def test_growth_blind_to_the_falling_stiffness_fails_the_loading_slope():
    law = changed_law(("* K * loading / softening", "* loading"))
    with pytest.raises(AssertionError):
        check_loading_slope(lead_by(law, homogeneous(), constant_feed(FAST.speed), FAST.angle), FAST)


def test_a_blade_that_never_cuts_as_it_loads_fails_slope_and_share():
    law = changed_law(("ratio: float = min(1.0, modulus / law.quasi_static_modulus)", "ratio = 1.0"))
    cut = lead_by(law, homogeneous(), constant_feed(FAST.speed), FAST.angle)
    for check in (check_unstable_share, check_loading_slope):
        with pytest.raises(AssertionError):
            check(cut, FAST)


def test_force_times_growth_instead_of_the_difference_of_stored_energy_does_not_close():
    law = changed_law(("change = U - next_U - spent", "change = F * (tip - a) - spent"))
    cut = lead_by(law, homogeneous(), constant_feed(FAST.speed), FAST.angle)
    with pytest.raises(AssertionError):
        check_residual(cut)


def test_a_run_that_stops_at_the_resistance_wastes_energy_and_fails_work_per_area():
    law = changed_law(("if ledger <= 0.0 and F < toughness:", "if F < toughness:"))
    cut = lead_by(law, homogeneous(), constant_feed(0.0127))
    with pytest.raises(AssertionError):
        check_work_per_area(cut)


def test_tissue_of_twice_the_stiffness_fails_the_mean_lag():
    with pytest.raises(AssertionError):
        check_mean_lag(lead(homogeneous(modulus=2 * 48.36e3), constant_feed(FAST.speed)))
