"""Draw one cut above its force trace: assets/pictures/cut.png.

python -m scripts.drawings.cut
"""

from __future__ import annotations

import math

import gymnasium
import numpy as np

from cutenv.agents.policy import ConstantFeed
from cutenv.display.report import CutPicture, draw_cut
from scripts import ROOT

PICTURE = ROOT / "assets" / "pictures" / "cut.png"


def main() -> None:
    """Draw one cut by a script on measured liver, above its force trace."""
    env = gymnasium.make("cutenv/GentleCut-v1", specimen_class="liver", target_length=0.08)
    observation, _ = env.reset(seed=7)
    policy = ConstantFeed(speed=0.0127, angle=math.radians(75.0))
    policy.reset(np.random.default_rng(0))
    parts, ended = [], False
    while not ended:
        observation, _, ended, _, _ = env.step(policy(observation))
        parts.append(env.unwrapped.cutting.readings.copy())  # type: ignore[attr-defined]
    specimen = env.unwrapped.specimen  # type: ignore[attr-defined]
    cut = CutPicture(
        policy="constant feed",
        caption="",
        readings=np.concatenate(parts),
        depth=specimen.depth,
        target_length=0.08,
        force_limit_per_depth=1000.0,
    )
    draw_cut(PICTURE, cut, "1.27 cm/s and 75 degrees through a slice of liver, then stop and unload")


if __name__ == "__main__":
    main()
