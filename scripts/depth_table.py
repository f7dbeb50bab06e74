"""Table of DepthCut-v1: scripts and the planner with truth on held-out specimens, and a picture of two of their cuts.

python scripts/depth_table.py                      500 specimens; writes runs/depth/depth.csv
python scripts/depth_table.py --specimens 100
python scripts/depth_table.py --print              the table of what is in runs/depth
python scripts/depth_table.py --picture FILE       floor of the cut, wanted depth and layer below, as a PNG
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from task_table import TaskTable

from cutenv.envs.depth_cut import DepthCutEnv
from cutenv.learning.seeds import TEST_SEEDS
from cutenv.policy.depth_scripts import DEPTH_SCRIPTS

TABLE = TaskTable(
    task="depth",
    errors=(
        ("mean_error_mm", "mean error of the depth", "{:.2f} mm"),
        ("layer_mm", "into the layer below", "{:.3f} mm"),
    ),
    ends=(("force_limit", "the limit of force"), ("layer", "that of the layer")),
)


def draw(path: Path) -> None:
    """Draw the floor of two cuts, a ramp and a step, by the best script and by one depth held."""
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(2, 1, figsize=(8.0, 6.0), sharex=True, layout="constrained")
    for axis, wanted in zip(axes, ("ramp", "step"), strict=True):
        env = DepthCutEnv(wanted=wanted, target_length=0.08)
        for name, colour in (("depth by two forces", "tab:blue"), ("hold one depth", "tab:gray")):
            policy = DEPTH_SCRIPTS[name]()
            observation, info = env.reset(seed=TEST_SEEDS[0], options={"episode": 0})
            policy.reset(np.random.default_rng(0))
            ended = False
            while not ended:
                observation, _, ended, _, info = env.step(policy(observation))
            x = np.arange(env.cutting.motion["cell"][0] + 1) * 0.5
            axis.plot(x, 1e3 * env.cutting.floor[: len(x)], color=colour, label=f"floor of the cut, {name}")
        along = np.arange(len(env.cutting.floor)) * 0.5
        axis.plot(along, 1e3 * env.cutting.whole["wanted"][0], "k--", lw=1.0, label="wanted depth")
        axis.axhspan(1e3 * info["truth"]["layer_m"], 25.0, color="tab:red", alpha=0.2, label="layer below, not seen")
        axis.set(ylim=(20.0, 0.0), xlim=(0.0, 100.0), ylabel="depth below the surface [mm]", title=wanted)
        axis.axvline(80.0, color="tab:green", lw=1.0, label="target")
    axes[0].legend(loc="lower left", fontsize=8)
    axes[1].set_xlabel("along the cut [mm]")
    figure.savefig(path, dpi=110)
    plt.close(figure)


if __name__ == "__main__":
    TABLE.run(__doc__, draw)
