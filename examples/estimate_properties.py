"""Measure modulus and fracture resistance from a recorded cut, and get back what was put in."""

import numpy as np

from cutenv.records.measurement import estimate_fracture_resistance, estimate_local_effective_moduli
from cutenv.sim.plant import Leg, SimulatedPlant, run, to_trace
from cutenv.sim.tissue import Specimen

specimen = Specimen.homogeneous(modulus=51e3, fracture_resistance=211.0, depth=0.02)
plant = SimulatedPlant(specimen)
readings = run(plant, [Leg(position=0.08, speed=0.0127), Leg(position=0.0, speed=0.0127)])  # forth and back
trace = to_trace(plant, readings)  # what a rig would have recorded

moduli = estimate_local_effective_moduli(trace, specimen.cut_model())
resistance = estimate_fracture_resistance(trace)
print(f"local effective modulus: {np.median(moduli.modulus) / 1e3:.1f} kPa (Table 5.6: 39 kPa at 1.27 cm/s)")
print(f"fracture resistance: {resistance.corrected:.0f} J/m2 (put in: 211), apparent {resistance.apparent:.0f} J/m2")

assert abs(np.median(moduli.modulus) / 38.5e3 - 1.0) < 0.02
assert abs(resistance.corrected / 211.0 - 1.0) < 0.03
