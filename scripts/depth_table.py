"""Table of DepthCut-v1: scripts and the planner with truth on held-out specimens, and a picture of two of their cuts.

python scripts/depth_table.py                      500 specimens; writes runs/depth/depth.csv
python scripts/depth_table.py --specimens 100
python scripts/depth_table.py --print              the table of what is in runs/depth
python scripts/depth_table.py --picture FILE       floor of the cut, wanted depth and layer below, as a PNG
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cutenv.envs.depth_cut import DepthCutEnv
from cutenv.learning.evaluation import Contestant, evaluate
from cutenv.learning.result_tables import rows_of, write_csv
from cutenv.learning.seeds import TEST_SEEDS
from cutenv.learning.statistics import differences, summarise
from cutenv.policy.depth_planner import DepthPlanner
from cutenv.policy.depth_scripts import DEPTH_SCRIPTS

TABLE = Path("runs") / "depth" / "depth.csv"
KEYWORDS: dict[str, Any] = {"task": "depth", "specimen_class": "mixed"}
ORACLE = "planner with truth"
SCORES = ("return", "success", "mean_error_mm", "layer_mm", "peak_force_N", "time_s")


def measure(specimens: int, processes: int | None) -> list[dict[str, Any]]:
    """Return one row for each cut of every script and of the planner."""
    contestants = {name: Contestant(make()) for name, make in DEPTH_SCRIPTS.items()}
    contestants[ORACLE] = Contestant(DepthPlanner())
    return evaluate(contestants, TEST_SEEDS[:specimens], KEYWORDS, processes=processes, description="depth")


def table(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return the table as lines of Markdown, and below it what there is to gain."""
    values = {(row["policy"], row["score"]): row for row in summarise(rows)}
    names = sorted(dict.fromkeys(row["policy"] for row in rows), key=lambda name: -values[name, "return"]["mean"])
    lines = [
        "| policy | return | success | mean error of the depth | into the layer below | peak force | time |",
        "| --- | --- | --- | --- | --- | --- | --- |",
    ]
    for name in names:
        found = {score: values[name, score] for score in SCORES}
        whole = found["return"]
        lines.append(
            f"| {name} | {whole['mean']:.3f} [{whole['low_95']:.3f}, {whole['high_95']:.3f}] "
            f"| {100 * found['success']['mean']:.0f} % | {found['mean_error_mm']['mean']:.2f} mm "
            f"| {found['layer_mm']['mean']:.3f} mm | {found['peak_force_N']['mean']:.1f} N "
            f"| {found['time_s']['mean']:.1f} s |"
        )
    best = next(name for name in names if name != ORACLE)
    lead = next(
        row for row in differences(rows, ORACLE, ("return",)) if row["baseline"] == best and row["score"] == "return"
    )
    specimens = len({row["seed"] for row in rows})
    ends = {end: sum(row["end"] == end and row["policy"] == best for row in rows) for end in ("force_limit", "layer")}
    return [
        *lines,
        "",
        f"{specimens} held-out specimens of class mixed; mean [95 % interval]. The planner with truth leads the best "
        f"script, *{best}*, by {lead['mean']:.3f} [{lead['low_95']:.3f}, {lead['high_95']:.3f}]. The best script "
        f"meets the limit of force in {ends['force_limit']} cuts and that of the layer in {ends['layer']}.",
    ]


def kept() -> list[dict[str, Any]]:
    """Return the rows of the last measurement; SystemExit if there is none."""
    if not TABLE.is_file():
        raise SystemExit(f"{TABLE} is missing; run 'python scripts/depth_table.py' first.")
    texts = ("policy", "specimen_class", "end")
    return [{name: value if name in texts else float(value) for name, value in row.items()} for row in rows_of(TABLE)]


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
            x = np.arange(env.cutting.descents["cell"][0] + 1) * 0.5
            axis.plot(x, 1e3 * env.cutting.floor[: len(x)], color=colour, label=f"floor of the cut, {name}")
        along = np.arange(len(env.cutting.floor)) * 0.5
        axis.plot(along, 1e3 * env.cutting.depths["wanted"][0], "k--", lw=1.0, label="wanted depth")
        axis.axhspan(1e3 * info["truth"]["layer_m"], 25.0, color="tab:red", alpha=0.2, label="layer below, not seen")
        axis.set(ylim=(20.0, 0.0), xlim=(0.0, 100.0), ylabel="depth below the surface [mm]", title=wanted)
        axis.axvline(80.0, color="tab:green", lw=1.0, label="target")
    axes[0].legend(loc="lower left", fontsize=8)
    axes[1].set_xlabel("along the cut [mm]")
    figure.savefig(path, dpi=110)
    plt.close(figure)


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--specimens", type=int, default=500, metavar="N", help="number of specimens; default 500")
    parser.add_argument("--processes", type=int, metavar="N", help="number of processes; default one per core")
    parser.add_argument("--print", action="store_true", help="print the kept table without measuring again")
    parser.add_argument("--picture", type=Path, metavar="FILE", help="draw two cuts, and stop")
    arguments = parser.parse_args()
    if arguments.picture is not None:
        draw(arguments.picture)
        return
    if not arguments.print:
        TABLE.parent.mkdir(parents=True, exist_ok=True)
        write_csv(TABLE, measure(arguments.specimens, arguments.processes))
    print("\n".join(table(kept())))


if __name__ == "__main__":
    main()
