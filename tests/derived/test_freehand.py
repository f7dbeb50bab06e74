"""The plant whose model is solved again as it is cut: equal to the table on its line, exact in energy, led anywhere."""

from __future__ import annotations

import math
import time

import numpy as np
import pytest

from cutenv.plant import FreehandPlant, SteeredPlant
from cutenv.tissue import Specimen, SteeredModel
from cutenv.tissue.lines import bent, half_ellipse, straight

UPRIGHT = math.radians(90.0)
BESIDE = straight()._replace(y=np.full(301, 0.02))


def led_by_hand(plant: SteeredPlant, steps: int = 300) -> SteeredPlant:
    for k in range(steps):
        plant.advance(0.012, UPRIGHT, 20, 0.25 * math.sin(k / 40))
    return plant


def test_on_the_line_of_its_mesh_the_force_is_that_of_the_table() -> None:
    specimen = Specimen.drawn(3, specimen_class="uniform")
    free, table = FreehandPlant(specimen), SteeredPlant(specimen, straight())
    works = []
    for plant in (free, table):
        for _ in range(300):
            plant.advance(0.012, UPRIGHT, 20)
        works.append(plant.energy()["work"])
    assert works[0] == pytest.approx(works[1], rel=5e-3)
    ahead = slice(40, 250)  # from 20 mm on: nearer, the clamp holds an element of 10 mm at the tip
    assert free.steerings["along"][0][ahead] == pytest.approx(table.steerings["along"][0][ahead], rel=2e-3)


def test_energy_is_an_identity_wherever_the_blade_is_led() -> None:
    for seed in range(3):
        rng, plant = np.random.default_rng(seed), FreehandPlant(Specimen.drawn(seed))
        for _ in range(120):
            plant.advance(rng.uniform(-0.005, 0.025), rng.uniform(0.8, 1.57), 25, rng.uniform(-1.5, 1.5))
        energy = plant.energy()
        assert abs(energy["residual"]) <= 1e-12 * max(energy["work"], 1e-3)
        assert min(energy[name] for name in ("loss", "fracture", "friction", "stored")) >= -1e-15
        assert len(plant.cut) > 3


def test_the_model_is_cut_where_the_tip_went() -> None:
    plant = FreehandPlant(Specimen.drawn(0))
    tips = [plant.tip]
    for k in range(250):
        plant.advance(0.012, UPRIGHT, 20, 0.4 * math.sin(k / 30))
        tips.append(plant.tip)
    fine = np.linspace(0.0, len(tips) - 1.0, 20 * len(tips))  # it runs straight on between
    passed = np.column_stack([np.interp(fine, np.arange(len(tips)), axis) for axis in np.transpose(tips)])
    gaps = [np.hypot(*(passed - node).T).min() for node in plant.cut]
    assert max(gaps) < 3e-4
    assert math.dist(plant.cut[-1], plant.tip) < 0.01


def test_a_second_thread_cuts_the_same_within_a_percent() -> None:
    alone, beside = (led_by_hand(FreehandPlant(Specimen.drawn(3), background=way)) for way in (False, True))
    assert isinstance(beside, FreehandPlant)
    beside.settle()
    assert beside.energy()["work"] == pytest.approx(alone.energy()["work"], rel=0.02)
    assert math.dist(beside.tip, alone.tip) < 3e-3
    assert len(beside.cut) >= 12


def test_a_command_does_not_wait_for_the_model(monkeypatch: pytest.MonkeyPatch) -> None:
    grown = SteeredModel.cut_to
    slow = 0.4

    def late(self: SteeredModel, point: object, angle: float | None = None) -> int:
        time.sleep(slow)
        return grown(self, point, angle)  # type: ignore[arg-type]

    plant = FreehandPlant(Specimen.drawn(3), background=True)
    monkeypatch.setattr(SteeredModel, "cut_to", late)
    start = time.perf_counter()
    for _ in range(20):
        plant.advance(0.02, UPRIGHT, 10)
    assert plant.cut_distance.size > 2
    assert time.perf_counter() - start < slow
    monkeypatch.undo()
    plant.settle()


def test_a_second_cut_feels_the_first() -> None:
    specimen = Specimen.drawn(1, specimen_class="uniform")
    first = led_by_hand(FreehandPlant(specimen, straight()), 200)
    assert isinstance(first, FreehandPlant)
    again = FreehandPlant(specimen, BESIDE, model=first.model)
    fresh = FreehandPlant(specimen, BESIDE)
    assert again.blade == fresh.blade == (0.0, 0.02)
    assert first.cut[0] == pytest.approx([0.0, 0.0])  # the first plant keeps its own
    for plant in (again, fresh):
        for _ in range(150):
            plant.advance(0.012, UPRIGHT, 20)
    softer = again.steerings["along"][0][60] / fresh.steerings["along"][0][60]
    assert 0.9 < softer < 0.999


def test_a_crack_that_meets_a_cut_ends_and_says_so() -> None:
    specimen = Specimen.drawn(1)
    first = FreehandPlant(specimen)
    for _ in range(300):
        first.advance(0.015, UPRIGHT, 20)
    second = FreehandPlant(specimen, BESIDE, model=first.model)
    for k in range(300):
        second.advance(0.015, UPRIGHT, 20, -0.6 if k < 60 else 0.0)
        if second.end:
            break
    assert second.end is not None
    assert "cannot go on from" in second.end
    assert abs(second.energy()["residual"]) <= 1e-12 * second.energy()["work"]


def test_beside_a_drawn_line_places_are_told_along_it() -> None:
    plant = FreehandPlant(Specimen.drawn(0), half_ellipse())
    plant.advance(0.01, UPRIGHT, 2000, -0.2)  # to the right of the line, which bends to the right itself
    assert float(plant.states["blade"][0]) == pytest.approx(0.019, abs=2e-3)
    x, y = plant.blade
    gap = np.hypot(plant.line.x - x, plant.line.y - y).min()
    assert abs(plant.distance) == pytest.approx(gap, abs=1e-4)
    assert gap > 3e-4


def test_a_line_is_given_as_such() -> None:
    with pytest.raises(ValueError, match=r"line.y at its start = 0.2 m is outside -0.03 to 0.03 m"):
        FreehandPlant(Specimen.drawn(0), bent(np.zeros(301))._replace(y=np.full(301, 0.2)))
