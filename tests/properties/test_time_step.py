"""The law at 1 ms and at 0.1 ms: the same cut.

Where a unit ends decides where the next begins, and at some speeds and angles long and short units alternate,
so that their number depends on the last digits of the motion.  Where it does, the bounds below say how much.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from led_cut import INCLINED, UPRIGHT, LedCut, changed_law, constant_feed, homogeneous, lead, lead_by, liver

from cutenv._engine.randomness import generator
from cutenv.tissue.specimen import Specimen

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
