"""Files of the benchmark of cuts along a curve: paths, meshes, stiffness at the tip, and our own entries."""

from __future__ import annotations

import csv
import json
import time
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cutenv.sim.plant import FreehandPlant, SteeredPlant
from cutenv.sim.tissue import CutModel, Specimen, SteeredModel
from cutenv.sim.tissue.grid import LENGTH, N_POINTS, SPACING
from cutenv.sim.tissue.lines import WIDTH, CutLine, arc, half_ellipse, length_within, random_line, s_shape, straight
from cutenv.sim.tissue.path_model import stiffness_on_line
from scripts.validation.physics.crack_truth import ELEMENT, led_along
from scripts.validation.physics.curves.calculix import MODULUS, POISSON, THICKNESS, deck
from scripts.validation.physics.steering import follow_line

PATHS: dict[str, CutLine] = {  # paths by name
    "straight": straight(),
    "arc": arc(0.05),
    "s": s_shape(0.04, 0.08),
    "half-excision": half_ellipse(),
    "random": random_line(np.random.default_rng(2)),
}
FIRST, LAST = 0.02, 0.08
"""Range of the arc lengths at which stiffnesses are compared [m]; a path that nears a side of the slab ends before."""
STIFFNESS = ("path", "arc_length_m", "along", "coupled", "across")
ENERGY = ("path", "time_s", "work_J", "stored_J", "fracture_J", "friction_J", "loss_J", "ledger_J")
FORCES = ("path", "time_s", "x_m", "y_m", "heading_rad", "force_N", "lateral_force_N", "tip_x_m", "tip_y_m")
_SPEED = 0.01  # of the blade [m/s]


def reach(line: CutLine) -> float:
    """Return the arc length up to which a path is compared [m]."""
    return min(LAST, length_within(line) - 0.01)


def make(folder: Path) -> None:
    """Write all files of the benchmark."""
    grid = np.arange(N_POINTS) * SPACING
    folder.mkdir(parents=True, exist_ok=True)
    about = {
        "version": 1, "width_m": WIDTH, "length_m": LENGTH, "thickness_m": THICKNESS, "young_modulus_Pa": MODULUS,
        "poisson": POISSON, "formulation": "plane stress", "element_at_the_tip_m": ELEMENT,
        "first_arc_length_m": FIRST, "last_arc_length_m": {name: reach(line) for name, line in PATHS.items()},
        "blade_speed_m_per_s": _SPEED,
    }  # fmt: skip
    (folder / "about.json").write_text(json.dumps(about, indent=2) + "\n", encoding="utf-8")
    points = (
        (name, *(f"{value:.7g}" for value in row))
        for name, line in PATHS.items()
        for row in zip(grid[::2], line.x[::2], line.y[::2], line.angle[::2], line.curvature[::2], strict=True)
    )
    _write(folder / "paths.csv", ("path", "arc_length_m", "x_m", "y_m", "angle_rad", "curvature_per_m"), points)
    (folder / "meshes").mkdir(exist_ok=True)
    reference = []
    for name, line in PATHS.items():
        reference += _rows(name, *led_along(line, SteeredModel((32, 60), line=line), reach(line)))
    _write(folder / "reference.csv", STIFFNESS, reference)
    for entry, divisions in (("steered", (16, 30)), ("steered-fine", (32, 60))):
        steered, seconds = [], []
        for name, line in PATHS.items():
            model, start = SteeredModel(divisions), time.process_time()
            ways, found = led_along(line, model, reach(line))
            seconds.append((time.process_time() - start) / len(ways))
            steered += _rows(name, ways, found)
            if entry == "steered":
                title = f"cut along the path {name}, tip at {ways[-1]:.4f} m of it"
                (folder / "meshes" / f"{name}.inp").write_text(deck(model.doubled_mesh(), title), encoding="ascii")
        method = f"cutenv: SteeredModel, nodes moved and doubled, {150 / divisions[1]:g} mm elements"
        free: list[SteeredPlant] = [
            FreehandPlant(_specimen(), line, model=SteeredModel(divisions)) for line in PATHS.values()
        ]
        _entry(folder / "entries" / entry, method, steered, float(np.mean(seconds)), free)
    table, start = [], time.process_time()
    base = np.asarray(CutModel().stiffness(np.clip(grid, ELEMENT, LENGTH)))
    for name, line in PATHS.items():
        parts = [part / _specimen().stiffness() * base for part in stiffness_on_line(_specimen(), line)]
        kept = [i for i in range(0, N_POINTS, 5) if grid[i] <= reach(line)]
        found = np.array([[[parts[0][i], parts[1][i]], [parts[1][i], parts[2][i]]] for i in kept])
        table += _rows(name, grid[kept], found)
    method, seconds_each = "cutenv: table of a known path, PathModel, 10 mm elements", time.process_time() - start
    held = [SteeredPlant(_specimen(), line) for line in PATHS.values()]
    _entry(folder / "entries" / "table", method, table, seconds_each / len(table), held)


def _specimen() -> Specimen:
    return Specimen.drawn(0, specimen_class="uniform")


def _rows(name: str, ways: Any, stiffness: Any) -> list[tuple[str, ...]]:
    return [
        (name, f"{way:.6g}", *(f"{round(each[i, j], 9) + 0.0:.8g}" for i, j in ((0, 0), (0, 1), (1, 1))))
        for way, each in zip(ways, stiffness, strict=True)
        if way >= FIRST - 0.005
    ]


def _entry(
    folder: Path, method: str, stiffness: list[tuple[str, ...]], seconds: float, plants: Sequence[SteeredPlant]
) -> None:
    """Write an entry of our own: stiffness, and force and energy of a blade that is led along each path."""
    folder.mkdir(parents=True, exist_ok=True)
    about = {"method": method, "by": "the cutenv developers", "seconds_per_tip": float(f"{seconds:.2g}")}
    (folder / "about.json").write_text(json.dumps(about, indent=2) + "\n", encoding="utf-8")
    _write(folder / "stiffness.csv", STIFFNESS, stiffness)
    forces: list[tuple[Any, ...]] = []
    energies: list[tuple[Any, ...]] = []
    for name, plant in zip(PATHS, plants, strict=True):

        def note(readings: Any, name: str = name, plant: SteeredPlant = plant) -> None:
            tick = int(plant.states["tick"][0])
            if tick % 200 == 0:
                force, aside = readings["force"][-1], plant.lateral_force[-1]
                told = (*plant.blade, plant.heading, force, aside, *plant.tip)
                forces.append((name, f"{1e-3 * tick:.1f}", *(f"{value:.6g}" for value in told)))
                account = plant.energy()
                parts = (account[part.removesuffix("_J")] for part in ENERGY[2:])
                energies.append((name, f"{1e-3 * tick:.1f}", *(f"{value:.17g}" for value in parts)))

        follow_line(plant, _SPEED, reach(plant.line), note)
    _write(folder / "forces.csv", FORCES, forces)
    _write(folder / "energy.csv", ENERGY, energies)


def _write(path: Path, header: Sequence[str], rows: Iterable[Sequence[Any]]) -> None:
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(header)
        writer.writerows(rows)
