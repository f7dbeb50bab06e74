"""Figures 6.5 to 6.7: forward one inch, back to the start, forward two inches, back (thesis, section 6.2)."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest
from led_cut import changed_law, homogeneous, lead, lead_by, liver, through

from cutenv._engine.randomness import generator
from cutenv.sim.cutting.sensor import SensorParameters
from cutenv.sim.plant import SimulatedPlant, forward_backward, run
from cutenv.sim.tissue.specimen import Specimen

INCH = 0.0254
SPEED = 0.01  # [m/s]; the thesis does not say which of its speeds it was
STILL = 1e-4  # [m/s]
FREE = 0.2e-3  # [m] behind the tip, where the tissue is unloaded for certain


def rubbing() -> Specimen:
    return homogeneous(friction_share=0.2)


def drawn() -> Specimen:
    return Specimen.draw(generator(65), tissue=liver())


def uninterrupted(reach: float) -> Any:
    return lead(rubbing(), through([reach], SPEED * 1e-3)).readings


def strokes(readings: Any) -> list[Any]:
    """Out, back, out again, back again: the readings between the turning points of the blade."""
    x = readings["position"]
    moving = readings[np.abs(readings["speed"]) > STILL]
    turns = np.flatnonzero(np.diff(np.sign(moving["speed"]))) + 1
    found = np.split(moving, turns)
    assert len(found) == 4
    assert x.max() == pytest.approx(2 * INCH, abs=1e-5)
    return found


def check_travel(readings: Any) -> None:
    """Figure 6.5: the blade's travel over time."""
    out, back, out_again, back_again = strokes(readings)
    ends = [out["position"][-1], back["position"][-1], out_again["position"][-1], back_again["position"][-1]]
    assert ends == pytest.approx([INCH, 0.0, 2 * INCH, 0.0], abs=0.05e-3)


def check_same_friction_in_the_old_crack(readings: Any) -> None:
    """The same magnitude and variation of friction on the way back as on the second way out."""
    out, back, out_again, _ = strokes(readings)
    tip = out["tip"][-1]
    place = np.linspace(0.5e-3, tip - FREE, 200)
    on_the_way_back = np.interp(place, back["position"][::-1], back["true_force"][::-1])
    second_way_out = np.interp(place, out_again["position"], out_again["true_force"])
    assert np.all(second_way_out > 0.0)
    assert second_way_out == pytest.approx(-on_the_way_back, rel=1e-5)


def check_force_resumes(readings: Any) -> None:
    """At about one inch the second cycle reaches the unloading point of the first."""
    out, _, out_again, _ = strokes(readings)
    tip = out["tip"][-1]
    before = out_again["true_force"][out_again["position"] <= tip]
    at_one_inch = np.interp(INCH, out_again["position"], out_again["true_force"])
    assert at_one_inch == pytest.approx(out["true_force"][-1], rel=0.01)
    assert before.max() < 0.5 * at_one_inch


def check_second_inch_continues_the_first(readings: Any) -> None:
    """As if the blade had never gone back: units, crack and highest force of one cut of two inches."""
    _, _, out_again, _ = strokes(readings)
    whole = uninterrupted(2 * INCH)
    new = out_again[out_again["position"] > INCH]
    assert new["tip"][-1] == pytest.approx(whole["tip"][-1], abs=2e-3)
    assert new["true_force"].max() == pytest.approx(whole["true_force"].max(), rel=0.01)
    second_inch = whole["position"] > INCH
    assert abs((new["jump"] > 0.0).sum() - (whole["jump"][second_inch] > 0.0).sum()) <= 1


CHECKS = [
    check_travel,
    check_same_friction_in_the_old_crack,
    check_force_resumes,
    check_second_inch_continues_the_first,
]


def on_the_rig(specimen: Specimen) -> tuple[SimulatedPlant, Any]:
    plant = SimulatedPlant(specimen, sensor=SensorParameters(force_noise=0.0))
    return plant, run(plant, forward_backward(first=INCH, second=2 * INCH, speed=SPEED))


@pytest.mark.parametrize("check", CHECKS)
def test_two_cycles_on_the_rig(check):
    check(on_the_rig(rubbing())[1])


def test_friction_varies_with_the_bulge_alike_both_ways():
    _, readings = on_the_rig(drawn())
    check_travel(readings)
    check_same_friction_in_the_old_crack(readings)
    friction = np.abs(strokes(readings)[3]["true_force"])
    assert friction.max() > 5.0 * friction[-200:].min()


@pytest.mark.parametrize("specimen", [rubbing(), drawn()], ids=["homogeneous", "drawn"])
def test_energy_closes_over_both_cycles(specimen):
    plant, readings = on_the_rig(specimen)
    energy = plant.energy()
    assert abs(energy["residual"]) <= 1e-9 * energy["work"]
    assert energy["stored"] == 0.0
    x, F = np.append(0.0, readings["position"]), np.append(0.0, readings["elastic_force"])
    friction = np.append(0.0, readings["true_force"] - readings["elastic_force"])
    elastic_work, rubbed = (0.5 * (force[1:] + force[:-1]) @ np.diff(x) for force in (F, friction))
    assert energy["work"] == pytest.approx(elastic_work + rubbed, rel=2e-3)
    assert energy["friction"] == pytest.approx(rubbed, rel=1e-5)


def test_nothing_is_cut_on_the_ways_back_or_in_the_old_crack():
    _, back, out_again, back_again = strokes(on_the_rig(rubbing())[1])
    in_the_old_crack = out_again[out_again["position"] <= back["tip"][-1]]
    for stroke, part in itertools.product((back, in_the_old_crack, back_again), ("tip", "jump")):
        assert np.ptp(stroke[part]) == 0.0


START = "x, a, dx, K = row.blade[n] - row.creep[n], row.tip[n], row.dx[n], row.K[n]\n"
BACKWARD_CUT = "row.tip[n] += 0.3 * max(-row.dx[n], 0.0); " + START
HEALING = "row.tip[n] = min(row.tip[n], row.blade[n]); " + START


@pytest.mark.parametrize(
    ("check", "old", "new"),
    [
        (check_same_friction_in_the_old_crack, "next_bristle, speed)\n", "next_bristle, speed) + 0.2\n"),
        (check_same_friction_in_the_old_crack, START, HEALING),
        (check_force_resumes, START, HEALING),
        (check_second_inch_continues_the_first, START, BACKWARD_CUT),
    ],
    ids=["friction one way", "healing crack", "healing crack forgets the force", "return stroke cuts"],
)  # fmt: skip
def test_a_law_broken_on_purpose_fails_its_check(check, old, new):
    path = through([INCH, 0.0, 2 * INCH, 0.0], SPEED * 1e-3)
    check(lead_by(changed_law(), rubbing(), path).readings)
    with pytest.raises(AssertionError):
        check(lead_by(changed_law((old, new)), rubbing(), path).readings)
