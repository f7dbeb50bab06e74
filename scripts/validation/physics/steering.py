"""Check the cutting law in the plane, and the models of cuts along a curve against others and against closed forms.

    python -m scripts.validation.physics.steering                 4 specimens: two minutes
    python -m scripts.validation.physics.steering --only account --specimens 1
    python -m scripts.validation.physics.steering --picture FILE  half an excision, led along the line

The table shows the results and what is promised; a line without a promise is a finding.  The exit status is 1 if a
promise is not kept.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cutenv.sim.cutting.dtypes import TICK
from cutenv.sim.cutting.steering import SteeringParameters
from cutenv.sim.plant import SteeredPlant
from cutenv.sim.tissue import CutModel, Specimen
from cutenv.sim.tissue.grid import SPACING
from cutenv.sim.tissue.lines import CutLine, arc, half_ellipse, random_line, s_shape, straight
from cutenv.sim.tissue.path_model import PathModel
from scripts.validation.physics import crack_truth, promises
from scripts.validation.physics.adversarial_motions import FEED, MOTIONS, TICKS, UPRIGHT
from scripts.validation.physics.promises import Led, Row, account_rows, differing, run, share_row

LINES = {  # lines to cut along, by name
    "straight": straight(),
    "arc, radius 40 mm": arc(0.04),
    "S, radius 30 mm": s_shape(0.03, 0.08),
    "half an excision": half_ellipse(),
    "random": random_line(np.random.default_rng(0)),
}
TURNS: dict[str, Callable[[np.random.Generator], Any]] = {  # one turn each millisecond [rad], by name
    "none": lambda rng: np.zeros(TICKS),
    "white jitter of 3 degrees": lambda rng: rng.normal(0.0, 0.05, TICKS),
    "round and round": lambda rng: np.full(TICKS, 2e-3),
    "23 degrees to and fro each millisecond": lambda rng: np.where(np.arange(TICKS) % 2 == 0, 0.4, -0.4),
    "aside at once": lambda rng: np.where(np.arange(TICKS) < 10, 0.05, 0.0),
}
TOLERANCE = 0.02  # largest difference between work and the integral of the force [1]
_GAIN_ANGLE, _GAIN_DISTANCE = 6.0, 400.0  # of a hand that follows a line [1/s], [1/(m s)]


def led(
    specimen: Specimen, line: CutLine, turns: Any, ways: Any, angles: Any, parameters: SteeringParameters | None = None
) -> Led:
    """Lead a blade by turns [rad], ways since the start [m] and angles [rad], one of each every millisecond."""
    plant = SteeredPlant(specimen, line, steering=parameters, angle=float(np.ravel(angles)[0]))
    return Led(plant, plant.lead(ways, angles, turns))


def follow_line(
    plant: SteeredPlant, speed: float, length: float, told: Callable[[Any], object] = lambda readings: None
) -> Any:
    """Lead the blade along its line at ``speed`` [m/s] up to ``length`` [m]; return its places, shape (n, 2) [m].

    ``told`` is called with the readings of every 20 ms.
    """
    places = [plant.blade]
    for _ in range(round(3.0 * length / speed / 0.02)):
        at = float(plant.states["blade"][0])
        if at >= length:
            break
        i = min(round(at / SPACING), len(plant.line.x) - 1)
        aside = plant.heading - float(plant.line.angle[i])
        turn = speed * float(plant.line.curvature[i]) - _GAIN_ANGLE * aside - _GAIN_DISTANCE * plant.distance
        told(plant.advance(speed, UPRIGHT, 20, min(max(turn, -4.0), 4.0)))
        places.append(plant.blade)
    return np.array(places)


def check_straight(specimens: Sequence[Specimen]) -> Iterator[Row]:
    """Check that on a straight line, with the blade on it, every reading is that of the straight law."""
    different = compared = 0
    for specimen in specimens:
        for number, motion in enumerate(MOTIONS.values()):
            path = motion(np.random.default_rng(number))
            off, count = differing(led(specimen, straight(), 0.0, *path), specimen, *path)
            different, compared = different + off, compared + count
    what = f"readings on a straight line that differ from the straight law ({compared})"
    yield Row(what, str(different), "0", different == 0)


def check_account(specimens: Sequence[Specimen]) -> Iterator[Row]:
    """Check the energy account under motions and turns that no drive makes, on every line."""

    def cuts() -> Iterator[tuple[Led, Any]]:
        for specimen, line in itertools.product(specimens, LINES.values()):
            for (k, motion), (m, turns) in itertools.product(enumerate(MOTIONS.values()), enumerate(TURNS.values())):
                rng = np.random.default_rng((k, m))
                ways, angles = motion(rng)
                cut = led(specimen, line, turns(rng), ways, angles)
                yield cut, cut.plant.lateral_force

    yield from account_rows(cuts(), "residual over the work or 1 mJ ({} motions)", -1e-15)


def check_bends(specimens: Sequence[Specimen]) -> Iterator[Row]:
    """Check mirror images, force against work, the response time; find how far the cut leaves the line."""
    unlike: list[float] = []
    works, sooner = [], []
    turns = np.full(TICKS, FEED[0] / 0.04)
    for specimen in specimens:
        left, right = (led(specimen, arc(sign * 0.04), sign * turns, FEED, UPRIGHT) for sign in (1.0, -1.0))
        unlike.append(float(abs(left.readings["force"] - right.readings["force"]).max()))
        unlike.append(float(abs(left.plant.lateral_force + right.plant.lateral_force).max()))
        forces, ways = np.append(0.0, left.readings["force"]), np.append(0.0, FEED)
        work = left.plant.states[0]["work"]
        works.append(float((0.5 * (forces[1:] + forces[:-1]) * np.diff(ways)).sum() / work - 1.0))
        at_once = led(specimen, arc(0.04), turns, FEED, UPRIGHT, SteeringParameters(response_time=TICK))
        sooner.append(float(at_once.plant.states[0]["work"] / work - 1.0))
    what = "largest difference of the forces of an arc to the right from those of its mirror image"
    yield Row(what, f"{max(unlike):.1e} N", "1e-9 N", max(unlike) <= 1e-9)
    yield share_row("integral of the force over the work, on an arc", works, TOLERANCE)
    yield share_row("work where the crack turns every ms, not every 10, on an arc", sooner, TOLERANCE)
    for speed in (0.005, 0.0254):
        plants = [SteeredPlant(specimen, arc(0.04)) for specimen in specimens]
        for plant in plants:
            follow_line(plant, speed, 0.035)
        cuts = [1e3 * abs(p.cut_distance).mean() for p in plants]
        what = f"mean distance of the cut to an arc of 40 mm that the blade follows at {1e3 * speed:g} mm/s"
        yield Row(what, f"{np.mean(cuts):.2f} mm")
    for curvature in (50.0, 200.0):
        plants = [
            SteeredPlant(specimen, arc(0.04), steering=SteeringParameters(crack_curvature=curvature))
            for specimen in specimens
        ]
        for plant in plants:
            follow_line(plant, 0.01, 0.035)
        cuts = [1e3 * abs(p.cut_distance).mean() for p in plants]
        yield Row(f"the same at 10 mm/s with a crack that bends to {1e3 / curvature:g} mm", f"{np.mean(cuts):.2f} mm")


def check_passing(specimens: Sequence[Specimen]) -> Iterator[Row]:
    """Check the forces where a blade passes its tip: loops that lead it there and back, and ordinary return strokes."""
    for friction in (0.0, None):
        gaps = []
        for (number, specimen), line in itertools.product(enumerate(specimens), LINES.values()):
            tissue = specimen if friction is None else dataclasses.replace(specimen, friction_per_depth=friction)
            gaps += _polygon_gaps(SteeredPlant(tissue, line), np.random.default_rng(number))
        what = f"reported work less the account, {len(gaps)} closed polygons, {{}}"
        if friction == 0.0:
            yield Row(what.format("without friction"), f"{max(gaps):.1e} J", "1e-6 J", max(gaps) <= 1e-6)
        else:
            yield Row(what.format("with friction, of 15 mJ"), f"{max(gaps):.1e} J")
    steps = [_lateral_step(specimen, line) for specimen in specimens for line in LINES.values()]
    what = "largest step of the lateral force in 1 ms, return strokes of 4 and 12 mm along all lines, but for runs"
    yield Row(what, f"{max(steps):.3f} N", "0.05 N", max(steps) <= 0.05)


def _polygon_gaps(plant: SteeredPlant, rng: np.random.Generator) -> list[float]:
    """Return works by the force less those of the account [J], of a polygon of some millimetres, run through thrice."""
    follow_line(plant, 0.01, 0.04)
    angles = np.sort(rng.uniform(0.0, 2.0 * np.pi, int(rng.integers(3, 6))))
    corners = 10.0 ** rng.uniform(-2.6, -2.1) * np.column_stack((np.cos(angles), np.sin(angles)))
    sides = np.roll(corners, -1, axis=0) - corners
    way, force, gaps = float(plant.states["blade"][0] - plant.states["hand"][0]), 0.0, []
    for loop in range(5):
        before, told = plant.energy()["work"], 0.0
        for east, north in sides:
            turn = math.remainder(math.atan2(north, east) - plant.heading, 2.0 * math.pi)
            force = float(plant.lead(np.full(8, way), UPRIGHT, np.full(8, turn / 8.0))["force"][-1])
            ways = way + math.hypot(east, north) * np.arange(1, 401) / 400.0
            forces = np.append(force, plant.lead(ways, UPRIGHT, 0.0)["force"])
            told += float((0.5 * (forces[1:] + forces[:-1])).mean()) * math.hypot(east, north)
            way = float(ways[-1])
        if loop >= 2:
            gaps.append(abs(told - (plant.energy()["work"] - before)))
    return gaps


def _lateral_step(specimen: Specimen, line: CutLine) -> float:
    """Return the largest step of the lateral force [N] in a millisecond, but for 10 ms after a run of the crack."""
    plant, lateral, jumps = SteeredPlant(specimen, line), [], []

    def note(readings: Any) -> None:
        lateral.append(plant.lateral_force.copy())
        jumps.append(readings["jump"])

    for k, place in enumerate((0.02, 0.03, 0.04, 0.05, 0.06)):
        follow_line(plant, 0.01, place, note)
        strokes = round((0.004 if k % 2 else 0.012) / 0.01 / 0.02)
        for _ in range(strokes):
            i = min(round(float(plant.states["blade"][0]) / SPACING), len(line.x) - 1)
            note(plant.advance(-0.01, UPRIGHT, 20, -0.01 * float(line.curvature[i])))
    steps, ran = abs(np.diff(np.concatenate(lateral))), np.concatenate(jumps) > 0.0
    since = np.convolve(ran, np.ones(12))[: len(ran)] > 0.0  # the crack turns after a run when it next responds
    return float(steps[~since[1:]].max())


def check_model(_: Sequence[Specimen], finest: int = 4) -> Iterator[Row]:
    """Check the finite-element model whose mesh follows the line, with elements down to a part of 10 mm."""
    own, plain = PathModel(straight()), CutModel()
    error = float(abs(own.stiffness[:, 0, 0] / plain.stiffness(own.tips) - 1.0).max())
    yield Row("straight: stiffness along the line against CutModel", f"{error:.1e}", "1e-10", error <= 1e-10)
    left, right = PathModel(arc(0.05)), PathModel(arc(-0.05))
    mirror = float(abs(left.stiffness * [[1, -1], [-1, 1]] - right.stiffness).max())
    yield Row(
        "an arc to the right has the stiffness of one to the left, mirrored", f"{mirror:.1e}", "1e-10", mirror <= 1e-10
    )
    model = PathModel(half_ellipse())
    reciprocal = float(abs(model.stiffness - model.stiffness.swapaxes(1, 2)).max())
    yield Row("stiffness is symmetric", f"{reciprocal:.1e}", "1e-10", reciprocal <= 1e-10)
    line = half_ellipse()
    ratios = []
    for n in (n for n in (1, 2, 4) if n <= finest):
        fine, base = PathModel(line, (8 * n, 15 * n)), PathModel(straight(), (8 * n, 15 * n))
        at = np.interp(0.05, base.tips, base.stiffness[:, 0, 0])
        ratios.append(
            [float(np.interp(0.05, fine.tips, fine.stiffness[:, i, j])) / at for i, j in ((0, 0), (0, 1), (1, 1))]
        )
    for name, values in zip(("along", "coupled", "across"), np.transpose(ratios), strict=True):
        shown = ", ".join(f"{value:.3f}" for value in values)
        yield Row(
            f"stiffness {name} at 50 mm of half an excision over that of a straight cut; 10, 5, 2.5 mm elements", shown
        )


CHECKS: dict[str, Callable[[Sequence[Specimen]], Iterator[Row]]] = {
    "straight": check_straight,
    "account": check_account,
    "bends": check_bends,
    "passing": check_passing,
    "model": check_model,
    "steered": crack_truth.check_other_models,
    "table": crack_truth.check_table,
    "beside": crack_truth.check_beside,
    "second solver": crack_truth.check_second_solver,
    "turned": crack_truth.check_turned,
    "fracture": crack_truth.check_fracture,
    "arcs": crack_truth.check_arcs,
}


def draw(path: Path) -> None:
    """Draw half an excision: the line, the mesh of its model, the blade's way and the cut."""
    from matplotlib.collections import LineCollection
    from matplotlib.figure import Figure

    line = half_ellipse()
    model, plant = PathModel(line, (16, 30)), SteeredPlant(Specimen.drawn(0), line)
    blade = follow_line(plant, 0.01, 0.085)
    figure = Figure(figsize=(9.0, 4.2), layout="constrained")
    axes = figure.add_subplot()
    corners = model.mesh.nodes[model.mesh.elements][:, [0, 1, 2, 3, 0]]
    axes.add_collection(
        LineCollection(1e3 * np.stack((corners[..., 1], -corners[..., 0]), axis=-1), color="0.85", lw=0.6)
    )
    axes.plot(1e3 * line.x[:190], 1e3 * line.y[:190], "k--", lw=1.2, label="drawn line")
    axes.plot(*(1e3 * blade.T), color="tab:blue", lw=1.5, label="way of the blade")
    cut = plant.cut_distance
    x, y = line.x[: len(cut)], line.y[: len(cut)]
    axes.plot(
        1e3 * (x - cut * np.sin(line.angle[: len(cut)])), 1e3 * (y + cut * np.cos(line.angle[: len(cut)])),
        color="tab:orange", lw=2.0, label="cut",
    )  # fmt: skip
    axes.set(xlabel="along the slab, from the clamp [mm]", ylabel="across [mm]", xlim=(-2, 152), ylim=(-42, 42))
    axes.set_aspect("equal")
    axes.legend(loc="lower right")
    figure.savefig(path, dpi=110)


def markdown() -> str:
    """Return the table of the page."""
    return promises.markdown(CHECKS, 2)


if __name__ == "__main__":
    sys.exit(run(__doc__, CHECKS, draw))
