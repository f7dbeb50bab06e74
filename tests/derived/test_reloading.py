"""Unloading and reloading: elastic (Figures 6.6, 6.7), and what tissue that relaxes makes of it."""

from __future__ import annotations

import math

import numpy as np
import pytest
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
from cutenv.cutting.parameters import LawParameters
from cutenv.tissue.specimen import Specimen

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
