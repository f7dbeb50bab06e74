"""Sawing: whatever the stroke and the force level, cutting below the resistance is a loan with a limit."""

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
    recorded_work,
    specimens,
    through,
    toughening,
)

from cutenv.tissue.specimen import SPACING, Specimen

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
