"""Compare cutenv/FreeCut-v1, whose elements are solved as the cut opens, with cutenv/PathCut-v1, and measure its rate.

    python -m scripts.validation.physics.free_cut  20 drawn lines: a minute on a quiet core; prints the table
    python -m scripts.validation.physics.free_cut --picture FILE
                                                   the elements of one cut, moved by the blade, as a PNG

Both environments get the same actions: those by which "steer by force" cuts in PathCut-v1.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from cutenv.agents.learning.seeds import TEST_SEEDS
from cutenv.envs.free_cut import FreeCutEnv
from cutenv.envs.path_cut import PathCutEnv
from cutenv.task.registry import TASKS
from scripts.tables import markdown_table

KINDS = ("arc", "s", "excision", "random")
CUTS = 5  # cuts of each kind of line
RATE = 50.0  # decisions a second that are real time [Hz]


class Compared(NamedTuple):
    """Difference of the two environments under the same actions, until the first of both cuts ends."""

    force: float  # root mean square of the difference of the forces [N]
    felt: float  # root mean square of the force in PathCut-v1 [N]
    tip: float  # mean distance of the tips along the line [mm]
    aside: float  # largest distance between the cuts, beside the line [mm]
    returns: tuple[float, float]
    """Return of PathCut-v1 and of FreeCut-v1 under the script, each by its own observations [1]."""
    rate: float  # decisions of FreeCut-v1 a second of processor time [Hz]
    residual: float  # residual of the energy account of FreeCut-v1 [J]


def _scripted(env: PathCutEnv, seed: int) -> tuple[list[Any], float]:
    """Let the script cut; return its actions and the return."""
    policy = TASKS["path"].scripts["steer by force"]()
    policy.reset(np.random.default_rng(0))
    observation, _ = env.reset(seed=seed)
    actions, total, done = [], 0.0, False
    while not done:
        actions.append(policy(observation))
        observation, reward, done, _, _ = env.step(actions[-1])
        total += float(reward)
    return actions, total


def compare(seed: int, kind: str) -> Compared:
    """Cut one line in both environments."""
    path, free = PathCutEnv(line=kind), FreeCutEnv(line=kind)
    actions, returned = _scripted(path, seed)
    began = time.process_time()
    steps, own = _scripted(free, seed)
    rate = len(steps) / (time.process_time() - began)
    path.reset(seed=seed)
    free.reset(seed=seed)
    gaps, felt, tips, residual = [], [], [], 0.0
    for action in actions:
        ended, (_, _, free_ended, _, info) = path.step(action)[2], free.step(action)
        residual = max(residual, abs(info["energy"]["residual"]))
        if ended or free_ended:
            break
        forces = [env.cutting.readings["true_force"].copy() for env in (path, free)]
        gaps.append(forces[1] - forces[0])
        felt.append(forces[0])
        tips.append(abs(free.cutting.tip - path.cutting.tip))
    both = [env.cutting.aside_to_tip for env in (path, free)]
    shared = min(map(len, both))
    return Compared(
        float(np.sqrt(np.mean(np.square(gaps)))), float(np.sqrt(np.mean(np.square(felt)))), 1e3 * float(np.mean(tips)),
        1e3 * float(abs(both[0][:shared] - both[1][:shared]).max()), (returned, own), rate, residual,
    )  # fmt: skip


def table(cuts: int = CUTS) -> str:
    """Return the comparison as Markdown: a row for each kind of line, and the rate."""
    rows, everything = [], []
    for kind in KINDS:
        found = [compare(seed, kind) for seed in TEST_SEEDS[:cuts]]
        everything += found
        rows.append(_row(kind, found))
    rows.append(_row("all", everything))
    heading = ("line", "difference of the force, RMS", "of a force of", "tip, mean", "cut, largest")
    heading += ("return in PathCut-v1", "in FreeCut-v1")
    rates, residuals = ([getattr(each, name) for each in everything] for name in ("rate", "residual"))
    verdict = "faster than" if min(rates) >= RATE else "MISSED:"
    return "\n".join(
        [
            markdown_table(heading, rows),
            "",
            f"{len(everything)} cuts of held-out specimens of class mixed; medians, and the largest in brackets; mean "
            f"return. FreeCut-v1 makes {min(rates):.0f} to {max(rates):.0f} decisions a second of one core, {verdict} "
            f"real time ({RATE:.0f}); largest residual of its energy account {max(residuals):.0e} J.",
        ]
    )


def _row(name: str, found: list[Compared]) -> tuple[str, ...]:
    def shown(values: list[float], unit: str) -> str:
        return f"{np.median(values):.2f} {unit} ({max(values):.2f})"

    before, now = np.mean([each.returns for each in found], axis=0)
    return (
        name, shown([each.force for each in found], "N"), f"{np.median([each.felt for each in found]):.2f} N",
        shown([each.tip for each in found], "mm"), shown([each.aside for each in found], "mm"),
        f"{before:.3f}", f"{now:.3f}",
    )  # fmt: skip


def draw(path: Path) -> None:
    """Draw the elements of one cut along half an excision, moved by the blade."""
    from matplotlib.collections import PolyCollection
    from matplotlib.figure import Figure

    env = FreeCutEnv(line="excision", target_length=0.08)
    policy = TASKS["path"].scripts["steer by force"]()
    policy.reset(np.random.default_rng(0))
    observation, info = env.reset(seed=TEST_SEEDS[0])
    while info["truth"]["tip_m"] < 0.06:
        observation, _, ended, _, info = env.step(policy(observation))
        if ended:
            break
    cutting = env.cutting
    shown = cutting.shown_path
    figure = Figure(figsize=(9.0, 4.6), layout="constrained")
    axes = figure.add_subplot()
    outlines = [1e3 * each for each in cutting.displaced(opening=0.001)]
    axes.add_collection(PolyCollection(outlines, facecolors="0.96", edgecolors="0.7", linewidths=0.6))
    axes.plot(*(1e3 * shown.line.T), "k--", lw=1.2, label="drawn line")
    axes.plot(*(1e3 * shown.cut.T), color="tab:orange", lw=2.0, label="cut, where it was before the blade moved it")
    axes.plot(*(1e3 * np.array(cutting.blade_place)), "o", color="tab:blue", label="blade")
    axes.set(xlabel="along the slab, from the clamp [mm]", ylabel="across [mm]", xlim=(-2, 156), ylim=(-46, 46))
    axes.set_aspect("equal")
    axes.legend(loc="lower right")
    figure.savefig(path, dpi=110)


def main() -> int:
    """Print the table, or draw; return 1 if the rate is missed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cuts", type=int, default=CUTS, metavar="N", help=f"lines of each kind; default {CUTS}")
    parser.add_argument("--picture", type=Path, metavar="FILE", help="draw one cut, and stop")
    arguments = parser.parse_args()
    if arguments.picture is not None:
        draw(arguments.picture)
        return 0
    print(shown := table(arguments.cuts))
    return int("MISSED" in shown)


if __name__ == "__main__":
    sys.exit(main())
