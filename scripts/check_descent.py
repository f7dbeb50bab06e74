"""Check the cutting law where the blade also moves up and down: energy, limit cases, and layers against bricks.

    python scripts/check_descent.py                 4 specimens, and layers on bricks: some minutes
    python scripts/check_descent.py --only account limits --specimens 1

The table shows the results and what is promised; a line without a promise is a finding.  The exit status is 1 if a
promise is not kept.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from adversarial_motions import FEED, MOTIONS, TICKS, UPRIGHT
from benchmark.table import markdown_table
from check_physics import RESIDUAL, Row, drawn
from fit_layers import SlabsOfBricks, size_of, slab_name

from cutenv.cutting.descent import DescentParameters
from cutenv.cutting.dtypes import READING, TICK
from cutenv.plant import DescendingPlant, SimulatedPlant
from cutenv.tissue import Layers, Specimen
from cutenv.tissue.layers import LAYER_REACH
from cutenv.tissue.specimen import SPACING

LAYERED = Layers(capsule_thickness=5e-4, capsule_toughness=8.0, boundary=0.01, deep_toughness=5.0, deep_modulus=2.0)
SLAB_LAYERS = (
    Layers(capsule_thickness=0.5e-3, capsule_modulus=10.0),
    Layers(boundary=0.008, deep_modulus=2.0),
    Layers(boundary=0.008, deep_modulus=0.3),
    Layers(boundary=0.005, deep_modulus=5.0),
    Layers(boundary=0.015, deep_modulus=5.0),
)
"""Layers whose stiffness is compared with bricks; the fit of their reach has not seen them."""
VERTICAL: dict[str, Callable[[np.random.Generator], Any]] = {
    "white jitter of 1 mm": lambda rng: rng.normal(0.0, 1e-3, TICKS),
    "5 mm up and down each millisecond": lambda rng: np.where(np.arange(TICKS) % 2 == 0, 0.0, -0.005),
    "anywhere at once": lambda rng: rng.uniform(-0.03, 0.03, TICKS),
    "steadily down": lambda rng: -3e-6 * np.arange(TICKS),
    "pumping at 25 Hz": lambda rng: -2e-3 * (1.0 + np.sin(2.0 * math.pi * 25e-3 * np.arange(TICKS))),
    "steps of 1e-12 m": lambda rng: -0.004 - 1e-12 * np.arange(TICKS),
}
"""One level each millisecond [m], by name."""

LEVEL_TOLERANCE = 0.02
"""Largest difference between work and the integral of the forces, and of the area from that of the floor [1]."""


class Led(NamedTuple):
    """A cut whose blade was led along a path."""

    plant: DescendingPlant
    readings: Any

    @property
    def vertical(self) -> Any:
        """Vertical force at each reading, shape (n,) [N]."""
        return self.plant.vertical_force


def led(
    specimen: Specimen,
    positions: Any,
    levels: Any,
    angles: Any,
    layers: Layers | None = None,
    parameters: DescentParameters | None = None,
) -> Led:
    """Lead a blade along positions [m], levels [m] and angles [rad], one of each every millisecond."""
    plant = DescendingPlant(specimen, layers=layers or Layers(), descent=parameters, angle=float(np.ravel(angles)[0]))
    return Led(plant, plant.lead(positions, angles, levels))


def check_level_zero(specimens: Sequence[Specimen]) -> Iterator[Row]:
    """Check that at level 0, and in layers that are alike, every reading is that of the law without a vertical axis."""
    alike = Layers(capsule_thickness=0.002, boundary=0.007)
    different = compared = 0
    for specimen in specimens:
        for number, (motion, layers) in enumerate((m, la) for m in MOTIONS.values() for la in (None, alike)):
            positions, angles = motion(np.random.default_rng(number))
            readings = SimulatedPlant(specimen, angle=float(np.ravel(angles)[0])).lead(positions, angles)
            own = led(specimen, positions, 0.0, angles, layers)
            different += sum(int((own.readings[name] != readings[name]).sum()) for name in READING.names or ())
            compared += readings.size
    what = f"readings at level 0 that differ from the law without it ({compared})"
    yield Row(what, str(different), "0", different == 0)


def check_descent_account(specimens: Sequence[Specimen]) -> Iterator[Row]:
    """Check the energy account under motions that no drive makes, along the cut and up and down."""
    worst, lowest, gained, paths = 0.0, 0.0, math.inf, 0
    finite = monotone = True
    for specimen in specimens:
        for k, (_, motion) in enumerate(MOTIONS.items()):
            for m, (_, vertical) in enumerate(VERTICAL.items()):
                rng = np.random.default_rng((k, m))
                positions, angles = motion(rng)
                cut = led(specimen, positions, vertical(rng), angles, LAYERED)
                energy = cut.plant.energy()
                worst = max(worst, abs(energy["residual"]) / max(abs(energy["work"]), 1e-3))
                lowest = min(lowest, *(energy[name] for name in ("loss", "fracture", "friction", "stored")))
                gained = min(gained, energy["work"] - energy["friction"] - energy["stored"])
                finite &= bool(np.isfinite(cut.readings["force"]).all() and np.isfinite(cut.vertical).all())
                monotone &= bool((np.diff(cut.readings["tip"]) >= 0.0).all())
                paths += 1
    yield Row(
        f"residual of the account over the work or 1 mJ ({paths})", f"{worst:.1e}", f"{RESIDUAL:.0e}", worst <= RESIDUAL
    )
    yield Row("least work beyond friction and what is stored [J]", f"{gained:.1e}", "not negative", gained >= -1e-12)
    yield Row(
        "least of fracture, friction, loss and what is stored [J]", f"{lowest:g}", "not negative", bool(lowest >= 0.0)
    )
    yield Row("forces finite, tip never backwards", f"{finite}, {monotone}", "True, True", finite and monotone)


def check_limits(specimens: Sequence[Specimen]) -> Iterator[Row]:
    """Check a pure stab, the area that was opened, and work against the integrals of the forces."""
    uniform = Specimen.drawn(0, specimen_class="uniform")
    feed = np.concatenate((FEED, np.linspace(FEED[-1], 0.01, TICKS)))
    stab = led(uniform, np.append(feed, np.full(TICKS, 0.01)), np.append(0.0 * feed, -4e-6 * np.arange(TICKS)), UPRIGHT)
    descent = stab.plant.descents[0]
    expected = (
        descent["toughness"][0] * descent["edge_length"]
        + stab.plant.cuts["laws"][0, 0]["friction_per_depth"] * stab.plant.profiles[0]["depth"][20]
    )
    ratio = stab.vertical[-1] / expected
    yield Row(
        "vertical force of a pure stab over R w plus friction",
        f"{ratio:.4f}",
        "1.00",
        math.isclose(ratio, 1.0, abs_tol=0.01),
    )

    ratio = held_force_over_work(uniform)
    yield Row(
        "vertical force of a blade at rest over the work of raising it, per length",
        f"{ratio:.4f}",
        "1.00",
        math.isclose(ratio, 1.0, abs_tol=0.01),
    )

    errors, works, sooner, steps = [], [], [], []
    for specimen in (uniform, *specimens):
        levels = -0.004 * np.sin(np.arange(TICKS) / 500.0) ** 2
        cut = led(specimen, 2.0 * FEED, levels, UPRIGHT)
        state, own = cut.plant.states[0], cut.plant.descents[0]
        quiet = (cut.readings["jump"][1:] == 0.0) & (np.arange(1, TICKS) > 10)  # friction begins in the first ones
        steps.append(np.abs(np.diff(cut.readings["force"]))[quiet].max())
        at_once = led(specimen, 2.0 * FEED, levels, UPRIGHT, parameters=DescentParameters(response_time=TICK))
        sooner.append(at_once.plant.energy()["work"] / state["work"] - 1.0)
        cells = np.clip(np.floor(state["tip"] / SPACING + 0.5 - np.arange(len(own["floor"])) + 0.5), 0, 1) * SPACING
        cells[0] *= 0.5
        fracture = float((own["toughness"] * (own["surface"] - own["floor"]) * cells).sum())
        errors.append(state["fracture"] / fracture - 1.0)
        x, h = np.append(0.0, cut.readings["position"]), np.append(levels[0], levels)
        along, up = cut.readings["force"], -cut.vertical
        mean = 0.5 * (np.append(0.0, along[:-1]) + along)
        works.append(
            (np.sum(mean * np.diff(x)) + np.sum(0.5 * (np.append(0.0, up[:-1]) + up) * np.diff(h))) / state["work"]
            - 1.0
        )
    found = f"{100 * min(errors):+.2f} to {100 * max(errors):+.2f} %"
    worst = float(max(map(abs, errors)))
    yield Row(
        "fracture energy over R times the area of the floor, waving depth",
        found,
        "within 2 %",
        worst <= LEVEL_TOLERANCE,
    )
    found = f"{100 * min(works):+.2f} to {100 * max(works):+.2f} %"
    worst = float(max(map(abs, works)))
    yield Row("integral of both forces over the work, waving depth", found, "within 2 %", worst <= LEVEL_TOLERANCE)
    found = f"{100 * min(sooner):+.2f} to {100 * max(sooner):+.2f} %"
    worst = float(max(map(abs, sooner)))
    yield Row(
        "work where tissue responds every ms, not every 10, waving", found, "within 2 %", worst <= LEVEL_TOLERANCE
    )
    yield Row("largest step of the force along the cut without a run, waving depth", f"{1e3 * max(steps):.0f} mN")


def held_force_over_work(specimen: Specimen) -> float:
    """Return the vertical force at rest 2 mm above level 0, over the work of a raise from there by 50 um."""
    x = np.append(FEED, np.full(40, FEED[-1]))
    levels = 2e-3 * np.minimum(np.arange(len(x)) / TICKS, 1.0)
    held = led(specimen, x, levels, UPRIGHT)
    raised = led(specimen, np.append(x, np.full(20, x[-1])), np.append(levels, np.full(20, levels[-1] + 5e-5)), UPRIGHT)
    before, after = held.plant.energy(), raised.plant.energy()
    work = after["work"] - before["work"] - (after["friction"] - before["friction"])
    return float(held.vertical[-1] / (-work / 5e-5))


def check_layers(_: Sequence[Specimen]) -> Iterator[Row]:
    """Compare the stiffness of layered slabs with bricks, solved anew, at 15 tips and 16 depths from 1 mm on."""
    bricks = SlabsOfBricks()
    for layers in SLAB_LAYERS:
        errors = bricks.errors(layers, bricks.ratio(layers), LAYER_REACH)
        yield Row(f"K of a slab with {slab_name(layers)}, error beside bricks", size_of(errors))


CHECKS: dict[str, Callable[[Sequence[Specimen]], Iterator[Row]]] = {
    "level-zero": check_level_zero,
    "account": check_descent_account,
    "limits": check_limits,
    "bricks": check_layers,
}


def table(specimens: int, parts: Sequence[str]) -> Iterator[Row]:
    """Yield the rows of the chosen parts."""
    sampled = drawn(specimens)
    for part in parts:
        yield from CHECKS[part](sampled)


def markdown(specimens: int = 4) -> str:
    """Return the whole table as Markdown."""
    rows = [(row.what, row.found, row.promised) for row in table(specimens, list(CHECKS))]
    return markdown_table(("what", "found", "promised"), rows)


def main(argv: Sequence[str] | None = None) -> int:
    """Check and print; return 1 if a promise is not kept."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--specimens", type=int, default=4, metavar="N", help="default 4")
    parser.add_argument(
        "--only", nargs="+", choices=CHECKS, default=list(CHECKS), metavar="PART", help=", ".join(CHECKS)
    )
    arguments = parser.parse_args(argv)
    if arguments.specimens < 1:
        parser.error(f"--specimens {arguments.specimens} is less than 1")
    print(f"{Row('what', 'found', 'promised')} holds")
    kept = []
    for row in table(arguments.specimens, arguments.only):
        print(row, flush=True)
        kept.append(row.holds is not False)
    return int(not all(kept))


if __name__ == "__main__":
    sys.exit(main())
