"""Cut an ellipse by a free hand with a tremor, on a model that is solved again as it opens; draw it, print its areas.

    python -m scripts.drawings.excision FILE  PNG or SVG; elements are drawn displaced by the blade's last force
    python -m scripts.drawings.excision FILE --view PAGE
                                              and write a page that shows it in 3-D

The hand follows both sides of an elliptical excision, one after the other; the second cut begins beside the first, and
ends where it would meet it.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from cutenv.display.viewer.solid import CurvedCut, write_curved_view
from cutenv.sim.plant import FreehandPlant
from cutenv.sim.tissue import Specimen
from cutenv.sim.tissue.grid import SPACING
from cutenv.sim.tissue.lines import CutLine, half_ellipse

LENGTH, HEIGHT = 0.056, 0.01  # distance of the ends of one side of the excision, and height of its summit [m]
_BEGIN = 0.0025  # from the first cut's beginning to the second's, along the clamp [m]
_SPEED = 0.01
_UPRIGHT = math.radians(90.0)
_GAIN_ANGLE, _GAIN_DISTANCE = 4.0, 200.0  # of a hand [1/s], [1/(m s)]
_TREMOR, _SLOW = 0.5, 0.3  # of its rate of turn: size [rad/s], and how long it lasts [s]
_STEP = 20  # ms


class Side(NamedTuple):
    """One side of an excision, cut by a hand; places of shape (n, 2) [m]."""

    line: CutLine
    blade: Any
    cut: Any
    plant: FreehandPlant


def cut_side(specimen: Specimen, line: CutLine, rng: np.random.Generator, model: Any = None) -> Side:
    """Lead a blade along a line by hand, up to its end or to where the crack meets a cut."""
    plant = FreehandPlant(specimen, line, model=model)
    blade, tips, tremor = [plant.blade], [plant.tip], 0.0
    keep = math.exp(-1e-3 * _STEP / _SLOW)
    for _ in range(round(2.0 * LENGTH / _SPEED / (1e-3 * _STEP))):
        at = float(plant.states["blade"][0])
        if plant.tip[0] >= LENGTH or plant.blade[0] >= LENGTH + 0.012 or plant.end:
            break
        i = min(round(at / SPACING), len(line.x) - 1)
        tremor = keep * tremor + math.sqrt(1.0 - keep**2) * _TREMOR * rng.normal()
        aside = plant.heading - float(line.angle[i])
        turn = _SPEED * float(line.curvature[i]) - _GAIN_ANGLE * aside - _GAIN_DISTANCE * plant.distance + tremor
        plant.advance(_SPEED, _UPRIGHT, _STEP, min(max(turn, -4.0), 4.0))
        blade.append(plant.blade)
        tips.append(plant.tip)
    return Side(line, np.array(blade), np.array(tips), plant)


def excision(hand: int = 0) -> tuple[Side, Side]:
    """Cut both sides of an ellipse."""
    rng, specimen = np.random.default_rng(hand), Specimen.drawn(0)
    left = half_ellipse(LENGTH, HEIGHT)
    right = half_ellipse(LENGTH - 2.0 * _BEGIN, -HEIGHT + _BEGIN)
    first = cut_side(specimen, left, rng)
    beside = right._replace(y=right.y - _BEGIN)
    return first, cut_side(specimen, beside, rng, first.plant.model)


def area_between(side: Side) -> float:
    """Return the area between a cut and its line [m2]."""
    aside = side.plant.cut_distance
    s = np.arange(len(aside)) * SPACING
    return float(np.trapezoid(abs(aside), s))


def area_within(first: Side, second: Side) -> float:
    """Return the area between the cuts of both sides, up to where the shorter one ends [m2]."""
    x = np.linspace(0.0, min(first.cut[-1, 0], second.cut[-1, 0]), 2001)
    upper, lower = (np.interp(x, side.cut[:, 0], side.cut[:, 1]) for side in (first, second))
    return float(np.trapezoid(upper - lower, x))


def draw(path: Path, first: Side, second: Side) -> None:
    """Draw the slab under the last force, and the cuts beside the lines."""
    from matplotlib.collections import PolyCollection
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, 9.4), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(98, 56))
    for side, name in ((first, "drawn ellipse"), (second, None)):
        n = round((LENGTH + 0.003) / SPACING)
        below.plot(1e3 * side.line.x[:n], 1e3 * side.line.y[:n], "k--", lw=1.0, label=name)
        below.plot(*(1e3 * side.blade.T), color="tab:blue", lw=1.0, label=name and "way of the blade")
        below.plot(*(1e3 * side.cut.T), color="tab:orange", lw=2.0, label=name and "cut")
        low, high = (np.interp(side.line.x[:n], side.cut[:, 0], side.cut[:, 1]), side.line.y[:n])
        below.fill_between(1e3 * side.line.x[:n], 1e3 * low, 1e3 * high, color="tab:orange", alpha=0.25, lw=0)
    below.set(xlabel="along the slab, from the clamp [mm]", ylabel="across [mm]", xlim=(-3, 152), ylim=(-28, 28))
    below.set_title(
        f"{1e6 * area_within(first, second):.0f} mm² between the cuts; "
        f"{1e6 * (area_between(first) + area_between(second)):.0f} mm² between cuts and lines"
    )
    below.legend(loc="lower right")
    below.set_aspect("equal")
    moved = second.plant.displaced()
    above.add_collection(
        PolyCollection([1e3 * cell for cell in moved], facecolor="#e9c8bd", edgecolor="#a3644f", lw=0.5)
    )
    above.plot(*(1e3 * np.array(second.plant.blade)), "^", color="tab:blue", ms=8, label="blade")
    above.set(ylabel="across [mm]", ylim=(-46, 52))
    above.set_title("the model after both cuts, displaced by the blade's last force")
    above.legend(loc="lower right")
    above.set_aspect("equal")
    figure.savefig(path, dpi=110)


def main(argv: Sequence[str] | None = None) -> int:
    """Cut, draw and print the areas."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("file", type=Path, help="picture to write")
    parser.add_argument("--hand", type=int, default=0, metavar="N", help="number of the hand, default 0")
    parser.add_argument("--view", type=Path, metavar="PAGE", help="page in 3-D to write, .html; needs cutenv[view3d]")
    arguments = parser.parse_args(argv)
    if arguments.hand < 0:
        parser.error(f"--hand {arguments.hand} is negative")
    first, second = excision(arguments.hand)
    for name, side in (("left", first), ("right", second)):
        energy = side.plant.energy()
        print(
            f"{name} side: {1e3 * len(side.plant.cut_distance) * SPACING:.0f} mm, {1e6 * area_between(side):.0f} mm2 "
            f"beside its line, at most {1e3 * abs(side.plant.cut_distance).max():.1f} mm; {energy['work']:.3f} J, "
            f"residual {energy['residual']:.0e} J" + (f"; {side.plant.end}" if side.plant.end else "")
        )
    print(f"between the cuts: {1e6 * area_within(first, second):.0f} mm2")
    draw(arguments.file, first, second)
    if arguments.view is not None:
        size = write_curved_view(arguments.view, CurvedCut.of_plant(second.plant, "An ellipse, cut by a free hand"))
        print(f"page: {arguments.view} ({size / 1e6:.1f} MB)")
    return 0


if __name__ == "__main__":
    sys.exit(main())
