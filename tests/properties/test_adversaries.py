"""Motions that no drive makes: the energy account stays exact, and fracture is the integral of R B over the crack."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from adversarial_motions import MOTIONS
from led_cut import LedCut, changed_law, homogeneous, lead, lead_by, residual_of, turning_work

from cutenv._engine.randomness import generator
from cutenv.cutting.parameters import LawParameters
from cutenv.tissue.specimen import SPACING, Specimen

MOST_FRACTURE_ERROR = 1e-5  # [J], of 0.1 J and more


def check_account(cut: LedCut) -> None:
    """Work = stored + fracture + friction + loss + ledger; the force is finite and pulls back; no crack heals."""
    assert np.all(np.abs(residual_of(cut)) <= 1e-12 * np.maximum(cut.states["work"], 1e-3))
    assert np.all(np.isfinite(cut.readings["true_force"]))
    assert cut.readings["elastic_force"].min() >= 0.0
    assert np.diff(cut.states["tip"]).min() >= 0.0


def check_fracture(cut: LedCut) -> None:
    """What was booked as fracture, less turning, is the integral of R B from the clamp to the tip."""
    knots = cut.profile["toughness"]
    whole = SPACING * np.concatenate(([0.0], np.cumsum(0.5 * (knots[1:] + knots[:-1]))))
    tip = cut.states["tip"]
    i = np.minimum((tip / SPACING).astype(int), len(knots) - 2)
    rest = tip - i * SPACING
    integral = whole[i] + 0.5 * rest * (knots[i] + cut.along("toughness", tip))
    assert np.abs(cut.states["fracture"] - turning_work(cut) - integral).max() <= MOST_FRACTURE_ERROR


@pytest.mark.parametrize("episode", range(3))
@pytest.mark.parametrize("name", MOTIONS)
def test_the_account_and_fracture_are_exact_under_any_motion(name, episode):
    rng = generator(13, episode)
    specimen = Specimen.draw(rng, specimen_class="vascular" if episode else "liver")
    relaxing = LawParameters(relaxing_share=0.4 if episode == 2 else 0.0)
    cut = lead(specimen, *MOTIONS[name](rng), parameters=relaxing)
    check_account(cut)
    check_fracture(cut)


def leap(law: Any = None) -> LedCut:
    """From the clamp by 10 cm in one update, the crack growing stably by some of them."""
    specimen, path = Specimen.draw(generator(13, 1), specimen_class="vascular"), np.full(2, 0.1)
    return lead(specimen, path) if law is None else lead_by(law, specimen, path)


def test_a_leap_that_is_not_divided_fails_the_check_of_fracture():
    check_fracture(leap())
    with pytest.raises(AssertionError):
        check_fracture(leap(changed_law(("leaps += 1 if da > LONGEST_ADVANCE else 0", "leaps += 0"))))


def test_a_leap_whose_parts_are_not_paid_fails_the_check_of_the_account():
    check_account(lead(homogeneous(), np.full(2, 0.1)))
    law = changed_law(("        work += cutting_work\n        fracture += spent\n", "        work += cutting_work\n"))
    with pytest.raises(AssertionError):
        check_account(lead_by(law, homogeneous(), np.full(2, 0.1)))
