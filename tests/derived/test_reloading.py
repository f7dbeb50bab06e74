"""Unloading and reloading are elastic: the force comes back to where the blade was drawn back (Figures 6.6, 6.7)."""

from __future__ import annotations

import math

import numpy as np
import pytest
from led_cut import INCLINED, UPRIGHT, LedCut, changed_law, constant_feed, homogeneous, lead, lead_by, through

from cutenv._engine.randomness import generator
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
