"""Nothing locks: a driven blade goes on cutting, at forces that initiation explains."""

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
    policies,
    specimens,
)

from cutenv.tissue.specimen import SPACING


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
        specimen,
        np.concatenate((positions, onward)),
        np.concatenate((angles, np.full(len(onward), angles[-1]))),
    )
    check_force(cut, specimen.tissue.eta90)
    check_progress(cut)


@pytest.mark.parametrize("check", [lambda cut: check_force(cut, 0.28), check_progress])
def test_a_law_in_which_cracks_do_not_run_fails_the_checks(check):
    law = changed_law(("waits = F < (1.0 +", "waits = F < 2.0 * (1.0 +"))
    with pytest.raises(AssertionError):
        check(lead_by(law, homogeneous(), constant_feed(0.0254, to=0.04)))
