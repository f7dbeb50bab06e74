"""Check the physics on sampled specimens: stiffness, reloading, energy and sampling.

    python -m scripts.validation.physics.straight                        30 specimens, 10,000 draws: about a minute
    python -m scripts.validation.physics.straight --specimens 3 --only stiffness account

A third of the specimens are livers, a third have vessels, a third come from other seeds.  The table shows the results
and what is promised; a line without a promise is a finding.  The exit status is 1 if a promise is not kept.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cutenv._engine.jit import njit
from cutenv._engine.randomness import generator
from cutenv.sim.cutting.dtypes import READING, TICK
from cutenv.sim.cutting.motion import STRAIGHT
from cutenv.sim.cutting.simulate import account_one, follow
from cutenv.sim.plant import SimulatedPlant
from cutenv.sim.tissue import CutModel, Specimen
from cutenv.sim.tissue.slab import ROWS, row_means
from cutenv.sim.tissue.specimen import N_POINTS, SPACING
from scripts.validation.physics.adversarial_motions import INCLINED, MOTIONS, UPRIGHT
from scripts.validation.physics.promises import LEAST_WORK, RESIDUAL, SEED, Row, run

Array = NDArray[np.float64]

STIFFNESS = 0.01
"""Largest relative error of K against the finite-element model [1]."""
SPEEDS = (0.001, 0.0127, 0.0254)  # [m/s]
TURNS = (0.03, 0.035, 0.04, 0.045, 0.05)  # where the blade is drawn back to the clamp and returns [m]
RELOAD = 0.0005
"""Largest relative change of the force on return, against that when the blade was drawn back [1]."""
FURTHEST = 0.10
"""Largest length of the cuts [m]."""
KEYS = 10_000
"""Specimens drawn to see that none is refused."""


def check_stiffness(specimens: Sequence[Specimen]) -> Iterator[Row]:
    """Compare K(a), cut through, with ``CutModel`` for the same moduli of the rows of elements, at all 301 points."""
    places, errors = np.arange(N_POINTS) * SPACING, []
    for specimen in specimens:
        through = dataclasses.replace(specimen, depth=np.full(N_POINTS, specimen.thickness))
        rows, model = row_means(specimen.modulus), specimen.cut_model()
        moduli = np.tile(rows / rows.mean(), model.n_elements // ROWS)
        full = CutModel(model.element, model.formulation, model.poisson, relative_modulus=moduli)
        expected = np.asarray(full.stiffness(places)) * rows.mean() * specimen.thickness
        errors.append(through.stiffness() / expected - 1.0)
    low, high = np.min(errors), np.max(errors)
    what, found = f"K(a), cut through, over CutModel's - 1 ({len(errors)})", f"{100 * low:+.3f} to {100 * high:+.3f} %"
    yield Row(what, found, f"within {100 * STIFFNESS:g} %", bool(max(-low, high) <= STIFFNESS))


def reload_ratios(specimen: Specimen, speed: float, angle: float) -> list[tuple[float, bool]]:
    """Return the elastic force on return to each of :data:`TURNS` over the one before, and whether a crack just ran."""
    plant = SimulatedPlant(specimen, angle=angle)
    state = plant.states[0]

    def felt_at(place: float) -> float:
        count = max(1, math.ceil(abs(place - state.blade) / (speed * TICK)))
        return float(plant.lead(np.linspace(state.blade, place, count + 1)[1:], angle)["elastic_force"][-1])

    found = []
    for place in TURNS:
        before, ran = felt_at(place), bool(state.running)
        felt_at(0.0)
        found.append((1.0 + (felt_at(place) - before) / max(before, 1e-3), ran))  # a run may leave no force at all
    return found


def check_reloading(specimens: Sequence[Specimen]) -> Iterator[Row]:
    """Check that unloading and reloading are elastic: the force recovers where the blade was drawn back."""
    ratios: dict[str, list[float]] = {}
    for angle, speed in itertools.product((UPRIGHT, INCLINED), SPEEDS):
        for ratio, ran in itertools.chain(*(reload_ratios(specimen, speed, angle) for specimen in specimens)):
            loading = f"while loading, {100 * speed:g} cm/s, {math.degrees(angle):.0f} degrees"
            ratios.setdefault("in the update of a crack's run" if ran else loading, []).append(ratio)
    for when, found in sorted(ratios.items()):
        low, high = np.min(found), np.max(found)
        what, shown = f"force on coming back, drawn back {when} ({len(found)})", f"{low:.6f} to {high:.6f}"
        yield Row(what, shown, "1.000", bool(max(1.0 - low, high - 1.0) <= RELOAD))


_follow, _account = follow(STRAIGHT), account_one(STRAIGHT)


@njit
def _lead(cuts: Any, shared: Any, path: Array, readings: Any, shares: Array) -> None:
    """Move a blade; fill ``shares`` with the residual over the work, or over 1 mJ, after each update."""
    for i in range(len(path)):
        _follow(cuts, shared, path[i : i + 1], TICK, readings, shares[:0])
        energy = _account(cuts)
        shares[i] = abs(energy.residual) / max(energy.work, LEAST_WORK)


def worst_residual(specimen: Specimen, motion: str, episode: int) -> float:
    """Return the largest residual of the energy account during a motion, over the work or 1 mJ [1]."""
    positions, angles = MOTIONS[motion](generator(SEED, episode))
    path, shares = np.stack(np.broadcast_arrays(positions, angles, 0.0), axis=-1), np.zeros(len(positions))
    plant = SimulatedPlant(specimen, angle=path[0, 1])
    _lead(plant.cuts, plant.shared, path, np.zeros(1, READING), shares)
    return float(shares.max())  # NaN if any is


def check_account(specimens: Sequence[Specimen]) -> Iterator[Row]:
    """Check work = stored + fracture + friction + loss + ledger under motions that no drive makes."""
    for motion in MOTIONS:
        worst = float(np.max([worst_residual(specimen, motion, n) for n, specimen in enumerate(specimens)]))
        yield Row(f"residual of the energy: {motion}", f"{worst:.1e}", f"at most {RESIDUAL:.0e}", worst <= RESIDUAL)


def runs_out_of_energy(specimen: Specimen, stiffness: Array) -> bool:
    """Return True if somewhere up to 10 cm no force lets a crack run on.

    Growth ahead of a blade at rest under the force F releases F - K' F^2/(2 K^2) per length, at most K^2/(2 K'),
    and takes R B.
    """
    last = round(FURTHEST / SPACING)
    K, rise = stiffness[:last], np.diff(stiffness)[:last] / SPACING
    return bool(np.any(rise / K * (specimen.fracture_force()[:last] / K) > 0.5))


def check_drawing(_: Sequence[Specimen]) -> Iterator[Row]:
    """Check that every key gives a specimen; count those with a position where no crack can run on."""
    drawn_of: Counter[str] = Counter()
    stopping: Counter[str] = Counter()
    for episode in range(KEYS):
        try:
            specimen = Specimen.drawn(SEED, episode, specimen_class="mixed")
        except ValueError:
            continue
        stiffness = specimen.stiffness()
        along = np.array([stiffness, specimen.modulus, specimen.fracture_resistance, specimen.depth])
        if np.all(np.isfinite(along)) and np.all(along > 0.0):
            drawn_of[specimen.specimen_class] += 1
            stopping[specimen.specimen_class] += runs_out_of_energy(specimen, stiffness)
    came = drawn_of.total()
    yield Row("keys that give a specimen, finite and positive everywhere", f"{came} of {KEYS}", "all", came == KEYS)
    for kind, count in sorted(drawn_of.items()):
        share = f"{stopping[kind]} of {count}, {100 * stopping[kind] / count:.2f} %"
        yield Row(f"  of class {kind}: a place where a crack finds no energy to run on", share)


CHECKS = {
    "stiffness": check_stiffness,
    "reloading": check_reloading,
    "account": check_account,
    "drawing": check_drawing,
}
"""Parts of the table."""


def main(argv: Sequence[str] | None = None) -> int:
    """Check and print; return 1 if a promise is not kept."""
    return run(__doc__, CHECKS, argv, specimens=30)


if __name__ == "__main__":
    sys.exit(main())
