"""Stiffness of a crack beside its line, by the place of its tip: the fit, what it keeps, and a line not seen."""

from __future__ import annotations

import numpy as np

from cutenv.sim.tissue.drawn_lines import STORED, drawn_lines, given_line
from cutenv.sim.tissue.lines import half_ellipse, straight
from cutenv.sim.tissue.place_model import MAX_TIP_DISTANCE, fitted_numbers, stiffness_off_line
from scripts.derivations import lines
from scripts.validation.physics import crack_truth

DISTANCES = (-0.02, -MAX_TIP_DISTANCE, -0.001, 0.003, MAX_TIP_DISTANCE, 0.02)  # [m]


def test_the_stored_numbers_are_those_that_the_script_fits():
    np.testing.assert_allclose(fitted_numbers(), lines.fitted(), rtol=1e-4)


def test_stiffness_beside_every_line_is_positive_and_on_it_the_lines_own_to_the_last_bit():
    for record in drawn_lines(*STORED.values()).records:
        own = record["along"], record["coupled"], record["across"]
        rates = record["off_line"].reshape(-1, 3).T
        for i in range(0, round(record["within"] / 0.0005) + 1, 20):
            here, off = tuple(float(part[i]) for part in own), tuple(float(part[i]) for part in rates)
            assert stiffness_off_line(here, off, 0.0) == here
            for d in DISTANCES:
                along, coupled, across = stiffness_off_line(here, off, d)
                assert along > 0.0
                assert along * across > coupled**2


def test_beside_a_straight_line_both_sides_are_alike():
    record = given_line(straight(), **STORED).records[0]
    along, coupled, across = record["off_line"].reshape(-1, 3).T
    assert not along.any()
    assert not across.any()
    assert coupled.min() > 0.0  # the stiffer axis turns away from that of the slab


def test_a_crack_3_mm_beside_half_an_excision_that_was_not_fitted_has_its_stiffness():
    rows = list(crack_truth.check_beside([], [half_ellipse(0.09, 0.016)], [0.003]))
    assert all(row.holds for row in rows)
