"""The check of the physics on one specimen: what its promises say is kept, and broken physics is told."""

from __future__ import annotations

from typing import Any

import pytest

from cutenv.sim.plant import SimulatedPlant
from cutenv.sim.tissue import CutModel, Specimen
from cutenv.sim.tissue.specimen import N_POINTS, SPACING
from scripts.validation.physics import straight


def status(*parts: str) -> int:
    return straight.main(["--specimens", "1", "--only", *parts])


def test_one_specimen_keeps_every_promise(capsys: pytest.CaptureFixture[str]) -> None:
    assert status("stiffness", "reloading", "account") == 0
    assert "0 promises not kept" in capsys.readouterr().out


def local_product(specimen: Specimen) -> Any:
    """E kappa B of the place, as if a point load averaged nothing."""
    return specimen.modulus * CutModel().stiffness([i * SPACING for i in range(N_POINTS)]) * specimen.depth


def forgetting(plant: SimulatedPlant, *path: Any) -> Any:
    """Lead a blade, then lose the force at which growth stopped."""
    readings = LEAD(plant, *path)
    plant.states["held_force"] = 0.0
    return readings


def unaccounted(*arguments: Any, **keywords: Any) -> SimulatedPlant:
    """A fresh plant with a loss that no work has paid."""
    plant = SimulatedPlant(*arguments, **keywords)
    plant.states["loss"] = 1e-12
    return plant


LEAD = SimulatedPlant.lead


@pytest.mark.parametrize(
    ("part", "broken", "name", "by"),
    [
        ("stiffness", Specimen, "stiffness", local_product),
        ("reloading", SimulatedPlant, "lead", forgetting),
        ("account", straight, "SimulatedPlant", unaccounted),
    ],
)
def test_broken_physics_ends_in_status_1(
    part: str, broken: Any, name: str, by: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(broken, name, by)
    assert status(part) == 1
