"""Sawing is a loan with a limit, nothing locks, and the law at 1 ms and at 0.1 ms makes the same cut."""

from __future__ import annotations

import math

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
    liver,
    policies,
    recorded_work,
    specimens,
    through,
    toughening,
)

from cutenv._engine.randomness import generator
from cutenv.sim.tissue.specimen import SPACING, Specimen

DEBT_LENGTH = 1.5e-3  # l [m]
STEP = 5e-6  # [m] a millisecond


def check_loan(cut: LedCut) -> None:
    """Area cut times R, less what the recorded force paid for it, is at most R B l of the toughest place."""
    s = cut.states
    paid = recorded_work(cut) - cut.stored - s["friction"] - s["loss"]
    toughest = cut.profile["toughness"][: math.ceil(cut.end.tip / SPACING) + 1].max()
    unseen = cut.along("stiffness", s["tip"][:-1]) @ (cut.readings["jump"] * np.abs(np.diff(s["blade"])))
    assert (s["fracture"] - paid).max() <= toughest * DEBT_LENGTH + unseen + 1e-3 * s["work"].max()


def sawing_path(specimen: Specimen, *, angle: float, level: float, amplitude: float, strokes: int) -> np.ndarray:
    """Strokes of ``amplitude`` [m] whose upper end holds the force at ``level`` of the initiation force.

    The tip is felt after every stroke, so that the path follows the cut.
    """
    initiation = (1.0 + specimen.tissue.eta90 * math.sin(angle) ** 2) * specimen.fracture_force()
    lag = level * initiation / specimen.stiffness()
    pieces, state, x = [], None, 0.0
    for _ in range(strokes):
        tip = 0.0 if state is None else state.tip
        top = min(tip + lag[round(tip / SPACING)], 0.1)
        piece = through([top, max(top - amplitude, 0.0)], STEP, start=x)
        state = lead(specimen, piece, angle, start=state).end
        pieces.append(piece)
        x = piece[-1]
    return np.concatenate(pieces)


@settings(max_examples=40)
@given(
    specimens(),
    st.floats(0.5, 0.999),
    st.sampled_from([10e-6, 50e-6, 0.2e-3, 1e-3, 5e-3, 0.02]),
    st.floats(INCLINED, UPRIGHT),
)
def test_sawing_at_any_level_and_stroke_cuts_below_the_resistance_by_r_b_l_at_most(specimen, level, amplitude, angle):
    path = sawing_path(specimen, angle=angle, level=level, amplitude=amplitude, strokes=150)
    check_loan(lead(specimen, path, angle))


@pytest.mark.parametrize("amplitude", [50e-6, 0.2e-3, 1e-3])
@pytest.mark.parametrize("share_of_feed", [0.05, 0.2])
def test_dither_on_a_feed_cuts_no_cheaper_than_the_loan(amplitude, share_of_feed):
    """Back and forth while feeding, so slowly that the force never settles."""
    peaks = np.arange(0.01, 0.05, share_of_feed * amplitude)[:3000]
    turning_points = np.stack([peaks, peaks - amplitude], axis=1).ravel()
    check_loan(lead(homogeneous(), through(turning_points, STEP)))


def test_sawing_far_below_the_resistance_stops_cutting():
    specimen = homogeneous()
    path = sawing_path(specimen, angle=UPRIGHT, level=0.65, amplitude=1e-3, strokes=200)
    cut = lead(specimen, path)
    assert cut.readings["elastic_force"].max() < specimen.fracture_force()[0]
    tip = cut.states["tip"]
    assert 0.0 < tip[-1] == tip[len(tip) // 2]


def test_a_law_that_lends_without_limit_fails_the_check():
    specimen = toughening()
    path = constant_feed(0.0254, to=0.05)
    check_loan(lead(specimen, path, INCLINED))
    law = changed_law(("ledger + change >= -toughness * debt_length", "True"))
    with pytest.raises(AssertionError):
        check_loan(lead_by(law, specimen, path, INCLINED))


def check_force(cut: LedCut, eta90: float) -> None:
    """No force above 1.1 times the largest initiation force, (1 + eta) R B, on the path."""
    toughest = cut.profile["toughness"][: math.ceil(cut.end.tip / SPACING) + 1].max()
    initiation = (1.0 + eta90 * np.sin(cut.readings["angle"]).max() ** 2) * toughest
    assert cut.readings["elastic_force"].max() <= 1.1 * initiation


def check_progress(cut: LedCut) -> None:
    """The tip keeps up: it is never farther behind the blade than 1.1 times the largest lag at initiation."""
    reached = slice(0, math.ceil(cut.end.tip / SPACING) + 1)
    compliant = (cut.profile["toughness"] / cut.profile["stiffness"])[reached].max()
    assert cut.lag.max() <= 1.1 * (1.0 + cut.law.eta90) * compliant


@settings(max_examples=150)
@given(specimens(), st.floats(0.001, 0.0254), st.floats(INCLINED, UPRIGHT))
def test_a_steady_blade_meets_no_more_than_the_initiation_force(specimen, speed, angle):
    cut = lead(specimen, constant_feed(speed), angle)
    check_force(cut, specimen.tissue.eta90)
    check_progress(cut)


@settings(max_examples=100)
@given(specimens(), policies())
def test_no_policy_meets_more_than_the_initiation_force(specimen, policy):
    check_force(lead(specimen, *policy.path()), specimen.tissue.eta90)


@settings(max_examples=50)
@given(specimens(), policies(most_legs=3))
def test_a_cut_goes_on_after_any_treatment(specimen, policy):
    """Also after sawing has used up the loan."""
    positions, angles = policy.path()
    onward = np.arange(positions[-1], 0.12, 10e-6)
    cut = lead(
        specimen, np.concatenate((positions, onward)), np.concatenate((angles, np.full(len(onward), angles[-1])))
    )
    check_force(cut, specimen.tissue.eta90)
    check_progress(cut)


@pytest.mark.parametrize("check", [lambda cut: check_force(cut, 0.28), check_progress])
def test_a_law_in_which_cracks_do_not_run_fails_the_checks(check):
    law = changed_law(("waits = F < (1.0 +", "waits = F < 2.0 * (1.0 +"))
    with pytest.raises(AssertionError):
        check(lead_by(law, homogeneous(), constant_feed(0.0254, to=0.04)))


COARSE, FINE = 1e-3, 1e-4  # [s]
Pair = tuple[LedCut, LedCut]


def cuts(specimen: Specimen, speed: float, angle: float) -> Pair:
    coarse, fine = (lead(specimen, constant_feed(speed, dt=dt), angle, dt=dt) for dt in (COARSE, FINE))
    return coarse, fine


def more_units(coarse: LedCut, fine: LedCut) -> int:
    return abs(int(coarse.end.units - fine.end.units))


def peak_force(cut: LedCut) -> float:
    return float(cut.readings["elastic_force"].max())


def peak_over_toughness(cut: LedCut) -> float:
    """Largest F/(R B), which does not depend on where along uneven tissue the units happen to begin."""
    return float((cut.readings["elastic_force"] / cut.along("toughness", cut.states["tip"][1:])).max())


def check_units(coarse: LedCut, fine: LedCut) -> None:
    assert more_units(coarse, fine) <= 1


def check_peak_force(coarse: LedCut, fine: LedCut) -> None:
    assert peak_force(coarse) == pytest.approx(peak_force(fine), rel=0.01)


@pytest.mark.parametrize("angle_deg", [45, 60, 75, 90])
@pytest.mark.parametrize("speed", [0.001, 0.0038, 0.0127, 0.0254])
def test_units_and_peak_force_agree_in_the_specimen_of_the_worked_out_check(speed, angle_deg):
    pair = cuts(homogeneous(), speed, math.radians(angle_deg))
    check_units(*pair)
    check_peak_force(*pair)


@settings(max_examples=25)
@given(st.floats(0.001, 0.0254), st.floats(INCLINED, UPRIGHT), st.floats(20e3, 100e3), st.floats(150.0, 500.0))
def test_peak_force_and_mean_lag_agree_in_any_homogeneous_tissue(speed, angle, modulus, resistance):
    coarse, fine = cuts(homogeneous(modulus=modulus, fracture_resistance=resistance), speed, angle)
    check_peak_force(coarse, fine)
    assert coarse.lag.mean() == pytest.approx(fine.lag.mean(), rel=0.05)
    assert more_units(coarse, fine) <= 1 + fine.end.units / 8


def test_units_and_force_over_toughness_agree_in_nearly_all_drawn_livers():
    pairs = []
    for episode in range(60):
        rng = generator(1, episode)
        specimen = Specimen.draw(rng, tissue=liver(eta90=0.3))
        pairs.append(cuts(specimen, rng.uniform(0.003, 0.0254), rng.uniform(INCLINED, UPRIGHT)))
    differences = np.array([more_units(*pair) for pair in pairs])
    assert np.median(differences) == 0
    assert np.mean(differences <= 1) >= 0.9
    ratios = np.array([peak_over_toughness(coarse) / peak_over_toughness(fine) for coarse, fine in pairs])
    assert np.mean(np.abs(ratios - 1.0) <= 0.01) >= 0.95


def test_a_speed_counted_per_update_fails_the_units():
    law = changed_law(("speed = dx / dt\n", "speed = dx / 1e-3\n"))
    path = [constant_feed(0.0254, to=0.05, dt=dt) for dt in (COARSE, FINE)]
    with pytest.raises(AssertionError):
        check_units(*(lead_by(law, homogeneous(), positions) for positions in path))


def test_a_run_that_waits_for_the_next_update_fails_the_peak_force():
    """In updates eight times as long, at which the law itself still passes."""
    run = (
        "        if row.runs > 0:\n            if renew_runs is not None:\n"
        "                renew_runs(row, moving, profiles, dt)\n"
        "            run_row(row, profiles)\n"
    )
    first = "        if row.turns > 0:\n            turn_row(row, profiles)\n"
    waiting = changed_law((run, ""), (first, run + first))
    path = [constant_feed(0.0254, to=0.05, dt=dt) for dt in (8 * COARSE, FINE)]
    check_peak_force(*(lead_by(changed_law(), homogeneous(), positions) for positions in path))
    with pytest.raises(AssertionError):
        check_peak_force(*(lead_by(waiting, homogeneous(), positions) for positions in path))
