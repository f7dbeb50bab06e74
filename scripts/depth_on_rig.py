"""Scripts of ``cutenv/DepthCut-v1`` on the same specimens in the simulator and on a rig: how closely they agree.

    python scripts/depth_on_rig.py [--rig fake] [--specimens 6]

It prints the table of the section "Along a wanted depth" of docs/rig/run.md.
"""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np

from cutenv.envs.depth_cut import DepthCutEnv
from cutenv.envs.rig_depth_cut import RigDepthCutEnv
from cutenv.policy.depth_scripts import BLADE_DEPTH, DEPTH_SCRIPTS
from cutenv.task.depth_terms import DEPTH_COMPONENTS
from cutenv.task.observation import COMPONENTS

_POSITION = [one.name for one in COMPONENTS].index("position")
_DEPTH = len(COMPONENTS) + BLADE_DEPTH
_MM = 1e3


def cut(env: Any, name: str, *, seed: int, episode: int) -> tuple[float, dict[str, Any], np.ndarray]:
    """Cut once; return return, last info, and position and depth of the blade at each decision [mm], shape (n, 2)."""
    policy = DEPTH_SCRIPTS[name]()
    observation, info = env.reset(seed=seed, options={"episode": episode})
    policy.reset(np.random.default_rng([seed, episode]))
    total, path, ended = 0.0, [], False
    scales = _MM * np.array([COMPONENTS[_POSITION].scale, DEPTH_COMPONENTS[BLADE_DEPTH].scale])
    while not ended:
        observation, reward, ended, _, info = env.step(policy(observation))
        total += reward
        path.append(observation[[_POSITION, _DEPTH]] * scales)
    return total, info, np.array(path)


def compared(rig: RigDepthCutEnv, simulator: DepthCutEnv, name: str, *, seed: int, specimens: int) -> list[list[float]]:
    """Return, for each specimen, the numbers of a row of the table."""
    found = []
    for episode in range(specimens):
        ours, our_info, our_path = cut(rig, name, seed=seed, episode=episode)
        theirs, their_info, their_path = cut(simulator, name, seed=seed, episode=episode)
        n = min(len(our_path), len(their_path))
        apart = np.sqrt(np.mean((our_path[:n] - their_path[:n]) ** 2, axis=0))
        errors = our_info["depth"]["mean_error_mm"], their_info["depth"]["mean_error_mm"]
        same = float(our_info["end"] == their_info["end"] and our_info["is_success"] == their_info["is_success"])
        found.append([same, *apart, abs(ours - theirs), ours, theirs, *errors])
    return found


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rig", default="fake", choices=("fake", "emulator"), help="rig; default fake")
    parser.add_argument("--specimens", type=int, default=6, help="number of specimens; default 6")
    parser.add_argument("--seed", type=int, default=0, help="seed of the specimens; default 0")
    arguments = parser.parse_args()
    rig, simulator = RigDepthCutEnv(rig=arguments.rig), DepthCutEnv(surface_spread=0.0)  # an imitated rig has none
    print(f"{arguments.specimens} specimens, seed {arguments.seed}, rig {arguments.rig}; medians\n")
    print("| Script | same end and success | position apart, rms [mm] | depth apart, rms [mm] | returns apart "
          "| return on the rig | in the simulator | depth error on the rig [mm] | in the simulator [mm] |")  # fmt: skip
    print("|---|--:|--:|--:|--:|--:|--:|--:|--:|")
    try:
        for name in DEPTH_SCRIPTS:
            found = np.array(compared(rig, simulator, name, seed=arguments.seed, specimens=arguments.specimens))
            same = int(found[:, 0].sum())
            numbers = " | ".join(f"{value:.2f}" for value in np.median(found[:, 1:], axis=0))
            print(f"| {name} | {same} of {len(found)} | {numbers} |", flush=True)
    finally:
        rig.close()


if __name__ == "__main__":
    main()
