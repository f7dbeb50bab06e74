"""Friction on the blade's faces: both ways, by depth, and contained in the measured resistance."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from functools import partial

import numpy as np
import pytest
from led_cut import LedCut, changed_law, constant_feed, homogeneous, lead, lead_by, through

from cutenv.sim.cutting.dtypes import LawParameters
from cutenv.sim.tissue.specimen import LENGTH, N_POINTS, Specimen

SHARE, R, B = 0.2, 211.0, 0.02
PRESLIDING = LawParameters().presliding_length
STEP = 10e-6  # [m] a millisecond


def rubbing(**changes: float) -> Specimen:
    return homogeneous(**({"friction_share": SHARE} | changes))


def there_and_back(law=None) -> LedCut:
    """Cut to 8 cm, return to the clamp, and come back."""
    path = through([0.08, 0.0, 0.08], STEP)
    return lead(rubbing(), path) if law is None else lead_by(law, rubbing(), path)


def friction_of(cut: LedCut) -> np.ndarray:
    return cut.readings["true_force"] - cut.readings["elastic_force"]


def turned_lately(cut: LedCut) -> np.ndarray:
    """Whether the blade has come less than twice the presliding length since it started or turned."""
    x = cut.readings["position"]
    turns = np.flatnonzero(np.diff(np.sign(np.diff(x, prepend=0.0)), prepend=0.0))
    since = np.searchsorted(turns, np.arange(len(x)), side="right") - 1
    return np.abs(x - np.append(0.0, x)[turns[since]]) < 2.0 * PRESLIDING


def check_opposes_motion(cut: LedCut) -> None:
    """Friction is SHARE R B against the motion on the way out, on the way back, and out again."""
    slipping = ~turned_lately(cut)
    expected = SHARE * R * B * np.sign(cut.readings["speed"])
    assert friction_of(cut)[slipping] == pytest.approx(expected[slipping], rel=1e-9)
    assert slipping.mean() > 0.99


def check_resistance_returned(cut: LedCut) -> None:
    """R = (work of the closed loop - 2 f x)/(B a) + f/B: friction included, what was put in.

    A loan of at most R B l remains: 1.5 mm of 75 mm.
    """
    home = int(np.argmax(cut.readings["position"] == 0.0)) + 1
    a, x, f = cut.states["tip"][home], cut.states["blade"].max(), abs(friction_of(cut)[home - 1])
    measured = (cut.states["work"][home] - 2.0 * f * x) / (B * a) + f / B
    assert measured == pytest.approx(R, rel=0.02)


def test_friction_opposes_the_motion_both_ways():
    check_opposes_motion(there_and_back())
    law = changed_law(("friction_force(law, next_depth, next_bristle, speed)\n", "SHARE_R_B\n"))
    law.SHARE_R_B = SHARE * R * B
    with pytest.raises(AssertionError):
        check_opposes_motion(there_and_back(law))


def check_trembling(cut: LedCut) -> None:
    """Back and forth by 2 um, friction changes by the share of the presliding length, and the way costs nothing."""
    trembling = friction_of(cut)[-100:]
    assert np.ptp(trembling) == pytest.approx(SHARE * R * B * 2e-6 / PRESLIDING, rel=1e-6)
    assert cut.end.friction == pytest.approx(cut.states["friction"][-101], rel=1e-9)


def trembling() -> np.ndarray:
    return np.concatenate((constant_feed(0.01, to=0.03), 0.03 - 2e-6 * (np.arange(1, 101) % 2)))


def test_a_hand_that_trembles_feels_a_spring():
    check_trembling(lead(rubbing(), trembling()))
    law = changed_law(("max(bristle + dx,", "max(bristle + 1e9 * dx,"))
    with pytest.raises(AssertionError):
        check_trembling(lead_by(law, rubbing(), trembling()))


def test_a_blade_at_rest_stays_held_by_what_it_was_drawn_along():
    fresh = lead(rubbing(), np.full(50, 0.0))
    assert np.all(friction_of(fresh) == 0.0)
    rested = lead(rubbing(), np.concatenate((constant_feed(0.01, to=0.03), np.full(50, 0.03))))
    assert friction_of(rested)[-50:] == pytest.approx(SHARE * R * B)
    drawn_back = lead(rubbing(), np.array([0.03 - PRESLIDING]), start=rested.end)
    assert friction_of(drawn_back) == pytest.approx(0.0, abs=1e-12)
    assert rested.end.friction == pytest.approx(SHARE * R * B * (0.03 - 0.5 * PRESLIDING))


def check_given_back(cut: LedCut) -> None:
    """Of a blade that sticks, friction took nothing when it is back where it was."""
    assert abs(cut.end.friction) < 1e-9 * SHARE * R * B * PRESLIDING


def sticking(by: Callable[..., LedCut] = lead) -> LedCut:
    """Out by nearly the presliding length at once and back in eight steps, a hundred times, where the depth rises."""
    wedge = dataclasses.replace(rubbing(), depth=0.001 + 0.5 * np.linspace(0.0, LENGTH, N_POINTS), thickness=0.1)
    return by(wedge, np.tile(0.9 * PRESLIDING * np.array([1.0, 0.8, 0.7, 0.6, 0.4, 0.3, 0.2, 0.1, 0.0]), 100))


def test_bristles_give_back_what_they_took_where_the_depth_changes():
    check_given_back(sticking())
    law = changed_law((" + _TWELFTH * stretch * (next_depth - depth)", ""))
    with pytest.raises(AssertionError):
        check_given_back(sticking(partial(lead_by, law)))


def test_the_closed_loop_returns_the_resistance_that_was_put_in():
    check_resistance_returned(there_and_back())
    law = changed_law(
        ("    return lerp(profile.toughness, i, share)\n", "    return R_B\n"),
        ("value_and_rise(profile.toughness, i)", "(R_B, 0.0)"),
    )
    law.R_B = R * B
    with pytest.raises(AssertionError):
        check_resistance_returned(there_and_back(law))


@pytest.mark.parametrize("share", [0.0, 0.1, 0.4])
def test_fracture_and_friction_share_the_resistance(share):
    specimen = homogeneous(friction_share=share)
    assert specimen.friction_per_depth == pytest.approx(share * R)
    assert specimen.fracture_force() == pytest.approx((1.0 - share) * R * B)


def test_friction_follows_the_depth_at_the_blade():
    y = np.linspace(0.0, LENGTH, N_POINTS)
    depth = 0.005 + 0.1 * y
    wedge = dataclasses.replace(rubbing(), depth=depth)
    cut = lead(wedge, through([0.08, 0.0], STEP))
    per_depth = np.abs(friction_of(cut)) / np.interp(cut.states["blade"][1:], y, depth)
    assert per_depth[~turned_lately(cut)] == pytest.approx(SHARE * R, rel=1e-9)


def test_friction_ignores_speed_unless_it_is_asked_to_grow_with_it():
    slow, fast = (np.abs(friction_of(lead(rubbing(), constant_feed(v))))[-1] for v in (0.002, 0.02))
    assert slow == pytest.approx(fast, rel=1e-12)
    viscous = LawParameters(friction_per_depth_speed=1000.0)
    slow, fast = (np.abs(friction_of(lead(rubbing(), constant_feed(v), parameters=viscous)))[-1] for v in (0.002, 0.02))
    assert fast - slow == pytest.approx(1000.0 * B * 0.018, rel=1e-6)


def test_retracting_unloads_the_tip_and_then_only_friction_remains():
    cut = there_and_back()
    back = cut.readings["speed"] < 0.0
    elastic, ahead = (cut.readings["elastic_force"][back], (cut.readings["position"] - cut.readings["tip"])[back])
    assert np.all(np.diff(elastic) <= 0.0)
    assert np.all(elastic[ahead <= 0.0] == 0.0)
    assert np.all(elastic[ahead > 0.0] > 0.0)


def test_advancing_through_the_open_crack_shows_only_friction_until_the_tip_is_met():
    cut = there_and_back()
    out_again = np.flatnonzero(cut.readings["speed"] < 0.0)[-1] + 1
    again = cut.readings[out_again:]
    tip = cut.states["tip"][out_again]
    open_crack = again["position"] <= tip
    assert np.all(again["elastic_force"][open_crack] == 0.0)
    assert np.all(again["elastic_force"][~open_crack] > 0.0)
    assert open_crack.sum() > 7000
