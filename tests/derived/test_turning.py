"""Turning the blade: its leaning edge sweeps B^2 |d cot(theta)| / 2 toward upright, and pays R for it."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable
from functools import partial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from led_cut import (
    INCLINED,
    UPRIGHT,
    LedCut,
    changed_law,
    constant_feed,
    homogeneous,
    lead,
    lead_by,
    residual_of,
    through,
)

from cutenv.cutting.law import leaning, sweeping
from cutenv.tissue.specimen import LENGTH, N_POINTS

R_B, B = 211.0 * 0.02, 0.02
WEDGE = 0.5 * R_B * B  # [J], from 45 deg to upright: cot falls from 1 to 0
Leading = Callable[..., LedCut]


def turning_on_the_spot(angles: np.ndarray, *, by: Leading = lead) -> LedCut:
    return by(homogeneous(), np.zeros(len(angles)), angles)


def ramp(*angles_deg: float, steps: int = 500) -> np.ndarray:
    """From each angle [deg] to the next."""
    return np.radians(np.concatenate([np.linspace(a, b, steps) for a, b in itertools.pairwise(angles_deg)]))


def check_wedge_is_paid(by: Leading = lead) -> None:
    cut = turning_on_the_spot(ramp(45, 90), by=by)
    assert cut.end.work == pytest.approx(WEDGE, rel=1e-12)
    assert cut.end.fracture == pytest.approx(WEDGE, rel=1e-12)


def check_turning_away_is_free(by: Leading = lead) -> None:
    cut = turning_on_the_spot(ramp(90, 45), by=by)
    assert cut.end.work == cut.end.fracture == 0.0


def check_oscillation_pays_every_time(by: Leading = lead) -> None:
    cut = turning_on_the_spot(ramp(90, 45, 90, 45, 90, 45, 90), by=by)
    assert cut.end.work == pytest.approx(3 * WEDGE, rel=1e-12)
    assert np.diff(cut.states["work"]).min() >= 0.0


CHECKS = [check_wedge_is_paid, check_turning_away_is_free, check_oscillation_pays_every_time]


@pytest.mark.parametrize("check", CHECKS)
def test_wedge_is_paid_once_toward_upright_and_never_given_back(check):
    check()


@pytest.mark.parametrize(
    ("check", "old", "new"),
    [
        (check_wedge_is_paid, "return 0.5 * toughness * depth", "return toughness * depth"),
        (check_wedge_is_paid, "        row.fracture[n] += energy\n", ""),
        (check_turning_away_is_free, "max(lean - next_lean, 0.0)", "(lean - next_lean)"),
        (check_oscillation_pays_every_time, "max(lean - next_lean, 0.0)", "(lean - next_lean)"),
    ],
)
def test_turning_broken_on_purpose_fails_the_check(check, old, new):
    with pytest.raises(AssertionError):
        check(partial(lead_by, changed_law((old, new))))


@given(st.lists(st.floats(45.0, 90.0), min_size=2, max_size=6), st.integers(1, 50))
@settings(max_examples=30)
def test_what_is_paid_depends_on_the_angles_alone_and_not_on_the_steps(angles_deg, steps):
    cut = turning_on_the_spot(ramp(*angles_deg, steps=steps + 1))
    cot = 1.0 / np.tan(np.radians(angles_deg))
    assert cut.end.work == pytest.approx(WEDGE * np.maximum(-np.diff(cot), 0.0).sum(), rel=1e-9, abs=1e-15)


def test_resistance_and_depth_are_those_at_the_blade():
    y = np.linspace(0.0, LENGTH, N_POINTS)
    uneven = dataclasses.replace(homogeneous(), depth=0.005 + 0.1 * y, fracture_resistance=100.0 + 3e3 * y)
    place = lead(uneven, constant_feed(0.01, to=0.03), math.radians(60))
    turned = lead(uneven, np.full(500, 0.03), ramp(60, 90), start=place.end)
    assert turned.end.tip == place.end.tip
    R, depth = 190.0, 0.008  # at 3 cm
    assert turned.end.fracture - place.end.fracture == pytest.approx(
        R * depth**2 / 2.0 / math.tan(math.radians(60)), rel=1e-9
    )


def test_no_wedge_is_removed_for_free_by_cutting_inclined_and_turning_back_and_forth():
    """To end upright costs the wedge at least once, however the blade oscillates on its way."""
    specimen = homogeneous()
    path = constant_feed(0.01, to=0.06)
    inclined = np.full(len(path), INCLINED)
    upright_at_last = np.concatenate((inclined[:-500], ramp(45, 90)))
    swinging = INCLINED + (UPRIGHT - INCLINED) * 0.5 * (1.0 - np.cos(np.linspace(0.0, 9.0 * np.pi, len(path))))
    swings = 5  # toward upright
    lying, standing, swung = (lead(specimen, path, angles) for angles in (inclined, upright_at_last, swinging))
    for cut, wedges in ((lying, 0), (standing, 1), (swung, swings)):
        assert np.abs(residual_of(cut)).max() < 1e-12
        assert cut.end.fracture == pytest.approx(R_B * cut.end.tip + wedges * WEDGE, rel=1e-6)


def test_a_rotation_can_start_a_run():
    """Upright, the force is below (1 + eta90) R B; inclined, the same force is above (1 + eta90 / 2) R B."""
    specimen = homogeneous()
    cut = lead(specimen, constant_feed(0.002, to=0.04))
    high = int(np.argmax(cut.readings["elastic_force"] >= 1.2 * R_B))
    standing = lead(
        specimen,
        np.full(600, cut.readings["position"][high]),
        ramp(90, 90, 45, steps=300),
        start=cut.states[high + 1],
    )
    assert np.all(standing.readings["jump"][:300] == 0.0)
    assert standing.readings["jump"][300:].max() > 1e-3


def test_the_wedge_is_paid_in_an_old_crack_too():
    out_and_back = lead(homogeneous(), through([0.03, 0.01], 1e-5), INCLINED)
    turned = lead(homogeneous(), np.full(500, 0.01), ramp(45, 90), start=out_and_back.end)
    assert turned.end.work - out_and_back.end.work == pytest.approx(WEDGE, rel=1e-9)


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
