"""Put blade wear into series of virtual cuts, measure them as records, and print what is found beside what was put in.

    python -m scripts.validation.measurement.wear_series                      the table: some minutes
    python -m scripts.validation.measurement.wear_series --series 3 --json runs/wear.json

A series is cuts of 80 mm at 1.27 cm/s with a return stroke, one after the other by one blade, each in its own
specimen, with the noise of force and depth of the environments.  In liver, cuts differ by half besides; in a block of
one material ("uniform") they do not.  A cut whose tip stays behind in its first half is left out, as in a lab.
"""

from __future__ import annotations

import argparse
import itertools
import math
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from cutenv.envs.constants import Knowledge
from cutenv.records.measurement import estimate_fracture_resistance, fit_wear
from cutenv.records.measurement.wear import without_friction
from cutenv.sim.plant import Leg, SimulatedPlant, run, to_trace
from cutenv.sim.tissue import Specimen
from cutenv.sim.tissue.specimen import BladeWear
from scripts.tables import keep_json

DEFAULT = Path("runs") / "wear.json"
LENGTH = 0.08  # length of each cut [m]
SPEED = 0.0127  # speed of each cut [m/s]
WEARS = (0.0, 0.1, 0.25, 0.5)  # rises of R put in [1/m]: none, and the assumed range
CUTS = {"liver": 36, "uniform": 8}  # number of cuts of a series, by class of specimens


def series(specimen_class: str, wear: float, number: int) -> tuple[list[float], list[float]]:
    """Return measured R without friction [J/m2] of every cut of a series, and the length cut before its middle [m]."""
    found, middles, used = [], [], 0.0
    for cut in range(CUTS[specimen_class]):
        seed, blade = 1000 + number, BladeWear(blade_wear=wear, blade_used=used)
        specimen = blade.of(Specimen.drawn(seed, cut, specimen_class=specimen_class))
        depth = Knowledge().measure_depth(specimen.depth, seed, cut)
        plant = SimulatedPlant(specimen, depth=depth, seed=seed, episode=cut)
        legs = [Leg(position=place, speed=SPEED, angle=math.pi / 2, dwell=0.2) for place in (LENGTH, 0.0)]
        measured = estimate_fracture_resistance(to_trace(plant, run(plant, legs)))
        if measured.cut_length > 0.5 * LENGTH:
            found.append(without_friction(measured))
            middles.append(used + 0.5 * measured.cut_length)
        used += measured.cut_length
    return found, middles


def row(specimen_class: str, wear: float, count: int) -> dict[str, Any]:
    """Return what is found in ``count`` series with a wear put in: means, and how often the interval held it."""
    fits = [fit_wear(*series(specimen_class, wear, number)) for number in range(count)]
    return {
        "specimens": specimen_class,
        "cuts": CUTS[specimen_class],
        "series": count,
        "put_in_per_m": wear,
        "found_per_m": float(np.mean([fit.wear for fit in fits])),
        "low_per_m": float(np.mean([fit.low for fit in fits])),
        "high_per_m": float(np.mean([fit.high for fit in fits])),
        "held": sum(fit.low <= wear <= fit.high for fit in fits),
        "seen": sum(fit.seen for fit in fits),
    }


def table(kept: dict[str, Any]) -> str:
    """Return the rows as a table of Markdown."""
    head = ("specimens", "cuts", "put in [1/m]", "found [1/m]", "95 % interval [1/m]", "interval holds it", "wear seen")
    lines = [f"| {' | '.join(head)} |", "| --- | ---: | ---: | ---: | ---: | ---: | ---: |"]
    for each in kept["rows"]:
        found, low, high = (round(each[f"{name}_per_m"], 2) + 0.0 for name in ("found", "low", "high"))
        cells = [
            each["specimens"], f"{each['cuts']}", f"{each['put_in_per_m']:g}", f"{found:.2f}",
            f"{low:.2f} to {high:.2f}",
            f"{each['held']} of {each['series']}", f"{each['seen']} of {each['series']}",
        ]  # fmt: skip
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--series", type=int, default=20, metavar="N", help="series of each row; default 20")
    parser.add_argument("--json", type=Path, metavar="FILE", help=f"keep the rows there; the page has {DEFAULT}")
    arguments = parser.parse_args()
    if arguments.series < 1:
        parser.error(f"--series {arguments.series}: give 1 or more.")
    pairs = tqdm(list(itertools.product(CUTS, WEARS)), desc="wear", unit="row")
    found = {"rows": [row(specimen_class, wear, arguments.series) for specimen_class, wear in pairs]}
    print(table(found))
    if arguments.json is not None:
        keep_json(arguments.json, found)
