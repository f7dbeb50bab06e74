"""Scripts of ``cutenv/DepthCut-v1`` or ``PathCut-v1`` on the same specimens in the simulator and on a rig, compared.

    python scripts/tasks_on_rig.py --task depth [--rig fake] [--specimens 6]
    python scripts/tasks_on_rig.py --task path [--rig fake] [--specimens 6]

It prints the tables of the sections "Along a wanted depth" and "Along a curve" of docs/rig/run.md.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np

from cutenv.envs.depth_cut import DepthCutEnv
from cutenv.envs.path_cut import PathCutEnv
from cutenv.envs.rig_depth_cut import RigDepthCutEnv
from cutenv.envs.rig_path_cut import RigPathCutEnv
from cutenv.policy import Policy
from cutenv.policy.depth_scripts import BLADE_DEPTH, DEPTH_SCRIPTS
from cutenv.policy.path_scripts import PATH_SCRIPTS
from cutenv.task.depth import DEPTH_CUT
from cutenv.task.observation import COMPONENTS
from cutenv.task.path import PATH_CUT

_POSITION = [one.name for one in COMPONENTS].index("position")
_ASIDE = [one.name for one in PATH_CUT.all_components].index("aside")
_MM = 1e3


class Compared(NamedTuple):
    """A task on a rig and in the simulator."""

    rig: Callable[..., Any]
    simulator: Callable[..., Any]
    scripts: Mapping[str, Callable[[], Policy]]
    components: tuple[Any, ...]
    across: int
    """Component of the observation that tells where the blade is beside the position."""
    apart: str
    """Its name in the table."""
    group: str
    """Entry of the info that has the mean error, and its name there and in the table."""
    error: str
    named: str


TASKS = {
    "depth": Compared(
        RigDepthCutEnv, lambda: DepthCutEnv(surface_spread=0.0),  # a rig has no spread
        DEPTH_SCRIPTS, DEPTH_CUT.all_components,
        len(COMPONENTS) + BLADE_DEPTH, "depth", "depth", "mean_error_mm", "depth error",
    ),
    "path": Compared(
        RigPathCutEnv, PathCutEnv, PATH_SCRIPTS, PATH_CUT.all_components, _ASIDE, "distance to the line", "path",
        "mean_distance_mm", "cut off the line",
    ),
}  # fmt: skip


def cut(env: Any, task: Compared, name: str, *, seed: int, episode: int) -> tuple[float, dict[str, Any], np.ndarray]:
    """Cut once; return return, last info, and place of the blade at each decision [mm], shape (n, 2)."""
    policy = task.scripts[name]()
    observation, info = env.reset(seed=seed, options={"episode": episode})
    policy.reset(np.random.default_rng([seed, episode]))
    total, places, ended = 0.0, [], False
    told = [_POSITION, task.across]
    scales = _MM * np.array([task.components[k].scale for k in told])
    while not ended:
        observation, reward, ended, _, info = env.step(policy(observation))
        total += reward
        places.append(observation[told] * scales)
    return total, info, np.array(places)


def true_error(env: Any) -> float:
    """Return the distance of the true cut to the line on a fake rig, mean along the cut [mm]; NaN for another."""
    try:
        tissue = env.the_fake().bench.tissue
    except (AttributeError, ValueError):
        return float("nan")
    return float(_MM * np.mean(np.abs(tissue.plant.cut_distance)))


def compared(
    rig: Any, simulator: Any, task: Compared, name: str, *, seed: int, specimens: int
) -> list[list[float]]:  # fmt: skip
    """Return, for each specimen, the numbers of a row of the table."""
    found = []
    for episode in range(specimens):
        ours, our_info, our_way = cut(rig, task, name, seed=seed, episode=episode)
        true = [true_error(rig)] if task.group == "path" else []
        theirs, their_info, their_way = cut(simulator, task, name, seed=seed, episode=episode)
        n = min(len(our_way), len(their_way))
        apart = np.sqrt(np.mean((our_way[:n] - their_way[:n]) ** 2, axis=0))
        errors = our_info[task.group][task.error], *true, their_info[task.group][task.error]
        same = float(our_info["end"] == their_info["end"] and our_info["is_success"] == their_info["is_success"])
        found.append([same, *apart, abs(ours - theirs), ours, theirs, *errors])
    return found


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--task", required=True, choices=tuple(TASKS), help="task")
    parser.add_argument("--rig", default="fake", choices=("fake", "emulator"), help="rig; default fake")
    parser.add_argument("--specimens", type=int, default=6, help="number of specimens; default 6")
    parser.add_argument("--seed", type=int, default=0, help="seed of the specimens; default 0")
    arguments = parser.parse_args()
    task = TASKS[arguments.task]
    rig, simulator = task.rig(rig=arguments.rig), task.simulator()
    print(f"{arguments.specimens} specimens, seed {arguments.seed}, rig {arguments.rig}; medians\n")
    true, error = " | in truth [mm]" if arguments.task == "path" else "", f"{task.named} on the rig [mm]"
    print(f"| Script | same end and success | position apart, rms [mm] | {task.apart} apart, rms [mm] | returns apart "
          f"| return on the rig | in the simulator | {error}{true} | in the simulator [mm] |")  # fmt: skip
    print("|---|--:|--:|--:|--:|--:|--:|--:|--:|" + ("--:|" if true else ""))
    off: list[float] = []
    try:
        for name in task.scripts:
            found = np.array(compared(rig, simulator, task, name, seed=arguments.seed, specimens=arguments.specimens))
            same = int(found[:, 0].sum())
            numbers = " | ".join(f"{value:.2f}" for value in np.median(found[:, 1:], axis=0))
            print(f"| {name} | {same} of {len(found)} | {numbers} |", flush=True)
            if true:
                off += np.abs(found[:, -3] - found[:, -2]).tolist()
    finally:
        rig.close()
    if off:
        median, most = np.median(off), max(off)
        print(
            f"\nThe rig's distance to the line is off the truth by {median:.2f} mm in the median, {most:.2f} at most."
        )


if __name__ == "__main__":
    main()
