"""Check the cutting law where the blade also moves up and down: energy, limit cases, and layers against bricks.

    python -m scripts.validation.physics.descent                 4 specimens, and layers on bricks: some minutes
    python -m scripts.validation.physics.descent --only account limits --specimens 1
    python -m scripts.validation.physics.descent --slice-push
        forces on an edge that is pressed and drawn, beside the closed form

The table shows the results and what is promised; a line without a promise is a finding.  The exit status is 1 if a
promise is not kept.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
import sys
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np

from cutenv.sim.cutting.descent import DescentParameters
from cutenv.sim.cutting.dtypes import TICK
from cutenv.sim.plant import DescendingPlant
from cutenv.sim.tissue import Layers, Specimen, measured_liver
from cutenv.sim.tissue.layers import LAYER_REACH
from cutenv.sim.tissue.specimen import SPACING
from scripts.derivations.layers import SlabsOfBricks, size_of, slab_name
from scripts.tables import markdown_table
from scripts.validation.physics import promises
from scripts.validation.physics.adversarial_motions import FEED, MOTIONS, TICKS, UPRIGHT
from scripts.validation.physics.promises import Led, Row, account_rows, differing, run, share_row

LAYERED = Layers(capsule_thickness=5e-4, capsule_toughness=8.0, boundary=0.01, deep_toughness=5.0, deep_modulus=2.0)
SLAB_LAYERS = (  # layers whose stiffness is compared with bricks; the fit of their reach has not seen them
    Layers(capsule_thickness=0.5e-3, capsule_modulus=10.0),
    Layers(boundary=0.008, deep_modulus=2.0),
    Layers(boundary=0.008, deep_modulus=0.3),
    Layers(boundary=0.005, deep_modulus=5.0),
    Layers(boundary=0.015, deep_modulus=5.0),
)
VERTICAL: dict[str, Callable[[np.random.Generator], Any]] = {  # one level each millisecond [m], by name
    "white jitter of 1 mm": lambda rng: rng.normal(0.0, 1e-3, TICKS),
    "5 mm up and down each millisecond": lambda rng: np.where(np.arange(TICKS) % 2 == 0, 0.0, -0.005),
    "anywhere at once": lambda rng: rng.uniform(-0.03, 0.03, TICKS),
    "steadily down": lambda rng: -3e-6 * np.arange(TICKS),
    "pumping at 25 Hz": lambda rng: -2e-3 * (1.0 + np.sin(2.0 * math.pi * 25e-3 * np.arange(TICKS))),
    "steps of 1e-12 m": lambda rng: -0.004 - 1e-12 * np.arange(TICKS),
}

_LEVEL, _DESCENT = 0.016, 0.0015  # at which a pressed blade begins [m], and how fast it goes down [m/s]
XIS = (0.0, 0.25, 0.5, 1.0, 2.0, 4.0, 8.0)  # slice-push ratios: drawn over pressed length [1]

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
    return float((held.plant.vertical_force[-1] - held.plant.descents["grip"][0]) / (-work / 5e-5))


def check_friction(specimens: Sequence[Specimen]) -> Iterator[Row]:
    """Check that friction is one vector: a tremble, a blade that is drawn and raised, and commands with noise."""
    feed = np.append(FEED, np.full(TICKS, FEED[-1]))
    smallest, apart = 0.0, []
    for specimen in specimens:
        for size in (1e-8, 1e-4):
            tremble = np.append(0.0 * FEED, size * np.sin(2.0 * math.pi * 25e-3 * np.arange(TICKS)))
            down = led(specimen, feed, tremble, UPRIGHT).plant.vertical_force[TICKS + 200 :]
            along = led(specimen, feed + tremble, 0.0 * feed, UPRIGHT).readings["force"][TICKS + 200 :]
            if size == 1e-8:
                smallest = max(smallest, float(np.ptp(down)))
            else:
                apart.append(float(abs(np.diff(down)).max() / abs(np.diff(along)).max() - 1.0))
    what = "vertical force of a tremble of 10 nm at 25 Hz, peak to peak"
    yield Row(what, f"{1e3 * smallest:.2f} mN", "10 mN", smallest <= 0.01)
    what = "largest step in 1 ms of a tremble of 0.1 mm down, over that along the cut"
    yield Row(what, f"{1.0 + min(apart):.2f} to {1.0 + max(apart):.2f}", "1.0 within 0.1", max(map(abs, apart)) <= 0.1)
    drawn = 2.0 * FEED
    grips = []
    for specimen in specimens:
        rising = np.maximum(0.0, 1e-8 * (np.arange(TICKS) - 1000.0))
        grips.append(abs(float(led(specimen, drawn, rising, UPRIGHT).plant.descents["grip"][0])))
    what = "vertical friction of a blade drawn at 20 mm/s and raised at 0.01 mm/s"
    yield Row(what, f"{1e3 * max(grips):.2f} mN", "2 mN", max(grips) <= 0.002)
    for noise in (1e-4, 5e-4, 2e-3):
        rises = [_scatter(specimen, noise) / _scatter(specimen, 0.0) - 1.0 for specimen in specimens]
        most = 0.05 if noise == 1e-4 else math.inf
        what = f"rise of the vertical force's scatter by descent commands with noise of {1e3 * noise:g} mm/s"
        shown = f"{100 * min(rises):+.1f} to {100 * max(rises):+.1f} %"
        yield Row(what, shown, "" if most == math.inf else "5 %", None if most == math.inf else max(rises) <= most)


def _scatter(specimen: Specimen, noise: float) -> float:
    """Return the standard deviation of the vertical force [N] of a cut at 1 cm/s under commands with noise [m/s]."""
    rng, plant = np.random.default_rng(0), DescendingPlant(specimen, angle=UPRIGHT)
    felt = []
    for _ in range(300):
        plant.advance(0.01, UPRIGHT, 20, float(rng.normal(0.0, noise)))
        felt.append(plant.vertical_force.copy())
    return float(np.concatenate(felt).std())


def check_pressing(specimens: Sequence[Specimen]) -> Iterator[Row]:
    """Check the work of the reported forces against the account, on a floor that does not yield."""
    tough = Layers(boundary=0.012, deep_toughness=30.0)
    for friction in (0.0, None):
        gaps = []
        for specimen, (length, depth) in itertools.product(specimens, ((0.004, 0.002), (0.001, 0.002))):
            tissue = specimen if friction is None else dataclasses.replace(specimen, friction_per_depth=friction)
            gaps.append(_late_loop(DescendingPlant(tissue, layers=tough, angle=UPRIGHT), length, depth))
        what = "reported work less the account, {}, over the most stored: rectangles of 4 x 2 and 1 x 2 mm pressed down"
        worst = max(gaps, key=abs)
        named = "without friction" if friction == 0.0 else "with friction"
        yield Row(what.format(named), f"{100 * worst:+.2f} %", "1 %", bool(abs(worst) <= 0.01))


def _late_loop(plant: DescendingPlant, length: float, depth: float) -> float:
    """Return work by the forces less that of the account, of the sixth loop, over the most that is stored [1]."""
    readings = plant.lead(FEED, UPRIGHT, 0.0 * FEED)
    x, h, along, up = float(FEED[-1]), 0.0, float(readings["force"][-1]), float(plant.vertical_force[-1])
    told = stored = before = 0.0
    ways = np.arange(1, 401) / 400.0
    for loop in range(6):
        told, before = 0.0, plant.energy()["work"] if loop == 5 else before
        for ahead, fall in ((0.0, depth), (length, 0.0), (0.0, -depth), (-length, 0.0)):
            readings = plant.lead(x + ahead * ways, UPRIGHT, h - fall * ways)
            forces, ups = np.append(along, readings["force"]), np.append(up, plant.vertical_force)
            told += float((0.5 * (forces[1:] + forces[:-1])).mean() * ahead)
            told += float((0.5 * (ups[1:] + ups[:-1])).mean() * fall)
            x, h, along, up = x + ahead, h - fall, float(forces[-1]), float(ups[-1])
            stored = max(stored, plant.energy()["stored"])
    return (told - (plant.energy()["work"] - before)) / stored


def slice_push() -> str:
    """Return the forces on a blade that goes down while it is drawn, beside the closed form, as a Markdown table.

    The tissue is uniform; means are taken from 6 to 14 mm below where the blade began to go down.
    """
    specimen = Specimen.homogeneous(modulus=38e3, fracture_resistance=211.0, depth=0.02, tissue=measured_liver())
    rows = []
    for xi in XIS:
        bed, drag = _pressed_and_drawn(dataclasses.replace(specimen, friction_per_depth=0.0), xi)[:2]
        grip = _pressed_and_drawn(specimen, xi)[2]
        closed = 1.0 / (1.0 + xi**2), xi / (1.0 + xi**2), 1.0 / math.sqrt(1.0 + xi**2)
        pairs = zip((bed, drag, grip), closed, strict=True)
        rows.append((f"{xi:g}", *(f"{each:.3f}" for pair in pairs for each in pair)))
    heading = "slice-push ratio", "down, over R w", "1/(1 + xi^2)", "along, over R w", "xi/(1 + xi^2)"
    return markdown_table((*heading, "friction down, over its size", "1/sqrt(1 + xi^2)"), rows)


def _pressed_and_drawn(specimen: Specimen, xi: float) -> tuple[float, float, float]:
    """Return the mean forces of floor and slicing over R w, and friction downwards over its size [1]."""
    plant = DescendingPlant(specimen, angle=UPRIGHT, level=_LEVEL)
    plant.lead(2.0 * FEED[:1000], UPRIGHT, _LEVEL)
    x = float(2.0 * FEED[999])
    if xi == 0.0:  # a stab behind the tip, which does not load it
        x = 0.5 * x
        plant.lead(np.linspace(2.0 * x, x, 1000), UPRIGHT, _LEVEL)
    down = _DESCENT * TICK * np.arange(1, 11)
    found = []
    for fallen in np.arange(0.0, 0.014, down[-1]):
        plant.lead(x + xi * (fallen + down), UPRIGHT, _LEVEL - (fallen + down))
        own, cut = plant.descents[0], plant.cuts[0]
        full = (
            cut["laws"][0]["friction_per_depth"] * plant.profiles[0]["depth"][round(plant.states[0]["blade"] / SPACING)]
        )
        if fallen > 0.006:
            wide = own["toughness"][0] * own["edge_length"]
            found.append((own["bearing"] / wide, own["drag"] / wide, own["grip"] / full if full else 0.0))
    bed, drag, grip = np.mean(found, axis=0)
    return float(bed), float(drag), float(grip)


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
    "friction": check_friction,
    "pressing": check_pressing,
    "bricks": check_layers,
}


def markdown() -> str:
    """Return the table of the page."""
    return promises.markdown(CHECKS, 4)


if __name__ == "__main__":
    if sys.argv[1:] == ["--slice-push"]:
        print(slice_push())
    else:
        sys.exit(run(__doc__, CHECKS))
