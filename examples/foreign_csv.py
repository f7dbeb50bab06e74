"""Import a table that another program wrote: semicolons, decimal commas, millinewtons, an offset, lines above."""

from pathlib import Path

import numpy as np

from cutenv.records import ColumnMap, load_foreign
from cutenv.records.measurement import estimate_fracture_resistance
from cutenv.sim.plant import Leg, SimulatedPlant, run, to_trace
from cutenv.sim.tissue import Specimen

specimen = Specimen.homogeneous(modulus=38e3, fracture_resistance=240.0, depth=0.02)
plant = SimulatedPlant(specimen)
legs = [Leg(position=0.0, speed=0.01, dwell=1.0), Leg(position=0.06, speed=0.0127), Leg(position=0.0, speed=0.0127)]
trace = to_trace(plant, run(plant, legs))

offset = 0.350  # [N] of a sensor that was not tared
lines = ["Versuch 12; Leber", "", "Zeit [s];Kraft X [mN];Weg [mm]"]
for t, force, x in zip(trace.time, trace.force, trace.position, strict=True):
    lines.append(f"{t:.3f};{1e3 * (offset - force):.1f};{1e3 * x:.4f}".replace(".", ","))  # counted the other way
Path("foreign.csv").write_text("\n".join(lines), encoding="latin-1")

mapping = ColumnMap.parse(
    ["time=Zeit [s]", "force=-Kraft X [mN]", "position=Weg [mm]", "angle=90deg", "depth=20mm"],  # as for --map
)
imported = load_foreign("foreign.csv", mapping)
for note in imported.notes:
    print(note)
(cut,) = imported.sound
found = estimate_fracture_resistance(cut)
print(f"fracture resistance: {found.corrected:.0f} J/m2 (put in: 240)")
assert np.isclose(found.corrected, 240.0, rtol=0.05)
