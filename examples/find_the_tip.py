"""Find the hidden crack tip in two ways: from the mean tissue, and by drawing the blade back."""

import gymnasium
import numpy as np

import cutenv  # registers the environments
from cutenv.agents.policy import TipEstimate
from cutenv.task.observation import OFFSETS, SCALES, to_action

UPRIGHT = np.pi / 2
env = gymnasium.make("cutenv/GentleCut-v1", specimen_class="liver", target_length=0.08)
errors = {"mean tissue": [], "probe": []}

for seed in range(10):
    estimate = TipEstimate()  # believes in the stiffness of the mean liver
    observation, info = env.reset(seed=seed)
    for _ in range(230):  # cut for 4.6 s
        observation, *_, info = env.step(to_action(0.0127, UPRIGHT))
        estimated = estimate(observation)
    tip = info["truth"]["tip_m"]  # only to compare: no policy sees it
    errors["mean tissue"].append(1e3 * abs(estimated - tip))

    felt = []
    for _ in range(100):  # draw back for 2 s at 1 cm/s: no crack grows, the force falls in a straight line
        observation, *_, info = env.step(to_action(-0.010, UPRIGHT))
        values = observation * SCALES + OFFSETS
        felt.append((values[4], values[0]))  # position [m], force [N]
    position, force = np.array(felt[10:]).T
    friction = force[-3:].mean()  # what remains, once the tip is passed
    falling = force > friction + 0.3
    stiffness, offset = np.polyfit(position[falling], force[falling] - friction, 1)
    errors["probe"].append(1e3 * abs(-offset / stiffness - info["truth"]["tip_m"]))

for way, found in errors.items():
    print(f"{way:12} off by {np.median(found):.2f} mm in the median, {max(found):.2f} mm at most")
assert np.median(errors["probe"]) < 0.3
assert np.median(errors["probe"]) < np.median(errors["mean tissue"])
