"""Draw cuts as moving pictures, in assets/pictures.

    python -m scripts.drawings.moving_cut            cut.gif: a cut by the shipped agent
    python -m scripts.drawings.moving_cut excision   excision.gif: the best script and the agent on the same excision

They run at twice the speed of the cut, and are repeated after a pause.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from typing import Any

import gymnasium
import numpy as np
from PIL import Image  # comes with matplotlib

import cutenv  # noqa: F401  registers the environments
from cutenv.agents.learning.evaluation import contestant
from cutenv.task.registry import TASKS
from scripts import ROOT

PICTURES = ROOT / "assets" / "pictures"
CUTS: Mapping[str, tuple[tuple[str, ...], int]] = {
    "cut": (("ppo-free",), 7),
    "excision": (("excision by force", "ppo-excision"), 3_000_031),
}
"""Policies that cut side by side, and the seed of the specimen, by name of the picture."""
EVERY_S = 0.2  # time between two pictures [s], in which GIF can show twice the speed: its unit is 10 ms
PAUSE_MS = 3000
WIDTH = 640
COLOURS = 40


def pictures(name: str, seed: int) -> list[Image.Image]:
    """Return the pictures of a cut by the policy of this name, from its start to its end."""
    chosen = contestant(name)
    arguments: dict[str, Any] = {"control_hz": 10, **chosen.arguments}
    policy: Any = chosen.policy
    task = TASKS[arguments.pop("task", "gentle")]
    env = gymnasium.make(task.id, render_mode="rgb_array", **arguments)
    every = round(EVERY_S * env.metadata["render_fps"])  # decisions
    observation, info = env.reset(seed=seed)
    policy.reset(np.random.default_rng(0))
    drawn, decisions, over, total = [env.render()], 0, False, 0.0
    while not over:
        observation, reward, terminated, truncated, info = env.step(policy(observation))
        decisions, over, total = decisions + 1, terminated or truncated, total + float(reward)
        if over or decisions % every == 0:
            drawn.append(env.render())
    ended = f"{info['end']}, success {info['is_success']}, return {total:.2f}"
    print(f"{name}, seed {seed}: {ended}, {len(drawn)} pictures")
    height = round(WIDTH * drawn[0].shape[0] / drawn[0].shape[1])
    return [Image.fromarray(np.asarray(each)).resize((WIDTH, height), Image.Resampling.LANCZOS) for each in drawn]


def side_by_side(several: Sequence[list[Image.Image]]) -> list[Image.Image]:
    """Return pictures of several cuts beside each other; one that has ended stands still."""
    joined = []
    for k in range(max(map(len, several))):
        row = [np.asarray(each[min(k, len(each) - 1)]) for each in several]
        joined.append(Image.fromarray(np.concatenate(row, axis=1)))
    return joined


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("picture", nargs="?", choices=list(CUTS), default="cut", help="what to draw; default cut")
    name = parser.parse_args().picture
    policies, seed = CUTS[name]
    drawn = side_by_side([pictures(policy, seed) for policy in policies])
    chosen = np.concatenate([np.asarray(drawn[k]) for k in (0, len(drawn) // 2, -1)])
    palette = Image.fromarray(chosen).quantize(COLOURS, kmeans=3)
    frames = [each.quantize(palette=palette, dither=Image.Dither.NONE) for each in drawn]
    times = [round(500 * EVERY_S)] * (len(frames) - 1) + [PAUSE_MS]
    path = PICTURES / f"{name}.gif"
    frames[0].save(path, save_all=True, append_images=frames[1:], duration=times, loop=0, optimize=True)
    print(f"picture: {path} ({path.stat().st_size / 1e3:.0f} kB)")
