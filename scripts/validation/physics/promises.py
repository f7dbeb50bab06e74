"""Checks of promises on sampled specimens: rows of a table, the energy account of a motion, and a command line."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from cutenv.sim.cutting.dtypes import READING
from cutenv.sim.plant import DescendingPlant, SimulatedPlant, SteeredPlant
from cutenv.sim.tissue import Specimen
from scripts.tables import markdown_table

SEED, OTHER_SEEDS = 1, 1000  # of the livers and those with vessels; the first of the others
RESIDUAL, LEAST_WORK = 1e-12, 1e-3
"""Largest residual of the energy account over the work [1], or over 1 mJ where that is more."""


class Row(NamedTuple):
    """One line of the table; ``holds`` is None for a finding."""

    what: str
    found: str
    promised: str = ""
    holds: bool | None = None

    def __str__(self) -> str:
        mark = {True: "yes", False: "NO", None: ""}[self.holds]
        return f"{self.what:76s} | {self.found:20s} | {self.promised:15s} | {mark}".rstrip()


def drawn(count: int) -> list[Specimen]:
    """Sample specimens in turn: a liver, one with vessels, and one of another seed that may be either."""
    kinds = ("liver", "vascular", "mixed")
    return [
        Specimen.drawn(SEED if n % 3 < 2 else OTHER_SEEDS + n, n, specimen_class=kinds[n % 3]) for n in range(count)
    ]


class Led(NamedTuple):
    """A cut whose blade was led along a path."""

    plant: DescendingPlant | SteeredPlant
    readings: Any


def differing(cut: Led, specimen: Specimen, positions: Any, angles: Any) -> tuple[int, int]:
    """Count the numbers of a cut's readings that are not those of the law without a third axis, and all readings."""
    readings = SimulatedPlant(specimen, angle=float(np.ravel(angles)[0])).lead(positions, angles)
    return sum(int((cut.readings[name] != readings[name]).sum()) for name in READING.names or ()), readings.size


def account_rows(cuts: Iterable[tuple[Led, Any]], what: str, least: float) -> Iterator[Row]:
    """Check the energy account of cuts, each with its force of the third axis; no part is less than ``least`` [J]."""
    worst, lowest, gained, paths = 0.0, 0.0, math.inf, 0
    finite = monotone = True
    for cut, force in cuts:
        energy = cut.plant.energy()
        worst = max(worst, abs(energy["residual"]) / max(abs(energy["work"]), LEAST_WORK))
        lowest = min(lowest, *(energy[name] for name in ("loss", "fracture", "friction", "stored")))
        gained = min(gained, energy["work"] - energy["friction"] - energy["stored"])
        finite &= bool(np.isfinite(cut.readings["force"]).all() and np.isfinite(force).all())
        monotone &= bool((np.diff(cut.readings["tip"]) >= 0.0).all())
        paths += 1
    yield Row(what.format(paths), f"{worst:.1e}", f"{RESIDUAL:.0e}", worst <= RESIDUAL)
    yield Row("least work beyond friction and what is stored [J]", f"{gained:.1e}", "not negative", gained >= -1e-12)
    yield Row(
        "least of fracture, friction, loss and what is stored [J]", f"{lowest:g}", "not negative", bool(lowest >= least)
    )
    yield Row("forces finite, tip never backwards", f"{finite}, {monotone}", "True, True", finite and monotone)


def share_row(what: str, shares: Sequence[float], most: float) -> Row:
    """Return the row of shares of which none may be further from 0 than ``most``, which is 2 %."""
    worst = float(max(map(abs, shares)))
    return Row(what, f"{100 * min(shares):+.2f} to {100 * max(shares):+.2f} %", "within 2 %", worst <= most)


Checks = Mapping[str, Callable[[Sequence[Specimen]], Iterator[Row]]]  # rows of each part, of sampled specimens


def markdown(checks: Checks, specimens: int) -> str:
    """Return the whole table as Markdown."""
    sampled = drawn(specimens)
    rows = [(row.what, row.found, row.promised) for check in checks.values() for row in check(sampled)]
    return markdown_table(("what", "found", "promised"), rows)


def run(about: str | None, checks: Checks, draw: Callable[[Path], None] | None = None) -> int:
    """Run the command line of a script that is described by ``about``; return 1 if a promise is not kept."""
    parser = argparse.ArgumentParser(description=about, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--specimens", type=int, default=4, metavar="N", help="default 4")
    parser.add_argument("--only", nargs="+", choices=checks, default=[*checks], metavar="PART", help=", ".join(checks))
    if draw is not None:
        parser.add_argument("--picture", type=Path, metavar="FILE", help="draw a cut into a PNG or SVG instead")
    arguments = parser.parse_args()
    if arguments.specimens < 1:
        parser.error(f"--specimens {arguments.specimens} is less than 1")
    if draw is not None and arguments.picture is not None:
        draw(arguments.picture)
        return 0
    print(f"{Row('what', 'found', 'promised')} holds")
    sampled, kept = drawn(arguments.specimens), []
    for part in arguments.only:
        for row in checks[part](sampled):
            print(row, flush=True)
            kept.append(row.holds is not False)
    return int(not all(kept))
