"""Table of PathCut-v1: scripts and the planner with truth on held-out specimens, and a picture of two of their cuts.

python scripts/path_table.py                      500 specimens; writes runs/path/path.csv
python scripts/path_table.py --specimens 100
python scripts/path_table.py --print              the table of what is in runs/path
python scripts/path_table.py --picture FILE       line, way of the blade and cut from above, as a PNG
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from task_table import TaskTable

from cutenv.envs.path_cut import PathCutEnv
from cutenv.learning.seeds import TEST_SEEDS
from cutenv.policy.path_scripts import PATH_SCRIPTS
from cutenv.tissue.grid import SPACING

TABLE = TaskTable(
    task="path",
    errors=(
        ("mean_distance_mm", "mean distance to the line", "{:.2f} mm"),
        ("largest_distance_mm", "largest", "{:.2f} mm"),
        ("area_mm2", "area between", "{:.0f} mm²"),
    ),
    ends=(("force_limit", "the limit of force"), ("off_line", "that of the distance")),
)
_DRAWN = ("excision", "s")


def draw(path: Path) -> None:
    """Draw the cuts of two lines, by the best script and by a blade that follows the line."""
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(2, 1, figsize=(9.5, 5.2), sharex=True, layout="constrained")
    for axis, kind in zip(axes, _DRAWN, strict=True):
        env = PathCutEnv(line=kind, target_length=0.09)
        for name, colour in (("steer by force", "tab:blue"), ("blade on the line", "tab:orange")):
            policy = PATH_SCRIPTS[name]()
            observation, info = env.reset(seed=TEST_SEEDS[0], options={"episode": 0})
            policy.reset(np.random.default_rng(0))
            ended, places = False, []
            while not ended:
                observation, _, ended, _, info = env.step(policy(observation))
                places.append((info["truth"]["blade_x_m"], info["truth"]["blade_y_m"]))
            line, aside = env.cutting.line, env.cutting.cut_distance
            n = len(aside)
            x, y = line.x[:n] - aside * np.sin(line.angle[:n]), line.y[:n] + aside * np.cos(line.angle[:n])
            area = info["path"]["area_mm2"]
            axis.plot(1e3 * x, 1e3 * y, color=colour, lw=1.5, label=f"cut, {name}: {area:.0f} mm² from the line")
            axis.plot(*(1e3 * np.array(places).T), color=colour, lw=0.7, ls=":", label=f"blade, {name}")
        whole = slice(0, round(0.09 / SPACING) + 1)
        axis.plot(1e3 * line.x[whole], 1e3 * line.y[whole], "k--", lw=0.8, label="line")
        axis.set(ylabel="across the slab [mm]", title=f"a line of kind {kind}", aspect="equal")
        axis.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=7)
    axes[1].set_xlabel("along the slab, from the clamp [mm]")
    figure.savefig(path, dpi=110)
    plt.close(figure)


if __name__ == "__main__":
    TABLE.run(__doc__, draw)
