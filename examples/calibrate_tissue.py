"""Calibrate a tissue from recorded cuts: here from twelve virtual ones, so that the truth is known."""

import math
from pathlib import Path

import gymnasium
import numpy as np

import cutenv  # registers the environments
from cutenv.records.measurement import calibrate
from cutenv.sim.plant import Leg, SimulatedPlant, run, to_trace
from cutenv.sim.tissue import Specimen

traces, moduli, resistances = [], [], []
for number in range(12):
    angle, speed = math.radians((90.0, 45.0)[number % 2]), (0.004, 0.0127, 0.0254)[number % 3]
    specimen = Specimen.draw(np.random.default_rng((1, number)))  # another liver each
    plant = SimulatedPlant(specimen, seed=1, episode=number, angle=angle)
    forward = Leg(position=0.1, speed=speed, angle=angle, dwell=0.2)
    back = Leg(position=0.0, speed=0.0254, angle=angle, dwell=0.2)  # past the tip: shows friction
    traces.append(to_trace(plant, run(plant, [forward, back]), specimen=f"liver {number}"))
    moduli.append(specimen.modulus[:200].mean())
    resistances.append(specimen.fracture_resistance[:200].mean())

tissue = calibrate(traces, name="my tissue", resamples=0)  # resamples=400 adds 95 % intervals
Path("my_tissue.json").write_text(tissue.to_json())
print(f"modulus:             put in {np.mean(moduli) / 1e3:.1f} kPa, found {tissue.modulus / 1e3:.1f} kPa")
print(f"fracture resistance: put in {np.mean(resistances):.0f} J/m2, found {tissue.fracture_resistance:.0f} J/m2")
print(f"friction share:      put in 0.20, found {tissue.friction_share:.2f}")

assert abs(tissue.modulus / np.mean(moduli) - 1.0) < 0.15
assert abs(tissue.fracture_resistance / np.mean(resistances) - 1.0) < 0.1
assert abs(tissue.friction_share - 0.2) < 0.02

env = gymnasium.make("cutenv/GentleCut-v1", tissue="my_tissue.json")  # specimens of this tissue
env.reset(seed=0)
