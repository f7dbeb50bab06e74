"""Describe another tissue in a file, and cut it."""

import dataclasses
from pathlib import Path

import gymnasium
import numpy as np

import cutenv  # registers the environments
from cutenv.agents.policy import ConstantFeed
from cutenv.sim.tissue import measured_liver

soft = dataclasses.replace(
    measured_liver(),
    name="softer",
    modulus=20e3,  # [Pa]; 38 kPa in pig liver
    fracture_resistance=120.0,  # [J/m2]; 247 in pig liver
)
Path("softer.json").write_text(soft.to_json())


def peak_force(**arguments: object) -> float:
    """Cut one specimen; return the greatest force [N]."""
    env = gymnasium.make("cutenv/GentleCut-v1", specimen_class="liver", target_length=0.08, **arguments)
    policy = ConstantFeed(speed=0.0127, angle=1.31)
    observation, _ = env.reset(seed=7)
    policy.reset(np.random.default_rng(0))
    peak, terminated = 0.0, False
    while not terminated:
        observation, _, terminated, _, _ = env.step(policy(observation))
        peak = max(peak, 5.0 * float(observation[3]))  # greatest force since the last decision; its scale is 5 N
    return peak


liver, softer = peak_force(), peak_force(tissue="softer.json")
print(f"peak force: liver {liver:.2f} N, softer tissue {softer:.2f} N")
assert 0.35 < softer / liver < 0.65  # it goes with the fracture resistance: 120/247 = 0.49
