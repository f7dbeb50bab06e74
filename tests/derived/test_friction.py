"""Friction on the blade's faces: both ways, by depth, and contained in the measured resistance."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from led_cut import LedCut, changed_law, constant_feed, homogeneous, lead, lead_by, liver, through

from cutenv.cutting.parameters import LawParameters
from cutenv.tissue.specimen import LENGTH, N_POINTS, Specimen

SHARE, R, B = 0.2, 211.0, 0.02
STEP = 10e-6  # [m] a millisecond


def rubbing(**changes: float) -> Specimen:
    return homogeneous(**({"friction_share": SHARE} | changes))


def there_and_back(law=None) -> LedCut:
    """Cut to 8 cm, return to the clamp, and come back."""
    path = through([0.08, 0.0, 0.08], STEP)
    return lead(rubbing(), path) if law is None else lead_by(law, rubbing(), path)


def friction_of(cut: LedCut) -> np.ndarray:
    return cut.readings["true_force"] - cut.readings["elastic_force"]


def check_opposes_motion(cut: LedCut) -> None:
    """Friction is SHARE R B against the motion on the way out, on the way back, and out again."""
    assert friction_of(cut) == pytest.approx(SHARE * R * B * np.sign(cut.readings["speed"]), rel=1e-9)


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


def test_a_pull_forward_on_the_way_back_fails_the_check():
    with pytest.raises(AssertionError):
        check_opposes_motion(there_and_back(changed_law(("math.copysign(friction, dx)", "friction"))))


def test_a_blade_at_rest_feels_no_friction():
    cut = lead(rubbing(), np.full(50, 0.0))
    assert np.all(friction_of(cut) == 0.0)
    loaded = lead(rubbing(), np.concatenate((constant_feed(0.01, to=0.03), np.full(50, 0.03))))
    assert np.all(friction_of(loaded)[-49:] == 0.0)
    assert loaded.end.friction == pytest.approx(SHARE * R * B * 0.03)


def test_the_closed_loop_returns_the_resistance_that_was_put_in():
    check_resistance_returned(there_and_back())


def test_friction_charged_on_top_of_the_whole_resistance_fails_the_check():
    law = changed_law(
        ("    return between(profile.toughness, i, share)\n", "    return R_B\n"),
        ("between(profile.toughness, i, share), state.ledger", "R_B, state.ledger"),
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
    per_depth = np.abs(friction_of(cut)) / np.interp(cut.states["blade"][:-1], y, depth)
    assert per_depth == pytest.approx(SHARE * R, rel=1e-9)


def test_friction_ignores_speed_unless_it_is_asked_to_grow_with_it():
    slow, fast = (np.abs(friction_of(lead(rubbing(), constant_feed(v))))[-1] for v in (0.002, 0.02))
    assert slow == pytest.approx(fast, rel=1e-12)
    viscous = LawParameters(friction_per_depth_speed=1000.0)
    slow, fast = (np.abs(friction_of(lead(rubbing(), constant_feed(v), parameters=viscous)))[-1] for v in (0.002, 0.02))
    assert fast - slow == pytest.approx(1000.0 * B * 0.018, rel=1e-6)


def test_retracting_unloads_the_tip_and_then_only_friction_remains():
    cut = there_and_back()
    back = cut.readings["speed"] < 0.0
    elastic, ahead = (
        cut.readings["elastic_force"][back],
        (cut.readings["position"] - cut.readings["tip"])[back],
    )
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


@pytest.mark.parametrize("reach", [0.0301, 0.0437, 0.0812])
def test_the_force_resumes_where_it_left_off(reach):
    """Exactly, if the blade stopped below the force at which it begins to cut; else it cuts a little more."""
    specimen = rubbing(friction_share=0.0)
    out = lead(specimen, through([reach], STEP))
    again = lead(specimen, through([0.0, reach], STEP, start=reach), start=out.end)
    force, resumed = out.readings["elastic_force"][-1], again.readings["elastic_force"][-1]
    start_of_growth = min(out.end.arrest_ratio, 1.0 - liver().eta90) * specimen.fracture_force()[0]
    if force <= start_of_growth:
        assert resumed == pytest.approx(force, rel=1e-9)
    assert start_of_growth <= resumed <= force * (1.0 + 1e-9)
