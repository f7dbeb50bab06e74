"""Unloading, reloading (Figures 6.6, 6.7) and turning: elastic, but for B^2 |d cot(theta)| / 2 swept toward upright."""

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

from cutenv._engine.randomness import generator
from cutenv.sim.cutting.dtypes import LawParameters
from cutenv.sim.cutting.law import leaning, sweeping
from cutenv.sim.tissue.specimen import LENGTH, N_POINTS, Specimen

SPEEDS = [0.001, 0.0038, 0.0089, 0.0127, 0.0165, 0.0216, 0.0254]  # [m/s]
FEED, FREQUENCY, AMPLITUDE = 0.005, 25.0, 0.3e-3  # [m/s], [1/s], [m]
FORGETFUL = ("row.held_force[n] = F if row.loading[n] > 0.0 else row.held_force[n]", "pass")


def there_and_back_and_there(place: float, speed: float, back: float) -> np.ndarray:
    """Positions [m]: cut to ``place``, draw back by ``back``, come again."""
    return through([place, place - back, place], speed * 1e-3)


def check_reload(cut: LedCut) -> None:
    """Force at the end of the path is that of the first time the blade was there; nothing was cut in between."""
    first = int(np.argmax(cut.readings["position"] >= cut.readings["position"][-1]))
    force = cut.readings["elastic_force"]
    assert force[-1] == pytest.approx(force[first], rel=1e-12)
    assert cut.end.tip == cut.states["tip"][first + 1]


@pytest.mark.parametrize("angle_deg", [45, 60, 90])
@pytest.mark.parametrize("speed", SPEEDS)
def test_the_force_comes_back_to_where_the_blade_was_drawn_back(speed, angle_deg):
    for place in np.linspace(0.03, 0.05, 5):
        for back in (0.2e-3, 1e-3, 0.02):
            check_reload(lead(homogeneous(), there_and_back_and_there(place, speed, back), math.radians(angle_deg)))


@pytest.mark.parametrize("episode", range(4))
def test_it_does_in_drawn_livers(episode):
    specimen = Specimen.draw(generator(8, episode), specimen_class="vascular")
    check_reload(lead(specimen, there_and_back_and_there(0.06, 0.0254, 0.02), INCLINED))


@pytest.mark.parametrize("angle", [UPRIGHT, INCLINED])
def test_a_law_that_forgets_the_force_at_which_growth_stopped_fails_the_check(angle):
    path = there_and_back_and_there(0.0437, 0.0254, 0.02)
    check_reload(lead_by(changed_law(), homogeneous(), path, angle))
    with pytest.raises(AssertionError):
        check_reload(lead_by(changed_law(FORGETFUL), homogeneous(), path, angle))


def check_runs(dithered: LedCut) -> None:
    """A dither on a feed leaves a third of the units at least, with the force from which a crack runs."""
    plain = lead(homogeneous(), constant_feed(FEED), dithered.end.angle)
    assert dithered.end.units >= plain.end.units / 3
    peaks = [cut.readings["elastic_force"].max() for cut in (dithered, plain)]
    assert peaks[0] == pytest.approx(peaks[1], rel=0.01)


def dither() -> np.ndarray:
    """Positions [m] of a blade that trembles on its way."""
    feed = constant_feed(FEED)
    time = 1e-3 * np.arange(1, len(feed) + 1)
    return np.maximum(feed + AMPLITUDE * np.sin(2.0 * np.pi * FREQUENCY * time), 0.0)


@pytest.mark.parametrize("angle", [UPRIGHT, INCLINED])
def test_a_trembling_blade_does_not_cut_without_runs(angle):
    check_runs(lead(homogeneous(), dither(), angle))


def test_under_a_law_that_forgets_it_would():
    with pytest.raises(AssertionError):
        check_runs(lead_by(changed_law(FORGETFUL), homogeneous(), dither()))


SHARE, CREEP_TIME = 0.4, LawParameters().creep_time
RELAXING = LawParameters(relaxing_share=SHARE)
SPEED = 0.0254
HELD = 0.002  # [m]: below the force at which a blade begins to cut


def dwell(seconds: float, *, back: float = 0.0) -> np.ndarray:
    """Positions [m]: press the tissue at the clamp, stay, and draw back."""
    press = constant_feed(SPEED, to=HELD)
    rest = np.full(round(1e3 * seconds), press[-1])
    return np.concatenate((press, rest, through([back], SPEED * 1e-3, start=press[-1]) if back else np.zeros(0)))


def check_dwell(cut: LedCut) -> None:
    """The force falls by exp(-t / (1 - rho) T) to (1 - rho) K u; the account holds, and nothing is won back."""
    pressed = round(HELD / SPEED * 1e3) - 1
    force = cut.readings["elastic_force"][pressed:]
    time = 1e-3 * np.arange(len(force))
    rest = (1.0 - SHARE) * cut.profile["stiffness"][0] * cut.readings["position"][-1]
    expected = rest + (force[0] - rest) * np.exp(-time / ((1.0 - SHARE) * CREEP_TIME))
    assert force == pytest.approx(expected, rel=1e-3)
    assert force[-1] == pytest.approx(rest, rel=1e-3)
    assert np.abs(residual_of(cut)).max() < 1e-12 * max(cut.end.work, 1e-3)
    assert np.diff(cut.states["loss"]).min() >= 0.0


def test_a_held_blades_force_relaxes():
    check_dwell(lead(homogeneous(), dwell(10.0), parameters=RELAXING))


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("row.loss[n] += lost\n", "row.loss[n] += 0.0\n"),
        ("rate * law.relaxing_share * max(reach, creep)", "rate * max(reach, creep)"),
    ],
)
def test_a_relaxation_broken_on_purpose_fails_the_check(old, new):
    check_dwell(lead_by(changed_law(), homogeneous(), dwell(10.0), parameters=RELAXING))
    with pytest.raises(AssertionError):
        check_dwell(lead_by(changed_law((old, new)), homogeneous(), dwell(10.0), parameters=RELAXING))


def test_tissue_that_nobody_holds_comes_back():
    held = lead(homogeneous(), dwell(10.0), parameters=RELAXING)
    free = lead(homogeneous(), np.zeros(1000), start=held.end, parameters=RELAXING)
    assert free.states["creep"][1:] == pytest.approx(
        free.states["creep"][1] * np.exp(-1e-3 * np.arange(1000) / CREEP_TIME), rel=1e-3
    )
    assert np.all(free.readings["elastic_force"][1:] == 0.0)
    assert np.abs(residual_of(free)).max() < 1e-15


@pytest.mark.parametrize(("seconds", "short_by"), [(0.0, 0.02), (1.0, 0.25), (10.0, SHARE)])
def test_a_probe_after_a_dwell_tells_the_stiffness_but_finds_the_tip_too_early(seconds, short_by):
    """Unloading by 1 mm within 40 ms: the slope is K, and its zero lies before the tip by what has crept."""
    cut = lead(homogeneous(), dwell(seconds, back=0.5 * HELD), parameters=RELAXING)
    probe = cut.readings[-40:]
    slope, offset = np.polyfit(probe["position"], probe["elastic_force"], 1)
    assert slope == pytest.approx(cut.profile["stiffness"][0], rel=0.03)
    assert -offset / slope == pytest.approx(short_by * HELD, abs=0.05 * HELD)


def test_tissue_does_not_relax_unless_it_is_asked_to():
    path = np.concatenate((constant_feed(0.01, to=0.03), np.full(1000, 0.03)))
    plain, slow = (lead(homogeneous(), path, parameters=LawParameters(creep_time=t)) for t in (CREEP_TIME, 50.0))
    assert plain.states.tobytes() == slow.states.tobytes()
    assert np.ptp(plain.readings["elastic_force"][-1000:]) == 0.0


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
        specimen, np.full(600, cut.readings["position"][high]), ramp(90, 90, 45, steps=300), start=cut.states[high + 1]
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
