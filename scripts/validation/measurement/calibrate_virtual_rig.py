"""The measurement loop, step by step: cut virtual livers on a virtual rig, and recover their properties from records.

    python -m scripts.validation.measurement.calibrate_virtual_rig  84 cuts of six livers, about a minute

The protocol is the thesis's (sections 3.1, 5.1 and 6.2): seven speeds from 0.1 to 2.54 cm/s, 90 and 45 degrees, several
livers, every cut 4 inches forward and back again, force from a sensor with noise, delay and a resolution of 0.05 N.
The results from the records are compared with the properties of the livers.
"""

from __future__ import annotations

import argparse
import dataclasses
import itertools
import math
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from tqdm import tqdm

from cutenv._engine.randomness import generator
from cutenv.commands import cli
from cutenv.records import save
from cutenv.records.measurement.pooled_cuts import Variogram, cv_of, fit_variances, mean_field_variance
from cutenv.sim.plant import Leg, SimulatedPlant, run, to_trace
from cutenv.sim.tissue import Specimen, TissueDescription, draw_liver, load_description, measured_liver
from cutenv.sim.tissue.specimen import SPACING
from cutenv.sim.tissue.tables import table
from cutenv.sim.trace import Trace

INCH = 0.0254
SPEEDS = tuple(float(v) / 100.0 for v in table("5.6")["speed_cm_s"])
ANGLES_DEG = (90.0, 45.0)
RETURN_SPEED = 0.0127  # at least [m/s]: the way back shows friction at any speed, so no time is spent on it
DWELL = 0.2  # at either end [s]
SEED = 5  # of livers and sensor noise


def session(
    tissue: TissueDescription, livers: int, seed: int, speeds: Sequence[float] = SPEEDS
) -> list[tuple[Trace, Specimen]]:
    """Cut (step 1). Return records as a rig would have made them, and with each the truth, which is kept apart."""
    cuts = []
    protocol = list(itertools.product(range(livers), ANGLES_DEG, speeds))
    for number, (liver, angle_deg, speed) in enumerate(tqdm(protocol, desc="cutting", unit="cut", leave=False)):
        factor = draw_liver(generator(seed, liver), tissue)
        specimen = Specimen.draw(generator(seed, livers + number), tissue=tissue, liver_factor=factor)
        angle = math.radians(angle_deg)
        plant = SimulatedPlant(specimen, seed=seed, episode=number, angle=angle)
        forward = Leg(position=4 * INCH, speed=speed, angle=angle, dwell=DWELL)
        back = Leg(position=0.0, speed=max(speed, RETURN_SPEED), angle=angle, dwell=DWELL)
        facts = {"name": f"cut {number + 1}", "specimen": f"liver {liver + 1}", "rig": "virtual"}
        cuts.append((to_trace(plant, run(plant, [forward, back]), **facts), specimen))
    return cuts


def truth(tissue: TissueDescription, specimens: list[Specimen]) -> dict[str, float]:
    """Return the truth: the tissue's constants, and means and spreads of the very specimens that were cut."""
    n = round(4 * INCH / SPACING)
    places = np.arange(n) * SPACING
    modulus, resistance = ([getattr(s, name)[:n] for s in specimens] for name in ("modulus", "fracture_resistance"))
    along = [Variogram.of([places] * len(specimens), fields) for fields in (modulus, resistance)]
    within, _ = fit_variances(along, np.ones(len(specimens)), tissue.correlation_length)
    depths = [s.depth[:n] for s in specimens]
    means = np.array([np.average(R, weights=B) for R, B in zip(resistance, depths, strict=True)])
    between = np.log(means).var(ddof=1) - mean_field_variance(places, within[1], tissue.correlation_length)
    material = float(np.mean([E.mean() for E in modulus]))  # of these livers, by chance
    # Records give the local effective modulus of the material itself: its own modulus times the loading ratio.
    lines = {name: getattr(tissue, name) for name in ("intercept_90", "slope_90", "intercept_45", "slope_45")}
    return {
        "modulus": material,
        **{name: material * value / tissue.intercept_90 for name, value in lines.items()},
        "modulus_within_cut_cv": cv_of(within[0]),
        "correlation_length": tissue.correlation_length,
        "fracture_resistance": float(means.mean()),
        "fracture_between_cut_cv": cv_of(between),
        "fracture_within_cut_cv": cv_of(within[1]),
        "friction_share": sum(s.friction_per_depth for s in specimens) / float(means.sum()),
        "eta90": tissue.eta90,
        "edge_depth": tissue.edge_depth,
        "crown_depth": tissue.crown_depth,
        "rise_length": tissue.rise_length,
    }


def compare(tissue: TissueDescription, put_in: dict[str, float]) -> tuple[str, int]:
    """Compare results with the truth (step 4); return the table and the number of intervals that miss it."""
    assert tissue.calibration is not None
    units = {field.name: field.metadata.get("unit", "") for field in dataclasses.fields(tissue)}
    lines = [f"{'':25s} {'':6s} {'put in':>11s} {'found':>11s}  95 % interval"]
    missed = 0
    for each in tissue.calibration.evidence:
        if each.name not in put_in:
            continue
        mark, interval = "", ""
        if each.low is not None and each.high is not None:
            inside = each.low <= put_in[each.name] <= each.high
            missed += not inside
            mark, interval = "" if inside else "  MISS", f"{each.low:.4g} to {each.high:.4g}"
        found = getattr(tissue, each.name)
        unit = units[each.name].replace("1", "")
        lines.append(f"{each.name:25s} {unit:6s} {put_in[each.name]:11.4g} {found:11.4g}  {interval}{mark}".rstrip())
    return "\n".join(lines), missed


def main() -> int:
    """Cut, save, calibrate from the files alone, and compare."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--livers", type=int, default=6, help="each is cut 14 times")
    parser.add_argument("--out", type=Path, help="keep records, tissue and card there; default a temporary folder")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = arguments.out or Path(temporary)
        (folder / "records").mkdir(parents=True, exist_ok=True)
        liver = measured_liver()

        print(f"1. {arguments.livers} livers, drawn from pig liver as measured, are cut 14 times each.")
        cuts = session(liver, arguments.livers, SEED)

        print(f"2. The records go to {folder}/records; nothing else does.")
        files = []
        for trace, _ in tqdm(cuts, desc="saving", unit="file", leave=False):
            files.append(folder / "records" / f"{trace.metadata['name'].replace(' ', '_')}.parquet")
            save(trace, files[-1])

        print("3. cutenv calibrate reads them:\n")
        start = time.perf_counter()
        outputs = ["--out", str(folder / "tissue.json"), "--report", str(folder / "card.html")]
        outputs += ["--name", "virtual liver"]
        status = cli.main(["calibrate", *map(str, files), *outputs])
        if status:
            return status
        print(f"  {time.perf_counter() - start:.1f} s for {len(files)} cuts, reading and the card included")

        print("\n4. Compared with the true values:\n")
        text, missed = compare(load_description(folder / "tissue.json"), truth(liver, [s for _, s in cuts]))
        print(text)
        if arguments.out is None:
            print("\nThe records, the tissue and the card are deleted now; --out FOLDER keeps them.")
        print(
            f"\n{missed} of the intervals miss the true value. They describe how cuts scatter; eta has a bias of 0.01."
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
