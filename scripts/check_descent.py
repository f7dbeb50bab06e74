"""Check the cutting law where the blade also moves up and down: energy, limit cases, and layers against bricks.

    python scripts/check_descent.py                 4 specimens, and layers on bricks: some minutes
    python scripts/check_descent.py --only account limits --specimens 1

The table shows the results and what is promised; a line without a promise is a finding.  The exit status is 1 if a
promise is not kept.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
from adversarial_motions import FEED, MOTIONS, TICKS, UPRIGHT
from fit_layers import SlabsOfBricks, size_of, slab_name
from promises import Led, Row, account_rows, differing, run, share_row

from cutenv.cutting.descent import DescentParameters
from cutenv.cutting.dtypes import TICK
from cutenv.plant import DescendingPlant
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
            path = motion(np.random.default_rng(number))
            off, count = differing(led(specimen, path[0], 0.0, path[1], layers), specimen, *path)
            different, compared = different + off, compared + count
    what = f"readings at level 0 that differ from the law without it ({compared})"
    yield Row(what, str(different), "0", different == 0)


def check_descent_account(specimens: Sequence[Specimen]) -> Iterator[Row]:
    """Check the energy account under motions that no drive makes, along the cut and up and down."""

    def cuts() -> Iterator[tuple[Led, Any]]:
        for specimen in specimens:
            for k, motion in enumerate(MOTIONS.values()):
                for m, vertical in enumerate(VERTICAL.values()):
                    rng = np.random.default_rng((k, m))
                    positions, angles = motion(rng)
                    cut = led(specimen, positions, vertical(rng), angles, LAYERED)
                    yield cut, cut.plant.vertical_force

    yield from account_rows(cuts(), "residual of the account over the work or 1 mJ ({})", 0.0)


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
    ratio = stab.plant.vertical_force[-1] / expected
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
        along, up = cut.readings["force"], -cut.plant.vertical_force
        mean = 0.5 * (np.append(0.0, along[:-1]) + along)
        works.append(
            (np.sum(mean * np.diff(x)) + np.sum(0.5 * (np.append(0.0, up[:-1]) + up) * np.diff(h))) / state["work"]
            - 1.0
        )
    for what, shares in (
        ("fracture energy over R times the area of the floor, waving depth", errors),
        ("integral of both forces over the work, waving depth", works),
        ("work where tissue responds every ms, not every 10, waving", sooner),
    ):
        yield share_row(what, shares, LEVEL_TOLERANCE)
    yield Row("largest step of the force along the cut without a run, waving depth", f"{1e3 * max(steps):.0f} mN")


def held_force_over_work(specimen: Specimen) -> float:
    """Return the vertical force at rest 2 mm above level 0, over the work of a raise from there by 50 um."""
    x = np.append(FEED, np.full(40, FEED[-1]))
    levels = 2e-3 * np.minimum(np.arange(len(x)) / TICKS, 1.0)
    held = led(specimen, x, levels, UPRIGHT)
    raised = led(specimen, np.append(x, np.full(20, x[-1])), np.append(levels, np.full(20, levels[-1] + 5e-5)), UPRIGHT)
    before, after = held.plant.energy(), raised.plant.energy()
    work = after["work"] - before["work"] - (after["friction"] - before["friction"])
    return float(held.plant.vertical_force[-1] / (-work / 5e-5))


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


def main(argv: Sequence[str] | None = None) -> int:
    """Check and print; return 1 if a promise is not kept."""
    return run(__doc__, CHECKS, argv)


if __name__ == "__main__":
    sys.exit(main())
