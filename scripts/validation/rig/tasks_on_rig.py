"""Scripts of ``cutenv/DepthCut-v1`` or ``PathCut-v1`` on the same specimens in the simulator and on a rig, compared.

    python -m scripts.validation.rig.tasks_on_rig --task depth [--rig fake] [--specimens 6]
    python -m scripts.validation.rig.tasks_on_rig --task path [--rig fake] [--specimens 6]

It prints the tables of the sections "Along a wanted depth" and "Along a curve" of docs/rig/run.md.
"""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np

from cutenv.task.observation import COMPONENTS
from cutenv.task.registry import TASKS, RegisteredTask

_POSITION = [one.name for one in COMPONENTS].index("position")
_MM = 1e3


def across(task: RegisteredTask) -> int:
    """Return the component of the observation that tells where the blade is beside the position: the first length."""
    return next(k for k, one in enumerate(task.task.all_components) if k >= len(COMPONENTS) and one.unit == "m")


def cut(
    env: Any, task: RegisteredTask, name: str, *, seed: int, episode: int
) -> tuple[float, dict[str, Any], np.ndarray]:
    """Cut once; return return, last info, and place of the blade at each decision [mm], shape (n, 2)."""
    policy = task.scripts[name]()
    observation, info = env.reset(seed=seed, options={"episode": episode})
    policy.reset(np.random.default_rng([seed, episode]))
    total, places, ended = 0.0, [], False
    told = [_POSITION, across(task)]
    scales = _MM * np.array([task.task.all_components[k].scale for k in told])
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
    rig: Any, simulator: Any, task: RegisteredTask, name: str, *, seed: int, specimens: int
) -> list[list[float]]:  # fmt: skip
    """Return, for each specimen, the numbers of a row of the table."""
    group, error, found = task.task.shown_as, task.errors[0][0], []
    for episode in range(specimens):
        ours, our_info, our_way = cut(rig, task, name, seed=seed, episode=episode)
        true = [true_error(rig)] if task.line else []
        theirs, their_info, their_way = cut(simulator, task, name, seed=seed, episode=episode)
        n = min(len(our_way), len(their_way))
        apart = np.sqrt(np.mean((our_way[:n] - their_way[:n]) ** 2, axis=0))
        errors = our_info[group][error], *true, their_info[group][error]
        same = float(our_info["end"] == their_info["end"] and our_info["is_success"] == their_info["is_success"])
        found.append([same, *apart, abs(ours - theirs), ours, theirs, *errors])
    return found


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--task", required=True, choices=[name for name, task in TASKS.items() if task.along], help="task"
    )
    parser.add_argument("--rig", default="fake", choices=("fake", "emulator"), help="rig; default fake")
    parser.add_argument("--specimens", type=int, default=6, help="number of specimens; default 6")
    parser.add_argument("--seed", type=int, default=0, help="seed of the specimens; default 0")
    arguments = parser.parse_args()
    task = TASKS[arguments.task]
    rig = task.rig(rig=arguments.rig)
    simulator = rig.simulated(**rig.as_simulated)
    print(f"{arguments.specimens} specimens, seed {arguments.seed}, rig {arguments.rig}; medians\n")
    true, error = " | in truth [mm]" if task.line else "", f"{task.errors[0][1]} on the rig [mm]"
    print(f"| Script | same end and success | position apart, rms [mm] "
          f"| {task.task.all_components[across(task)].name} apart, rms [mm] | returns apart | return on the rig "
          f"| in the simulator | {error}{true} | in the simulator [mm] |")  # fmt: skip
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
