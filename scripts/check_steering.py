"""Check the cutting law in the plane, and the models of cuts along a curve against others and against closed forms.

    python scripts/check_steering.py                 4 specimens: two minutes
    python scripts/check_steering.py --only account --specimens 1
    python scripts/check_steering.py --picture FILE  half an excision, led along the line

The table shows the results and what is promised; a line without a promise is a finding.  The exit status is 1 if a
promise is not kept.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import crack_truth
import numpy as np
from adversarial_motions import FEED, MOTIONS, TICKS, UPRIGHT
from benchmark.table import markdown_table
from check_physics import RESIDUAL, Row, drawn

from cutenv.cutting.dtypes import READING, TICK
from cutenv.cutting.steering import SteeringParameters
from cutenv.plant import SimulatedPlant, SteeredPlant
from cutenv.tissue import CutModel, Specimen
from cutenv.tissue.grid import SPACING
from cutenv.tissue.lines import CutLine, arc, half_ellipse, random_line, s_shape, straight
from cutenv.tissue.path_model import PathModel

LINES = {
    "straight": straight(),
    "arc, radius 40 mm": arc(0.04),
    "S, radius 30 mm": s_shape(0.03, 0.08),
    "half an excision": half_ellipse(),
    "random": random_line(np.random.default_rng(0)),
}
"""Lines to cut along, by name."""
TURNS: dict[str, Callable[[np.random.Generator], Any]] = {
    "none": lambda rng: np.zeros(TICKS),
    "white jitter of 3 degrees": lambda rng: rng.normal(0.0, 0.05, TICKS),
    "round and round": lambda rng: np.full(TICKS, 2e-3),
    "23 degrees to and fro each millisecond": lambda rng: np.where(np.arange(TICKS) % 2 == 0, 0.4, -0.4),
    "aside at once": lambda rng: np.where(np.arange(TICKS) < 10, 0.05, 0.0),
}
"""One turn each millisecond [rad], by name."""
TOLERANCE = 0.02
"""Largest difference between work and the integral of the force [1]."""
_GAIN_ANGLE, _GAIN_DISTANCE = 6.0, 400.0  # of a hand that follows a line [1/s], [1/(m s)]


class Led(NamedTuple):
    """A cut whose blade was led along a path."""

    plant: SteeredPlant
    readings: Any

    @property
    def lateral(self) -> Any:
        """Force to the right of the blade at each reading, shape (n,) [N]."""
        return self.plant.lateral_force


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
            positions, angles = motion(np.random.default_rng(number))
            readings = SimulatedPlant(specimen, angle=float(np.ravel(angles)[0])).lead(positions, angles)
            own = led(specimen, straight(), 0.0, positions, angles)
            different += sum(int((own.readings[name] != readings[name]).sum()) for name in READING.names or ())
            compared += readings.size
    what = f"readings on a straight line that differ from the straight law ({compared})"
    yield Row(what, str(different), "0", different == 0)


def check_account(specimens: Sequence[Specimen]) -> Iterator[Row]:
    """Check the energy account under motions and turns that no drive makes, on every line."""
    worst, lowest, gained, paths = 0.0, 0.0, math.inf, 0
    finite = monotone = True
    for specimen in specimens:
        for line in LINES.values():
            for k, motion in enumerate(MOTIONS.values()):
                for m, turns in enumerate(TURNS.values()):
                    rng = np.random.default_rng((k, m))
                    ways, angles = motion(rng)
                    cut = led(specimen, line, turns(rng), ways, angles)
                    energy = cut.plant.energy()
                    worst = max(worst, abs(energy["residual"]) / max(abs(energy["work"]), 1e-3))
                    lowest = min(lowest, *(energy[name] for name in ("loss", "fracture", "friction", "stored")))
                    gained = min(gained, energy["work"] - energy["friction"] - energy["stored"])
                    finite &= bool(np.isfinite(cut.readings["force"]).all() and np.isfinite(cut.lateral).all())
                    monotone &= bool((np.diff(cut.readings["tip"]) >= 0.0).all())
                    paths += 1
    yield Row(f"residual over the work or 1 mJ ({paths} motions)", f"{worst:.1e}", f"{RESIDUAL:.0e}", worst <= RESIDUAL)
    yield Row("least work beyond friction and what is stored [J]", f"{gained:.1e}", "not negative", gained >= -1e-12)
    yield Row(
        "least of fracture, friction, loss and what is stored [J]", f"{lowest:g}", "not negative", lowest >= -1e-15
    )
    yield Row("forces finite, tip never backwards", f"{finite}, {monotone}", "True, True", finite and monotone)


def check_bends(specimens: Sequence[Specimen]) -> Iterator[Row]:
    """Check mirror images, force against work, the response time; find how far the cut leaves the line."""
    unlike: list[float] = []
    works, sooner = [], []
    turns = np.full(TICKS, FEED[0] / 0.04)
    for specimen in specimens:
        left, right = (led(specimen, arc(sign * 0.04), sign * turns, FEED, UPRIGHT) for sign in (1.0, -1.0))
        unlike.append(float(abs(left.readings["force"] - right.readings["force"]).max()))
        unlike.append(float(abs(left.lateral + right.lateral).max()))
        forces, ways = np.append(0.0, left.readings["force"]), np.append(0.0, FEED)
        work = left.plant.states[0]["work"]
        works.append(float((0.5 * (forces[1:] + forces[:-1]) * np.diff(ways)).sum() / work - 1.0))
        at_once = led(specimen, arc(0.04), turns, FEED, UPRIGHT, SteeringParameters(response_time=TICK))
        sooner.append(float(at_once.plant.states[0]["work"] / work - 1.0))
    what = "largest difference of the forces of an arc to the right from those of its mirror image"
    yield Row(what, f"{max(unlike):.1e} N", "1e-9 N", max(unlike) <= 1e-9)
    for what, found in (
        ("integral of the force over the work, on an arc", works),
        ("work where the crack turns every ms, not every 10, on an arc", sooner),
    ):
        worst = max(map(abs, found))
        yield Row(what, f"{100 * min(found):+.2f} to {100 * max(found):+.2f} %", "within 2 %", worst <= TOLERANCE)
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
    "model": check_model,
    "steered": crack_truth.check_other_models,
    "table": crack_truth.check_table,
    "second solver": crack_truth.check_second_solver,
    "turned": crack_truth.check_turned,
    "fracture": crack_truth.check_fracture,
    "arcs": crack_truth.check_arcs,
}


def table(specimens: int, parts: Sequence[str]) -> Iterator[Row]:
    """Yield the rows of the chosen parts."""
    sampled = drawn(specimens)
    for part in parts:
        yield from CHECKS[part](sampled)


def markdown(specimens: int = 2) -> str:
    """Return the whole table as Markdown."""
    rows = [(row.what, row.found, row.promised) for row in table(specimens, list(CHECKS))]
    return markdown_table(("what", "found", "promised"), rows)


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


def main(argv: Sequence[str] | None = None) -> int:
    """Check and print; return 1 if a promise is not kept."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--specimens", type=int, default=4, metavar="N", help="default 4")
    parser.add_argument(
        "--only", nargs="+", choices=CHECKS, default=list(CHECKS), metavar="PART", help=", ".join(CHECKS)
    )
    parser.add_argument("--picture", type=Path, metavar="FILE", help="draw a cut into a PNG or SVG instead")
    arguments = parser.parse_args(argv)
    if arguments.specimens < 1:
        parser.error(f"--specimens {arguments.specimens} is less than 1")
    if arguments.picture is not None:
        draw(arguments.picture)
        return 0
    print(f"{Row('what', 'found', 'promised')} holds")
    kept = []
    for row in table(arguments.specimens, arguments.only):
        print(row, flush=True)
        kept.append(row.holds is not False)
    return int(not all(kept))


if __name__ == "__main__":
    sys.exit(main())
